"""A SpaceEx model, read into the texts from which an automaton is stated.

SpaceEx transitions may be taken while their guard holds and must be taken where the invariant ends;
here they are taken where their guard rises to zero. A model is read where both are the same: every
invariant ends where a guard lets the state out or never, every guard holds only where an invariant
ends, and where a transition leads the invariant holds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.polynomial_text import read_inequality, read_polynomial
from swsysid._automaton.polynomials import Polynomial, follows, negative, rate, substituted
from swsysid._automaton.spaceex import MEANING
from swsysid._automaton.spaceex_network import Component, Edge, read_component, refusal
from swsysid._checks.parameters import shown
from swsysid.exporting._text import identifiers

_ASSIGNED = re.compile(r"(\w+)\s*('?)\s*(:=|==|=)\s*(.+)", re.DOTALL)
_CHAIN = re.compile(r"(<=|>=|<|>)")


@dataclass
class SpaceexModel:
    """Names and texts of a model."""

    states: list[str]
    inputs: list[str]
    laws: list[dict[str, str]] = field(default_factory=list)
    transitions: list[tuple[int, int, str, dict[str, str]]] = field(default_factory=list)


def read_spaceex(
    content: bytes, parameters: Mapping[str, float], component: str | None, urgent: bool
) -> SpaceexModel:
    """The texts of a model; what an automaton here cannot be is refused in one sentence.

    With `urgent` its guards alone decide: transitions are taken where they first may be, and a
    state goes on beyond an invariant that no guard ends.
    """
    read = read_component(content, component)
    _check_constants(read.of_kind("constant"), parameters)
    written_here = read.note == MEANING
    if not written_here:
        read = _clocks_renamed(read)
    model = SpaceexModel(read.of_kind("state"), read.of_kind("input"))
    model.laws = [_assignments(one.flow, "flow") for one in read.locations]
    resets = [_assignments(one.assignment, "assignment") for one in read.edges]
    if written_here:
        _set_clocks_apart(model, resets)
    if not model.states:
        raise refusal("nothing in it moves")
    checks = _Checks(model, read, parameters)
    for edge, reset in zip(read.edges, resets, strict=True):
        guard = checks.guard(edge)
        model.transitions.append((edge.source, edge.target, guard, reset))
    if not urgent:
        checks.invariants_end()
        for number, edge in enumerate(read.edges):
            checks.is_forced(number, edge)
            if not written_here:
                checks.may_enter(number, edge)
    if not written_here:
        checks.is_determined()
    return model


def _check_constants(constants: list[str], parameters: Mapping[str, float]) -> None:
    unknown = [name for name in constants if name not in parameters]
    if unknown:
        raise ValueError(
            f"the model has the constant {unknown[0]!r} without a value; give parameters={{"
            f"{unknown[0]!r}: ...}}."
        )
    useless = [name for name in parameters if name not in constants]
    if useless:
        raise ValueError(
            f"parameters give {useless[0]!r} a value, which the model does not leave open; leave "
            "it out."
        )


# -- names -----------------------------------------------------------------------------------------


def _clocks_renamed(read: Component) -> Component:
    """Names that are those of clocks here become others: what they are at the start is open."""
    names = {
        name: identifiers([*(other for other in read.kinds if other != name), name], CLOCKS)[-1]
        for name in CLOCKS
        if name in read.kinds
    }
    if not names:
        return read
    kinds = {names.get(name, name): kind for name, kind in read.kinds.items()}
    return read.rewritten(names, kinds, read.local)


def _set_clocks_apart(model: SpaceexModel, resets: list[dict[str, str]]) -> None:
    """Take states that run as the clocks of guards do for these clocks."""
    for clock in CLOCKS:
        runs = all(law.get(clock) in ("1", "1.0") for law in model.laws)
        begins = {"dwell": ("0", "0.0"), "time": (None,)}[clock]
        as_told = all(reset.get(clock) in begins for reset in resets)
        if clock in model.states and runs and as_told:
            model.states.remove(clock)
            for texts in (*model.laws, *resets):
                texts.pop(clock, None)


def _assignments(parts: tuple[str, ...], where: str) -> dict[str, str]:
    """The values of names in conditions ``x' == value``, or ``x := value``."""
    told: dict[str, str] = {}
    for part in parts:
        match = _ASSIGNED.fullmatch(part)
        # without a prime or := it is a condition on what is there
        if match is None or re.search(r"[<>=']", match[4]) or not (match[2] or match[3] == ":="):
            raise refusal(f"{shown(part)}, of the {where}, is no equation for one variable")
        if match[1] in told:
            raise refusal(f"one {where} has two equations for {match[1]}")
        told[match[1]] = match[4]
    return told


# -- what the conditions mean ------------------------------------------------------------------


