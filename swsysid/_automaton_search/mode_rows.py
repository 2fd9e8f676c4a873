"""Rows of recordings in discrete time by their modes: when each mode is entered, and from where.

The mode at row k makes x[k + 1]. A transition that is taken at row k had a guard below zero at row
k - 1 and has one that is not at row k. Where the state jumps, row k holds what the reset made; what
the old law made of row k - 1 is what it, and the guard, were given.

With lags a transition may reset the *whole* lagged state: x[k] goes on, and older rows become what
the new law asks for, which then makes x[k + 1], ..., x[k + lags] of rows that nobody has measured.
A motion sampled in x alone does that wherever its law switches, for its speed goes on.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.conditions import Exits
from swsysid._automaton_search.found import FoundTransition
from swsysid._automaton_search.settings import SETTINGS
from swsysid._discrete_stays.identify import DiscreteStays
from swsysid._results import Array
from swsysid._stays.given import Given


@dataclass(frozen=True)
class Taken:
    """Transitions that were taken, one row for each."""

    rows: NDArray[np.intp]
    recording: NDArray[np.intp]
    source: NDArray[np.intp]
    target: NDArray[np.intp]
    times: Array
    jumped: NDArray[np.bool_]
    last: Array  # (n_taken, n_columns): columns at the row before, as early as it may have been
    given: Array  # what guard and reset were given, as late as it may have been
    after: Array  # (n_taken, n_lagged)
    asked: NDArray[np.bool_]  # whether guards were asked at the row before

    def __len__(self) -> int:
        return len(self.times)

    def take(self, rows: NDArray[np.bool_]) -> Taken:
        """Some of them."""
        return Taken(*(part[rows] for part in vars(self).values()))


@dataclass(frozen=True)
class ModeRows:
    """Rows with their modes; one that no law explains belongs to the stay before it.

    Unless the transition to the stay after it is one that resets the `whole` lagged state.
    """

    stays: DiscreteStays
    given: Given
    whole: frozenset[tuple[int, int]] = frozenset()

    @cached_property
    def modes(self) -> NDArray[np.intp]:
        """Mode of every row."""
        modes = self._modes_before.copy()
        for first, last in self._made_anew:
            modes[first : last + 1] = modes[last + 1]
        return modes

    @cached_property
    def _modes_before(self) -> NDArray[np.intp]:
        modes = self.stays.modes.copy()
        for k in np.flatnonzero(self.stays.straddling & ~self.stays.rows.begins):
            modes[k] = modes[k - 1]
        return modes

    @cached_property
    def _made_anew(self) -> list[tuple[int, int]]:
        """First and last of the rows that were made of others than those measured."""
        rows, modes, straddling = self.stays.rows, self._modes_before, self.stays.straddling
        parts = np.flatnonzero(np.diff(np.concatenate([[False], straddling, [False]])))
        runs = [(int(first), int(end) - 1) for first, end in parts.reshape(-1, 2)]
        return [
            (first, last)
            for first, last in runs
            if last - first < rows.lags
            and first + rows.lags < len(rows)
            and not rows.begins[first : first + rows.lags + 1].any()
            and (modes[first - 1], modes[last + 1]) in self.whole
        ]

    def is_whole(self, taken: Taken) -> bool:
        """Whether the transition that was taken resets the whole lagged state."""
        return (int(taken.source[0]), int(taken.target[0])) in self.whole

    @property
    def n_made_anew(self) -> int:
        """How many rows these are, but for one of each transition."""
        return sum(last - first for first, last in self._made_anew)

    @cached_property
    def columns(self) -> Array:
        """Lagged states without noise, inputs, steps since their mode was entered, and the step.

        The steps are NaN where a recording begins in the mode.
        """
        stays, rows = self.stays, self.stays.rows
        lagged = [
            [stays.states[r][k - lag] for lag in range(rows.lags + 1)]
            for r, k in zip(rows.recording, rows.sample, strict=True)
        ]
        inputs = rows.columns[:, self.n_lagged :]
        dwell, since = np.empty(len(rows)), np.nan
        for k, (begins, enters) in enumerate(zip(rows.begins, self._entered, strict=True)):
            since = np.nan if begins else 0.0 if enters else since + 1.0
            dwell[k] = since
        states = np.reshape(lagged, (len(rows), -1))
        return np.column_stack([states, inputs, dwell, rows.sample.astype(float)])

    @property
    def n_lagged(self) -> int:
        """Number of the columns that are states."""
        return self.stays.rows.n_states * (self.stays.rows.lags + 1)

    @cached_property
    def taken(self) -> Taken:
        """All transitions between rows."""
        rows, n_states = self.stays.rows, self.stays.rows.n_states
        at = np.flatnonzero(self._entered)
        before = at - 1
        jumped, anew = self.stays.straddling[before], np.isin(at, [k for k, _ in self._made_anew])
        early, late = at - self._around[0], at + self._around[1]
        reached = self.columns[late].copy()
        # the mode is still the old one
        reached[:, -2] = self.columns[before, -2] + 1.0 + self._around[1]
        reached[jumped, :n_states] = self._made(before[jumped])
        after = self.columns[at, : self.n_lagged].copy()
        if anew.any():
            after[anew, n_states:] = self.older(at[anew], self.modes[at[anew]])[0]
        times = [self.given.records[r].t[k] for r, k in zip(rows.recording[at], rows.sample[at],
                                                            strict=True)]  # fmt: skip
        return Taken(
            at, rows.recording[at], self.modes[before], self.modes[at], np.array(times),
            jumped | anew, self.columns[early - 1], reached, after, ~self._passed[before],
        )  # fmt: skip

    @cached_property
    def _around(self) -> NDArray[np.intp]:
        r"""Rows before and after each switch between which its law has surely changed, (2, n).

        A state with noise :math:`\sigma` of the sensor and :math:`\rho \sigma` in the equation is
        known from its past, or its future, with the variance :math:`\sigma^2 (\rho^2 + \rho
        \sqrt{\rho^2 + 4}) / 2`; both differ by what the laws do at every row. None where that is
        no more than a guard may be off by. No stay has less than a row that is its own.
        """
        at, states = np.flatnonzero(self._entered), self.stays.searched.found.states
        if states is None or not len(at):
            return np.zeros((2, len(at)), dtype=np.intp)
        stays, edges = self.stays, np.flatnonzero(self._entered | self.stays.rows.begins)
        features = stays.feature_map(self.columns[at, :-2])
        laws = stays.coef[self.modes[at]] - stays.coef[self.modes[at - 1]]
        apart = np.einsum("kij,kj->ki", laws, features) / stays.noise
        known = states.tie * (states.tie + np.sqrt(np.square(states.tie) + 4.0))
        rows = SETTINGS.far_miss / np.sqrt((np.square(apart) / known).sum(axis=1))
        rows[stays.straddling[at - 1] | (rows <= SETTINGS.near)] = 0.0
        place = np.searchsorted(edges, at)
        room = np.array([at - edges[place - 1], np.append(edges, len(self.modes))[place + 1] - at])
        return np.minimum(rows, (room - 1) // 2).astype(np.intp)

    @cached_property
    def _is_sure(self) -> NDArray[np.bool_]:
        """True at rows of a mode that are no straddling ones, nor within those around a switch."""
        sure = ~self.stays.straddling
        for at, before, after in zip(np.flatnonzero(self._entered), *self._around, strict=True):
            sure[at - before : at + after] = False
        return sure

    def older(self, at: NDArray[np.intp], modes: NDArray[np.intp]) -> tuple[Array, Array]:
        """Older rows that laws ask for from some rows on, (n_at, lags * n_states).

        And by how much the states that the laws make then change with them, (n_at, lags * n_states,
        lags * n_states). Laws are affine in them.
        """
        rows, n = self.stays.rows, self.stays.rows.n_states
        lags, size = rows.lags, rows.n_states * rows.lags
        steps = at[:, None] + np.arange(lags)
        columns = self.columns[steps][:, :, :-2]

        def made(older: Array) -> Array:
            seen = columns.copy()
            for step in range(lags):  # of which so many are measured by then
                seen[:, step, (1 + step) * n : (1 + lags) * n] = older[:, : (lags - step) * n]
            features = self.stays.feature_map(seen.reshape(-1, seen.shape[2]))
            features = features.reshape(len(at), lags, -1)
            return np.einsum("kij,ksj->ksi", self.stays.coef[modes], features).reshape(-1, size)

        states = self.stays.states
        reached = [
            [states[r][k + 1] for r, k in zip(rows.recording[own], rows.sample[own], strict=True)]
            for own in steps
        ]
        measured = columns[:, 0, n : (1 + lags) * n]
        by_measured = made(measured)
        slopes = [made(measured + unit) - by_measured for unit in np.eye(size)]
        change = np.stack(slopes, axis=2).reshape(len(at), size, size)
        missing = np.reshape(reached, (len(at), size)) - by_measured
        # what no law sees goes on
        return measured + np.matmul(np.linalg.pinv(change), missing[:, :, None])[:, :, 0], change

    def left_before(self, taken: Taken) -> Array:
        """What the old law leaves of rows before the one that jumps, (n_taken, lags - 1 states)."""
        rows, n = self.stays.rows, self.stays.rows.n_states
        before = taken.rows[:, None] - np.arange(2, rows.lags + 1)
        left = rows.targets[before] - self._made(before.ravel()).reshape(*before.shape, n)
        own = (before >= 0) & (rows.recording[before] == taken.recording[:, None])
        some = own & self.stays.straddling[before]
        return np.where(some[:, :, None], left, 0.0).reshape(len(before), -1)

    def agreements(self, pair: tuple[int, int], degree: int) -> list[PolynomialGuard]:
        """Surfaces of no higher degree at which two laws agree in a state, of polynomial laws."""
        feature_map, coef = self.stays.feature_map, self.stays.coef
        if feature_map.powers is None or pair[0] == pair[1]:
            return []
        apart, surfaces = coef[pair[1]] - coef[pair[0]], []
        sizes = np.abs(apart) * np.where(feature_map.sizes > 0.0, feature_map.sizes, 1.0)
        for own, size in zip(apart, sizes, strict=True):
            kept = size > SETTINGS.exact * size.max()
            if kept.any() and feature_map.powers[kept].sum(axis=1).max() <= degree:
                wide = np.pad(feature_map.powers[kept], ((0, 0), (0, len(CLOCKS))))
                surfaces.append(PolynomialGuard(own[kept], wide.astype(np.intp)))
        return surfaces

    def inside(self, mode: int) -> Array:
        """Columns at the rows of a mode at which its guards were asked."""
        return self.columns[self._asked(mode)]

    def _asked(self, mode: int) -> NDArray[np.bool_]:
        return (self.modes == mode) & self._is_sure & ~self._passed

    @cached_property
    def _passed(self) -> NDArray[np.bool_]:
        """Rows at which a mode is entered to be left at the next one.

        One transition is taken at a sample: a mode may be entered beyond the guard that leaves it.
        """
        return self._entered & np.append(self._entered[1:], False)

    def exits(self, mode: int) -> Exits:
        """The stays in a mode, with the row at which each is left."""
        inside = self._asked(mode)
        number = np.cumsum(self._entered | self.stays.rows.begins, dtype=np.intp)
        taken = self.taken.take(self.taken.source == mode)
        left = number[taken.rows - 1]
        return Exits.of(self.columns[inside], number[inside], left, taken.given, taken.target)

    def with_ends(
        self, found: Sequence[FoundTransition]
    ) -> tuple[list[NDArray[np.intp]], list[FoundTransition]]:
        """Modes of all samples, and transitions with those at the end of a recording.

        The mode of a sample is that of its row, of the nearest row before, or of the first one. The
        last sample of a recording has no law to tell its mode: the guards do.
        """
        modes, ended = self._by_samples(), list(found)
        for k, columns in self._ends():
            source = modes[k][-1]
            taken = [place for place, one in enumerate(ended) if one.source == source
                     and one.guard is not None and one.guard.whole.at(columns) >= 0.0]  # fmt: skip
            if taken:
                one = ended[taken[0]]
                modes[k][-1] = one.target
                ended[taken[0]] = replace(
                    one,
                    recording=np.append(one.recording, k),
                    times=np.append(one.times, self.given.records[k].t[-1]),
                )
        return modes, ended

    @cached_property
    def _entered(self) -> NDArray[np.bool_]:
        """True at rows whose mode was entered there: another one than before, or after a jump."""
        rows, modes, straddling = self.stays.rows, self.modes, self.stays.straddling
        entered = np.zeros(len(rows), dtype=bool)
        entered[1:] = (modes[1:] != modes[:-1]) | (straddling[:-1] & ~straddling[1:])
        for first, last in self._made_anew:
            entered[first], entered[last + 1] = True, False
        return entered & ~rows.begins

    def _made(self, rows: NDArray[np.intp]) -> Array:
        """What the laws of some rows make of them."""
        features = self.stays.feature_map(self.columns[rows, :-2])
        return np.einsum("kij,kj->ki", self.stays.coef[self.modes[rows]], features)

    def _by_samples(self) -> list[NDArray[np.intp]]:
        modes = []
        for k, record in enumerate(self.given.records):
            own = np.flatnonzero(self.stays.rows.recording == k)
            samples = self.stays.rows.sample[own]
            if not len(own):
                modes.append(np.zeros(len(record.t), dtype=np.intp))
                continue
            last = np.searchsorted(samples, np.arange(len(record.t)), side="right") - 1
            modes.append(self.modes[own][np.maximum(last, 0)])
        return modes

    def _ends(self) -> list[tuple[int, Array]]:
        """Recordings whose last sample follows a row, and what the guards are given there."""
        rows, ends = self.stays.rows, []
        for k, record in enumerate(self.given.records):
            own = np.flatnonzero(rows.recording == k)
            if len(own) and rows.sample[own[-1]] == len(record.t) - 2:
                last = own[-1:]
                made = self.stays.states[k][-1]
                if self.stays.straddling[last[0]]:
                    made = self._made(last)[0]
                lagged = np.concatenate([made, self.columns[last[0], : self.n_lagged]])
                u = record.u[::-1][: rows.lags + 1].ravel()
                clocks = self.columns[last[0], -2:] + 1.0
                ends.append((k, np.concatenate([lagged[: self.n_lagged], u, clocks])))
        return ends
