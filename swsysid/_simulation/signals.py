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
from swsysid._simulation.inputs import Stretch, parabola
from swsysid._simulation.settings import SETTINGS
from swsysid.effects import PlacedEffect


def trajectory_records(X: Array, n_states: int, t: Array, signals: Array) -> Records:
    """Records of one trajectory."""
    n_channels = X.shape[1] + signals.shape[1]
    names = tuple(f"channel{number}" for number in range(n_channels))
    return Records(X, n_states, t, np.zeros(len(t), np.intp), signals, names, True)


def refined_grid(t: Array, instants: Array) -> Array:
    """The requested times and the instants between them that are not the same to roundoff."""
    if len(t) < 2:
        return t
    near = SETTINGS.same_time * np.diff(t).min()
    inside = np.unique(instants[(instants > t[0]) & (instants < t[-1])])
    after = np.searchsorted(t, inside)
    apart = np.minimum(inside - t[after - 1], t[after] - inside) > near
    inside = inside[apart]
    inside = inside[np.diff(inside, prepend=-np.inf) > near]
    return np.union1d(t, inside)


@dataclass(frozen=True)
class Given:
    """Inputs and signals at the samples, and the effects that remember them."""

    n_states: int
    t: Array  # times of the samples, (n_known,)
    inputs: Array  # (n_known, n_inputs)
    signals: Array  # (n_known, n_signals)
    linear: bool  # linear between the samples, else constant until the next one
    terms: Sequence[PlacedEffect]  # effects that remember an input or a signal

    def at(self, times: Array) -> tuple[Array, Array]:
        """Inputs and signals at some times."""
        if self.linear:
            both = np.empty((2, len(times), 0)), (self.inputs, self.signals)
            inputs, signals = (
                np.column_stack([none, *(np.interp(times, self.t, column) for column in values.T)])
                for none, values in zip(*both, strict=True)
            )
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
        inputs, signals = self.at(grid)
        held = np.column_stack([inputs, grid, signals])
        slope = np.diff(held, axis=0) / np.diff(grid)[:, None]
        going_on = np.zeros(held.shape[1])
        going_on[inputs.shape[1]] = 1.0  # time
        if not self.linear:
            slope = np.tile(going_on, (len(slope), 1))
        # coefficients of the parabola through three values of a column in each interval:
        # values = V (c0, c1 h, c2 h^2) with the Vandermonde matrix V of the places
        h = np.diff(grid)[:, None]
        places = np.array([SETTINGS.inside, 0.5, 1.0 - SETTINGS.inside])
        times = (grid[:-1, None] + h * places).ravel()
        values = self.columns(np.concatenate([grid[:1], times, grid[-1:]]))
        inside = values[1:-1].reshape(len(h), 3, values.shape[1])
        solved = np.linalg.inv(np.vander(places, increasing=True)) @ inside
        tabulated = solved[:, 0], solved[:, 1] / h, solved[:, 2] / h**2
        quadratics = [
            np.column_stack([held[:-1], tabulated[0]]),
            np.column_stack([slope, tabulated[1]]),
            np.column_stack([np.zeros_like(slope), tabulated[2]]),
        ]
        listed: list[Stretch] = [
            (float(end), partial(parabola, begin, *coefficients))
            for begin, end, *coefficients in zip(grid[:-1], grid[1:], *quadratics, strict=True)
        ]
        ends = values[-1]
        last, rest = np.concatenate([held[-1], ends]), np.append(going_on, np.zeros(len(ends)))
        return [*listed, (float(grid[-1]), partial(parabola, grid[-1], last, rest, 0.0))]
