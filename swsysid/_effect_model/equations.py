"""Laws and guards of a model with effects beside it: text, a hybrid automaton, and formulas.

Surfaces become guards. A guard that remembers has one guard for each direction, and a jump of the
state is a reset of the transition at which it happens.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.equations import system_of as automaton_system
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import AffineReset, PolynomialGuard, Transition
from swsysid._effect_model.declared import SwitchingLaws
from swsysid._effect_model.joint_fit import JointFit
from swsysid._pipelines import steps_before
from swsysid._results import Array
from swsysid._simulation.inputs import trajectory_records
from swsysid._simulation.model import SwitchingModel, law_equations
from swsysid._surfaces.surface import has_monomials
from swsysid.effects import (
    GuardEffect,
    MeasurementEffect,
    PlacedEffect,
    RateEffect,
    ResetEffect,
)
from swsysid.effects._memory import Lag
from swsysid.effects._placed import n_signals, shaped
from swsysid.effects._types import Crossing, WithoutColumns
from swsysid.exporting import Expression, HybridSystem, NoFormulaError
from swsysid.exporting._expressions import as_expression, traced
from swsysid.exporting._features import combination


def laws_with_effects(fit: JointFit, names: Sequence[str], precision: int, style: str) -> list[str]:
    """The law of every mode with the effects' terms, what becomes of rates and what sensors do."""
    # `names` are those of the channels, `style` is "text" or "latex".

    def added(mode: int, state: int) -> Iterator[tuple[float, str, float]]:
        for term, coef in zip(fit.terms, fit.coef, strict=True):
            if term.target == state:
                own = term.in_mode(coef, mode, fit.n_modes)
                written = term.effect.written(term.label(names), term.theta, own)
                # whatever its size: it would not have been found if it were negligible
                yield from ((value, name, np.inf) for value, name in written)

    own = fit.laws
    laws = law_equations(
        own.coef,
        own.feature_map,
        precision,
        style,
        discrete_time=own.discrete_time,
        states=names if fit.quantity is None else (fit.quantity,),
        static=fit.quantity is not None,
        columns=own.column_names(names),
        added=added,
    )
    return laws + _statements(fit, names, style, of_laws=True)


def guards_with_effects(
    fit: JointFit, names: Sequence[str], precision: int, style: str
) -> list[str]:
    """The surfaces, or the guard with memory in their place; then what happens at them."""
    statements = _statements(fit, names, style, of_laws=False)
    if fit.guard is not None:
        return statements
    return fit.laws.guard_equations(names, precision, style) + statements


def _statements(fit: JointFit, names: Sequence[str], style: str, *, of_laws: bool) -> list[str]:
    """Effects without columns: those of rates and sensors, or those of guards and modes."""
    texts = [
        term.effect.statement(term.place, names, term.target, *term.theta)
        for term in fit.terms
        if isinstance(term.effect, WithoutColumns)
        and isinstance(term.effect, (MeasurementEffect, RateEffect)) == of_laws
    ]
    texts = [text for text in texts if text]
    if style == "latex":
        return [rf"\text{{{text}}}".replace("_", r"\_") for text in texts]
    return texts


class NoAutomatonError(ValueError):
    """A fit cannot be written as an automaton; the message says why."""


def automaton_of_fit(fit: JointFit) -> HybridAutomaton:
    """The laws of the declared model and its transitions, with hysteresis and resets of effects."""
    laws = fit.laws
    if isinstance(laws, SwitchingLaws):
        automaton = _of_switching(fit, laws)
    else:
        assert laws.automaton is not None
        automaton = laws.automaton
    resets = [term for term in fit.terms if isinstance(term.effect, ResetEffect)]
    n_states = automaton.n_states
    return HybridAutomaton(
        automaton.coef,
        automaton.feature_map,
        tuple(_with_resets(one, resets, n_states) for one in automaton.transitions),
        automaton.discrete_time,
        automaton.lags,
        automaton.first_modes,
    )


def _of_switching(fit: JointFit, laws: SwitchingLaws) -> HybridAutomaton:
    if steps_before(laws.estimator) is not None:
        raise NoAutomatonError(
            "the laws see what the steps of a pipeline make of the states; declare a "
            "SwitchingSystemRegressor alone to have an automaton."
        )
    model = laws.switching.switching_model
    crossings = _of_surfaces(model) if fit.guard is None else _of_guard(fit.guard, laws.n_columns)
    return HybridAutomaton(
        model.coef, model.feature_map, tuple(map(_transition, crossings)), model.discrete_time
    )


def _of_guard(guard: PlacedEffect, n_columns: int) -> Sequence[Crossing]:
    assert isinstance(guard.effect, GuardEffect)
    crossings = guard.effect.crossings(guard.place, n_columns, *guard.theta)
    if not crossings:
        raise NoAutomatonError(
            f"the effect {guard.effect.kind!r} has no polynomials as guards; give its class "
            "`crossings` to have an automaton."
        )
    return crossings


def _of_surfaces(model: SwitchingModel) -> list[Crossing]:
    """Each mode is left where one of its surfaces changes sign."""
    surface = model.surface
    if len(model.coef) == 1:
        return []
    if not has_monomials(surface) or surface.powers is None:
        raise NoAutomatonError(
            "the surface between the modes is no polynomial; use PolynomialSurfaceClassifier as "
            "surface, of a degree, to have an automaton."
        )
    crossings, book = [], surface.mode_book_
    for row, number in np.ndindex(book.shape):
        behind = book[row].copy()
        behind[number] *= -1
        others = np.flatnonzero((book == behind).all(axis=1))
        if not len(others) or not book.all():
            raise NoAutomatonError(
                "behind a surface of some mode there is no mode of its own, so that an automaton "
                "would not know where it leads; declare two modes."
            )
        source, target = (int(surface.classes_[place]) for place in (row, others[0]))
        leaving = -float(book[row, number]) * surface.coef_[number]
        crossings.append(Crossing(source, target, leaving, surface.powers))
    return crossings


def _transition(crossing: Crossing) -> Transition:
    """Guards have columns for the two clocks as well."""
    clocks: NDArray[np.intp] = np.zeros((len(crossing.powers), 2), dtype=np.intp)
    powers = np.hstack([crossing.powers, clocks])
    return Transition(crossing.source, crossing.target, PolynomialGuard(crossing.coef, powers))


def _with_resets(
    transition: Transition, resets: Sequence[PlacedEffect], n_states: int
) -> Transition:
    """The transition with the jumps of states that happen at it."""
    own = [term for term in resets if term.place == (transition.source, transition.target)]
    if not own:
        return transition
    factors: Array = np.ones(n_states)
    for term in own:
        assert isinstance(term.effect, ResetEffect)
        factors[term.target] *= term.effect.factor(*term.theta)
    before = transition.reset
    matrix, offset = np.diag(factors), np.zeros(n_states)
    if before is not None:
        matrix, offset = matrix @ before.matrix, matrix @ before.offset
    return Transition(
        transition.source,
        transition.target,
        transition.guard,
        AffineReset(matrix, offset),
        transition.support,
    )


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
