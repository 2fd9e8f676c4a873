"""An automaton as a SpaceEx model: one component with locations and transitions.

SpaceEx transitions may be taken while their guard holds and must be taken where the invariant ends.
The invariant of a location is therefore that no guard of its transitions has become positive.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.transitions import Transition
from swsysid._results import Array

NAMESPACE = "http://www-verimag.imag.fr/xml-namespaces/sspaceex"


def spaceex_model(automaton: AutomatonParts, component: str) -> bytes:
    """The XML of a model in continuous time; features other than monomials are refused."""
    feature_map, transitions = automaton.feature_map, automaton.transitions
    powers = feature_map.powers
    if powers is None:
        raise TypeError(
            f"the features of {type(feature_map.library).__name__} are no polynomials, and SpaceEx "
            "models are made of polynomials here; state or fit the laws with a degree."
        )
    names = identifiers(feature_map.names_in)
    n_states = automaton.n_states
    clocks = _clocks_used(transitions)
    root = ElementTree.Element("sspaceex", xmlns=NAMESPACE, version="0.2", math="SpaceEx")
    body = ElementTree.SubElement(root, "component", id=identifiers([component])[0])
    for place, name in enumerate([*names, *clocks]):
        controlled = place < n_states or place >= len(names)
        _add_parameter(body, name, controlled)
    for mode, law in enumerate(automaton.coef):
        location = ElementTree.SubElement(body, "location", id=str(mode + 1), name=f"mode{mode}")
        kept = [
            f"{expression(one.guard.coef, one.guard.powers, [*names, *CLOCKS])} <= 0"
            for one in transitions
            if one.source == mode
        ]
        if kept:
            ElementTree.SubElement(location, "invariant").text = " & ".join(kept)
        flows = [expression(row, powers, names) for row in law] + ["1"] * len(clocks)
        moving = [*names[:n_states], *clocks]
        ElementTree.SubElement(location, "flow").text = " & ".join(
            f"{name}' == {flow}" for name, flow in zip(moving, flows, strict=True)
        )
    for one in transitions:
        _add_transition(body, one, names, n_states, clocks)
    ElementTree.indent(root)
    written: bytes = ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)
    return written + b"\n"


def _add_parameter(body: ElementTree.Element, name: str, controlled: bool) -> None:
    given = {"name": name, "type": "real", "local": "false", "d1": "1", "d2": "1"}
    ElementTree.SubElement(body, "param", given, dynamics="any", controlled=str(controlled).lower())


def _add_transition(
    body: ElementTree.Element, one: Transition, names: list[str], n_states: int, clocks: list[str]
) -> None:
    ends = {"source": str(one.source + 1), "target": str(one.target + 1)}
    element = ElementTree.SubElement(body, "transition", ends)
    guard = expression(one.guard.coef, one.guard.powers, [*names, *CLOCKS])
    ElementTree.SubElement(element, "guard").text = f"{guard} >= 0"
    assigned = ["dwell := 0"] if "dwell" in clocks else []
    if one.reset is not None:
        linear = np.concatenate([np.zeros((1, n_states)), np.eye(n_states)]).astype(np.intp)
        for name, row, constant in zip(names, one.reset.matrix, one.reset.offset, strict=False):
            value = expression(np.concatenate([[constant], row]), linear, names[:n_states])
            assigned.append(f"{name} := {value}")
    if assigned:
        ElementTree.SubElement(element, "assignment").text = " & ".join(assigned)


def _clocks_used(transitions: Sequence[Transition]) -> list[str]:
    """The clocks that occur in a guard."""
    return [
        name
        for column, name in zip((-2, -1), CLOCKS, strict=True)
        if any(one.guard.powers[:, column].any() for one in transitions)
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


def identifiers(names: Sequence[str]) -> list[str]:
    """Names of letters, digits and underscores, each another one and none that of a clock.

    Examples
    --------
    >>> identifiers(["h", "speed (m/s)", "speed_m/s", "2nd", "time"])
    ['h', 'speed_m_s', 'speed_m_s_2', 'x2nd', 'time_2']
    """
    found: list[str] = []
    for name in names:
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
        plain = plain if plain[:1].isalpha() else f"x{plain}"
        number, unique = 1, plain
        while unique in (*found, *CLOCKS):
            number += 1
            unique = f"{plain}_{number}"
        found.append(unique)
    return found
