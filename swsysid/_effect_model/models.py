"""What a user may declare, and how each answers as a declared model.

A regressor of velocities (perhaps in a pipeline) is fitted with the effects. An identifier of
recordings stands for the model that it looks for: that of an automaton is identified once, in the
record, and is a declared automaton from then on.
"""

from __future__ import annotations

from functools import singledispatch

import numpy as np
from sklearn.base import BaseEstimator, clone

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._checks.parameters import shown
from swsysid._data.records import Records
from swsysid._effect_model.automata import AutomatonLaws, DeclaredAutomaton, identified
from swsysid._effect_model.declared import (
    Declared,
    DeclaredSwitching,
    FittedLaws,
    SwitchingLaws,
)
from swsysid._pipelines import seeded, switching_step
from swsysid._stays.search import check_estimator
from swsysid._trajectory_identifier import TrajectoryIdentifier


@singledispatch
def declared_model(estimator: object, records: Records) -> Declared:
    """The declared model that an estimator is, for some records."""
    check_declared(estimator)
    assert isinstance(estimator, BaseEstimator)
    return DeclaredSwitching(estimator)


@declared_model.register
def _(estimator: TrajectoryIdentifier, records: Records) -> Declared:
    return DeclaredSwitching(check_estimator(estimator.estimator))


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
