r"""Weighted integrals instead of derivatives, for sensors too slow or too coarse to differentiate.

If the law :math:`\dot x = C \Phi(x)` is multiplied by a test function :math:`\psi` that vanishes at
both ends of a window, and is integrated by parts, it becomes

.. math:: -\int \dot\psi \, x \, dt = C \int \psi \, \Phi(x) \, dt ,

in which nothing is differentiated but :math:`\psi`, which is known. Both integrals are sums over
the samples of the window. On even times the sums are nearly exact even for a few samples a
period, because a bump that vanishes smoothly at both ends leaves no error of its own: with nine
samples in a window and eight in a period a rate comes out right to 1e-4, where central
differences are 10 % off.

A window in which the mode changes mixes the laws of both modes. As long as nothing is known about
the modes, such rows are outliers, which the loss of `SwitchingSystemRegressor` can bear. Once a
model knows the modes, no window is lost: with the mode :math:`q(t)` given at every sample,

.. math:: -\int \dot\psi \, x \, dt = \sum_j C_j \int_{q(t) = j} \psi \, \Phi(x) \, dt

is linear in the laws of all modes together. `weak_refit` solves this by least squares.
"""

from __future__ import annotations

import copy
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from sklearn.base import BaseEstimator

from swsysid._checks.parameters import whole
from swsysid._data.features import FeatureMap
from swsysid._data.trajectories import trajectories
from swsysid._results import Array
from swsysid._simulation.model import FittedModel, fitted_system
from swsysid._surfaces.surface import Surface, decisions_of
from swsysid.differentiation import estimate_noise
from swsysid.differentiation._record import measured_rows

# Power of the bump (1 - s^2)^6: the least error of the sums over windows of 9 to 25 samples.
_POWER = 6
# Windows to choose from, each about 1.3 times the one before it.
_WINDOWS = (9, 11, 13, 17, 21, 27, 35, 45, 59, 77, 101)
# Share of noise in the targets that is small enough to ask for no longer window.
_NOISE_SHARE = 0.1

Model = TypeVar("Model", bound=FittedModel)

__all__ = ["WeakForm", "weak_form", "weak_refit"]


class WeakForm(NamedTuple):
    """Rows of a regression, one for each window.

    Attributes
    ----------
    features : ndarray of shape (n_windows, n_features)
        Averages of the features, weighted by the test function.
    targets : ndarray of shape (n_windows, n_states)
        Averages of the velocities with the same weights.
    t : ndarray of shape (n_windows,)
        Centres of the windows.
    groups : ndarray of shape (n_windows,)
    window : int
        Samples in a window.
    """

    features: Array
    targets: Array
    t: Array
    groups: NDArray
    window: int


def weak_form(
    x: ArrayLike,
    t: ArrayLike,
    groups: ArrayLike | None = None,
    *,
    inputs: ArrayLike | None = None,
    feature_library: BaseEstimator | int | None = None,
    window: int | None = None,
) -> WeakForm:
    """Turn measured trajectories into rows that need no derivatives.

    Parameters
    ----------
    x : array-like of shape (n_samples, n_states)
        Measured states.
    t : array-like of shape (n_samples,)
        Times, increasing within each trajectory; even ones leave the smallest errors.
    groups : array-like of shape (n_samples,), default=None
        The trajectory each row belongs to; None means one trajectory.
    inputs : array-like of shape (n_samples, n_inputs), default=None
    feature_library : None, int, transformer or PySINDy library, default=None
        As in `SwitchingSystemRegressor`; None means the columns themselves.
    window : int, default=None
        Number of samples in a window, odd and at least 5, and shorter than a stay in a mode.
        None starts from 9 and takes the first at which noise is a small part of the targets.

    Returns
    -------
    WeakForm
        ``features`` and ``targets`` are X and Xdot of
        ``SwitchingSystemRegressor(feature_library=None)``, whose coefficients are then those
        of the features.

    Examples
    --------
    Eight samples a period of an oscillator, and its frequency to four digits:

    >>> import numpy as np
    >>> from swsysid.weak_form import weak_form
    >>> t = np.arange(40) * 2 * np.pi / 8
    >>> rows = weak_form(np.column_stack([np.cos(t), -np.sin(t)]), t)
    >>> coef = np.linalg.lstsq(rows.features, rows.targets, rcond=None)[0]
    >>> (coef.T.round(3) + 0.0).tolist()
    [[0.0, 1.0], [-1.0, 0.0]]
    """
    states, times, labels, signals = measured_rows(x, t, groups, inputs)
    X = np.hstack([states, signals])
    names = [f"x{k}" for k in range(X.shape[1])]
    features = FeatureMap(feature_library, X, names)(X)
    chosen = _chosen_window(window, states, times, labels)
    pieces = []
    for label, rows in trajectories(labels):
        values, slopes, centres = _bumps(times[rows], chosen)
        kept = np.full(len(centres), label, dtype=labels.dtype)
        pieces.append((values @ features[rows], slopes @ states[rows], centres, kept))
    averages, velocities, centres, kept = (np.concatenate(c) for c in zip(*pieces, strict=True))
    return WeakForm(averages, velocities, centres, kept, chosen)


