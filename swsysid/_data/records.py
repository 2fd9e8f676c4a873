"""Samples as they were recorded: states, inputs, times, trajectories and logged signals."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks.arrays import labels, table
from swsysid._data.recordings import Hold, a_row_sooner, stepped
from swsysid._data.trajectories import increasing_times, places_along
from swsysid._results import Array

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class Records:
    """Rows of measurements and what is known about when and where they were taken.

    The columns of the states, the inputs and the signals are its *channels*, numbered in this
    order.

    Attributes
    ----------
    X : ndarray of shape (n_samples, n_states + n_inputs)
    n_states : int
    t : ndarray of shape (n_samples,) or None
        Times in s, or numbers of the rows in their trajectory where rows are known to be in
        order and no times are given.
    groups : ndarray of shape (n_samples,), int, or None
        Trajectory of each row, None if rows are exchangeable.
    signals : ndarray of shape (n_samples, n_signals)
        Channels that the declared model does not use.
    names : tuple of str
        One for each channel.
    timed : bool
        True if the times were measured.
    average : callable or None
        What a filter that has made velocities of measured states does to any columns of all rows,
        as all rows show it or some (None is all); None where velocities were measured.
    decoded_modes : ndarray of shape (n_samples,), int, or None
        Modes that the measured states themselves show, -1 where they take no part; None where
        velocities were measured.
    rates : frozenset of int
        States whose equation is known to give their own rate, and no force of theirs.
    positions : mapping of int to int
        States whose rate is known to be another state, as in x' = v, and that state.
    quantity : str or None
        What the one law gives where that is the rate of no state: a force, a torque, a current.
        No column of X is a state then. None where the equations are those of states.
    n_hidden : int
        The last so many states are measured by nobody, and are what a filter makes of the others.
    holds : mapping of int to Hold
        What inputs do between two rows, those that keep a value; others are on lines. What acts a
        row before it is logged stands in that row.
    """

    X: Array
    n_states: int
    t: Array | None
    groups: NDArray[np.intp] | None
    signals: Array
    names: tuple[str, ...]
    timed: bool
    average: Callable[[Array, Rows | None], Array] | None = None
    decoded_modes: NDArray[np.intp] | None = None
    rates: frozenset[int] = frozenset()
    positions: Mapping[int, int] = field(default_factory=dict)
    quantity: str | None = None
    n_hidden: int = 0
    holds: Mapping[int, Hold] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.X)

    @property
    def ordered(self) -> bool:
        """True if rows are known to follow each other in time."""
        return self.groups is not None

    @property
    def n_inputs(self) -> int:
        """Number of columns of X after the states."""
        return self.X.shape[1] - self.n_states

    @property
    def n_measured(self) -> int:
        """Number of states that are measured; the others are hidden."""
        return self.n_states - self.n_hidden

    @property
    def held(self) -> frozenset[int]:
        """Inputs that keep a value until the next row."""
        return frozenset(one for one, hold in self.holds.items() if hold is not Hold.LINE)

    @property
    def holds_in_words(self) -> str:
        """What inputs that are on no lines do between rows, in sentences."""
        holds = [(self.names[channel], hold) for channel, hold in sorted(self.holds.items())]
        told = (hold.sentence([name for name, own in holds if own is hold]) for hold in Hold)
        return " ".join(one for one in told if one)

    def holding(self, holds: Mapping[int, Hold]) -> Records:
        """The same as it was logged, of which inputs do this between two rows."""
        sooner = np.array([holds.get(one) is Hold.NEXT for one in range(self.X.shape[1])])
        X = self.X.copy()
        for rows in self.trajectories:
            X[rows] = a_row_sooner(self.X[rows], sooner)
        return replace(self, X=X, holds=holds)

    @property
    def static(self) -> bool:
        """True if the law gives a quantity that is no rate."""
        return self.quantity is not None

    @property
    def states(self) -> range:
        """Channels that are states; none of a static law."""
        return range(0 if self.static else min(self.n_states, self.X.shape[1]))

    @property
    def inputs(self) -> range:
        """Channels that are inputs: of a static law all columns of X."""
        return range(0 if self.static else self.n_states, self.X.shape[1])

    @property
    def variables(self) -> range:
        """Channels that the laws are about: the states, of a static law all columns of X."""
        return self.inputs if self.static else self.states

    @property
    def equations(self) -> tuple[str, ...]:
        """Names of what the laws give: those of the states, or of the quantity."""
        return self.names[: self.n_states] if self.quantity is None else (self.quantity,)

    @property
    def signal_channels(self) -> range:
        """Channels that are logged signals."""
        return range(self.X.shape[1], self.X.shape[1] + self.signals.shape[1])

    def number(self, channel: int | str) -> int:
        """Number of a channel that is given by its name or its number."""
        known = dict(zip(self.names, range(len(self.names)), strict=True))
        number = known.get(channel, -1) if isinstance(channel, str) else int(channel)
        if number not in range(len(self.names)):
            raise ValueError(
                f"{channel!r} is no channel of this record; choose from {', '.join(self.names)}."
            )
        return number

    def channel(self, number: int) -> Array:
        """Values of one channel, shape (n_samples,)."""
        n_columns, n_signals = self.X.shape[1], self.signals.shape[1]
        if not isinstance(number, (int, np.integer)) or not 0 <= number < n_columns + n_signals:
            raise ValueError(
                f"channel {number!r} is asked for; give the number of one, from 0 to "
                f"{n_columns + n_signals - 1}: columns first, then signals."
            )
        return self.X[:, number] if number < n_columns else self.signals[:, number - n_columns]

    @cached_property
    def _answers(self) -> dict[Hashable, Array]:
        return {}

    def once(self, question: Hashable, answer: Callable[[], Array]) -> Array:
        """The answer to a question about this very record, worked out once."""
        if question not in self._answers:
            self._answers[question] = answer()
        return self._answers[question]

    @cached_property
    def trajectories(self) -> list[NDArray[np.intp]]:
        """Rows of each trajectory, in order of time."""
        if self.groups is None:
            return [np.arange(len(self))]
        order = np.argsort(self.groups, kind="stable")
        return np.split(order, np.flatnonzero(np.diff(self.groups[order])) + 1)

    @cached_property
    def step(self) -> float:
        """Median time between neighbouring rows of a trajectory."""
        assert self.t is not None
        steps = np.concatenate([np.diff(self.t[rows]) for rows in self.trajectories])
        return float(np.median(steps)) if len(steps) else 1.0

    @cached_property
    def durations(self) -> list[float]:
        """Time from the first row of each trajectory to its last."""
        assert self.t is not None
        return [float(np.ptp(self.t[rows])) for rows in self.trajectories]

    def along(self, operator: Callable[[Array, Array], Array], values: Array) -> Array:
        """Apply ``operator(t, values)`` to each trajectory and put the answers back in place."""
        assert self.t is not None
        answer = np.empty_like(values, dtype=float)
        for rows in self.trajectories:
            answer[rows] = operator(self.t[rows], values[rows])
        return answer

    def response(self, operator: Callable[[Array, Array], Array], number: int) -> Array:
        """The same of a channel, as it is between the rows too."""
        if number not in self.held:
            return self.along(operator, self.channel(number))

        def of_steps(t: Array, values: Array) -> Array:
            found = stepped(t, values[:, None], [Hold.ROW])
            return operator(found.t, found.u[:, 0])[found.places]

        return self.along(of_steps, self.channel(number))

    def averaged(self, columns: Array, rows: Rows | None = None) -> Array:
        """Columns of all rows as the velocities show them, on some rows or all."""
        if self.average is not None:
            return self.average(columns, rows)
        return columns if rows is None else columns[rows]

    def take(self, rows: NDArray) -> Records:
        """The same record on some rows only, which no filter can work on."""
        t, groups, decoded = (
            None if one is None else one[rows] for one in (self.t, self.groups, self.decoded_modes)
        )
        return replace(
            self,
            X=self.X[rows],
            t=t,
            groups=groups,
            signals=self.signals[rows],
            average=None,
            decoded_modes=decoded,
        )

    def decoded_on(self, rows: NDArray) -> Records:
        """The same record whose modes are told on some rows only."""
        if self.decoded_modes is None:
            return self
        decoded = np.full(len(self), -1)
        decoded[rows] = self.decoded_modes[rows]
        return replace(self, decoded_modes=decoded)

    def with_columns(self, X: Array) -> Records:
        """The same record with other states and inputs."""
        return replace(self, X=X)

    def with_channel(self, number: int, values: Array) -> Records:
        """The same record with other values of one channel."""
        every = np.column_stack([self.X, self.signals])
        every[:, number] = values
        X, signals = np.split(every, [self.X.shape[1]], axis=1)
        return replace(self, X=X, signals=signals)


def make_records(
    X: Array,
    n_states: int,
    *,
    t: ArrayLike | None = None,
    groups: ArrayLike | None = None,
    signals: ArrayLike | None = None,
    names: Sequence[str],
    signal_names: Sequence[str] | None = None,
) -> Records:
    """Check what came with the samples: lengths, finite values, times that increase."""
    n_samples, timed = len(X), t is not None
    if groups is not None:
        groups = np.unique(labels("groups", groups, n_samples), return_inverse=True)[1]
    elif timed:
        groups = np.zeros(n_samples, dtype=np.intp)
    times = None
    if groups is not None:
        times = increasing_times(t, groups) if timed else places_along(groups)
    listed = np.empty((n_samples, 0)) if signals is None else table("signals", signals, n_samples)
    given: list = list(signal_names or getattr(signals, "columns", ()))  # type: ignore[arg-type]
    if len(given) != listed.shape[1]:
        given = [f"signal{column}" for column in range(listed.shape[1])]
    return Records(X, n_states, times, groups, listed, (*names, *map(str, given)), timed)


def next_states(records: Records) -> tuple[NDArray[np.intp], Array]:
    """Rows that have a next one in their trajectory, and the next states of all, (n_samples, ...).

    The last row of a trajectory stands for its own next one.
    """
    targets = records.X[:, : records.n_states].copy()
    for rows in records.trajectories:
        targets[rows[:-1]] = targets[rows[1:]]
    return np.sort(np.concatenate([rows[:-1] for rows in records.trajectories])), targets
