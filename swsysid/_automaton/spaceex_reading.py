"""A SpaceEx model, read into the texts from which an automaton is stated.

SpaceEx transitions may be taken while their guard holds and must be taken where the invariant ends;
here they are taken where their guard rises to zero. A model is read where both are the same: every
invariant ends where a guard lets the state out or never, every guard holds only where an invariant
ends, and where a transition leads the invariant holds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.parts import FirstModes
from swsysid._automaton.polynomial_text import (
    Polynomial,
    follows,
    inequalities_in,
    negative,
    rate,
    read_inequality,
    read_polynomial,
    substituted,
)
from swsysid._automaton.spaceex import MEANING, read_settings
from swsysid._automaton.spaceex_network import (
    Component,
    Edge,
    Location,
    read_component,
    refusal,
)
from swsysid._automaton.spaceex_pruning import without_contradictions, without_instants
from swsysid._automaton.stating import constants_of
from swsysid._checks.parameters import bytes_of, flag, shown
from swsysid.exporting._text import identifiers

_ASSIGNED = re.compile(r"(\w+)\s*('?)\s*(:=|==|=)\s*(.+)", re.DOTALL)
_MOST_SIDES = 40  # conditions known of a place, at which no further case is told apart


@dataclass
class SpaceexModel:
    """Names and texts of a model."""

    states: list[str]
    inputs: list[str]
    parameters: dict[str, float]
    first_modes: FirstModes | None = None
    laws: list[dict[str, str]] = field(default_factory=list)
    transitions: list[tuple[int, int, str, dict[str, str]]] = field(default_factory=list)


def read_spaceex(
    path: str | Path,
    parameters: Mapping[str, float] | None,
    component: str | None,
    settings: str | Path | None,
    urgent: bool,
) -> SpaceexModel:
    """The texts of a model; what an automaton here cannot be is refused in one sentence.

    Constants have the values that `parameters` give, or those of its settings. With `urgent` guards
    alone decide: transitions are taken where they first may be, and a state goes on beyond an
    invariant that no guard ends.
    """
    beside = Path(path).with_suffix(".cfg") if settings is None else Path(settings)
    is_told = settings is not None or beside.is_file()
    told = read_settings(bytes_of(beside).decode("utf-8", errors="replace") if is_told else "")
    read = read_component(bytes_of(path), component or told.system)
    constants = read.of_kind("constant")
    values = told.constants(constants, constants_of(parameters))
    _check_constants(constants, values)
    written_here = read.note == MEANING
    if not written_here:
        read = _with_inputs(_without_outputs(_clocks_renamed(read)))
    model = SpaceexModel(read.of_kind("state"), read.of_kind("input"), values)
    columns = [*model.states, *model.inputs, *CLOCKS]
    read = without_contradictions(read, lambda part: _is_possible(part, columns, values))
    start, mode = told.start(model.states), _first_mode(read, told.locations)
    read, mode, begun = without_instants(read, mode, lambda part: _assignments(part, "assignment"))
    if start is not None and mode is not None:
        start = [
            _at(read_polynomial(begun.get(name, name), model.states, values), start)
            for name in model.states
        ]
        model.first_modes = FirstModes(np.array([start]), np.array([mode]))
    model.laws = [_law(one, model.states) for one in read.locations]
    resets = [_assignments(one.assignment, "assignment") for one in read.edges]
    if written_here:
        _set_clocks_apart(model, resets)
    if not model.states:
        raise refusal("nothing in it moves")
    checks = _Checks(model, read, values)
    for edge, reset in zip(read.edges, resets, strict=True):
        guard = checks.guard(edge)
        model.transitions.append((edge.source, edge.target, guard, reset))
    if not flag("urgent", urgent):
        checks.invariants_end()
        for number, edge in enumerate(read.edges):
            checks.is_forced(number, edge)
            if not written_here:
                checks.may_enter(number, edge)
    if not written_here:
        checks.is_determined()
    return model


def _first_mode(read: Component, told: Mapping[str, str]) -> int | None:
    """The only location in which all instances are where they are told to start."""

    def starts(location: Location) -> bool:
        return all(at == told.get(instance, at) for instance, at in location.places)

    possible = [place for place, one in enumerate(read.locations) if told and starts(one)]
    return possible[0] if len(possible) == 1 else None


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


def _without_outputs(read: Component) -> Component:
    """Names that all invariants define by an equation, and no flow, become what defines them."""
    equations = [set(location.invariant) for location in read.locations]
    for condition in set.intersection(*equations):
        name, equal, value = (part.strip() for part in condition.partition("=="))
        if equal and name in read.of_kind("state") and not read.moves(name):
            kinds = {other: kind for other, kind in read.kinds.items() if other != name}
            texts = {name: f"({value})"}
            read = read.rewritten(texts, kinds, read.local).without(f"({value}) == {value}")
            return _without_outputs(read)
    return read


def _with_inputs(read: Component) -> Component:
    """Names that nothing moves and no transition knows may go any way: they are inputs."""
    named = read.states_named()
    for name in read.of_kind("state"):
        read.kinds[name] = "state" if name in named else "input"
    return read


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


def _law(location: Location, states: Sequence[str]) -> dict[str, str]:
    """The rates of all states in a location."""
    told = _assignments(location.flow, "flow")
    open_ones = [name for name in states if name not in told]
    if open_ones:
        raise refusal(f"location {location.name} does not say how {open_ones[0]} moves")
    return told


def _assignments(parts: tuple[str, ...], where: str) -> dict[str, str]:
    """The values of names in conditions ``x' == value``, or ``x := value``."""
    told: dict[str, str] = {}
    for part in parts:
        match = _ASSIGNED.fullmatch(part)
        # without a prime or := or, in an assignment, = it is a condition on what is there
        sets = match and (match[2] or match[3] == ":=" or (match[3], where) == ("=", "assignment"))
        if match is None or not sets or re.search(r"[<>=']", match[4]):
            raise refusal(f"{shown(part)}, of the {where}, is no equation for one variable")
        if match[1] in told:
            raise refusal(f"one {where} has two equations for {match[1]}")
        told[match[1]] = match[4]
    return told