def weak_refit(
    model: Model,
    x: ArrayLike,
    t: ArrayLike,
    groups: ArrayLike | None = None,
    *,
    inputs: ArrayLike | None = None,
    window: int | None = None,
) -> Model:
    """Refit the laws of all modes of a model on weighted integrals, switches included.

    The modes of the samples are the model's; between two samples of different modes the switch
    is put where the decisions of the two are equal. Coefficients that are zero stay zero.

    Parameters
    ----------
    model : SwitchingSystemRegressor or StatedModel
    x, t, groups, inputs, window
        As in `weak_form`.

    Returns
    -------
    like the model given
        A copy with other coefficients. Its surface is the same; `refine` moves that too.
    """
    system = fitted_system(model)
    if system.discrete_time:
        raise ValueError("the model gives next states, not velocities; it needs no weak form.")
    states, times, labels, signals = measured_rows(x, t, groups, inputs)
    X = np.hstack([states, signals])
    n_modes, n_states, _ = system.coef.shape
    if X.shape[1] != len(system.feature_map.names_in) or states.shape[1] != n_states:
        raise ValueError(
            f"x and inputs have {states.shape[1]} and {X.shape[1] - states.shape[1]} columns; the "
            f"model needs {n_states} states and {system.n_inputs} inputs."
        )
    chosen = _chosen_window(window, states, times, labels)
    features, design, targets = system.feature_map(X), [], []
    for _, rows in trajectories(labels):
        values, slopes, _ = _bumps(times[rows], chosen)
        shares = _mode_shares(system.surface, X[rows], times[rows], n_modes)
        blocks = [values @ (share[:, None] * features[rows]) for share in shares]
        design.append(np.concatenate(blocks, axis=1))
        targets.append(slopes @ states[rows])
    refitted = copy.deepcopy(model)
    refitted.coef_ = _least_squares(np.vstack(design), np.vstack(targets), system.coef)
    return refitted


def _least_squares(design: Array, targets: Array, start: Array) -> Array:
    """Coefficients of all modes at once, state by state, over the terms that are there."""
    n_modes, n_states, n_features = start.shape
    terms = start.transpose(1, 0, 2).reshape(n_states, -1)
    found = np.zeros_like(terms)
    for state, present in enumerate(terms != 0.0):
        columns = design[:, present]
        size = np.sqrt(np.mean(columns**2, axis=0))
        size = np.where(size > 0.0, size, 1.0)
        solution = np.linalg.lstsq(columns / size, targets[:, state], rcond=None)[0]
        found[state, present] = solution / size
    return found.reshape(n_states, n_modes, n_features).transpose(1, 0, 2)


