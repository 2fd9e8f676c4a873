r"""From measured trajectories to (X, Xdot): smoothing and differentiation, group by group.

Differentiation amplifies noise, so every method here is a linear smoother followed by an exact
derivative, and the only choice that matters is how strongly to smooth. Two facts decide it.

*Parallel filtering.* If :math:`\dot x = C\,\phi(x) + B u` with linear terms, it still holds after
the same linear filter is applied to :math:`\dot x`, :math:`x` and :math:`u`; filtering only the
left side delays or attenuates it against the right. Inputs therefore pass through the filter of
the states.

*Automatic strength.* The strength with the least estimated sum of bias and variance over all
trajectories is taken (Goldenshluger and Lepski, Annals of Statistics 39, 2011), and at least the
one that decimation needs against aliasing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import comb

from swsysid._checks.arrays import column, names_of, refuse_vanishing, table
from swsysid._checks.parameters import flag, one_of, real, whole
from swsysid._data.trajectories import group_labels, trajectories
from swsysid._noise import robust_scale
from swsysid.differentiation._derivatives import Derivatives, rates_appended
from swsysid.differentiation._settings import SETTINGS
from swsysid.differentiation._smoothing import Array, TooShortError
from swsysid.differentiation._strength import Strength, strengths, strongest


class Smoothing(NamedTuple):
    """How a record is smoothed.

    Attributes
    ----------
    method : str or object
    window : int or None
        Samples of the window, with ``"savitzky_golay"``.
    cutoff : float or None
        Cut-off frequency, with ``"butterworth"``.
    noise : ndarray of shape (n_columns,)
        Standard deviation of the noise in each measured column, in its unit.
    """

    method: str | object
    window: int | None
    cutoff: float | None
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
    too_short: str = "raise",
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
    too_short : {"raise", "drop"}, default="raise"
        What becomes of a trajectory with fewer samples than the filter needs. Where it may be
        dropped, one short trajectory does not keep the filter of all others weak.

    Returns
    -------
    Derivatives
        Unpacks as ``X, Xdot, t, groups, noise``; columns keep the names that a data frame gives
        them.

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
    states, times, labels, signals = measured_rows(x, t, groups, inputs)
    flag("filter_inputs", filter_inputs)
    options = (window, degree, cutoff, decimate, too_short)
    smoother = _strength(states, times, labels, method, order, *options).smoother
    own = names_of(x, states.shape[1], "x")
    names = rates_appended(own, names_of(inputs, signals.shape[1], "u"), order)
    # An object of PySINDy's is not a filter that could be applied to the inputs too.
    filter_inputs = filter_inputs and isinstance(method, str) and signals.shape[1] > 0
    pieces, rows = [], trajectories(labels)
    for label, index in rows:
        try:
            jets, trim = smoother(states[index], times[index], None)
        except TooShortError as error:
            if too_short == "drop":
                continue
            raise ValueError(f"Trajectory {label!r} {error}") from None
        kept = index[trim : len(index) - trim]
        extra = signals[kept]
        if filter_inputs:
            extra = smoother(signals[index], times[index], None)[0][0]
        X, Xdot = np.hstack([*jets[:order], extra]), np.hstack([*jets[1 : order + 1]])
        pieces.append([part[::decimate] for part in (X, Xdot, times[kept], labels[kept])])
    if not pieces:
        longest = max(len(index) for _, index in rows)
        raise ValueError(
            f"No trajectory is long enough to be differentiated: the longest of {len(rows)} has "
            f"{longest} samples; use a smaller window or record longer ones."
        )
    X, Xdot, t, groups = (np.concatenate(part) for part in zip(*pieces, strict=True))
    return Derivatives(X, Xdot, t, groups, estimate_noise(states, labels), names)


def choose_smoothing(
    x: ArrayLike,
    t: ArrayLike,
    groups: ArrayLike | None = None,
    method: str | object = "savitzky_golay",
    *,
    order: int = 1,
    window: int | None = None,
    degree: int = 4,
    cutoff: float | None = None,
    decimate: int = 1,
    too_short: str = "raise",
) -> Smoothing:
    """The smoothing that `differentiate` would choose, from all trajectories.

    Parameters
    ----------
    x, t, groups, method, order, window, degree, cutoff, decimate, too_short
        Of `differentiate`.

    Returns
    -------
    Smoothing

    Raises
    ------
    ValueError
        If values are missing, times do not increase, or an option is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.differentiation import choose_smoothing
    >>> t = np.linspace(0.0, 5.0, 501)
    >>> noise = 0.01 * np.random.default_rng(0).standard_normal(501)
    >>> choose_smoothing(np.sin(t) + noise, t).window
    115
    """
    states, times, labels, _ = measured_rows(x, t, groups, None)
    options = (window, degree, cutoff, decimate, too_short)
    chosen = _strength(states, times, labels, method, order, *options)
    return Smoothing(method, chosen.window, chosen.cutoff, estimate_noise(states, labels))


def _strength(
    states, times, labels, method, order, window, degree, cutoff, decimate, too_short
) -> Strength:
    """The smoother that the options ask for, or the best one for all trajectories."""
    whole("order", order, most=2)
    whole("degree", degree, least=2, most=SETTINGS.most_degree)
    whole("window", window, least=3, also=(None,))
    if window is not None and (window % 2 == 0 or window <= degree):
        raise ValueError(f"window={window!r} must be odd and larger than degree={degree!r}.")
    real("cutoff", cutoff, above=0, also=(None,))
    whole("decimate", decimate, most=SETTINGS.most_decimated)
    may_drop = one_of("too_short", too_short, ("raise", "drop")) == "drop"
    parts = []
    for label, index in trajectories(labels):
        steps = np.diff(times[index])
        if len(steps) > 2 and steps.max() > SETTINGS.largest_gap * np.median(steps):
            raise ValueError(
                f"Trajectory {label!r} has a gap of {steps.max():g} where samples are usually "
                f"{np.median(steps):g} apart; give the parts before and after it different groups."
            )
        parts.append((states[index], times[index]))
    known = [t for _, t in parts]
    candidates = strengths(method, known, window, degree, cutoff, decimate, may_drop)
    return strongest(candidates, parts, [estimate_noise(x) for x, _ in parts], order)


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
    columns, order = table("x", x), SETTINGS.noise_order
    labels = group_labels(groups, len(columns))
    differences = np.vstack(
        [np.diff(columns[index], order, axis=0) for _, index in trajectories(labels)]
    )
    if not len(differences):
        return np.zeros(columns.shape[1])
    median = robust_scale(differences)
    # Coarsely quantised signals mostly repeat themselves: their median is zero, their mean not.
    mean = np.sqrt(np.mean(differences**2, axis=0))
    return np.where(median > 0, median, mean) / np.sqrt(comb(2 * order, order))


def measured_rows(x, t, groups, inputs) -> tuple[Array, Array, NDArray, Array]:
    """States, times that increase along each trajectory, trajectories and inputs, checked."""
    states = table("x", x)
    n_rows = len(states)
    times = column("t", t, n_rows)
    for name, values in (("x", states), ("t", times)):
        refuse_vanishing(name, values)
    signals = np.empty((n_rows, 0)) if inputs is None else table("inputs", inputs, n_rows)
    labels = group_labels(groups, n_rows)
    for label, index in trajectories(labels):
        steps = np.diff(times[index])
        if len(steps) and steps.min() <= 0:
            kind = "repeats a time" if steps.min() == 0 else "goes back in time"
            raise ValueError(
                f"Trajectory {label!r} {kind} at its sample {np.argmin(steps) + 1}; sort the rows "
                "by time, remove repeated ones, and name separate trajectories by groups."
            )
    return states, times, labels, signals
