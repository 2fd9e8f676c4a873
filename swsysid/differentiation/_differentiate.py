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

from swsysid._checks.arrays import names_of, table
from swsysid._checks.parameters import flag, one_of, real, whole
from swsysid._data.trajectories import group_labels, trajectories
from swsysid.differentiation._noise import noise_in
from swsysid.differentiation._record import (
    Derivatives,
    Record,
    at_rest,
    loudness,
    measured_rows,
    rates_appended,
    record_of,
    thinned,
)
from swsysid.differentiation._sensors import inspect_sensors
from swsysid.differentiation._smoothing import LARGEST_GAP, Array, TooShortError
from swsysid.differentiation._strength import Strength, strengths, strongest, warn_of_counting

# Polynomials beyond are lost to rounding.
_MOST_DEGREE = 20
_MOST_DECIMATED = 1_000_000


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
    clipped: str = "drop",
    rest: str = "thin",
) -> Derivatives:
    r"""Smooth and differentiate measured trajectories.

    Parameters
    ----------
    x : array-like of shape (n_samples, n_columns) or (n_samples,)
        Measured states, or positions with ``order=2``.
    t : array-like of shape (n_samples,)
        Times, increasing within each trajectory; sampling may be uneven. Two rows at one time are
        the limits of an event, across which nothing is smoothed; stretches between events that are
        too short for the filter are told by a parabola.
    groups : array-like of shape (n_samples,), default=None
        The trajectory each row belongs to; None means one trajectory.
    method : {"savitzky_golay", "butterworth", "finite_difference"} or object
        ``"savitzky_golay"`` fits a polynomial to a window of samples around each time, on the
        actual times. ``"butterworth"`` is a fourth-order low-pass run forward and backward
        (no phase), then central differences: the standard of robot identification; it needs
        even sampling. ``"finite_difference"`` does not smooth. An object is a PySINDy
        differentiator, called as ``method(x, t)``; it does not filter the inputs. One that counts
        samples instead of reading the times is told by a warning, with the size of its error.
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
    clipped : {"drop", "keep"}, default="drop"
        What becomes of samples at an end of the range of their sensor. ``"drop"`` treats them as
        missing, with a warning that counts them; ``"keep"`` takes them as measured, for a system
        that itself stops there. `inspect_sensors` lists them.
    rest : {"thin", "keep"}, default="thin"
        What becomes of rows at rest where they are more than a third. They would outvote those
        that move: the law of most rows would be that nothing moves. ``"thin"`` keeps at most one
        of them in each window of the filter, and few beside those that move.

    Returns
    -------
    Derivatives
        Unpacks as ``X, Xdot, t, groups, noise``; columns keep the names that a data frame gives
        them.

    Raises
    ------
    ValueError
        If values are missing, times go backward, or a trajectory is too short.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.differentiation import differentiate
    >>> t = np.linspace(0.0, 5.0, 501)
    >>> X, Xdot, t_kept, groups, noise = differentiate(np.sin(t), t)
    >>> bool(abs(Xdot[:, 0] - np.cos(t_kept)).max() < 1e-6)
    True
    """
    states, times, labels, signals = measured_rows(x, t, groups, inputs, events=True)
    flag("filter_inputs", filter_inputs)
    thin = one_of("rest", rest, ("thin", "keep")) == "thin"
    own = names_of(x, states.shape[1], "x")
    record = record_of(states, times, labels, clipped, uneven=_takes_uneven(method), names=own)
    options = (window, degree, cutoff, decimate, too_short)
    smoother = _strength(record, method, order, *options).smoother
    if not isinstance(method, str):
        runs = [(states[rows], times[rows]) for rows in record.stretches]
        warn_of_counting(smoother, runs, record.quantum, degree)
    names = rates_appended(own, names_of(inputs, signals.shape[1], "u"), order)
    # An object of PySINDy's is not a filter that could be applied to the inputs too.
    filter_inputs = filter_inputs and isinstance(method, str) and signals.shape[1] > 0
    pieces, noise, every = [], _noise(record), 1
    for label, stretches in record.parts:
        for index in stretches:
            try:
                jets, trim = smoother(states[index], times[index], None)
            except TooShortError as error:
                if too_short != "drop" and len(stretches) == 1:
                    raise ValueError(f"Trajectory {label!r} {error}") from None
                if np.ptp(times[index]) >= record.brief:
                    piece = states[index], signals[index], times[index], labels[index]
                    pieces += _between_samples(*piece, order)
                continue
            kept = index[trim : len(index) - trim]
            extra = signals[kept]
            if filter_inputs:
                extra = smoother(signals[index], times[index], None)[0][0]
            X, Xdot = np.hstack([*jets[:order], extra]), np.hstack([*jets[1 : order + 1]])
            # how far an object reaches is not told by the rows that it lacks
            reach = trim if isinstance(method, str) else len(index)
            loud = loudness(jets, smoother, times[index], noise, reach)
            still = at_rest(jets[0], loud, trim, noise)
            parts = (X, Xdot, times[kept], labels[kept], still, loud)
            pieces.append([part[::decimate] for part in parts])
            every = max((2 * trim + 1) // decimate, 1)
    if not pieces:
        lengths = [len(index) for index in record.stretches]
        raise ValueError(
            f"No trajectory is long enough to be differentiated: the longest of {len(lengths)} has "
            f"{max(lengths, default=0)} samples; use a smaller window or record longer ones."
        )
    *rows, still, loud = (np.concatenate(part) for part in zip(*pieces, strict=True))
    stays = thinned(still & thin, loud, every)
    X, Xdot, t, groups = (part[stays] for part in rows)
    return Derivatives(X, Xdot, t, groups, noise, names, every)


def _between_samples(
    states: Array, signals: Array, t: Array, labels: NDArray, order: int
) -> list[list[NDArray]]:
    """Rows between the samples of a short stretch, by the parabola through it.

    A line for two samples, and nothing for too few. No row counts as one at rest.
    """
    degree = min(2, len(t) - 1)
    if degree < order:
        return []
    middles, unit = 0.5 * (t[1:] + t[:-1]), t[-1] - t[0]
    basis = np.polynomial.polynomial.polyvander((t - t[0]) / unit, degree)
    fitted = np.linalg.pinv(basis) @ np.hstack([states, signals])
    jets = [
        np.polynomial.polynomial.polyval(
            (middles - t[0]) / unit, np.polynomial.polynomial.polyder(fitted, k)
        ).T / unit**k
        for k in range(order + 1)
    ]  # fmt: skip
    n = states.shape[1]
    X = np.hstack([*(jet[:, :n] for jet in jets[:order]), jets[0][:, n:]])
    Xdot, rest = np.hstack([jet[:, :n] for jet in jets[1:]]), np.zeros(len(middles), dtype=bool)
    return [[X, Xdot, middles, labels[1:], rest, np.ones(len(middles))]]


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
    clipped: str = "drop",
) -> Smoothing:
    """The smoothing that `differentiate` would choose, from all trajectories.

    Parameters
    ----------
    x, t, groups, method, order, window, degree, cutoff, decimate, too_short, clipped
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
    states, times, labels, _ = measured_rows(x, t, groups, None, events=True)
    record = record_of(states, times, labels, clipped, uneven=_takes_uneven(method))
    chosen = _strength(record, method, order, window, degree, cutoff, decimate, too_short)
    return Smoothing(method, chosen.window, chosen.cutoff, _noise(record))


def _takes_uneven(method: str | object) -> bool:
    """Whether a method fits on the actual times, however they are spaced."""
    return method in ("savitzky_golay", "finite_difference")


def _noise(record: Record) -> Array:
    """Standard deviation of the noise in each column of a record."""
    parts, times = (
        [own[rows] for rows in record.stretches] for own in (record.states, record.times)
    )
    return noise_in(parts, record.quantum, times)


def _strength(
    record: Record, method, order, window, degree, cutoff, decimate, too_short
) -> Strength:
    """The smoother that the options ask for, or the best one for all trajectories."""
    whole("order", order, most=2)
    whole("degree", degree, least=2, most=_MOST_DEGREE)
    whole("window", window, least=3, also=(None,))
    if window is not None and (window % 2 == 0 or window <= degree):
        raise ValueError(f"window={window!r} must be odd and larger than degree={degree!r}.")
    real("cutoff", cutoff, above=0, also=(None,))
    whole("decimate", decimate, most=_MOST_DECIMATED)
    may_drop = one_of("too_short", too_short, ("raise", "drop")) == "drop" or record.is_split
    parts = [(record.states[rows], record.times[rows]) for rows in record.stretches]
    labels = [label for label, stretches in record.parts for _ in stretches]
    apart = [(label, np.diff(times)) for label, (_, times) in zip(labels, parts, strict=True)]
    usual = 0.0  # of a short stretch longer ones say it: a jump may have cut off a few samples
    for label, steps in sorted(apart, key=lambda one: -len(one[1])):
        usual = max(usual, float(np.median(steps))) if len(steps) > 2 else np.inf
        if steps.max(initial=0.0) > LARGEST_GAP * usual:
            raise ValueError(
                f"Trajectory {label!r} has a gap of {steps.max():g} where samples are usually "
                f"{usual:g} apart; give the parts before and after it different groups."
            )
    known = [t for _, t in parts]
    candidates = strengths(method, known, window, degree, cutoff, decimate, may_drop)
    return strongest(candidates, parts, record.quantum, order)


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
    columns = table("x", x)
    labels = group_labels(groups, len(columns))
    sensors = inspect_sensors(columns, labels)
    parts = [columns[rows[~sensors.held[rows]]] for _, rows in trajectories(labels)]
    return noise_in(parts, sensors.quantum)