# -- what the conditions mean ------------------------------------------------------------------


def _positives(
    invariant: Sequence[str], columns: Sequence[str], values: Mapping[str, float]
) -> list[Polynomial]:
    """What an invariant says is not negative; of an equation both sides."""
    found: list[Polynomial] = []
    for one in (one for part in invariant for one in inequalities_in(part)):
        left, equal, right = one.partition("==")
        sides = (f"{left}<={right}", f"{left}>={right}") if equal else (one,)
        found += [read_inequality(side, columns, values) for side in sides]
    return found


def _is_possible(
    invariant: Sequence[str], columns: Sequence[str], values: Mapping[str, float]
) -> bool:
    """Whether nothing shows that an invariant holds nowhere."""
    nowhere: Polynomial = {(0,) * len(columns): -1.0}
    return not follows(nowhere, (), _positives(invariant, columns, values))


def _at(polynomial: Polynomial, state: Sequence[float]) -> float:
    """Its value."""
    return float(sum(coef * np.prod(np.power(state, row)) for row, coef in polynomial.items()))


class _Checks:
    """The polynomials of a model, and whether it means the same there and here."""

    def __init__(self, model: SpaceexModel, read: Component, parameters: Mapping[str, float]):
        self.parameters, self.read = parameters, read
        self.columns = [*model.states, *model.inputs, *CLOCKS]
        self.rates = [self._columns_of(law) for law in model.laws]
        for rates in self.rates:
            rates.update(dict.fromkeys(self._clocks, self._one))
        self.invariants = [
            _positives(location.invariant, self.columns, parameters) for location in read.locations
        ]
        self.guards: list[list[Polynomial]] = []  # what must not be negative

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
        """The conditions of a guard that are the last to become true; "" if there are none.

        A single one where the others hold as it rises to zero, and it goes no further or they hold
        there too; else all that do not follow from the others and the invariant.
        """
        told = [
            one
            for part in edge.guard
            for one in inequalities_in(self._one_sided(part, edge.source))
        ]
        read, inside = [self._positive(one) for one in told], self.invariants[edge.source]
        for text, guard in zip(told, read, strict=True):
            known = [*self._rising(guard, edge.source), *inside]
            ends = follows(negative(guard), (), inside)
            zero, beyond = ([guard], []) if ends else ([], [guard])
            if all(follows(one, zero, [*beyond, *known]) for one in read):
                self.guards.append([guard])
                return text
        kept = list(range(len(read)))
        for place in range(len(read)):
            others = [read[k] for k in kept if k != place]
            if follows(read[place], (), [*others, *inside]):
                kept.remove(place)
        if not kept:
            where = self.read.locations[edge.source].name
            raise refusal(f"a transition out of location {where} may be taken at any time")
        self.guards.append([read[place] for place in kept])
        return " & ".join(told[place] for place in kept)

    def _one_sided(self, condition: str, source: int) -> str:
        """An equation as the inequality that is left of it within the invariant."""
        left, equal, right = condition.partition("==")
        if not equal:
            return condition
        for relation, other in (("<=", ">="), (">=", "<=")):
            if follows(self._positive(f"{left}{other}{right}"), (), self.invariants[source]):
                return f"{left}{relation}{right}"
        raise refusal(
            f"the guard {shown(condition)} is an equation, and no invariant tells from which side "
            "it is reached"
        )

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
                if not _covered(out, [one], known):
                    raise refusal(
                        f"the invariant {shown(' & '.join(location.invariant))} of location "
                        f"{location.name} ends where no guard of its location begins; give "
                        "urgent=True to go on there"
                    )

    def is_forced(self, number: int, edge: Edge) -> None:
        """Refuse a transition that may be taken and need not."""
        inside = self.invariants[edge.source]
        ends = any(follows(negative(one), (), inside) for one in self.guards[number])
        if not (edge.at_once or ends):
            raise refusal(
                f"the transition with the guard {shown(' & '.join(edge.guard))} may be taken or "
                "not, as no invariant ends where it begins; give urgent=True to take it at once"
            )

    def is_determined(self) -> None:
        """Refuse two transitions out of one location that begin at one place."""
        for number, (edge, guard) in enumerate(zip(self.read.edges, self.guards, strict=True)):
            for other, rival in zip(self.read.edges[:number], self.guards[:number], strict=True):
                both = ((guard, rival), (rival, guard))
                same = all(follows(one, (), known) for told, known in both for one in told)
                if same and edge.source == other.source:
                    raise refusal(
                        f"two transitions out of location {self.read.locations[edge.source].name} "
                        "begin at one place, and nothing tells which is taken"
                    )

    def may_enter(self, number: int, edge: Edge) -> None:
        """Refuse a transition that leads to where its target's invariant may not hold."""
        guard, inside = self.guards[number], self.invariants[edge.source]
        reset = self._columns_of(_assignments(edge.assignment, "assignment"))
        # a guard of one condition is zero where it is taken; of several only the last is
        zero, known = (
            (guard, self._rising(guard[0], edge.source)) if len(guard) == 1 else ([], guard)
        )
        for one in self.invariants[edge.target]:
            if not follows(substituted(one, reset), zero, [*known, *inside]):
                raise refusal(
                    f"the invariant of location {self.read.locations[edge.target].name} need not "
                    f"hold where the transition with the guard {shown(' & '.join(edge.guard))} "
                    "leads; give urgent=True if it is taken nevertheless"
                )


def _covered(
    guards: Sequence[Sequence[Polynomial]], zero: list[Polynomial], known: list[Polynomial]
) -> bool:
    """Whether one guard or another holds wherever others are zero, or not negative.

    Where a condition is undecided, both of its sides are looked at.
    """
    if any(all(follows(one, zero, known) for one in guard) for guard in guards):
        return True
    some = next(iter(known or zero), None)
    if some is None or follows({(0,) * len(next(iter(some))): -1.0}, zero, known):
        return some is not None  # nothing is there
    for guard in guards:
        for one in guard:
            sides = one, negative(one)
            if len(known) < _MOST_SIDES and not any(follows(side, zero, known) for side in sides):
                return all(_covered(guards, zero, [*known, side]) for side in sides)
    return False
