"""Surfaces and jumps of laws as guards, with the slides along them as modes of their own.

Where the fields f and h on the two sides of a surface g = 0 both point at it, the state slides
along it with Filippov's combination f + w (h - f), w = a / (a - b), in which a and b are the rates
of g along f and h. The slide is left where a or b passes zero. Dry friction is a law that jumps at
the level v = 0: along it v' = 0, the state sticks.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from swsysid.exporting._expressions import (
    ONE,
    ZERO,
    Expression,
    NoFormulaError,
    derivative,
    evaluated,
    least,
    number,
    operation,
)
from swsysid.exporting._system import Edge, HybridSystem
from swsysid.exporting._text import PLAIN, named

Law = tuple[Expression, ...]
_JUMPS = ("sign", "positive", "where")
_MOST_LEVELS = 2  # each makes three modes of one
_PROBES, _ROUNDING = 8, 1e-12  # points at which the two sides of a level are compared


def with_slides(system: HybridSystem) -> HybridSystem:
    """The same system with edges alone, for tools that know guards and no surfaces.

    Examples
    --------
    Dry friction makes three modes of one: backwards, forwards, held.

    >>> import numpy as np
    >>> x, v = Expression("x", (0,)), Expression("x", (1,))
    >>> stick = HybridSystem(("x", "v"), (), ((v, -x - 0.1 * np.sign(v)),))
    >>> with_slides(stick).titles
    ('mode 0, v < 0', 'mode 0, v > 0', 'mode 0, v = 0 held')
    """
    levels = list(_levels(system))
    if system.surfaces is not None:
        system = _along_surfaces(system)
    if len(levels) > _MOST_LEVELS:
        raise NoFormulaError(
            f"the laws jump at {len(levels)} levels of states, and no more than {_MOST_LEVELS} can "
            "be written as modes; leave out effects that jump."
        )
    for level in levels:
        system = _Level(system, level).split()
    return system


def rate(value: Expression, law: Sequence[Expression]) -> Expression | None:
    """The time derivative of a value along a law, None if an input takes part in the value."""
    if "u" in value.leaves:
        return None
    terms = [derivative(value, Expression("x", (place,))) * one for place, one in enumerate(law)]
    return operation("add", derivative(value, Expression("time")), *terms)


# -- surfaces --------------------------------------------------------------------------------------


def _along_surfaces(system: HybridSystem) -> HybridSystem:
    """Edges for surfaces: each pair of modes with the slide between them."""
    assert system.surfaces is not None
    laws, titles, labels = list(system.laws), list(system.titles), list(system.labels)
    modes, edges, slides = range(len(laws)), list(system.edges), []
    enters = [system.surfaces.enters(mode) for mode in modes]
    for one, other in combinations(modes, 2):
        guard = system.surfaces.between(one, other)
        a, b = rate(guard, laws[one]), rate(guard, laws[other])
        if a is not None and b is not None and a != b:
            slide = len(laws)
            laws.append(_combined(laws[one], laws[other], a, b))
            titles.append(f"between {one} and {other}")
            labels.append(labels[one])
            slides.append((slide, one, other))
            edges += [Edge(one, slide, least(enters[other], a, -b))]
            edges += [Edge(other, slide, least(enters[one], a, -b))]
            edges += [Edge(slide, other, b), Edge(slide, one, -a)]
        edges += [
            Edge(one, other, least(enters[other], a)),
            Edge(other, one, least(enters[one], None if b is None else -b)),
        ]
    edges += [
        Edge(slide, third, enters[third])
        for slide, one, other in slides
        for third in modes
        if third not in (one, other)
    ]
    return replace(
        system, laws=tuple(laws), titles=tuple(titles), labels=tuple(labels), edges=tuple(edges),
        starts=tuple(enumerate(enters)), surfaces=None,
    )  # fmt: skip


def _combined(before: Law, after: Law, a: Expression, b: Expression) -> Law:
    """Filippov's combination of two laws."""
    share = a / (a - b)
    return tuple(
        one if one == other else one + share * (other - one)
        for one, other in zip(before, after, strict=True)
    )


# -- levels at which laws jump ---------------------------------------------------------------------


def _levels(system: HybridSystem) -> Iterator[Expression]:
    """What passes zero where a law jumps, of states or of time alone."""
    found: list[Expression] = []
    for law in system.laws:
        for part in (part for one in law for part in one.parts()):
            if part.kind not in _JUMPS:
                continue
            level = _upright(part.arguments[0])[0]
            if level in found or "u" in level.leaves or not level.leaves & {"x", "time"}:
                continue
            found.append(level)
            if _jumps(system, level):
                yield level


def _upright(value: Expression) -> tuple[Expression, float]:
    """A value or its negative, whichever is the same for both, and the sign of the value in it."""
    negative = (
        operation("add", *(-part for part in value.arguments)) if value.kind == "add" else -value
    )
    return (value, 1.0) if repr(value) >= repr(negative) else (negative, -1.0)


