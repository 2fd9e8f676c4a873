"""An automaton as text, LaTeX and formulas.

Text is that of transitions: where each is taken, and what it does to the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.transitions import AffineReset, Guard, PolynomialGuard, Transition
from swsysid._rendering.printing import linear_combination, symbol
from swsysid._simulation.model import laws_of
from swsysid.exporting import Edge, Expression, HybridSystem, NoFormulaError
from swsysid.exporting._expressions import ONE, least
from swsysid.exporting._features import columns_of, combination, monomials


def transition_equation(
    transition: Transition,
    columns: Sequence[str],
    states: Sequence[str],
    precision: int,
    style: str,
) -> str:
    """One transition as a line.

    `columns` name those of guards, `states` those that a reset may change, the lagged included.
    """
    source, target = transition.source, transition.target
    guard = guard_text(transition.guard, columns, precision, style)
    guard += asked_text(transition, style)
    resets = reset_texts(transition.reset, states, precision, style)
    if style == "latex":
        arrow = rf"\text{{mode }} {source} \to {target}: \; {guard}"
        return arrow + "".join(rf", \; {one}" for one in resets)
    then = f": {', '.join(resets)}" if resets else ""
    return f"mode {source} -> {target} where {guard}{then}"


def asked_text(transition: Transition, style: str = "text") -> str:
    """How often a guard is asked, where it is not watched all along."""
    every = transition.asked_every
    if every is None:
        return ""
    return rf" \text{{ every }} {every:.4g}" if style == "latex" else f", every {every:.4g}"


def guard_text(
    guard: Guard,
    columns: Sequence[str],
    precision: int,
    style: str = "text",
    *,
    brief: bool = False,
) -> str:
    """The inequalities that have become true where a transition is taken.

    Where one monomial stands beside a constant it stands alone: T >= 22.
    """
    joint = r" \wedge " if style == "latex" else " and "
    parts = (_condition(one, columns, precision, style, brief) for one in guard.conditions)
    return joint.join(parts)


def _condition(
    guard: PolynomialGuard, columns: Sequence[str], precision: int, style: str, brief: bool
) -> str:
    terms: dict[str, float] = {}
    for value, name in zip(guard.coef.tolist(), guard_terms(guard, columns), strict=True):
        terms[name] = terms.get(name, 0.0) + value
    combined = partial(linear_combination, precision=precision, style=style, brief=brief)
    others = [name for name, value in terms.items() if value and name != "1"]
    if len(others) == 1:
        coef = terms[others[0]]
        level = combined([-terms.get("1", 0.0) / coef], ["1"])
        return f"{symbol(others[0], style)} {relation(coef, style)} {level}"
    return f"{combined(list(terms.values()), list(terms))} {relation(1.0, style)} 0"


def guard_terms(guard: PolynomialGuard, columns: Sequence[str]) -> list[str]:
    """Names of the monomials of a guard."""
    return [monomial_name(powers, columns) for powers in guard.powers.tolist()]


def relation(coef: float, style: str = "text") -> str:
    """What a column is to its threshold where a guard holds in which it has a coefficient."""
    if style == "latex":
        return r"\geq" if coef > 0.0 else r"\leq"
    return ">=" if coef > 0.0 else "<="


def reset_texts(
    reset: AffineReset | None,
    states: Sequence[str],
    precision: int,
    style: str = "text",
    *,
    brief: bool = False,
) -> list[str]:
    """What becomes of each state that changes."""
    if reset is None:
        return []
    becomes = r"\leftarrow" if style == "latex" else ":="
    texts = []
    for place, (row, constant) in enumerate(zip(reset.matrix, reset.offset, strict=True)):
        if constant == 0.0 and (row == np.eye(len(row))[place]).all():
            continue
        values, names = [float(constant), *row.tolist()], ["1", *states[: len(row)]]
        value = linear_combination(values, names, precision=precision, style=style, brief=brief)
        texts.append(f"{symbol(states[place], style)} {becomes} {value}")
    return texts


def monomial_name(powers: Sequence[int], columns: Sequence[str]) -> str:
    """A product of powers of columns, as libraries of features name it.

    Examples
    --------
    >>> monomial_name([2, 0, 1], ["x", "v", "u"]), monomial_name([0], ["x"])
    ('x^2 u', '1')
    """
    factors = [
        name if power == 1 else f"{name}^{power}"
        for name, power in zip(columns, powers, strict=True)
        if power
    ]
    return " ".join(factors) or "1"


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