class _Checks:
    """The polynomials of a model, and whether it means the same there and here."""

    def __init__(self, model: SpaceexModel, read: Component, parameters: Mapping[str, float]):
        self.parameters, self.read = parameters, read
        self.columns = [*model.states, *model.inputs, *CLOCKS]
        self.rates = [self._columns_of(law) for law in model.laws]
        for rates in self.rates:
            rates.update(dict.fromkeys(self._clocks, self._one))
        self.invariants = [
            [self._positive(one) for part in location.invariant for one in _pairs(part)]
            for location in read.locations
        ]
        self.guards: list[Polynomial] = []

    @property
    def _clocks(self) -> range:
        return range(len(self.columns) - len(CLOCKS), len(self.columns))

    @property
    def _one(self) -> Polynomial:
        return {(0,) * len(self.columns): 1.0}

    def _columns_of(self, texts: Mapping[str, str]) -> dict[int, Polynomial]:
        """Polynomials by the column of their name; other names are left for `Statement`."""
        return {
            self.columns.index(name): read_polynomial(text, self.columns, self.parameters)
            for name, text in texts.items()
            if name in self.columns
        }

    def _positive(self, condition: str) -> Polynomial:
        found: Polynomial = read_inequality(condition, self.columns, self.parameters)
        return found

    def guard(self, edge: Edge) -> str:
        """The condition of a guard that is the last to become true.

        The others hold where it rises to zero, and it goes no further, or they hold there too.
        """
        told = [one for part in edge.guard for one in _pairs(self._one_sided(part, edge.source))]
        read, inside = [self._positive(one) for one in told], self.invariants[edge.source]
        for text, guard in zip(told, read, strict=True):
            known = [*self._rising(guard, edge.source), *inside]
            ends = follows(negative(guard), (), inside)
            zero, beyond = ([guard], []) if ends else ([], [guard])
            if all(follows(one, zero, [*beyond, *known]) for one in read):
                self.guards.append(guard)
                return text
        raise refusal(
            f"the guard {shown(' & '.join(edge.guard))} is not a single condition, as transitions "
            "here have"
        )

    def _one_sided(self, condition: str, source: int) -> str:
        """An equation as the inequality that is left of it within the invariant."""
        left, equal, right = condition.partition("==")
        if not equal:
            return condition
        for relation, other in (("<=", ">="), (">=", "<=")):
            if follows(self._positive(f"{left}{other}{right}"), (), self.invariants[source]):
                return f"{left}{relation}{right}"
        return condition

    def _rising(self, guard: Polynomial, source: int) -> list[Polynomial]:
        """What is not negative where a guard rises: its time derivative."""
        found = rate(guard, self.rates[source])
        return [] if found is None else [found]

    def invariants_end(self) -> None:
        """Refuse an invariant that ends where no guard lets the state out: time stops there."""
        for place, (location, known) in enumerate(
            zip(self.read.locations, self.invariants, strict=True)
        ):
            out = [
                guard
                for edge, guard in zip(self.read.edges, self.guards, strict=True)
                if edge.source == place
            ]
            for one in known:
                changes = rate(one, self.rates[place])
                if changes is not None and follows(changes, [one], known):
                    continue  # it never ends
                if not any(follows(guard, [one], known) for guard in out):
                    raise refusal(
                        f"the invariant {shown(' & '.join(location.invariant))} of location "
                        f"{location.name} ends where no guard of its location begins; give "
                        "urgent=True to go on there"
                    )

    def is_forced(self, number: int, edge: Edge) -> None:
        """Refuse a transition that may be taken and need not."""
        inside = self.invariants[edge.source]
        if not (edge.at_once or follows(negative(self.guards[number]), (), inside)):
            raise refusal(
                f"the transition with the guard {shown(' & '.join(edge.guard))} may be taken or "
                "not, as no invariant ends where it begins; give urgent=True to take it at once"
            )

    def is_determined(self) -> None:
        """Refuse two transitions out of one location that begin at one place."""
        for number, (edge, guard) in enumerate(zip(self.read.edges, self.guards, strict=True)):
            for other, rival in zip(self.read.edges[:number], self.guards[:number], strict=True):
                same = edge.source == other.source
                if same and follows(guard, (), [rival]) and follows(rival, (), [guard]):
                    raise refusal(
                        f"two transitions out of location {self.read.locations[edge.source].name} "
                        "begin at one place, and nothing tells which is taken"
                    )

    def may_enter(self, number: int, edge: Edge) -> None:
        """Refuse a transition that leads to where its target's invariant may not hold."""
        guard, inside = self.guards[number], self.invariants[edge.source]
        reset = self._columns_of(_assignments(edge.assignment, "assignment"))
        known = [*self._rising(guard, edge.source), *inside]
        for one in self.invariants[edge.target]:
            if not follows(substituted(one, reset), [guard], known):
                raise refusal(
                    f"the invariant of location {self.read.locations[edge.target].name} need not "
                    f"hold where the transition with the guard {shown(' & '.join(edge.guard))} "
                    "leads; give urgent=True if it is taken nevertheless"
                )


def _pairs(condition: str) -> list[str]:
    """Single inequalities of a chain such as ``0 <= x <= 1``."""
    parts = _CHAIN.split(condition)
    if len(parts) <= 3:
        return [condition]
    return ["".join(parts[place : place + 3]) for place in range(0, len(parts) - 2, 2)]
