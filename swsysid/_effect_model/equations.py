"""The laws and guards of a model with effects beside it, as text and as a hybrid automaton.

Surfaces become guards. A guard that remembers has one guard for each direction, and a jump of the
state is a reset of the transition at which it happens.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import AffineReset, PolynomialGuard, Transition
from swsysid._effect_model.declared import SwitchingLaws
from swsysid._effect_model.joint_fit import JointFit
from swsysid._pipelines import steps_before
from swsysid._results import Array
from swsysid._simulation.model import SwitchingModel, law_equations
from swsysid._surfaces.surface import has_monomials
from swsysid.effects import (
    GuardEffect,
    MeasurementEffect,
    PlacedEffect,
    RateEffect,
    ResetEffect,
)
from swsysid.effects._types import Crossing, WithoutColumns


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
