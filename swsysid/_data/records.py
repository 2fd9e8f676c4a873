"""Samples as they were recorded: states, inputs, times, trajectories and logged signals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks.arrays import column, labels, refuse_vanishing, table
from swsysid._results import Array

__all__ = ["Records", "make_records"]


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
    """

    X: Array
    n_states: int
    t: Array | None
    groups: NDArray[np.intp] | None
    signals: Array
    names: tuple[str, ...]
    timed: bool

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
    def states(self) -> range:
        """Channels that are states."""
        return range(min(self.n_states, self.X.shape[1]))

    @property
    def inputs(self) -> range:
        """Channels that are inputs."""
        return range(self.n_states, self.X.shape[1])

    @property
    def signal_channels(self) -> range:
        """Channels that are logged signals."""
        return range(self.X.shape[1], self.X.shape[1] + self.signals.shape[1])

    def channel(self, number: int) -> Array:
        """Values of one channel, shape (n_samples,)."""
        n_columns = self.X.shape[1]
        return self.X[:, number] if number < n_columns else self.signals[:, number - n_columns]

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

    def along(self, operator: Callable[[Array, Array], Array], values: Array) -> Array:
        """Apply ``operator(t, values)`` to each trajectory and put the answers back in place."""
        assert self.t is not None
        answer = np.empty_like(values, dtype=float)
        for rows in self.trajectories:
            answer[rows] = operator(self.t[rows], values[rows])
        return answer

    def take(self, rows: NDArray) -> Records:
        """The same record on some rows only."""
        return Records(
            X=self.X[rows],
            n_states=self.n_states,
            t=None if self.t is None else self.t[rows],
            groups=None if self.groups is None else self.groups[rows],
            signals=self.signals[rows],
            names=self.names,
            timed=self.timed,
        )

    def with_columns(self, X: Array) -> Records:
        """The same record with other states and inputs."""
        return Records(X, self.n_states, self.t, self.groups, self.signals, self.names, self.timed)

    def with_channel(self, number: int, values: Array) -> Records:
        """The same record with other values of one channel."""
        n_columns = self.X.shape[1]
        every = np.column_stack([self.X, self.signals])
        every[:, number] = values
        X, signals = every[:, :n_columns], every[:, n_columns:]
        return Records(X, self.n_states, self.t, self.groups, signals, self.names, self.timed)


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
    """Check what came with the samples.

    Raises
    ------
    ValueError
        If lengths differ, times do not increase along a trajectory, or values are not finite.
    """
    n_samples = len(X)
    t = None if t is None else column("t", t, n_samples)
    if t is not None:
        refuse_vanishing("t", t)
    if groups is not None:
        groups = np.unique(labels("groups", groups, n_samples), return_inverse=True)[1]
    timed = t is not None
    if groups is None and t is not None:
        groups = np.zeros(n_samples, dtype=np.intp)
    listed = np.empty((n_samples, 0)) if signals is None else table("signals", signals, n_samples)
    given: list = list(signal_names or getattr(signals, "columns", ()))  # type: ignore[arg-type]
    if len(given) != listed.shape[1]:
        given = [f"signal{column}" for column in range(listed.shape[1])]
    records = Records(X, n_states, t, groups, listed, (*names, *map(str, given)), timed)
    if groups is None:
        return records
    if t is None:
        places = np.empty(n_samples)
        for rows in records.trajectories:
            places[rows] = np.arange(len(rows))
        return Records(X, n_states, places, groups, listed, records.names, timed)
    for rows in records.trajectories:
        if (np.diff(t[rows]) <= 0).any():
            raise ValueError(
                "t must increase along every trajectory; sort the rows of each trajectory by "
                "time, or give `groups` so that trajectories are told apart."
            )
    return records
