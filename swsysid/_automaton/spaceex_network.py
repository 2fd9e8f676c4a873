"""The component that a SpaceEx model describes: its networks resolved, its instances composed.

Templates are instantiated with the names and numbers that their binds give them. Instances run
side by side: a state of the whole is a location of each, and transitions with a label that several
know are taken by these together.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from xml.etree import ElementTree

from swsysid._automaton.polynomial_text import MOST_TERMS
from swsysid._checks.parameters import shown

NAMESPACE = "http://www-verimag.imag.fr/xml-namespaces/sspaceex"
_NAME = re.compile(r"(?<![\w.])[^\W\d]\w*")  # not the exponent of a number
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


@dataclass(frozen=True)
class Location:
    """Conditions of a location, as they are written."""

    name: str
    flow: tuple[str, ...]
    invariant: tuple[str, ...]
    #: Where each instance is, by its name; by none where there is one.
    places: tuple[tuple[str, str], ...] = ()

    @property
    def moving(self) -> set[str]:
        """Names whose rates it tells."""
        return {part.partition("'")[0].strip() for part in self.flow if "'" in part}


@dataclass(frozen=True)
class Edge:
    """A transition between locations, by their places."""

    source: int
    target: int
    guard: tuple[str, ...]
    assignment: tuple[str, ...]
    label: str = ""
    at_once: bool = False  # said to be taken as soon as it may be


@dataclass
class Component:
    """Locations and transitions in the names of the model.

    `kinds` of the names are "state", "input", "constant" and "label".
    """

    kinds: dict[str, str]
    local: set[str]
    locations: list[Location] = field(default_factory=list)
    edges: list[Edge] = field(default_factory=list)
    note: str = ""

    def of_kind(self, kind: str) -> list[str]:
        """The names of a kind."""
        return [name for name, own in self.kinds.items() if own == kind]

    def moves(self, name: str) -> bool:
        """Whether a flow moves a name, or an assignment sets it."""
        sets = (_NAME.match(part) for edge in self.edges for part in edge.assignment)
        moving = (location.moving for location in self.locations)
        return any(one and one[0] == name for one in sets) or any(name in own for own in moving)

    def states_named(self) -> set[str]:
        """Names that a flow moves, that an assignment sets or reads, or that a guard asks."""
        told = [part for edge in self.edges for part in (*edge.guard, *edge.assignment)]
        return names_in(told).union(*(location.moving for location in self.locations))

    def without(self, condition: str) -> Component:
        """The same without one of the conditions of its invariants."""
        locations = [
            replace(one, invariant=tuple(part for part in one.invariant if part != condition))
            for one in self.locations
        ]
        return replace(self, locations=locations)

    def rewritten(
        self, texts: Mapping[str, str], kinds: dict[str, str], local: set[str]
    ) -> Component:
        """The same with other texts in the place of names."""

        def new(conditions: tuple[str, ...]) -> tuple[str, ...]:
            return tuple(renamed(one, texts) for one in conditions)

        locations = [
            replace(one, flow=new(one.flow), invariant=new(one.invariant)) for one in self.locations
        ]
        edges = [
            replace(
                one,
                guard=new(one.guard),
                assignment=new(one.assignment),
                label=texts.get(one.label, one.label),
            )
            for one in self.edges
        ]
        return Component(kinds, local, locations, edges)


def read_component(content: bytes, wanted: str | None) -> Component:
    """The component of a model that is `wanted`, or that is no part of another one."""
    parser = ElementTree.XMLParser(target=_PlainBuilder())
    try:
        root = ElementTree.fromstring(content, parser)
    except (ElementTree.ParseError, LookupError) as error:
        raise refusal(f"it is no XML: {error}") from None
    listed = _children(root, "component")
    components = {element.get("id", ""): element for element in listed}
    if len(components) < len(listed):
        raise refusal("two components have one name")
    if not any(_children(one, "location") for one in listed):
        raise refusal("it has 0 components with locations instead of one")
    bound = {bind.get("component") for one in listed for bind in _children(one, "bind")}
    tops = [name for name in components if name not in bound]
    if wanted is None and len(tops) != 1:
        raise refusal(
            f"it has {len(tops)} components that are no part of another one, {', '.join(tops)}; "
            "give component="
        )
    top = tops[0] if wanted is None else wanted
    if top not in components:
        raise refusal(f"it has no component {shown(top)}, but {', '.join(components)}")
    return _resolved(components, top, ())


class _PlainBuilder(ElementTree.TreeBuilder):
    """Builds trees of documents that define nothing of their own, such as entities that grow."""

    def doctype(self, name: str, public: str | None, system: str | None) -> None:
        raise refusal("it has a document type, which models of SpaceEx do not")


# -- one component -----------------------------------------------------------------------------


def _resolved(
    components: Mapping[str, ElementTree.Element], name: str, within: tuple[str, ...]
) -> Component:
    """A component with locations as it stands, or the composition of what a network binds."""
    if name not in components or name in within:
        raise refusal(f"a network binds {shown(name)}, which there is not or which it is part of")
    element = components[name]
    kinds = _kinds(element)
    locations, binds = _children(element, "location"), _children(element, "bind")
    if locations and binds:
        raise refusal(f"its component {shown(name)} has both locations and binds")
    if not binds:
        return _component_of(element, kinds, locations)
    if len({bind.get("as") for bind in binds}) < len(binds):
        raise refusal(f"two binds of its network {shown(name)} have one name")
    parts = (
        _bound(_resolved(components, bind.get("component", ""), (*within, name)), bind, kinds)
        for bind in binds
    )
    whole = reduce(_composed, parts)
    whole.local |= _local(element)
    in_order = [name for name in kinds if name in whole.kinds]
    whole.kinds = {name: whole.kinds[name] for name in dict.fromkeys([*in_order, *whole.kinds])}
    return whole


def _component_of(element: ElementTree.Element, kinds: dict[str, str], locations) -> Component:
    if not locations:
        raise refusal(f"its component {shown(element.get('id'))} has neither locations nor binds")
    places = {one.get("id"): place for place, one in enumerate(locations)}
    if len(places) != len(locations):
        raise refusal("its locations lack ids of their own")
    note = "".join(one.text or "" for one in _children(element, "note"))
    found = Component(kinds, _local(element), note=note.strip())
    for one in locations:
        flow, invariant = conditions(one, "flow"), conditions(one, "invariant")
        name = one.get("name") or one.get("id", "")
        found.locations.append(Location(name, flow, invariant, (("", name),)))
    for one in _children(element, "transition"):
        source, target = places.get(one.get("source")), places.get(one.get("target"))
        if source is None or target is None:
            raise refusal("a transition leads from or to a location that there is not")
        label = " ".join(conditions(one, "label"))
        kinds.update({label: "label"} if label else {})
        edge = Edge(source, target, conditions(one, "guard"), conditions(one, "assignment"), label)
        found.edges.append(replace(edge, at_once=one.get("asap") == "true"))
    return found


def _kinds(element: ElementTree.Element) -> dict[str, str]:
    """What the names of a component stand for."""
    kinds: dict[str, str] = {}
    for one in _children(element, "param"):
        name, kind, dynamics = one.get("name", ""), one.get("type"), one.get("dynamics", "any")
        if not _NAME.fullmatch(name) or name in kinds:
            raise refusal(f"it has a parameter of the name {shown(name)}, or two")
        if kind == "label":
            kinds[name] = "label"
            continue
        if kind != "real" or dynamics not in ("any", "const"):
            raise refusal(f"{name} is of the type {shown(kind)} with dynamics {shown(dynamics)}")
        if one.get("d1", "1") != "1" or one.get("d2", "1") != "1":
            raise refusal(f"{name} is a vector or a matrix; write its components one by one")
        free = "input" if one.get("controlled") == "false" else "state"
        kinds[name] = "constant" if dynamics == "const" else free
    return kinds


def _local(element: ElementTree.Element) -> set[str]:
    """Names that a component keeps to itself."""
    params = _children(element, "param")
    return {one.get("name", "") for one in params if one.get("local") == "true"}


# -- networks ----------------------------------------------------------------------------------


def _bound(part: Component, bind: ElementTree.Element, outer: Mapping[str, str]) -> Component:
    """A component in the names and numbers that a bind gives it."""
    instance = bind.get("as", bind.get("component", ""))
    given = {one.get("key", ""): (one.text or "").strip() for one in _children(bind, "map")}
    unknown = [key for key in given if key not in part.kinds]
    if unknown:
        raise refusal(f"the bind {instance} maps {shown(unknown[0])}, which its component lacks")
    texts = {
        name: _meaning(instance, name, kind, given.get(name), part.local, outer)
        for name, kind in part.kinds.items()
    }
    kinds: dict[str, str] = {}
    for name, text in texts.items():
        if _NAME.fullmatch(text):
            kind = "constant" if outer.get(text) == "constant" else part.kinds[name]
            # of several names that are mapped onto one, one may be the state
            kinds[text] = "state" if kinds.get(text) == "state" else kind

    found = part.rewritten(texts, kinds, set(kinds) - set(outer))
    found.locations = [
        replace(
            one, places=tuple((f"{instance}.{inner}".rstrip("."), at) for inner, at in one.places)
        )
        for one in found.locations
    ]
    return found


def _meaning(
    instance: str,
    name: str,
    kind: str,
    value: str | None,
    local: set[str],
    outer: Mapping[str, str],
) -> str:
    """What a bind puts in the place of a name: a name of the network, a number, or its own."""
    own = f"{instance}_{name}"
    if value is None and (name in local or kind == "label") and own not in outer:
        return own
    if value is None:
        raise refusal(f"the bind {instance} leaves {name} open")
    if _NUMBER.fullmatch(value) and kind in ("constant", "input"):
        return f"({value})"
    # an input may be a constant; a constant may be nothing else, and a label a label only
    fitting = {
        "state": ("state", "input"),
        "input": ("state", "input", "constant"),
        "constant": ("constant",),
        "label": ("label",),
    }
    if outer.get(value) in fitting[kind]:
        return value
    raise refusal(f"the bind {instance} gives {name} the value {shown(value)}")


def _composed(one: Component, other: Component) -> Component:
    """Two components side by side."""
    n_others = len(other.locations)
    if len(one.locations) * n_others > MOST_TERMS:
        raise refusal("its instances have too many locations together")
    kinds = {**one.kinds, **other.kinds}
    kinds.update((name, "state") for name, kind in one.kinds.items() if kind == "state")
    found = Component(kinds, one.local | other.local)
    for a in one.locations:
        for b in other.locations:
            name = f"{a.name}_{b.name}"
            both = a.flow + b.flow, a.invariant + b.invariant, a.places + b.places
            found.locations.append(Location(name, *both))
    for edge in one.edges:
        if other.kinds.get(edge.label) != "label":
            _check_owner(edge, other)
            found.edges += [
                replace(edge, source=edge.source * n_others + k, target=edge.target * n_others + k)
                for k in range(n_others)
            ]
            continue
        found.edges += [
            Edge(
                edge.source * n_others + partner.source,
                edge.target * n_others + partner.target,
                edge.guard + partner.guard,
                edge.assignment + partner.assignment,
                edge.label,
                edge.at_once or partner.at_once,
            )
            for partner in other.edges
            if partner.label == edge.label
        ]
    for edge in other.edges:
        if one.kinds.get(edge.label) != "label":
            _check_owner(edge, one)
            found.edges += [
                replace(edge, source=k * n_others + edge.source, target=k * n_others + edge.target)
                for k in range(len(one.locations))
            ]
    return found


def _check_owner(edge: Edge, other: Component) -> None:
    """Refuse a transition that sets a variable which an instance that stays lets flow."""
    moving = {name for location in other.locations for name in location.moving}
    for one in edge.assignment:
        name = (_NAME.match(one) or [""])[0]
        if name in moving:
            raise refusal(f"a transition sets {name}, which another instance controls")


# -- parts of the document ---------------------------------------------------------------------


def conditions(element: ElementTree.Element, tag: str) -> tuple[str, ...]:
    """The conditions that stand in the elements of a tag, joined by ``&`` or ``&&``."""
    text = " & ".join((child.text or "").strip() for child in _children(element, tag))
    parts = [" ".join(part.split()) for part in text.split("&")]
    if (either := next((part for part in parts if "|" in part), None)) is not None:
        of = f"{shown(either)}, of the {tag},"
        raise refusal(f"{of} is of two cases; write a transition or a location for each")
    return tuple(part for part in parts if part not in ("", "true"))


def names_in(texts: Iterable[str]) -> set[str]:
    """Names that stand in texts."""
    return set().union(*map(_NAME.findall, texts))


def renamed(text: str, texts: Mapping[str, str]) -> str:
    """A text with others in the place of names."""
    return _NAME.sub(lambda match: texts.get(match[0], match[0]), text)


def refusal(why: str) -> ValueError:
    """What is wrong with a model, in one sentence."""
    return ValueError(f"this SpaceEx model cannot be read ({why}); see from_spaceex.")


def _children(element: ElementTree.Element, tag: str) -> list[ElementTree.Element]:
    return [*element.findall(f"{{{NAMESPACE}}}{tag}"), *element.findall(tag)]