def _bumps(times: Array, window: int) -> tuple[sparse.csr_array, sparse.csr_array, Array]:
    """Quadrature weights of the averages and of the mean velocities, and centres of the windows.

    Of the sparse arrays (n_windows, n_samples) the first averages a function with the weights
    psi, the second gives its average velocity.
    """
    half = 0.5 * np.diff(times)
    share = np.append(half, 0.0) + np.append(0.0, half)  # the trapezoidal rule
    inside, share = sliding_window_view(times, window), sliding_window_view(share, window)
    centres = 0.5 * (inside[:, 0] + inside[:, -1])
    reach = 0.5 * (inside[:, -1:] - inside[:, :1])
    s = (inside - centres[:, None]) / reach
    bump = np.maximum(1.0 - s**2, 0.0)
    psi = share * bump**_POWER
    slope = share * s * bump ** (_POWER - 1)
    # exact for constants and straight lines, whatever the times
    total = psi.sum(axis=1, keepdims=True)
    slope -= psi * slope.sum(axis=1, keepdims=True) / total
    slope /= (slope * (inside - centres[:, None])).sum(axis=1, keepdims=True)
    columns = np.arange(len(centres))[:, None] + np.arange(window)
    ends = window * np.arange(len(centres) + 1)

    def matrix(weights):
        shape = (len(centres), len(times))
        return sparse.csr_array((weights.ravel(), columns.ravel(), ends), shape=shape)

    return matrix(psi / total), matrix(slope), centres


def _mode_shares(surface: Surface, X: Array, times: Array, n_modes: int) -> Array:
    """Part of the quadrature weight of each sample that falls to each mode, (n_modes, n_samples).

    Of a cell between two samples, the linear interpolant from 1 to 0 has the part a - a^2 / 2
    before the fraction a, where the mode changes, and (1 - a)^2 / 2 after it; together a half.
    It changes where the decisions of the two modes are equal.
    """
    modes, fraction = np.asarray(surface.predict(X)), np.ones(len(X) - 1)
    changes = np.flatnonzero(modes[1:] != modes[:-1])
    decided = decisions_of(surface, X) if len(changes) else None
    fraction[changes] = 0.5
    if decided is not None:
        column = np.searchsorted(surface.classes_, modes)
        old, new = column[changes], column[changes + 1]
        before = decided[changes, old] - decided[changes, new]
        total = before + decided[changes + 1, new] - decided[changes + 1, old]
        share = before / np.where(total > 0.0, total, 1.0)
        fraction[changes] = np.where(total > 0.0, share, 0.5)
    step, cells = np.diff(times), np.arange(len(X) - 1)
    masses = np.zeros((n_modes, len(X)))
    left, right = modes[:-1], modes[1:]
    np.add.at(masses, (left, cells), step * (fraction - 0.5 * fraction**2))
    np.add.at(masses, (right, cells), step * 0.5 * (1.0 - fraction) ** 2)
    np.add.at(masses, (left, cells + 1), step * 0.5 * fraction**2)
    np.add.at(masses, (right, cells + 1), step * 0.5 * (1.0 - fraction**2))
    return masses / masses.sum(axis=0)


def _chosen_window(window: int | None, states: Array, times: Array, labels: NDArray) -> int:
    """The window that was asked for, or the best one, if it fits into every trajectory."""
    parts = trajectories(labels)
    whole("window", window, least=5, also=(None,))
    chosen = window or _automatic_window(states, times, labels, [rows for _, rows in parts])
    if chosen % 2 == 0:
        raise ValueError(f"window={chosen!r} must be odd and at least 5.")
    for label, rows in parts:
        if len(rows) < chosen:
            raise ValueError(
                f"Trajectory {label} has {len(rows)} samples and the window {chosen}; use a "
                "smaller window, or leave it out."
            )
    return chosen


def _automatic_window(states: Array, times: Array, labels: NDArray, parts: list[NDArray]) -> int:
    """The shortest window in whose targets noise is small, or that in which it is smallest."""
    shortest, least = min(map(len, parts)), _WINDOWS[0]
    windows = [w for w in _WINDOWS if w <= max(shortest // 3, least)]
    noise, shares = estimate_noise(states, labels), []
    quiet = noise <= 0.0  # without noise there is none in the targets, however small they are
    for window in windows:
        spread, gain = np.zeros(states.shape[1]), 0.0
        for rows in parts:
            if len(rows) >= window:
                slopes = _bumps(times[rows], window)[1]
                spread = np.maximum(spread, np.std(slopes @ states[rows], axis=0))
                gain = max(gain, float(np.linalg.norm(slopes.data[:window])))
        shares.append(float(np.max(np.where(quiet, 0.0, noise * gain / (spread + quiet)))))
        if shares[-1] <= _NOISE_SHARE:
            return window
    return windows[int(np.argmin(shares))]
