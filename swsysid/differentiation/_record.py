"""A recording as it is differentiated, checked, and its derivatives as they are handed out.

Rows that say nothing are left out, such as those of a rest but for a few.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from swsysid._checks.arrays import column, refuse_vanishing, table
from swsysid._checks.parameters import one_of
from swsysid._data.trajectories import (
    evened,
    events_in,
    group_labels,
    how_to_unwrap,
    is_coarse,
    trajectories,
    turn_of,
)
from swsysid._rendering.series import draw_series, frame_of, names_or_numbers, span
from swsysid._results import IdentificationWarning
from swsysid.differentiation._noise import runs_in
from swsysid.differentiation._sensors import SURE, Sensors, inspect_sensors
from swsysid.differentiation._smoothing import Array, Smoother
from swsysid.differentiation._strength import kernels_of

# A gap that clipped samples leave is bridged up to so many steps.
_BRIDGED = 4.0
# Samples that a rest has at least; share of the largest derivative up to which there is none.
_SHORTEST_REST = 5
_STANDING = 1e-9
# Times the noise that movement has at least where rest can be told from it.
_PLAIN_MOVEMENT = 3.0
# A larger share of rows at rest outvotes those that move, or nearly.
_MOSTLY = 1 / 3
# Of the rows that move, so many are kept of those at rest.
_KEPT_AT_REST = 0.1

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from pandas import DataFrame


Stretch = NDArray[np.intp]  # rows of a trajectory, in order of time


def measured_rows(
    x, t, groups, inputs, *, events: bool = False
) -> tuple[Array, Array, NDArray, Array]:
    """States, times that increase along each trajectory, trajectories and inputs, checked.

    With `events` two rows may have one time: the limits of an event.
    """
    states = table("x", x)
    n_rows = len(states)
    times = column("t", t, n_rows).copy()
    for name, values in (("x", states), ("t", times)):
        refuse_vanishing(name, values)
    signals = np.empty((n_rows, 0)) if inputs is None else table("inputs", inputs, n_rows)
    labels = group_labels(groups, n_rows)
    for label, index in trajectories(labels):
        times[index] = evened(times[index], states[index])
        steps = np.diff(times[index])
        if not len(steps):
            continue
        place = int(np.argmin(steps)) + 1
        if steps.min() < 0:
            raise ValueError(
                f"Trajectory {label!r} goes back in time at its sample {place}; sort the rows by "
                "time, and name separate trajectories by groups."
            )
        if steps.min() == 0 and (not events or is_coarse(times[index], states[index])):
            raise ValueError(
                f"Trajectory {label!r} repeats a time at its sample {place}; "
                + (
                    "the clock is too coarse, give the times of a finer one."
                    if events
                    else "give the parts before and after each event different groups."
                )
            )
    return states, times, labels, signals


class Record(NamedTuple):
    """Trajectories in the stretches that are smoothed each by itself."""

    states: Array
    times: Array
    quantum: Array  # (n_columns,)
    clipped: NDArray[np.bool_]  # (n_samples,), in any column
    # Each trajectory with its stretches, several where rows are missing between them.
    parts: list[tuple[object, list[Stretch]]]
    # Stretches between events that last so long are told by a parabola where no filter fits.
    brief: float

    @property
    def stretches(self) -> list[Stretch]:
        """All stretches."""
        return [stretch for _, each in self.parts for stretch in each]

    @property
    def is_split(self) -> bool:
        """Whether a trajectory has several stretches."""
        return any(len(stretches) != 1 for _, stretches in self.parts)


def record_of(
    states: Array,
    times: Array,
    labels: NDArray,
    clipped: str,
    *,
    uneven: bool,
    names: Sequence[str] = (),
) -> Record:
    """The rows that count; with `names` of the columns, what is wrong with them is said.

    A smoother that takes `uneven` times bridges short gaps, and none bridges an event.
    """
    drop = one_of("clipped", clipped, ("drop", "keep")) == "drop"
    whole = [
        (label, np.split(rows, events_in(times[rows]) + 1)) for label, rows in trajectories(labels)
    ]
    number = np.empty(len(states), dtype=np.intp)
    for k, rows in enumerate(rows for _, each in whole for rows in each):
        number[rows] = k
    sensors = inspect_sensors(states, number)
    if names:
        _warn(states, sensors, names, drop)
        _warn_of_turns(states, labels, names)
    beyond: NDArray[np.bool_] = np.asarray(sensors.clipped.any(axis=1) & drop)
    bridged, parts = _BRIDGED if uneven else 0.0, []
    for label, each in whole:
        there = [rows[~(sensors.held | beyond)[rows]] for rows in each]
        stretches = [stretch for rows in there for stretch in _split(rows, times, beyond, bridged)]
        parts.append((label, stretches))
    has_events = any(len(each) > 1 for _, each in whole)
    brief = 0.5 * float(np.median(np.diff(times))) if has_events else np.inf
    return Record(states, times, sensors.quantum, beyond, parts, brief)


def _split(rows: Stretch, times: Array, beyond: NDArray[np.bool_], bridged: float) -> list[Stretch]:
    """Stretches between which clipped samples leave gaps longer than `bridged` steps."""
    steps, missing = np.diff(times[rows]), np.diff(np.cumsum(beyond)[rows])
    if not len(steps):
        return [rows] * len(rows)
    gaps = (missing > 0) & (steps > bridged * np.median(steps))
    return np.split(rows, np.flatnonzero(gaps) + 1)


def _warn(states: Array, sensors: Sensors, names: Sequence[str], drop: bool) -> None:
    """Say which columns are constant and which are clipped."""
    n_rows = len(states)
    for name, values, beyond in zip(names, states.T, sensors.clipped.T, strict=True):
        if n_rows > 1 and (values == values[0]).all():
            _say(
                f"{name} is {values[0]:g} in all {n_rows} samples: no law can be told from a "
                "state that never changes; leave the column out, or record it while it moves."
            )
        if beyond.any():
            ends = " and ".join(f"{end:g}" for end in np.unique(values[beyond]))
            done = "count as missing" if drop else "are taken as measured"
            _say(
                f"{name} stays at the end of its range, {ends}, in {beyond.sum()} of {n_rows} "
                f"samples, which {done}; record with a wider range. Where the system itself stops "
                "there, swsysid.differentiation.differentiate(..., clipped='keep') believes them."
            )


def _warn_of_turns(states: Array, labels: NDArray, names: Sequence[str]) -> None:
    """Say which columns are angles that begin anew after a turn."""
    rows = [members for _, members in trajectories(labels)]
    for name, values in zip(names, states.T, strict=True):
        turn = turn_of([values[own] for own in rows])
        if turn is not None:
            _say(f"{how_to_unwrap(name, turn)}.")


def _say(sentence: str) -> None:
    warnings.warn(sentence, IdentificationWarning, stacklevel=5)


def loudness(jets: Array, smoother: Smoother, times: Array, noise: Array, reach: int) -> Array:
    """Largest derivative of each smoothed row, in units of what noise may make of one.

    A row is made of measurements that are up to `reach` rows away.
    """
    found = np.zeros(jets.shape[1])
    for level in (1, 2):
        gain = float(np.linalg.norm(kernels_of([smoother], times, reach, level)[0]))
        size = np.abs(jets[level])
        least = np.maximum(SURE * gain * noise, _STANDING * size.max(axis=0))
        found = np.maximum(found, (size / np.where(least > 0.0, least, 1.0)).max(axis=1))
    return found


def at_rest(smooth: Array, loud: Array, half: int, noise: Array) -> NDArray[np.bool_]:
    """Rows of a trajectory that stay where they are for a while, and those beside them.

    Rows within half a window of a rest mix it with movement.
    """
    # A movement that only turns is still for a moment, and one that creeps gets somewhere.
    runs = runs_in(loud <= 1.0)
    spread = np.maximum.reduceat(smooth, runs.starts) - np.minimum.reduceat(smooth, runs.starts)
    least = np.maximum(SURE * noise, _STANDING * np.ptp(smooth, axis=0))
    rests = (loud[runs.starts] <= 1.0) & (runs.lengths >= _SHORTEST_REST)
    rests &= (spread <= least).all(axis=1)
    return np.asarray(binary_dilation(rests[runs.numbers], np.ones(2 * (half // 2) + 1)))


def thinned(rest: NDArray[np.bool_], loud: Array, window: int) -> NDArray[np.bool_]:
    """Rows that stay: all, or few of those at rest where these are many."""
    n_rest, n_moving = int(rest.sum()), int((~rest).sum())
    # Where movement is hardly more than noise, nothing says what rests.
    unclear = not n_moving or np.median(loud[~rest]) < _PLAIN_MOVEMENT
    if unclear or n_rest <= _MOSTLY * len(rest):
        return np.ones(len(rest), dtype=bool)
    # Rows of one window say the same, and those of a rest together tell little about the law.
    step = max(window, int(n_rest / (_KEPT_AT_REST * n_moving)))
    return ~rest | (runs_in(rest).places % step == 0)


class _Parts(NamedTuple):
    X: Array
    Xdot: Array
    t: Array
    groups: NDArray
    noise: Array


class Derivatives(_Parts):
    """States and their time derivatives, ends trimmed.

    Unpacks as ``X, Xdot, t, groups, noise``.

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
    names : tuple of str
        Names of the columns of `X`; x0, x1, ... where the data had none.
    window : int
        Rows that share measurements with a row, itself included.

    Examples
    --------
    >>> import numpy as np, pandas as pd
    >>> from swsysid.differentiation import differentiate
    >>> t = np.linspace(0.0, 4.0, 401)
    >>> done = differentiate(pd.DataFrame({"q": np.sin(t)}), t, order=2, window=9)
    >>> done
    Derivatives(393 times from 0.04 to 3.96, q, q'; 1 trajectory)
    >>> list(done.to_frame())
    ['q', "q'", "q''", 'group']
    """

    names: tuple[str, ...]
    window: int

    def __new__(
        cls,
        X: Array,
        Xdot: Array,
        t: Array,
        groups: NDArray,
        noise: Array,
        names: Iterable[str] = (),
        window: int = 1,
    ):
        parts = super().__new__(cls, X, Xdot, t, groups, noise)
        parts.names = tuple(names_or_numbers(tuple(names), X.shape[1]))
        parts.window = int(window)
        return parts

    def __repr__(self) -> str:
        n_groups = len(np.unique(self.groups))
        trajectories = "1 trajectory" if n_groups == 1 else f"{n_groups} trajectories"
        return f"Derivatives({span(self.t)}, {', '.join(self.names)}; {trajectories})"

    @property
    def rate_names(self) -> tuple[str, ...]:
        """Names of the columns of `Xdot`: those of the states with a prime."""
        return tuple(f"{name}'" for name in self.names[: self.Xdot.shape[1]])

    def to_frame(self) -> DataFrame:
        """States, inputs, rates and the trajectory of each row, ``group``, as a data frame.

        Returns
        -------
        pandas.DataFrame of n_kept rows
            Indexed by the times. With ``order=2`` velocities are both states and rates, and stand
            there once.
        """
        columns = dict(zip(self.rate_names, self.Xdot.T, strict=True))
        states = dict(zip(self.names, self.X.T, strict=True))
        return frame_of(self.t, {**states, **columns, **states}, {"group": self.groups})

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw states and inputs over time, trajectories apart.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, default=None
            None draws on a new figure.

        Returns
        -------
        matplotlib.axes.Axes
        """
        rows = [self.groups == label for label in np.unique(self.groups)]
        return draw_series(ax, [(self.t[some], self.X[some]) for some in rows], self.names, ())


def rates_appended(states: Sequence[str], inputs: Sequence[str], order: int) -> list[str]:
    """Names of the columns of X: states, their rates below the highest, inputs.

    Examples
    --------
    >>> rates_appended(["q"], ["u"], order=2)
    ['q', "q'", 'u']
    """
    return [*(name + "'" * level for level in range(order) for name in states), *inputs]
