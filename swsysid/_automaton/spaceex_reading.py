"""A SpaceEx model of one component, read into the texts from which an automaton is stated."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.polynomial_text import Polynomial, read_inequality
from swsysid._automaton.spaceex import NAMESPACE
from swsysid._checks.parameters import shown

_ASSIGNED = re.compile(r"\s*(\w+)\s*'?\s*(?::=|==|=)\s*(.+?)\s*$", re.DOTALL)


@dataclass
class SpaceexModel:
    """Names and texts of a model."""

    states: list[str]
    inputs: list[str]
    laws: list[dict[str, str]] = field(default_factory=list)
    transitions: list[tuple[int, int, str, dict[str, str]]] = field(default_factory=list)


def read_spaceex(content: bytes, parameters: Mapping[str, float]) -> SpaceexModel:
    """The texts of a model; what an automaton here cannot be is refused in one sentence."""
    component = _component(content)
    states, inputs, constants = _names(component)
    unknown = [name for name in constants if name not in parameters]
    if unknown:
        raise ValueError(
            f"the model has the constant {unknown[0]!r} without a value; give parameters={{"
            f"{unknown[0]!r}: ...}}."
        )
    locations = _children(component, "location")
    places = {element.get("id"): mode for mode, element in enumerate(locations)}
    if len(places) != len(locations) or not locations:
        raise _refusal("its locations lack ids of their own")
    model = SpaceexModel(states, inputs)
    model.laws = [_assignments(_text(element, "flow")) for element in locations]
    for element in _children(component, "transition"):
        ends = [places.get(element.get(end)) for end in ("source", "target")]
        if ends[0] is None or ends[1] is None:
            raise _refusal("a transition leads from or to a location that there is not")
        guard = _text(element, "guard")
        if "&" in guard or not guard:
            raise _refusal(
                f"the guard {shown(guard)} is not a single condition, as transitions here have"
            )
        resets = _assignments(_text(element, "assignment"))
        model.transitions.append((ends[0], ends[1], guard, resets))
    _set_clocks_apart(model)
    _check_invariants(model, [_text(element, "invariant") for element in locations], parameters)
    return model


class _PlainBuilder(ElementTree.TreeBuilder):
    """Builds trees of documents that define nothing of their own, such as entities that grow."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise _refusal("it has a document type, which models of SpaceEx do not")


def _component(content: bytes) -> ElementTree.Element:
    """The only component with locations."""
    parser = ElementTree.XMLParser(target=_PlainBuilder())
    try:
        root = ElementTree.fromstring(content, parser)
    except (ElementTree.ParseError, LookupError) as error:
        raise _refusal(f"it is no XML: {error}") from None
    with_locations = [one for one in _children(root, "component") if _children(one, "location")]
    if len(with_locations) != 1:
        raise _refusal(f"it has {len(with_locations)} components with locations instead of one")
    return with_locations[0]


def _names(component: ElementTree.Element) -> tuple[list[str], list[str], list[str]]:
    """Names of states, inputs and constants."""
    kinds: dict[str, list[str]] = {"state": [], "input": [], "constant": []}
    for element in _children(component, "param"):
        if element.get("type") == "label":
            continue
        name = element.get("name") or ""
        if element.get("dynamics") == "const":
            kinds["constant"].append(name)
        else:
            kinds["input" if element.get("controlled") == "false" else "state"].append(name)
    return kinds["state"], kinds["input"], kinds["constant"]


def _set_clocks_apart(model: SpaceexModel) -> None:
    """Take states that run as the clocks of guards do for these clocks."""
    for clock in CLOCKS:
        runs = all(law.get(clock) in ("1", "1.0") for law in model.laws)
        begins = {"dwell": ("0", "0.0"), "time": (None,)}[clock]
        as_told = all(resets.get(clock) in begins for *_, resets in model.transitions)
        if clock in model.states and runs and as_told:
            model.states.remove(clock)
            for texts in (*model.laws, *(resets for *_, resets in model.transitions)):
                texts.pop(clock, None)


def _check_invariants(
    model: SpaceexModel, invariants: Iterable[str], parameters: Mapping[str, float]
) -> None:
    """Refuse an invariant that ends where no guard lets the state out: here it would be lost."""
    columns = [*model.states, *model.inputs, *CLOCKS]

    def rising(condition: str) -> Polynomial:
        return _scaled(read_inequality(condition, columns, parameters))

    for mode, invariant in enumerate(invariants):
        out = [rising(guard) for source, _, guard, _ in model.transitions if source == mode]
        conditions = {part.strip() for part in invariant.split("&")} - {"", "true"}
        for condition in sorted(conditions):
            ends = {powers: -coef for powers, coef in rising(condition).items()}
            if not any(_is_same(ends, guard) for guard in out):
                raise _refusal(
                    f"the invariant {shown(condition)} ends where no guard of its location begins"
                )


def _scaled(polynomial: Polynomial) -> Polynomial:
    largest = max(map(abs, polynomial.values()), default=1.0)
    return {powers: coef / largest for powers, coef in polynomial.items()}


def _is_same(one: Polynomial, other: Polynomial) -> bool:
    return all(abs(one.get(key, 0.0) - other.get(key, 0.0)) < 1e-12 for key in {*one, *other})


def _assignments(text: str) -> dict[str, str]:
    """The values of names in conditions ``x' == value`` or ``x := value`` joined by ``&``."""
    told = {}
    for part in filter(None, map(str.strip, text.split("&"))):
        match = _ASSIGNED.match(part)
        if match is None or re.search(r"[<>=]", match[2]):
            raise _refusal(f"{shown(part)} is no equation for one variable")
        told[match[1]] = match[2]
    return told


def _children(element: ElementTree.Element, tag: str) -> list[ElementTree.Element]:
    return [*element.findall(f"{{{NAMESPACE}}}{tag}"), *element.findall(tag)]


def _text(element: ElementTree.Element, tag: str) -> str:
    return " & ".join((child.text or "").strip() for child in _children(element, tag))


def _refusal(why: str) -> ValueError:
    return ValueError(f"this SpaceEx model cannot be read ({why}); see from_spaceex.")