def _jumps(system: HybridSystem, level: Expression) -> bool:
    """Whether a law differs on both sides of a level x = c, of which only such can be asked."""
    rest = [part for part in _terms(level) if part.value is None]
    if len(rest) != 1 or rest[0].kind != "x":
        return True
    place, constant = rest[0].arguments[0], evaluated(level, {"x": [0.0] * len(system.states)})
    rng = np.random.default_rng(0)
    for _ in range(_PROBES):
        x = np.array(system.origin) + np.array(system.sizes) * rng.standard_normal(
            len(system.sizes)
        )
        x[place] = -constant
        point = {"x": x, "u": rng.standard_normal(len(system.inputs))}
        for law in system.laws:
            low, high = (
                np.array([evaluated(_sided(one, level, side), point) for one in law])
                for side in (-1.0, 1.0)
            )
            if (np.abs(high - low) > _ROUNDING * (np.abs(high) + np.abs(low))).any():
                return True
    return False


def _terms(value: Expression) -> tuple[Expression, ...]:
    return value.arguments if value.kind == "add" else (value,)


def _sided(value: Expression, level: Expression, side: float) -> Expression:
    """A value as it is on one side of a level."""

    def change(part: Expression) -> Expression | None:
        if part.kind not in _JUMPS:
            return None
        upright, sign = _upright(part.arguments[0])
        if upright != level:
            return None
        if part.kind == "sign":
            return number(side * sign)
        if part.kind == "positive":
            return ONE if side * sign > 0.0 else ZERO
        return _sided(part.arguments[1 if side * sign > 0.0 else 2], level, side)

    return value.mapped(change)


@dataclass(frozen=True)
class _Level:
    """A system, and a level of states or of time at which its laws jump."""

    system: HybridSystem
    level: Expression

    def split(self) -> HybridSystem:
        """Below, above and held at the level: three modes for each; two if it is one of time."""
        system, held = self.system, "x" in self.level.leaves
        name = PLAIN.text(self.level, named(system.states, system.inputs))
        signs = ("< 0", "> 0", "= 0 held") if held else ("< 0", ">= 0")
        n = len(signs)
        laws: list[Law] = []
        edges: list[Edge] = []
        for mode, law in enumerate(system.laws):
            below, above = (
                tuple(_sided(one, self.level, side) for one in law) for side in (-1.0, 1.0)
            )
            a, b = rate(self.level, below), rate(self.level, above)
            assert a is not None and b is not None
            laws += [below, above, self._at(below, above, a, b)][:n]
            low, high, hold = (n * mode + place for place in range(3))
            if held:
                edges += [
                    Edge(low, hold, least(self.level, a, -b)),
                    Edge(high, hold, least(-self.level, a, -b)),
                    Edge(hold, high, b),
                    Edge(hold, low, -a),
                ]
            edges += [
                Edge(low, high, least(self.level, a)),
                Edge(high, low, least(-self.level, -b)),
            ]
            sides = [self._side(-1.0), self._side(1.0), self._within(a, b)]
            for _, edge in system.exits(mode):
                for place, side in enumerate(sides[:n]):
                    edges += self._moved(edge, n, place, side)
        return replace(
            system,
            laws=tuple(laws),
            edges=tuple(edges),
            titles=tuple(f"{title}, {name} {sign}" for title in system.titles for sign in signs),
            labels=tuple(label for label in system.labels for _ in signs),
            starts=tuple(self._starts(n)),
        )

    def _at(self, below: Law, above: Law, a: Expression, b: Expression) -> Law:
        """Filippov's law at the level; a state that it holds has no rate."""
        law = list(_combined(below, above, a, b))
        moving = [part for part in _terms(self.level) if part.value is None]
        if len(moving) == 1 and moving[0].kind == "x":
            law[moving[0].arguments[0]] = ZERO
        return tuple(law)

    def _side(self, side: float) -> Callable[[Expression], Expression]:
        return lambda value: _sided(value, self.level, side)

    def _within(self, a: Expression, b: Expression) -> Callable[[Expression], Expression]:
        def at_level(value: Expression) -> Expression:
            below, above = (_sided(value, self.level, side) for side in (-1.0, 1.0))
            return below if below == above else below + a / (a - b) * (above - below)

        return at_level

    def _moved(
        self, edge: Edge, n: int, place: int, side: Callable[[Expression], Expression]
    ) -> Iterator[Edge]:
        """An edge of the system from one side of the level; a reset may lead to the other one."""
        source, target, guard = n * edge.source + place, n * edge.target, side(edge.guard)
        if edge.reset is None:
            yield Edge(source, target + place, guard)
            return
        reset = tuple(side(one) for one in edge.reset)
        landed = self.level.mapped(
            lambda part: reset[part.arguments[0]] if part.kind == "x" else None
        )
        if landed == self.level:
            yield Edge(source, target + place, guard, reset)
        elif n == 3:
            yield Edge(source, target + 1, least(guard, landed), reset)
            yield Edge(source, target, guard, reset)

    def _starts(self, n: int) -> Iterator[tuple[int, Expression]]:
        for mode, known in self.system.starts:
            if n == 3:
                yield n * mode + 2, least(known, self.level, -self.level)
            yield n * mode + 1, least(known, self.level)
            yield n * mode, least(known, -self.level)
