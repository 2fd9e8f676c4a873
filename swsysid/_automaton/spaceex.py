"""An automaton as a SpaceEx model: one component with locations and transitions.

SpaceEx transitions may be taken while their guard holds and must be taken where the invariant ends.
The invariant of a location is therefore that no guard of its transitions has become positive, and
what is written as guard is that it rises: it is not negative, nor is its time derivative. A ball
that has just left the ground would else jump for ever at one instant. No invariant says that one of
several conditions does not hold: their transition is one that is taken as soon as possible.
"""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.polynomials import Polynomial, negative, nonzero, rate
from swsysid._automaton.spaceex_network import NAMESPACE
from swsysid._automaton.transitions import Transition
from swsysid._checks.parameters import shown
from swsysid._results import Array
from swsysid.exporting._text import identifiers

#: The note of what is written, by which it is read again.
MEANING = (
    "Written by swsysid: a transition is taken at once where its guard rises to zero, and, where "
    "its location is entered with the guard beyond zero, at that instant."
)


def spaceex_model(automaton: AutomatonParts, component: str) -> bytes:
    """The XML of a model in continuous time; features other than monomials are refused."""
    if automaton.discrete_time:
        raise ValueError("SpaceEx models have continuous time; use to_dict for this automaton.")
    if not isinstance(component, str):
        raise TypeError(f"component={shown(component)} must be the name of the component.")
    feature_map, transitions = automaton.feature_map, automaton.transitions
    powers = feature_map.powers
    if powers is None:
        raise TypeError(
            f"the features of {type(feature_map.library).__name__} are no polynomials, and SpaceEx "
            "models are made of polynomials here; state or fit the laws with a degree."
        )
    names = identifiers(feature_map.names_in, CLOCKS)
    n_states = automaton.n_states
    clocks = clocks_used(transitions)
    columns = [*names, *CLOCKS]
    root = ElementTree.Element("sspaceex", xmlns=NAMESPACE, version="0.2", math="SpaceEx")
    body = ElementTree.SubElement(root, "component", id=identifiers([component], CLOCKS)[0])
    ElementTree.SubElement(body, "note").text = MEANING
    for place, name in enumerate([*names, *clocks]):
        controlled = place < n_states or place >= len(names)
        _add_parameter(body, name, controlled)
    for mode, law in enumerate(automaton.coef):
        location = ElementTree.SubElement(body, "location", id=str(mode + 1), name=f"mode{mode}")
        kept = [
            f"{expression(guard.coef, guard.powers, columns)} <= 0"
            for one in transitions
            for guard in one.guard.conditions
            if one.source == mode and len(one.guard.conditions) == 1
        ]
        if kept:
            ElementTree.SubElement(location, "invariant").text = " & ".join(kept)
        flows = [expression(row, powers, names) for row in law] + ["1"] * len(clocks)
        moving = [*names[:n_states], *clocks]
        ElementTree.SubElement(location, "flow").text = " & ".join(
            f"{name}' == {flow}" for name, flow in zip(moving, flows, strict=True)
        )
    for one in transitions:
        rises = _rising(one, automaton.coef[one.source], powers)
        guard = " & ".join(_not_negative(each, columns) for each in rises)
        _add_transition(body, one, guard, _assigned(one, names[:n_states], clocks))
    ElementTree.indent(root)
    written: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return written + b"\n"


def _rising(one: Transition, law: Array, powers: NDArray[np.intp]) -> list[Polynomial]:
    """A guard, and its time derivative where that is known and may be negative.

    Of several conditions any may be the last to become true: they stand alone.
    """
    guard, *others = (_polynomial(each.coef, each.powers) for each in one.guard.conditions)
    if others:
        return [guard, *others]
    n_columns = one.guard.conditions[0].powers.shape[1]
    wide = np.pad(powers, ((0, 0), (0, n_columns - powers.shape[1])))
    laws = {state: _polynomial(row, wide) for state, row in enumerate(law)}
    clocks = range(n_columns - len(CLOCKS), n_columns)
    laws.update(dict.fromkeys(clocks, {(0,) * n_columns: 1.0}))
    change = rate(guard, laws)
    if change is None or all(coef > 0.0 and not any(row) for row, coef in change.items()):
        return [guard]
    return [guard, change]


def _polynomial(coef: Array, powers: NDArray[np.intp]) -> Polynomial:
    found: Polynomial = {}
    for row, value in zip(map(tuple, powers.tolist()), coef.tolist(), strict=True):
        found[row] = found.get(row, 0.0) + value
    return nonzero(found)


def _not_negative(polynomial: Polynomial, columns: Sequence[str]) -> str:
    """The condition in the way in which most of its coefficients are positive."""
    falling = all(coef < 0.0 for coef in polynomial.values())
    sided = negative(polynomial) if falling else polynomial
    powers = np.array(list(sided), dtype=np.intp).reshape(len(sided), len(columns))
    text = expression(np.array(list(sided.values())), powers, columns)
    return f"{text} {'<=' if falling else '>='} 0"


def _add_parameter(body: ElementTree.Element, name: str, controlled: bool) -> None:
    given = {"name": name, "type": "real", "local": "false", "d1": "1", "d2": "1"}
    ElementTree.SubElement(body, "param", given, dynamics="any", controlled=str(controlled).lower())


def _add_transition(
    body: ElementTree.Element, one: Transition, guard: str, assigned: list[str]
) -> None:
    ends = {"source": str(one.source + 1), "target": str(one.target + 1)}
    if len(one.guard.conditions) > 1:
        ends["asap"] = "true"
    element = ElementTree.SubElement(body, "transition", ends)
    ElementTree.SubElement(element, "guard").text = guard
    if assigned:
        ElementTree.SubElement(element, "assignment").text = " & ".join(assigned)


def _assigned(one: Transition, states: list[str], clocks: list[str]) -> list[str]:
    """What becomes of the clocks and of the states."""
    assigned = ["dwell := 0"] if "dwell" in clocks else []
    if one.reset is None:
        return assigned
    linear = np.eye(len(states) + 1, dtype=np.intp)[:, 1:]  # the constant, then each state
    for name, row, constant in zip(states, one.reset.matrix, one.reset.offset, strict=True):
        value = expression(np.concatenate([[constant], row]), linear, states)
        assigned.append(f"{name} := {value}")
    return assigned


def clocks_used(transitions: Sequence[Transition]) -> list[str]:
    """The clocks that occur in a guard."""
    powers = [part.powers for one in transitions for part in one.guard.conditions]
    return [
        name
        for column, name in zip((-2, -1), CLOCKS, strict=True)
        if any(own[:, column].any() for own in powers)
    ]


def expression(coef: Array, powers: NDArray[np.intp], names: Sequence[str]) -> str:
    """A polynomial with all digits of its coefficients.

    Examples
    --------
    >>> powers = np.array([[0, 0], [1, 0], [2, 1]])
    >>> expression(np.array([1.5, 0.0, -2.0]), powers, ["x", "v"])
    '1.5 - 2.0*x^2*v'
    """
    text = ""
    for value, row in zip(coef.tolist(), powers.tolist(), strict=True):
        if value == 0.0:
            continue
        factors = [repr(abs(value))]
        for name, power in zip(names, row, strict=True):
            if power:
                factors.append(name if power == 1 else f"{name}^{power}")
        sign = ("-" if value < 0 else "") if not text else (" - " if value < 0 else " + ")
        text += sign + "*".join(factors)
    return text or "0"
