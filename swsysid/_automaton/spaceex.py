"""An automaton as a SpaceEx model: one component with locations and transitions.

SpaceEx transitions may be taken while their guard holds and must be taken where the invariant ends.
The invariant of a location is therefore that no guard of its transitions has become positive, and
what is written as guard is that it rises: it is not negative, nor is its time derivative. A ball
that has just left the ground would else jump for ever at one instant. No invariant says that one of
several conditions does not hold: their transition is one that is taken as soon as possible.

How a model is run is in its ``.cfg``. Of what is read there only the component, the values of
constants and where a run begins are used; the rest says how SpaceEx computes.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.polynomial_text import Polynomial, negative, nonzero, rate, read_polynomial
from swsysid._automaton.spaceex_network import NAMESPACE, refusal
from swsysid._automaton.transitions import Transition
from swsysid._checks.arrays import column, state
from swsysid._checks.parameters import shown, whole
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


_ENTRY = re.compile(r"^\s*([\w-]+)\s*=\s*\"?([^\"\n]*)\"?\s*$", re.MULTILINE)
_LOCATION = re.compile(r"loc\s*\(\s*([\w.]*)\s*\)\s*==?\s*(\w+)")
_RELATION = re.compile(r"\s*(<=|>=|==|=|<|>)\s*")


@dataclass
class SpaceexRun:
    """What a ``.cfg`` says of a model."""

    system: str | None = None
    #: Of names: the least and the greatest value at the start.
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    #: Of instances: the location in which they start.
    locations: dict[str, str] = field(default_factory=dict)

    def constants(self, names: list[str], given: Mapping[str, float]) -> dict[str, float]:
        """Values of constants; what is given counts."""
        values = dict(given)
        for name in names:
            least, most = self.ranges.get(name, (np.nan, np.nan))
            if name in given or np.isnan(least):
                continue
            if least < most:
                raise ValueError(
                    f"the settings leave the constant {name!r} between {least:g} and {most:g}; "
                    f"give parameters={{{name!r}: ...}}."
                )
            values[name] = least
        return values

    def start(self, states: list[str]) -> list[float] | None:
        """The middle of where a run begins, if that is told of all states."""
        if not set(states) <= set(self.ranges):
            return None
        middle = [sum(self.ranges[name]) / 2.0 for name in states]
        return middle if np.isfinite(middle).all() else None


def read_settings(text: str) -> SpaceexRun:
    r"""The settings that a ``.cfg`` tells.

    Examples
    --------
    >>> told = read_settings('system = tank\ninitially = "0 <= h <= 2 & g == 2*4.9 & loc()==full"')
    >>> told.system, told.ranges, told.locations
    ('tank', {'h': (0.0, 2.0), 'g': (9.8, 9.8)}, {'': 'full'})
    """
    entries = dict(_ENTRY.findall("\n".join(re.split(r"^\s*#.*$", text, flags=re.MULTILINE))))
    found = SpaceexRun(entries.get("system", "").strip() or None)
    for part in entries.get("initially", "").split("&"):
        location = _LOCATION.fullmatch(part.strip())
        if location:
            found.locations[location[1]] = location[2]
        elif part.strip():
            _bounded(found.ranges, part)
    return found


def _bounded(ranges: dict[str, tuple[float, float]], condition: str) -> None:
    """Narrow the range of the one name in a condition such as ``0 <= x <= 1``."""
    sides, relations = _RELATION.split(condition.strip())[::2], _RELATION.findall(condition)
    for left, relation, right in zip(sides[:-1], relations, sides[1:], strict=True):
        name, value = (right, left) if re.fullmatch(r"[^\W\d][\w.]*", right) else (left, right)
        if not re.fullmatch(r"[^\W\d][\w.]*", name):
            raise refusal(f"its settings say {shown(condition.strip())} of the start")
        number = read_polynomial(value, (), {}).get((), 0.0)
        least, most = ranges.get(name, (-np.inf, np.inf))
        if relation in ("==", "=") or ("<" in relation) == (name == left):
            most = min(most, number)
        if relation in ("==", "=") or ("<" in relation) == (name == right):
            least = max(least, number)
        ranges[name] = least, most


def spaceex_settings(
    automaton: AutomatonParts,
    component: str,
    x0: ArrayLike | None,
    t: ArrayLike | None,
    mode: int | None,
) -> str:
    """How a model is run: the start, the horizon, the step, and what is drawn.

    What is not given is that of the first recorded state where there is one. What is not known
    either is named in a comment.
    """
    first = None if x0 is None else state("x0", x0, automaton.n_states)
    times = None if t is None else column("t", t)
    whole("mode", mode, least=0, most=automaton.n_modes - 1, also=(None,))
    recorded = automaton.first_modes
    if first is None and recorded is not None:
        first = recorded.states[0, : automaton.n_states]
        mode = int(recorded.modes[0]) if mode is None else mode
    comments = [
        f"# {what} is not known to the automaton: put yours here, or give {argument} to to_spaceex"
        for what, argument, value in (
            ("the state at the start", "x0", first),
            ("the mode at the start", "mode", mode if automaton.n_modes > 1 else 0),
            ("the horizon", "t", times),
        )
        if value is None
    ]
    names = identifiers(automaton.feature_map.names_in, CLOCKS)[: automaton.n_states]
    first = np.zeros(len(names)) if first is None else first
    times = np.linspace(0.0, 10.0, 1001) if times is None else times
    clocks = clocks_used(automaton.transitions)
    start = dict(zip(names, first.tolist(), strict=True))
    start.update({name: float(times[0]) if name == "time" else 0.0 for name in clocks})
    initially = " & ".join(
        [f"loc()==mode{mode or 0}", *(f"{name}=={value!r}" for name, value in start.items())]
    )
    told = {
        "system": identifiers([component], CLOCKS)[0],
        "initially": initially,
        "scenario": "simulation",
        "sampling-time": f"{np.median(np.diff(times)):.12g}",
        "time-horizon": repr(float(times[-1] - times[0])),
        "iter-max": "1000",
        "output-variables": ", ".join(start),
        "output-format": "GEN",
        "rel-err": "1.0e-9",
        "abs-err": "1.0e-12",
    }
    return "\n".join([*comments, *(f'{key} = "{value}"' for key, value in told.items()), ""])
