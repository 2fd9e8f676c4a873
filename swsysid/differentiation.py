r"""From measured trajectories to (X, Xdot): smoothing and differentiation, group by group.

Differentiation amplifies noise, so every method here is a linear smoother followed by an exact
derivative, and the only choice that matters is how strongly to smooth. Two facts decide it.

*Parallel filtering.* If :math:`\dot x = C\,\phi(x) + B u` with linear terms, it still holds after
the same linear filter is applied to :math:`\dot x`, :math:`x` and :math:`u`; filtering only the
left side delays or attenuates it against the right. Inputs therefore pass through the filter of
the states.

*Automatic strength.* A smoother with derivative kernel :math:`d_w` has variance
:math:`\sigma^2\|d_w\|^2`, known once the noise :math:`\sigma` is; its bias is estimated by how far
it departs from every weaker smoother beyond what noise explains (Goldenshluger and Lepski, Annals
of Statistics 39, 2011). The strength with the smallest sum is taken, and at least the one that
decimation needs against aliasing.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import comb

from swsysid._smoothing import Array, Smoother, TooShortError, external, local_polynomial, low_pass

__all__ = ["Derivatives", "differentiate", "estimate_noise"]

LARGEST_GAP = 20.0  # a longer gap, in median steps, is not one trajectory any more
NOISE_ORDER = 6  # differences of this order leave noise and hardly any of a smooth signal
WINDOWS = (7, 9, 11, 15, 21, 29, 41, 57, 81, 115, 163)
CUTOFFS = (0.4, 0.28, 0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025, 0.0175, 0.0125)  # of the rate


class Derivatives(NamedTuple):
    """States and their time derivatives, ends trimmed.

    Attributes
    ----------
    X : ndarray of shape (n_kept, n_states + n_inputs)
        Smoothed states, then the inputs, filtered alike. With ``order=2`` the states are the
        positions followed by the velocities.
    Xdot : ndarray of shape (n_kept, n_states)
    t : ndarray of shape (n_kept,)
    groups : ndarray of shape (n_kept,)
    noise : ndarray of shape (n_columns,)
        Standard deviation of the noise in each measured column, in its unit.
    """

    X: Array
    Xdot: Array
    t: Array
    groups: NDArray
    noise: Array


def differentiate(
    x: ArrayLike,
    t: ArrayLike,
    groups: ArrayLike | None = None,
    method: str | object = "savitzky_golay",
    *,
    inputs: ArrayLike | None = None,
    order: int = 1,
    window: int | None = None,
    degree: int = 4,
    cutoff: float | None = None,
    decimate: int = 1,
    filter_inputs: bool = True,
) -> Derivatives:
    r"""Smooth and differentiate measured trajectories.

    Parameters
    ----------
    x : array-like of shape (n_samples, n_columns) or (n_samples,)
        Measured states, or positions with ``order=2``.
    t : array-like of shape (n_samples,)
        Times, increasing within each trajectory; sampling may be uneven.
    groups : array-like of shape (n_samples,), default=None
        The trajectory each row belongs to; None means one trajectory.
    method : {"savitzky_golay", "butterworth", "finite_difference"} or object
        ``"savitzky_golay"`` fits a polynomial to a window of samples around each time, on the
        actual times. ``"butterworth"`` is a fourth-order low-pass run forward and backward
        (no phase), then central differences: the standard of robot identification; it needs
        even sampling. ``"finite_difference"`` does not smooth. An object is a PySINDy
        differentiator, called as ``method(x, t)``; it does not filter the inputs.
    inputs : array-like of shape (n_samples, n_inputs), default=None
        Appended to X after the same filter, because filtering one side of an equation only
        biases it.
    order : {1, 2}, default=1
        2 means `x` holds positions: X = (positions, velocities), Xdot = (velocities,
        accelerations).
    window : int, default=None
        Samples in the window of ``"savitzky_golay"``, odd. None chooses it from the noise.
    degree : int, default=4
        Degree of the fitted polynomials.
    cutoff : float, default=None
        Cut-off frequency of ``"butterworth"``, in Hz if `t` is in s. None chooses it from the
        noise.
    decimate : int, default=1
        Keep every `decimate`-th row after filtering: neighbouring rows of an oversampled,
        filtered record repeat each other.
    filter_inputs : bool, default=True
        False keeps the inputs as measured (on/off signals, polynomial libraries of inputs).

    Returns
    -------
    Derivatives
        Unpacks as ``X, Xdot, t, groups, noise``.

    Raises
    ------
    ValueError
        If values are missing, times do not increase, or a trajectory is too short.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.differentiation import differentiate
    >>> t = np.linspace(0.0, 5.0, 501)
    >>> X, Xdot, t_kept, groups, noise = differentiate(np.sin(t), t)
    >>> bool(abs(Xdot[:, 0] - np.cos(t_kept)).max() < 1e-6)
    True
    """
    states, times, labels, signals = _checked(x, t, groups, inputs)
    _check_options(order, window, degree, cutoff, decimate)
    rows = dict(_trajectories(labels))
    noise = estimate_noise(states, labels)
    parts = [(states[index], times[index]) for index in rows.values()]
    family = _family(method, parts, window, degree, cutoff, decimate)
    smoother = _strongest(family, parts, noise, order)
    # An object of PySINDy's is not a filter that could be applied to the inputs too.
    filter_inputs = filter_inputs and isinstance(method, str) and signals.shape[1] > 0
    pieces = []
    for label, index in rows.items():
        jets, trim = _run(smoother, states[index], times[index], label)
        kept = index[trim : len(index) - trim]
        extra = _run(smoother, signals[index], times[index], label)[0][0] if filter_inputs else None
        extra = signals[kept] if extra is None else extra
        piece = (_side_by_side([*jets[:order], extra]), _side_by_side(jets[1 : order + 1]))
        pieces.append([part[::decimate] for part in (*piece, times[kept], labels[kept])])
    X, Xdot, t, groups = (np.concatenate(column) for column in zip(*pieces, strict=True))
    return Derivatives(X, Xdot, t, groups, noise)


def _side_by_side(blocks) -> Array:
    return np.concatenate(list(blocks), axis=1)


def estimate_noise(x: ArrayLike, groups: ArrayLike | None = None) -> Array:
    r"""Standard deviation of white noise in each column, from sixth differences.

    Differences of order six annihilate polynomials of degree five and turn noise of variance
    :math:`\sigma^2` into :math:`\binom{12}{6}\sigma^2`. The median makes the estimate blind to
    the few samples at which a switching system has a kink.

    Parameters
    ----------
    x : array-like of shape (n_samples, n_columns)
    groups : array-like of shape (n_samples,), default=None

    Returns
    -------
    ndarray of shape (n_columns,)
    """
    columns = np.atleast_2d(np.asarray(x, dtype=float).T).T
    labels = np.zeros(len(columns)) if groups is None else np.asarray(groups)
    differences = np.vstack(
        [np.diff(columns[index], NOISE_ORDER, axis=0) for _, index in _trajectories(labels)]
    )
    if not len(differences):
        return np.zeros(columns.shape[1])
    gain = np.sqrt(comb(2 * NOISE_ORDER, NOISE_ORDER))
    median = np.median(np.abs(differences), axis=0) / 0.6745  # quartile of the normal law
    # Coarsely quantised signals mostly repeat themselves: their median is zero, their mean not.
    mean = np.sqrt(np.mean(differences**2, axis=0))
    return np.where(median > 0, median, mean) / gain


def _family(method, parts, window, degree, cutoff, decimate) -> list[Smoother]:
    """The smoothers to choose from, weak to strong; one where the user chose."""
    shortest = min(len(times) for _, times in parts)
    if callable(method):
        return [external(method)]
    if method == "finite_difference":
        # The parabola through three neighbours: central differences, correct on uneven times.
        return [local_polynomial(3, 2)]
    if method == "savitzky_golay":
        longest = max(shortest // 4, WINDOWS[0])
        windows = [w for w in WINDOWS if 2 * decimate < w <= longest and w > degree + 1]
        chosen = window or (windows or [2 * (decimate + degree // 2) + 1])
        return [local_polynomial(w, degree) for w in np.atleast_1d(chosen)]
    if method == "butterworth":
        steps = np.diff(max((times for _, times in parts), key=len))
        rate = 1.0 / np.median(steps) if len(steps) else 1.0
        # The two ends trimmed may cost at most half of the shortest trajectory.
        least = 8.0 / shortest
        cutoffs = [c * rate for c in CUTOFFS if least <= c <= 0.5 / decimate]
        chosen = cutoff or (cutoffs or [0.4 * rate / decimate])
        return [low_pass(c) for c in np.atleast_1d(chosen)]
    raise ValueError(
        f"method={method!r} is unknown; choose savitzky_golay, butterworth, finite_difference "
        "or pass a PySINDy differentiator."
    )


# --- automatic strength ---------------------------------------------------------------------


def _strongest(smoothers, parts, noise, order) -> Smoother:
    """The smoother, from weak to strong, with the least estimated error of the derivative."""
    if len(smoothers) < 2:
        return smoothers[0]
    length = max(len(times) for _, times in parts)
    x, t = next(part for part in parts if len(part[1]) == length)
    estimates, kernels = [], []
    for smoother in smoothers:
        try:
            estimates.append(_padded(smoother, x, t, order))
        except TooShortError:
            break  # stronger ones do not fit into the record
        impulse = np.zeros((length, 1))
        impulse[length // 2] = 1.0
        even = np.linspace(t[0], t[-1], length)
        kernels.append(np.nan_to_num(_padded(smoother, impulse, even, order))[:, 0])
    if not estimates:
        return smoothers[0]
    size = np.nanmean(estimates[-1] ** 2, axis=0)
    weight = 1.0 / np.where(size > 0, size, 1.0)  # columns count in units of their own size
    risks = [weight @ _risk(k, estimates, kernels, noise) for k in range(len(estimates))]
    return smoothers[int(np.argmin(risks))]


def _padded(smoother, x, t, order) -> Array:
    """Derivative of order `order`, NaN where trimmed."""
    jets, trim = smoother(x, t)
    padded = np.full(x.shape, np.nan)
    padded[trim : trim + jets.shape[1]] = jets[order]
    return padded


def _risk(k, estimates, kernels, noise) -> Array:
    """Squared bias plus variance of the k-th estimate, for each column."""
    variance = noise**2 * np.sum(kernels[k] ** 2)
    bias = np.zeros_like(noise)
    for estimate, kernel in zip(estimates[:k], kernels[:k], strict=True):
        departure = np.nanmean((estimates[k] - estimate) ** 2, axis=0)
        explained = noise**2 * np.sum((kernels[k] - kernel) ** 2)
        bias = np.maximum(bias, departure - explained)
    return bias + variance


# --- checks ---------------------------------------------------------------------------------


def _run(smoother, x, t, label) -> tuple[Array, int]:
    try:
        return smoother(x, t)
    except TooShortError as error:
        raise ValueError(f"Trajectory {label!r} {error}") from None


def _trajectories(labels) -> Iterator[tuple[object, NDArray[np.intp]]]:
    """Label and row numbers of each trajectory, in order of appearance."""
    names, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    for k in np.argsort(first):
        yield names.tolist()[k], np.flatnonzero(inverse == k)


def _checked(x, t, groups, inputs):
    states = _columns(x, "x")
    times = _columns(t, "t")[:, 0]
    signals = np.empty((len(states), 0)) if inputs is None else _columns(inputs, "inputs")
    labels = np.zeros(len(states), dtype=int) if groups is None else np.asarray(groups).ravel()
    for name, array in (("t", times), ("inputs", signals), ("groups", labels)):
        if len(array) != len(states):
            raise ValueError(f"{name} has {len(array)} rows and x has {len(states)}.")
    for label, index in _trajectories(labels):
        _check_times(times[index], label)
    return states, times, labels, signals


def _columns(values, name) -> Array:
    columns = np.asarray(values, dtype=float)
    columns = columns[:, None] if columns.ndim == 1 else columns
    if columns.ndim != 2 or not columns.size:
        raise ValueError(f"{name} must hold one row for each sample; its shape is {columns.shape}.")
    bad = ~np.isfinite(columns).all(axis=1)
    if bad.any():
        raise ValueError(
            f"{name} has missing or infinite values in {bad.sum()} rows, first in row "
            f"{bad.argmax()}; remove these rows or fill them before differentiating."
        )
    return columns


def _check_options(order, window, degree, cutoff, decimate) -> None:
    if order not in (1, 2):
        raise ValueError(f"order={order!r} must be 1 or 2.")
    if window is not None and (window % 2 == 0 or window <= degree):
        raise ValueError(f"window={window!r} must be odd and larger than degree={degree!r}.")
    if degree < 2:
        raise ValueError(f"degree={degree!r} must be at least 2.")
    if cutoff is not None and not cutoff > 0:
        raise ValueError(f"cutoff={cutoff!r} must be positive.")
    if decimate < 1:
        raise ValueError(f"decimate={decimate!r} must be at least 1.")


def _check_times(t, label) -> None:
    steps = np.diff(t)
    if len(steps) and steps.min() <= 0:
        kind = "repeats a time" if steps.min() == 0 else "goes back in time"
        row = int(np.argmin(steps)) + 1
        raise ValueError(
            f"Trajectory {label!r} {kind} at its sample {row}; sort the rows by time, remove "
            "repeated ones, and name separate trajectories by groups."
        )
    if len(steps) > 2 and steps.max() > LARGEST_GAP * np.median(steps):
        raise ValueError(
            f"Trajectory {label!r} has a gap of {steps.max():g} where samples are usually "
            f"{np.median(steps):g} apart; give the parts before and after it different groups."
        )
