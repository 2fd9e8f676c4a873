"""An automaton of columns that are counted from an origin, in the user's own columns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import (
    AffineReset,
    PolynomialGuard,
    Transition,
    guard_of,
)
from swsysid._automaton_search.answer import IdentifiedAutomaton
from swsysid._automaton_search.errors import AutomatonErrors
from swsysid._automaton_search.joint import Joint
from swsysid._data.coordinates import shifted_monomials
from swsysid._data.features import FeatureMap
from swsysid._results import Array
from swsysid._stays.certainty import slopes_of
from swsysid._stays.given import Given
from swsysid._stays.origin import Origin


def told_from(
    origin: Origin, found: IdentifiedAutomaton, given: Given, library: object
) -> IdentifiedAutomaton:
    """What was found in columns counted from an origin; `given` are the user's recordings."""
    if not origin.moves:
        return found
    states = [origin.states(own) for own in found.states]
    automaton = automaton_from(origin, found.automaton, states, given, library)
    return replace(found, automaton=automaton, states=states)


def automaton_from(
    origin: Origin, automaton: HybridAutomaton, states: list[Array], given: Given, library: object
) -> HybridAutomaton:
    """An automaton that was found there; `states` are those of its recordings, as they are here."""
    if not origin.moves:
        return automaton
    features, first_modes = automaton.feature_map, automaton.first_modes
    columns = np.hstack([np.vstack(states), np.vstack([one.u for one in given.records])])
    if first_modes is not None:
        first_modes = replace(first_modes, states=origin.states(first_modes.states))
    return replace(
        automaton,
        coef=automaton.coef @ origin.change(features),
        feature_map=FeatureMap(library, columns, features.names_in),
        transitions=tuple(_transition(one, origin) for one in automaton.transitions),
        first_modes=first_modes,
    )


def slopes_from(
    origin: Origin, joint: Joint, features: FeatureMap
) -> tuple[Array, list[Array | None], Array]:
    """Derivatives of laws, of the guard of each transition, and of resets by the unknowns.

    Those of the user's own columns, (n_unknowns, ...). Resets have then the shape (n_transitions,
    n_states, 1 + n_states): of the offset, then of the matrix.
    """
    estimate = joint.after
    laws, guards, resets = estimate.laws, estimate.guards, estimate.resets
    n_states, change = resets.maps.shape[1], origin.change(features)
    of_offset = np.eye(1 + n_states)
    of_offset[1:, 0] = -origin.offset[:n_states]
    own_laws = slopes_of(laws.coef.shape, laws.places, change)
    own_resets = slopes_of(resets.maps.shape, resets.places, of_offset)
    ends = np.cumsum([laws.n_free, guards.n_free, resets.n_free])
    by_laws, by_guards, by_resets = np.split(np.eye(ends[-1]), ends[:-1])
    of_laws = np.tensordot(by_laws.T, own_laws, 1)
    of_resets = np.tensordot(by_resets.T, own_resets, 1)
    every: list[Array | None] = [None] * len(guards.which)
    of_each = guards.own_places()
    for transition in np.flatnonzero(guards.which >= 0).tolist():
        number = int(guards.which[transition])
        guard = guards.guard(transition)
        assert guard is not None, "it has a guard"
        _, moved = _moved_guard(guard, origin)
        own = np.zeros((guards.coef.shape[1], moved.shape[1]))
        own[guards.own[number]] = guards.signs[transition] * moved
        every[transition] = by_guards[of_each[number]].T @ own[guards.free[number]]
    return of_laws, every, of_resets


def errors_elsewhere(
    origin: Origin, errors: AutomatonErrors, automaton: HybridAutomaton
) -> AutomatonErrors:
    """Standard errors of guards and resets in the user's columns, those of laws as they are.

    Coefficients of one guard or reset are taken to be independent.
    """
    guards, resets = [], []
    for one, guard, reset in zip(automaton.transitions, errors.guards, errors.resets, strict=True):
        change = block_diag(*(_moved_guard(part, origin)[1] for part in one.guard.conditions))
        guards.append(np.sqrt(np.square(guard) @ np.square(change)))
        if reset is not None:
            own = origin.offset[: len(reset)]
            offset = np.sqrt(np.square(reset) @ np.append(1.0, np.square(own)))
            reset = np.column_stack([offset, reset[:, 1:]])
        resets.append(reset)
    return replace(errors, guards=tuple(guards), resets=tuple(resets))


def guard_elsewhere(origin: Origin, guard: PolynomialGuard) -> PolynomialGuard:
    """The same guard of the user's columns."""
    return _moved_guard(guard, origin)[0]


def _transition(one: Transition, origin: Origin) -> Transition:
    reset = one.reset
    if reset is not None:
        own = origin.offset[: len(reset.offset)]
        reset = AffineReset(reset.matrix, reset.offset + own - reset.matrix @ own)
    parts = [guard_elsewhere(origin, part) for part in one.guard.conditions]
    return replace(one, guard=guard_of(parts), reset=reset)


def _moved_guard(guard: PolynomialGuard, origin: Origin) -> tuple[PolynomialGuard, Array]:
    """The same guard of the user's columns, and what its coefficients are multiplied by."""
    if not origin.moves:
        return guard, np.eye(len(guard.coef))
    offset = np.append(origin.offset, np.zeros(len(CLOCKS)))
    powers = _with_lower(guard.powers.tolist(), np.flatnonzero(offset).tolist())
    change = shifted_monomials(powers, offset, np.ones(len(offset))).T[: len(guard.powers)]
    return PolynomialGuard(guard.coef @ change, powers), change


def _with_lower(powers: list[list[int]], columns: Sequence[int]) -> np.ndarray:
    """Exponents, then those of further monomials that have some of the columns less often."""
    every = list(powers)
    for one in every:
        for column in columns:
            lower = [power - (k == column) for k, power in enumerate(one)]
            if lower[column] >= 0 and lower not in every:
                every.append(lower)
    return np.array(every, dtype=np.intp)
