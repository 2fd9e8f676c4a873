"""An automaton as formulas: laws, guards and resets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.transitions import AffineReset, Transition
from swsysid._simulation.formulas import laws_of
from swsysid.exporting import Edge, Expression, HybridSystem, NoFormulaError
from swsysid.exporting._expressions import ONE, least
from swsysid.exporting._features import columns_of, combination, monomials


def system_of(automaton: AutomatonParts) -> HybridSystem:
    """Laws and transitions; what is no formula is refused in a sentence."""
    if automaton.lags:
        raise NoFormulaError(
            f"the laws see {automaton.lags} past rows, which formulas of the present ones do not; "
            "write the document of to_dict instead."
        )
    columns = columns_of(automaton.n_states, automaton.n_inputs)
    recorded, modes = automaton.first_modes, list(range(automaton.n_modes))
    if recorded is not None:
        first = int(recorded.modes[0])
        modes.sort(key=lambda mode: mode != first)
    system = HybridSystem(
        tuple(automaton.state_names),
        tuple(automaton.input_names),
        laws_of(automaton.coef, automaton.feature_map, columns),
        edges=tuple(_edge(one, columns, automaton.n_states) for one in automaton.transitions),
        discrete_time=automaton.discrete_time,
        starts=tuple((mode, ONE) for mode in modes),
    ).known_by(automaton.extent)
    if recorded is not None:
        start = recorded.states[0, : automaton.n_states]
        system = replace(system, origin=tuple(start.tolist()))
    return system.checked(automaton.velocity)


def _edge(one: Transition, columns: list[Expression], n_states: int) -> Edge:
    clocks = [Expression("dwell"), Expression("time")]
    guard = least(
        *(
            combination(part.coef, monomials(part.powers, [*columns, *clocks]))
            for part in one.guard.conditions
        )
    )
    reset = None if one.reset is None else _landing(one.reset, columns[:n_states])
    return Edge(one.source, one.target, guard, reset)


def _landing(reset: AffineReset, states: list[Expression]) -> tuple[Expression, ...]:
    rows = np.column_stack([reset.matrix, reset.offset])
    return tuple(combination(row, [*states, ONE]) for row in rows)
