"""What a user may declare, and how each answers as a declared model.

A regressor of velocities (perhaps in a pipeline) is fitted with the effects. An identifier of
recordings stands for the model that it looks for: that of an automaton is identified once, in the
record, and is a declared automaton from then on.

The laws of an automaton keep the terms that they have; the coefficients of these are fitted with
the effects. Its transitions stay as they are. Which modes a recording goes through is told once, by
laws and guards, before an effect is looked for. One that is identified is so once more with what
effects add to its laws: laws that lack an effect make a recording switch where it does not, and
guards are found for that. Once an effect is known, what it adds along the recordings is one more
input of the laws, not of guards.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import singledispatch

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone

from swsysid._automaton.equations import transition_equation
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import PolynomialGuard, Transition, guard_of
from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._checks.parameters import shown
from swsysid._data.features import FeatureMap
from swsysid._data.records import Records, next_states
from swsysid._effect_model.declared import (
    Added,
    Declared,
    DeclaredSwitching,
    FittedDeclared,
    FittedLaws,
    Modes,
    SwitchingLaws,
)
from swsysid._effect_model.decoding import decoded, modes_of_velocities
from swsysid._known.known import Known, both_known, check_known
from swsysid._noise import robust_regression
from swsysid._pipelines import seeded, steps_before, switching_step, with_parameters
from swsysid._results import Array
from swsysid._stays.search import check_estimator
from swsysid._trajectory_identifier import TrajectoryIdentifier
from swsysid.effects import Effect, GuardEffect, StructureEffect

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class DeclaredAutomaton(Declared):
    """An automaton whose laws are fitted in given modes."""

    automaton: HybridAutomaton
    identifier: HybridAutomatonRegressor | None = None  # by which it has been found

    def __post_init__(self):
        if self.automaton.lags:
            raise ValueError(
                f"the automaton has lags={self.automaton.lags}, and effects stand beside laws of "
                "the present row alone; declare one without lags, its past rows as inputs."
            )

    @property
    def n_modes(self) -> int:
        return self.automaton.n_modes

    @property
    def discrete_time(self) -> bool:
        return self.automaton.discrete_time

    @property
    def known(self) -> HybridAutomaton:
        return self.automaton

    def extended(self, effect: StructureEffect) -> DeclaredAutomaton:
        raise ValueError(f"an automaton has the modes that it has; leave {effect.kind!r} out.")

    def anew(self, records: Records, added: Array) -> DeclaredAutomaton | None:
        if self.identifier is None or self.discrete_time:
            return None
        found = identified(self.identifier, records, added)
        return None if found is None else replace(self, automaton=found)

    def refuses(self, effect: Effect) -> str | None:
        if isinstance(effect, (GuardEffect, StructureEffect)):
            return "the modes and guards of an automaton are declared"
        return None

    def library(self, X: Array) -> Array:
        return self.automaton.feature_map(X)

    def support(self, n_modes: int, n_states: int, n_features: int) -> NDArray[np.bool_]:
        return np.asarray(self.automaton.coef != 0.0)

    def fitted(self, records: Records, targets: Array, modes: Modes | None) -> FittedDeclared:
        modes = self._decoded_modes(records) if modes is None else modes
        features, coef = self.library(records.X), self.automaton.coef.copy()
        for mode, state in np.ndindex(coef.shape[:2]):
            rows, terms = modes == mode, coef[mode, state] != 0.0
            if rows.sum() >= terms.sum() > 0:  # a law of few rows stays as it was
                design = features[np.ix_(rows, terms)]
                coef[mode, state, terms] = robust_regression(design, targets[rows, state])
        return FittedDeclared(replace(self.automaton, coef=coef), modes)

    def sought(self, columns: Array, records: Records, targets: Array) -> Modes:
        return self._decoded_modes(records)

    @staticmethod
    def _decoded_modes(records: Records) -> Modes:
        assert records.decoded_modes is not None, "the rows of a fit have modes"
        return records.decoded_modes


@dataclass(frozen=True)
class AutomatonLaws(FittedLaws):
    """Those of an automaton, whose guards tell where recordings change the mode."""

    automaton: HybridAutomaton

    @property
    def coef(self) -> Array:
        return self.automaton.coef

    @property
    def support(self) -> NDArray[np.bool_]:
        return np.asarray(self.automaton.coef != 0.0)

    @property
    def feature_map(self) -> FeatureMap:
        return self.automaton.feature_map

    @property
    def discrete_time(self) -> bool:
        return self.automaton.discrete_time

    @property
    def resets(self) -> frozenset[tuple[int, int]]:
        listed = self.automaton.transitions
        return frozenset((one.source, one.target) for one in listed if one.reset is not None)

    @property
    def n_columns(self) -> int:
        return self.automaton.n_states + self.automaton.n_inputs

    def seen(self, X: Array) -> Array:
        return X

    def modes(self, records: Records, added: Added) -> Modes:
        if records.decoded_modes is not None:
            return _filled(records.decoded_modes, records.trajectories)
        if records.t is None:
            raise ValueError(
                "the modes of an automaton are those of recordings; give t (and groups, if there "
                "are several)."
            )
        if self.discrete_time:
            rows, targets = next_states(records)
            decoded_rows = np.full(len(records), -1)
            decoded_rows[rows] = modes_of_velocities(self, records, targets, added)[rows]
            return _filled(decoded_rows, records.trajectories)
        return decoded(self, records, records.X, added).modes

    def probabilities(self, records: Records) -> Array:
        decoded_rows = self.allowed(records.X)
        if records.decoded_modes is not None:
            known = records.decoded_modes >= 0
            decoded_rows[known] = np.eye(self.automaton.n_modes)[records.decoded_modes[known]]
        return decoded_rows

    def with_surface_between(self, X: Array, modes: Modes) -> object:
        """The automaton itself, whose guards stay."""
        return self.automaton

    def allowed(self, X: Array) -> Array:
        """Alike for all modes that no guard without a clock has left behind."""
        possible = np.ones((len(X), self.automaton.n_modes))
        columns = np.column_stack([X, np.zeros((len(X), 2))])
        for one in self.automaton.transitions:
            if one.source != one.target and not _has_clock(one):
                possible[one.guard.values(columns) > 0.0, one.source] = 0.0
        possible[~possible.any(axis=1)] = 1.0
        return np.asarray(possible / possible.sum(axis=1, keepdims=True))

    def column_names(self, names: Sequence[str]) -> list[str]:
        return list(names[: self.automaton.n_states + self.automaton.n_inputs])

    def guard_equations(self, names: Sequence[str], precision: int, style: str) -> list[str]:
        automaton = self.automaton
        columns = [*self.column_names(names), *automaton.guard_columns[-2:]]
        return [
            transition_equation(one, columns, columns[: automaton.n_states], precision, style)
            for one in automaton.transitions
        ]


def _has_clock(transition: Transition) -> bool:
    return any(one.powers[:, -2:].any() for one in transition.guard.conditions)


def _filled(modes: Modes, trajectories: Sequence[NDArray[np.intp]]) -> Modes:
    """Modes of all rows: one that is not known is that of the nearest row before, or after."""
    filled = np.zeros_like(modes)
    for rows in trajectories:
        known = np.flatnonzero(modes[rows] >= 0)
        if len(known):
            indices = np.searchsorted(known, np.arange(len(rows)), side="right") - 1
            filled[rows] = modes[rows][known[np.maximum(indices, 0)]]
    return filled


def identified(
    estimator: HybridAutomatonRegressor, records: Records, added: Array | None = None
) -> HybridAutomaton | None:
    """The automaton of some records; None if what is `added` cannot be taken out of it again.

    `added` (n_modes, n_samples, n_states) is what effects add to the velocities: further inputs of
    the laws, of which guards are not made.
    """
    states, inputs = np.split(records.X, [records.n_states], axis=1)
    columns = np.empty((len(records), 0)) if added is None else _columns(added)
    inputs, found = np.column_stack([inputs, columns]), clone(estimator)
    found.unguarded_inputs = columns.shape[1]
    found.fit(states, records.t, records.groups, inputs if inputs.shape[1] else None)
    automaton: HybridAutomaton = found.automaton_
    powers, n_kept = automaton.feature_map.powers, records.X.shape[1]
    if not columns.shape[1]:
        return automaton
    if powers is None:
        return None
    X = np.hstack([found.states_, records.X[:, records.n_states :]])
    library = FeatureMap(found.feature_library, X, automaton.feature_map.names_in[:n_kept])
    return replace(
        automaton,
        coef=automaton.coef[:, :, ~powers[:, n_kept:].any(axis=1)],
        feature_map=library,
        transitions=tuple(_among(one, n_kept) for one in automaton.transitions),
    )


def _columns(added: Array) -> Array:
    """Each different column of what is added in any mode."""
    flat = added.transpose(0, 2, 1).reshape(-1, added.shape[1])
    return np.unique(flat[flat.any(axis=1)], axis=0).T


def _among(one: Transition, n_kept: int) -> Transition:
    """The same of the first columns and the clocks."""
    kept = np.r_[:n_kept, -2:0]
    parts = [PolynomialGuard(part.coef, part.powers[:, kept]) for part in one.guard.conditions]
    return replace(one, guard=guard_of(parts))


@singledispatch
def declared_model(estimator: object, records: Records) -> Declared:
    """The declared model that an estimator is, for some records."""
    check_declared(estimator)
    assert isinstance(estimator, BaseEstimator)
    known = None
    if steps_before(estimator) is None:  # which would give other columns
        known = check_known(switching_step(estimator)[1].get_params(deep=False).get("known"))
    return _declared_switching(estimator, known, records)


@declared_model.register
def _(estimator: TrajectoryIdentifier, records: Records) -> Declared:
    regressor = check_estimator(estimator.estimator)
    known = both_known(check_known(regressor.known), check_known(estimator.known))
    return _declared_switching(regressor, known, records)


def _declared_switching(
    estimator: BaseEstimator, known: Known | None, records: Records
) -> DeclaredSwitching:
    """With what is known of the columns as they are called in the records."""
    if known is not None:
        known = known.of_columns(known.columns or records.names[: records.X.shape[1]])
        estimator = with_parameters(estimator, known=known)
    return DeclaredSwitching(estimator)


@declared_model.register
def _(estimator: HybridAutomaton, records: Records) -> Declared:
    declared, given = (estimator.n_states, estimator.n_inputs), (records.n_states, records.n_inputs)
    if declared != given:
        raise ValueError(
            f"the automaton has {declared[0]} states and {declared[1]} inputs and the recordings "
            f"{given[0]} and {given[1]}; give the columns that it is stated for."
        )
    return DeclaredAutomaton(estimator)


@declared_model.register
def _(estimator: HybridAutomatonRegressor, records: Records) -> Declared:
    if records.t is None:
        raise ValueError(
            "an automaton is identified from recordings; give t (and groups, if there are several)."
        )
    found = identified(estimator, records)
    assert found is not None
    return DeclaredAutomaton(found, estimator)


def check_declared(estimator: object) -> None:
    """Refuse what is no declared model, and one that is a class."""
    if isinstance(estimator, type) or not _is_known(estimator):
        raise TypeError(
            f"estimator={shown(estimator)} must be a SwitchingSystemRegressor or a pipeline "
            "that ends in one, a TrajectoryIdentifier, a HybridAutomatonRegressor or a "
            "HybridAutomaton."
        )
    if isinstance(estimator, TrajectoryIdentifier) and (
        estimator.order != 1 or estimator.observed is not None
    ):
        raise ValueError(
            "effects are looked for where all states are measured; declare a TrajectoryIdentifier "
            "of order 1 without observed, or of positions alone give X and Xdot of "
            "differentiate(x, t, order=2) beside its regressor."
        )
    if isinstance(estimator, HybridAutomatonRegressor) and estimator.order != 1:
        raise ValueError(
            "effects are looked for where all states are measured; declare an automaton of order 1 "
            "and give X and Xdot of differentiate(x, t, order=2)."
        )
    if isinstance(estimator, HybridAutomatonRegressor) and estimator.lags != 0:
        raise ValueError(
            f"lags={estimator.lags!r}: effects stand beside laws of the present row alone; declare "
            "an automaton without lags, with its past rows as inputs."
        )


def _is_known(estimator: object) -> bool:
    if declared_model.dispatch(type(estimator)) is not declared_model.dispatch(object):
        return True
    regressor = switching_step(estimator)[1]
    return not isinstance(regressor, type) and hasattr(regressor, "mode_velocities")


@singledispatch
def laws_of(estimator: object) -> FittedLaws:
    """The laws of a fitted declared model."""
    assert isinstance(estimator, BaseEstimator)
    return SwitchingLaws(estimator)


@laws_of.register
def _(estimator: HybridAutomaton) -> FittedLaws:
    return AutomatonLaws(estimator)


def with_seed(estimator: object, seed: int | np.random.RandomState) -> object:
    """A copy in which everything random that has no seed has this one."""
    return seeded(estimator, seed) if isinstance(estimator, BaseEstimator) else estimator


def unfitted(estimator: object) -> object:
    """A copy that has not been fitted; an automaton is what it is."""
    return clone(estimator) if isinstance(estimator, BaseEstimator) else estimator
