"""A model with effects beside it as formulas: laws with what the effects add, guards, resets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from swsysid._automaton.formulas import system_of as automaton_system
from swsysid._effect_model.declared import SwitchingLaws
from swsysid._effect_model.equations import NoAutomatonError, automaton_of_fit
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_model.simulation import n_signals
from swsysid._pipelines import steps_before
from swsysid._results import Array
from swsysid._simulation.inputs import trajectory_records
from swsysid.effects import MeasurementEffect, PlacedEffect, RateEffect
from swsysid.effects._memory import Lag
from swsysid.effects._placed import shaped
from swsysid.exporting import Expression, HybridSystem, NoFormulaError
from swsysid.exporting._expressions import as_expression, traced
from swsysid.exporting._features import combination


class _Row:
    """One row of formulas, as the columns of an effect ask for it."""

    def __init__(self, channels: Sequence[Expression]):
        self.channels, self.t = channels, Expression("time")

    def __len__(self) -> int:
        return 1

    def channel(self, number: int) -> Expression:
        return self.channels[number]


def system_of(fit: JointFit, names: Sequence[str]) -> HybridSystem:
    """Laws, effects and guards of a fit; `names` are those of the channels."""
    if fit.quantity is not None:
        raise NoFormulaError(
            f"the law gives {fit.quantity}, which is no rate of a state: there is no system to "
            "export; equations() has the law."
        )
    system = _declared(fit)
    n_states, n_columns = len(system.states), fit.laws.n_columns
    n_more = n_signals(fit.terms, n_columns)
    inputs = tuple(names[n_states : n_columns + n_more])
    system = replace(system, states=tuple(names[:n_states]), inputs=inputs)
    laws = [list(law) for law in system.laws]
    for term, coef in zip(fit.terms, fit.coef, strict=True):
        if isinstance(term.effect, MeasurementEffect):
            raise NoFormulaError(
                f"{term.effect.kind} of {term.label(names)} is one of a sensor or a clock, and "
                "formulas are those of the true states; export the model without it."
            )
        if isinstance(term.effect, Lag):
            system = _with_lag(system, term, names)
            laws = [[*law, system.laws[mode][-1]] for mode, law in enumerate(laws)]
        for mode, law in enumerate(laws):
            own = term.in_mode(coef, mode, fit.n_modes)
            if len(own):
                law[term.target] += combination(own, _columns(term, system, names))
    for term in fit.terms:
        if isinstance(term.effect, RateEffect):
            for law in laws:
                law[term.target] = _limited(term, law, system, names)
    system = replace(system, laws=tuple(map(tuple, laws)))
    if len(system.states) > n_states:  # with memories: the laws of the model have none
        return system
    return system.checked(lambda x, u, mode: _velocity(fit, x, u, mode))


def _declared(fit: JointFit) -> HybridSystem:
    """The system of the laws alone, with the guard and the resets of effects."""
    laws = fit.laws
    if isinstance(laws, SwitchingLaws):
        if steps_before(laws.estimator) is not None:
            raise NoFormulaError(
                "the laws see what the steps of a pipeline make of the states; declare the "
                "SwitchingSystemRegressor alone, with the steps in its feature_library."
            )
        if fit.guard is None and not laws.resets:
            return laws.switching.switching_model.to_hybrid_system()
    try:
        return automaton_system(automaton_of_fit(fit))
    except NoAutomatonError as error:
        raise NoFormulaError(str(error)) from None


def _columns(term: PlacedEffect, system: HybridSystem, names: Sequence[str]) -> list[Expression]:
    """The columns of an effect."""
    if isinstance(term.effect, Lag):
        return [Expression("x", (len(system.states) - 1,))]
    if "order" in term.effect.needs:
        raise NoFormulaError(
            f"{term.effect.kind} of {term.label(names)} remembers what was, and a formula of the "
            "present does not; export the model without it."
        )
    n_states = fitted_states(system)
    row = _Row([*system.columns[:n_states], *system.columns[len(system.states) :]])
    made: list[Expression] = []

    def columns(*_: Expression) -> float:
        given = term.effect.columns(row, term.place, *term.theta)  # type: ignore[arg-type]
        many = (
            given
            if isinstance(given, list)
            else np.ravel(given)
            if isinstance(given, np.ndarray)
            else [given]
        )
        made.extend(map(as_expression, many))
        return 0.0

    traced(columns, [], f"the effect {term.effect.kind} of {term.label(names)}")
    return made


def fitted_states(system: HybridSystem) -> int:
    """Number of states that are no memories of effects."""
    return sum(not name.startswith(_MEMORY) for name in system.states)


_MEMORY = "lag of "


def _with_lag(system: HybridSystem, term: PlacedEffect, names: Sequence[str]) -> HybridSystem:
    """With one state more: w' = (u - w) / time constant."""
    lagged, number = len(system.states), term.place - fitted_states(system)
    rate = (Expression("u", (number,)) - Expression("x", (lagged,))) / term.theta[0]
    edges = tuple(
        one if one.reset is None else replace(one, reset=(*one.reset, Expression("x", (lagged,))))
        for one in system.edges
    )
    return replace(
        system,
        states=(*system.states, f"{_MEMORY}{names[term.place]}"),
        laws=tuple((*law, rate) for law in system.laws),
        edges=edges,
        origin=(*system.origin, 0.0),
        sizes=(*system.sizes, 1.0),
    )


def _limited(
    term: PlacedEffect, law: Sequence[Expression], system: HybridSystem, names: Sequence[str]
) -> Expression:
    """The rate of a state as an effect of the whole of it leaves it."""
    effect = term.effect
    assert isinstance(effect, RateEffect)

    def rate(said: Expression, x: Expression) -> object:
        return effect.of_rate(said, x, term.place, *term.theta).rate  # type: ignore[arg-type]

    x = system.columns[term.target]
    return traced(rate, [law[term.target], x], f"the effect {effect.kind} of {term.label(names)}")


def _velocity(fit: JointFit, x: Array, u: Array, mode: int) -> Array:
    """The velocity in a mode as the model itself computes it, at the time zero."""
    n_inputs = fit.laws.n_columns - fit.n_states
    row = np.concatenate([x, u[:n_inputs]])[None]
    records = trajectory_records(row, fit.n_states, np.zeros(1), u[None, n_inputs:])
    velocity = fit.laws.coef[mode] @ fit.laws.feature_map.at(row[0])
    for term, coef in zip(fit.terms, fit.coef, strict=True):
        own = term.in_mode(coef, mode, fit.n_modes)
        if len(own):
            velocity[term.target] += term.columns(records)[-1] @ own
    return shaped(fit.terms, velocity, x)
