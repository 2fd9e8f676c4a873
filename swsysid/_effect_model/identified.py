"""An automaton identified from recordings, and once more with what effects add to its laws.

Laws that lack an effect make a recording switch where it does not, and guards are found for that.
Once an effect is known, what it adds along the recordings is one more input of the laws. Guards are
then found among the states and inputs that the automaton itself has.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import PolynomialGuard, Transition
from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._automaton_search.guards import Crossed, best_guard
from swsysid._automaton_search.settings import SETTINGS
from swsysid._data.features import FeatureMap
from swsysid._data.records import Records
from swsysid._results import Array
from swsysid._simulation.stepping import runge_kutta

Rows = NDArray[np.intp]


def identified(
    estimator: HybridAutomatonRegressor, records: Records, added: Array | None = None
) -> HybridAutomaton | None:
    """The automaton of some records; None if what is `added` cannot be taken out of it again.

    `added` (n_modes, n_samples, n_states) is what effects add to the velocities.
    """
    states, inputs = np.split(records.X, [records.n_states], axis=1)
    beside = np.empty((len(records), 0)) if added is None else _columns(added)
    inputs = np.column_stack([inputs, beside])
    found = clone(estimator).fit(
        states, records.t, records.groups, inputs if inputs.shape[1] else None
    )
    automaton: HybridAutomaton = found.automaton_
    if not beside.shape[1]:
        return automaton
    return _Apart(found, replace(records, X=np.hstack([states, inputs])), beside.shape[1]).reduced()


def _columns(added: Array) -> Array:
    """Each different column of what is added in any mode."""
    flat = added.transpose(0, 2, 1).reshape(-1, added.shape[1])
    return np.unique(flat[flat.any(axis=1)], axis=0).T


class _Apart:
    """An automaton whose last inputs are what effects add."""

    def __init__(self, found: HybridAutomatonRegressor, records: Records, n_added: int):
        self.found, self.records = found, records
        self.automaton: HybridAutomaton = found.automaton_
        self.n_kept = records.X.shape[1] - n_added
        self.X = np.hstack([found.states_, records.X[:, records.n_states :]])

    def reduced(self) -> HybridAutomaton | None:
        """The automaton without these inputs."""
        own, names = self.automaton, self.automaton.feature_map.names_in[: self.n_kept]
        powers = own.feature_map.powers
        if powers is None:
            return None
        transitions = [self._transition(one) for one in own.transitions]
        kept = ~powers[:, self.n_kept :].any(axis=1)
        library = FeatureMap(self.found.feature_library, self.X[:, : self.n_kept], names)
        return HybridAutomaton(
            own.coef[:, :, kept],
            library,
            tuple(one for one in transitions if one is not None),
            first_modes=own.first_modes,
        )

    def _transition(self, one: Transition) -> Transition | None:
        """The same by a guard of the kept columns; None where none tells it."""
        columns = np.r_[: self.n_kept, -2:0]
        guard = one.guard
        if guard.powers[:, self.n_kept : -2].any():
            switches = [switch for switch in self._switches() if switch[:2] == self._pair(one)]
            if not switches:
                return None
            found = best_guard(self._crossed(one.source, switches), self.found.guard_degree)
            return None if found is None else replace(one, guard=found.guard)
        kept = PolynomialGuard(guard.coef, guard.powers[:, columns])
        return replace(one, guard=kept)

    @staticmethod
    def _pair(one: Transition) -> tuple[int, int]:
        return one.source, one.target

    def _switches(self) -> Iterator[tuple[int, int, Array, Array]]:
        """Modes before and after each switch, its columns in the mode before, and their rates."""
        t, modes = self.records.t, self.found.modes_
        assert t is not None
        for rows, instants in zip(self.records.trajectories, self.found.switch_times_, strict=True):
            entered = np.nan
            for instant in instants.tolist():
                place = int(np.searchsorted(t[rows], instant)) - 1
                if 0 <= place < len(rows) - 1:
                    before, after = rows[place], rows[place + 1]
                    source, target = int(modes[before]), int(modes[after])
                    clocks = np.array([instant - entered, instant])
                    yield source, target, *self._at(before, after, instant, source, clocks)
                entered = instant

    def _at(
        self, before: int, after: int, instant: float, mode: int, clocks: Array
    ) -> tuple[Array, Array]:
        """Columns, clocks included, at an instant between two samples, and their rates."""
        n, t = self.records.n_states, self.records.t
        assert t is not None
        u, slope = self.X[before, n:], self.X[after, n:] - self.X[before, n:]
        slope = slope / (t[after] - t[before])
        step = instant - t[before]
        x = runge_kutta(
            lambda x, part: self.automaton.velocity(x, u + part * step * slope, mode),
            self.X[before, :n],
            step,
        )
        here = u + step * slope
        rates = self.automaton.velocity(x, here, mode)
        return self._kept(x, here, clocks), self._kept(rates, slope, np.ones(2))

    def _kept(self, states: Array, inputs: Array, clocks: Array) -> Array:
        return np.concatenate([np.concatenate([states, inputs])[: self.n_kept], clocks])

    def _crossed(self, mode: int, switches: list[tuple[int, int, Array, Array]]) -> Crossed:
        """What a guard out of a mode is known by."""
        t = self.records.t
        assert t is not None
        columns, rates = (np.array(each) for each in list(zip(*switches, strict=True))[2:])
        below, below_rates = [], []
        for rows, instants in zip(self.records.trajectories, self.found.switch_times_, strict=True):
            since = np.concatenate([[np.nan], instants])
            entered = since[np.searchsorted(instants, t[rows], side="right")]
            for row, begin in zip(rows.tolist(), entered.tolist(), strict=True):
                if self.found.modes_[row] == mode:
                    x, u = np.split(self.X[row], [self.records.n_states])
                    below.append(self._kept(x, u, np.array([t[row] - begin, t[row]])))
                    velocity = self.automaton.velocity(x, u, mode)
                    below_rates.append(self._kept(velocity, 0.0 * u, np.ones(2)))
        interval = self.records.step
        errors = np.full(len(columns), SETTINGS.beyond * interval)
        signs = -np.ones(len(below))
        return Crossed(
            columns, rates, errors, np.array(below), np.array(below_rates), signs, interval
        )
