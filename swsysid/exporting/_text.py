"""Formulas as text in the languages of other tools."""

from __future__ import annotations

import keyword
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from swsysid.exporting._expressions import LEAVES, Expression

_SUM, _PRODUCT, _ATOM = range(3)  # how tightly a text binds
Piece = tuple[str, int]
Names = Callable[[str, int], str]  # of a leaf, by its kind and its place


@dataclass(frozen=True)
class Style:
    """How a language writes formulas.

    `functions` are names of functions that go by another name there; `power` and `choice` write
    ``base ** exponent`` and a value where another is above zero.
    """

    power: Callable[[str, str], str]
    choice: Callable[[str, str, str], str]
    functions: Mapping[str, str] = field(default_factory=dict)

    def text(self, expression: Expression, names: Names) -> str:
        """A formula with all digits of its numbers."""

        def leaf(kind: str, argument: float) -> Piece:
            if kind == "number":
                text = repr(float(argument))
                return text, (_PRODUCT if text.startswith("-") else _ATOM)
            return (str(argument) if kind == "name" else names(kind, int(argument))), _ATOM

        return expression.folded(leaf, _Operations(self))[0]


class _Operations(dict[str, Callable[..., Piece]]):
    """What operations are in a style; what it has no words for is a function of that name."""

    def __init__(self, style: Style):
        self.style = style
        super().__init__(
            add=self._sum,
            mul=self._product,
            div=lambda a, b: (f"{_bound(a, _PRODUCT)}/{_bound(b, _ATOM)}", _PRODUCT),
            pow=lambda a, b: (style.power(_bound(a, _ATOM), b[0]), _ATOM),
            positive=lambda a: (style.choice(a[0], "1.0", "0.0"), _ATOM),
            where=lambda c, a, b: (style.choice(c[0], a[0], b[0]), _ATOM),
        )

    def __contains__(self, kind: object) -> bool:
        return True

    def __missing__(self, kind: str) -> Callable[..., Piece]:
        name = self.style.functions.get(kind, kind)
        return lambda *parts: (f"{name}({', '.join(part[0] for part in parts)})", _ATOM)

    @staticmethod
    def _product(*parts: Piece) -> Piece:
        factors = [_bound(part, _PRODUCT) for part in parts]
        text = "*".join(factors).removeprefix("-1.0*")
        return (text if text.startswith(factors[0]) else f"-{text}"), _PRODUCT

    @staticmethod
    def _sum(*parts: Piece) -> Piece:
        text = parts[0][0]
        for part, _ in parts[1:]:
            text += f" - {part[1:]}" if part.startswith("-") else f" + {part}"
        return text, _SUM


def _bound(part: Piece, least: int) -> str:
    return part[0] if part[1] >= least else f"({part[0]})"


def _powered(base: str, exponent: str) -> str:
    return f"{base}^{exponent.removesuffix('.0') if exponent[0].isdigit() else f'({exponent})'}"


def named(
    states: Sequence[str], inputs: Sequence[str], clocks: tuple[str, str] = ("dwell", "time")
) -> Names:
    """Leaves by names of their own."""
    known = {"x": states, "u": inputs, "dwell": clocks[:1], "time": clocks[1:]}
    return lambda kind, place: known[kind][place]


PLAIN = Style(_powered, lambda c, a, b: f"if({c} > 0, {a}, {b})")


def identifiers(names: Iterable[str], taken: Iterable[str] = ()) -> list[str]:
    """Names of letters, digits and underscores, each another one and none that is taken.

    Examples
    --------
    >>> identifiers(["h", "speed (m/s)", "speed_m/s", "2nd", "time"], ["time"])
    ['h', 'speed_m_s', 'speed_m_s_2', 'x2nd', 'time_2']
    """
    used, found = set(taken), []
    for name in names:
        plain = re.sub(r"\W+", "_", name, flags=re.ASCII).strip("_")
        plain = plain if plain[:1].isalpha() else f"x{plain}"
        plain = f"{plain}_" if keyword.iskeyword(plain) else plain
        count, unique = 1, plain
        while unique in used:
            count += 1
            unique = f"{plain}_{count}"
        used.add(unique)
        found.append(unique)
    return found


def shared(
    expressions: Sequence[Expression], prefix: str = "s"
) -> tuple[list[Expression], list[Expression]]:
    """Parts that occur in several places, the inner ones first, and what is left of the formulas.

    Each part is a leaf in what follows, named by the prefix and its number.

    Examples
    --------
    >>> import numpy as np
    >>> x = Expression("x", (0,))
    >>> parts, left = shared([np.sin(x + 1.0), np.cos(x + 1.0)])
    >>> [PLAIN.text(one, named(["x"], [])) for one in (*parts, *left)]
    ['1.0 + x', 'sin(s0)', 'cos(s0)']
    """
    counts: Counter[Expression] = Counter()
    pending = list(expressions)
    order: list[Expression] = []
    while pending:
        part = pending.pop()
        if part.kind in LEAVES:
            continue
        counts[part] += 1
        if counts[part] == 1:
            order.append(part)
            pending.extend(part.arguments)
    often = [part for part in order if counts[part] > 1]
    often.sort(key=lambda part: part.depth)
    named: dict[Expression, Expression] = {}
    parts = []
    for part in often:
        parts.append(_with_names(part, named))
        named[part] = Expression("name", (f"{prefix}{len(named)}",))
    return parts, [_with_names(one, named) for one in expressions]


def _with_names(expression: Expression, named: Mapping[Expression, Expression]) -> Expression:
    return expression.mapped(named.get)
