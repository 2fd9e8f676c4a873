"""Everything that a rollout with effects knows beforehand, as functions of time.

These are the *given channels*: inputs, the time itself, logged signals, and the columns of
effects that remember an input. Between neighbouring times of the grid each is a quadratic.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid._simulation.inputs import Stretch
from swsysid.effects import PlacedEffect

__all__ = ["Given", "refined_grid", "trajectory_records"]

# inputs jump at the ends of an interval: columns are asked a millionth of it further in
_INSIDE = 1e-6
_SAME_TIME = 1e-9  # of a step


def trajectory_records(X: Array, n_states: int, t: Array, signals: Array) -> Records:
    """Records of one trajectory."""
    n_channels = X.shape[1] + signals.shape[1]
    names = tuple(f"channel{number}" for number in range(n_channels))
    return Records(X, n_states, t, np.zeros(len(t), np.intp), signals, names, True)


def refined_grid(t: Array, instants: Array) -> Array:
    """The requested times and the instants between them that are not the same to roundoff."""
    if len(t) < 2:
        return t
    near = _SAME_TIME * np.diff(t).min()
    inside = np.unique(instants[(instants > t[0]) & (instants < t[-1])])
    after = np.searchsorted(t, inside)
    apart = np.minimum(inside - t[after - 1], t[after] - inside) > near
    inside = inside[apart]
    inside = inside[np.diff(inside, prepend=-np.inf) > near]
    return np.union1d(t, inside)


@dataclass(frozen=True)
class Given:
    """Inputs and signals at the samples, and the effects that remember them.

    Attributes
    ----------
    n_states : int
    t : ndarray of shape (n_known,)
        Times of the samples.
    inputs : ndarray of shape (n_known, n_inputs)
    signals : ndarray of shape (n_known, n_signals)
    linear : bool
        Linear between the samples, else constant until the next one.
    terms : sequence of PlacedEffect
        Effects that remember an input or a signal.
    """

    n_states: int
    t: Array
    inputs: Array
    signals: Array
    linear: bool
    terms: Sequence[PlacedEffect]

    def at(self, times: Array) -> tuple[Array, Array]:
        """Inputs and signals at some times."""
        if self.linear:
            held = [
                np.array([np.interp(times, self.t, column) for column in values.T]).T
                for values in (self.inputs, self.signals)
            ]
            inputs, signals = (part.reshape(len(times), -1) for part in held)
            return inputs, signals
        rows = np.clip(np.searchsorted(self.t, times, side="right") - 1, 0, None)
        return self.inputs[rows], self.signals[rows]

    def columns(self, times: Array) -> Array:
        """Columns of the effects that remember, shape (n_times, n_columns)."""
        inputs, signals = self.at(times)
        X = np.column_stack([np.zeros((len(times), self.n_states)), inputs])
        records = trajectory_records(X, self.n_states, times, signals)
        parts = [term.columns(records) for term in self.terms]
        return np.column_stack([np.empty((len(times), 0)), *parts])

    def sampled(self, times: Array) -> Array:
        """All given channels at the times of samples, (n_times, n_channels)."""
        inputs, signals = self.at(times)
        return np.column_stack([inputs, times, signals, self.columns(times)])

    def stretches(self, grid: Array) -> list[Stretch]:
        """End and signal of each interval of the grid, and of the last time by itself."""
        grid = grid[grid <= self.t[-1]]
        held, slope = self._lines(grid)
        tabulated, ends = self._parabolas(grid)
        quadratics = [
            np.column_stack([held[:-1], tabulated[0]]),
            np.column_stack([slope, tabulated[1]]),
            np.column_stack([np.zeros_like(slope), tabulated[2]]),
        ]
        listed: list[Stretch] = [
            (float(end), partial(_quadratic, begin, *coefficients))
            for begin, end, *coefficients in zip(grid[:-1], grid[1:], *quadratics, strict=True)
        ]
        last, nothing = np.concatenate([held[-1], ends]), np.zeros(held.shape[1] + len(ends))
        nothing[self.inputs.shape[1]] = 1.0  # time goes on
        return [*listed, (float(grid[-1]), partial(_quadratic, grid[-1], last, nothing, 0.0))]

    def _lines(self, grid: Array) -> tuple[Array, Array]:
        """Inputs, time and signals at the begin of each interval, and their slopes."""
        inputs, signals = self.at(grid)
        values = np.column_stack([inputs, grid, signals])
        slope = np.diff(values, axis=0) / np.diff(grid)[:, None]
        if not self.linear:
            slope = np.zeros_like(slope)
            slope[:, inputs.shape[1]] = 1.0
        return values, slope

    def _parabolas(self, grid: Array) -> tuple[tuple[Array, Array, Array], Array]:
        """Coefficients of the parabola through three values in each interval; the last values."""
        lengths = np.diff(grid)
        places = np.array([_INSIDE, 0.5, 1.0 - _INSIDE])
        times = (grid[:-1, None] + lengths[:, None] * places).ravel()
        values = self.columns(np.concatenate([grid[:1], times, grid[-1:]]))
        inside = values[1:-1].reshape(len(lengths), 3, values.shape[1])
        # values = V (c0, c1 h, c2 h^2) with the Vandermonde matrix V of the places
        solved = np.linalg.inv(np.vander(places, increasing=True)) @ inside
        h = lengths[:, None]
        return (solved[:, 0], solved[:, 1] / h, solved[:, 2] / h**2), values[-1]


def _quadratic(begin, value, slope, bend, time):
    since = time - begin
    return value + since * (slope + since * bend)
