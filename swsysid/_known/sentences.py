"""The kinds of things that can be known, each a set of linear constraints of coefficients."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array

REST = "*"  # every term that no other sentence about the equation names
_PLAIN = re.compile(r"[^\W\d][^`=<>+\-,*]*")


class Names:
    """Equations and terms as the printed equations have them, and how many modes there are."""

    def __init__(self, equations: Sequence[str], terms: Sequence[str], n_modes: int):
        self.equations, self.terms, self.n_modes = list(equations), list(terms), n_modes
        self._equations = {_usual(name): k for k, name in enumerate(self.equations)}
        self._terms = {_usual(name): k for k, name in enumerate(self.terms)}

    @property
    def shape(self) -> tuple[int, int, int]:
        """Modes, equations, terms."""
        return self.n_modes, len(self.equations), len(self.terms)

    def equation(self, name: str) -> int:
        """Number of an equation."""
        return self._place(name, "equation", "equations", self._equations, "'")

    def term(self, name: str) -> int:
        """Number of a term."""
        return self._place(name, "term", "terms", self._terms, "")

    def has_term(self, name: str) -> bool:
        """True if there is a term of that name."""
        return _usual(name) in self._terms

    @staticmethod
    def _place(name: str, kind: str, kinds: str, places: dict[str, int], prime: str) -> int:
        if _usual(name) not in places:
            listed = ", ".join(f"{one}{prime}" for one in list(places)[:20])
            more = ", ..." if len(places) > 20 else ""
            raise ValueError(
                f"known names the {kind} {name}{prime}, which there is not; "
                f"the {kinds} are {listed}{more}."
            )
        return places[_usual(name)]


def _usual(name: str) -> str:
    """A name with single spaces, products of columns without a star."""
    return " ".join(name.replace("*", " ").split()) or name


class Row(NamedTuple):
    """One constraint, lower <= sum of matrix times coefficients <= upper."""

    matrix: Array  # (n_modes, n_equations, n_terms)
    lower: float
    upper: float


class Sentence(Protocol):
    """Something known; `str` of it is a sentence of the grammar."""

    def rows(self, names: Names, named: set[tuple[int, int]], /) -> Iterator[Row]:
        """Its constraints, where sentences name these pairs of an equation and a term."""

    def named(self, names: Names, /) -> Iterator[tuple[int, int]]:
        """Equation and term of every coefficient that it names."""


class Part(NamedTuple):
    """So many times a coefficient, a law where there is no term, a term where there is no law."""

    weight: float
    equation: str
    term: str = ""

    def times(self, factor: float) -> Part:
        """So many times this."""
        return Part(self.weight * factor, self.equation, self.term)


@dataclass(frozen=True)
class Relation:
    """lower <= a sum of coefficients <= upper, in every mode."""

    parts: tuple[Part, ...]
    lower: float
    upper: float

    def rows(self, names: Names, named: set[tuple[int, int]]) -> Iterator[Row]:
        """One for each mode."""
        for mode in range(names.n_modes):
            matrix = np.zeros(names.shape)
            for part in self.parts:
                matrix[mode, names.equation(part.equation), names.term(part.term)] += part.weight
            yield Row(matrix, self.lower, self.upper)

    def named(self, names: Names) -> Iterator[tuple[int, int]]:
        """Those of the sum."""
        for part in self.parts:
            yield names.equation(part.equation), names.term(part.term)

    def __str__(self) -> str:
        total = _sum((one.weight, f"{_name(one.equation)}'[{one.term}]") for one in self.parts)
        if self.lower == self.upper:
            return f"{total} = {_number(self.lower)}"
        low = f"{_number(self.lower)} <= " if np.isfinite(self.lower) else ""
        if low and not np.isfinite(self.upper):
            return f"{total} >= {_number(self.lower)}"
        return f"{low}{total}" + (f" <= {_number(self.upper)}" if np.isfinite(self.upper) else "")


@dataclass(frozen=True)
class Identity:
    """A sum of laws is a sum of terms and laws, wherever the system is: each term for itself."""

    laws: tuple[Part, ...]
    others: tuple[Part, ...]

    def rows(self, names: Names, named: set[tuple[int, int]]) -> Iterator[Row]:
        """One for each mode and term."""
        value, laws = np.zeros(len(names.terms)), list(self.laws)
        for part in self.others:
            if part.equation and not names.has_term(f"{part.equation}'"):
                laws.append(part.times(-1.0))
            else:
                value[names.term(part.term or f"{part.equation}'")] += part.weight
        for mode in range(names.n_modes):
            for place, level in enumerate(value.tolist()):
                matrix = np.zeros(names.shape)
                for part in laws:
                    matrix[mode, names.equation(part.equation), place] += part.weight
                yield Row(matrix, level, level)

    def named(self, names: Names) -> Iterator[tuple[int, int]]:
        """All of the laws on its left."""
        for part in self.laws:
            yield from ((names.equation(part.equation), term) for term in range(len(names.terms)))

    def __str__(self) -> str:
        left, right = (
            _sum(
                (one.weight, _name(one.term) if one.term else _name(one.equation) + "'")
                for one in side
            )
            for side in (self.laws, self.others)
        )
        return f"{left} = {right or '0'}"


@dataclass(frozen=True)
class Without:
    """A law has none of some terms; `REST` are all that no sentence names."""

    equation: str
    terms: tuple[str, ...]

    def rows(self, names: Names, named: set[tuple[int, int]]) -> Iterator[Row]:
        """One for each mode and term."""
        own = names.equation(self.equation)
        gone = [names.term(one) for one in self.terms if one != REST]
        if REST in self.terms:
            gone += [one for one in range(len(names.terms)) if (own, one) not in named]
        yield from _nothing(names, own, gone)

    def named(self, names: Names) -> Iterator[tuple[int, int]]:
        """Those that it names."""
        own = names.equation(self.equation)
        yield from ((own, names.term(one)) for one in self.terms if one != REST)

    def __str__(self) -> str:
        return f"{_name(self.equation)}' has no {_listed(self.terms)}"


@dataclass(frozen=True)
class Only:
    """A law has no other terms than these."""

    equation: str
    terms: tuple[str, ...]

    def rows(self, names: Names, named: set[tuple[int, int]]) -> Iterator[Row]:
        """One for each mode and other term."""
        others = np.delete(np.arange(len(names.terms)), [names.term(one) for one in self.terms])
        yield from _nothing(names, names.equation(self.equation), others.tolist())

    def named(self, names: Names) -> Iterator[tuple[int, int]]:
        """Those that it names."""
        own = names.equation(self.equation)
        yield from ((own, names.term(one)) for one in self.terms)

    def __str__(self) -> str:
        return f"{_name(self.equation)}' has only {_listed(self.terms)}"


@dataclass(frozen=True)
class Same:
    """A term of a law, or all of its terms, have one coefficient in all modes."""

    equation: str
    term: str = REST

    def rows(self, names: Names, named: set[tuple[int, int]]) -> Iterator[Row]:
        """One for each mode but the first."""
        own = names.equation(self.equation)
        every = range(len(names.terms)) if self.term == REST else [names.term(self.term)]
        for term in every:
            for mode in range(1, names.n_modes):
                matrix = np.zeros(names.shape)
                matrix[0, own, term], matrix[mode, own, term] = -1.0, 1.0
                yield Row(matrix, 0.0, 0.0)

    def named(self, names: Names) -> Iterator[tuple[int, int]]:
        """The one term, if it is one."""
        if self.term != REST:
            yield names.equation(self.equation), names.term(self.term)

    def __str__(self) -> str:
        law = f"{_name(self.equation)}'"
        return (law if self.term == REST else f"{law}[{self.term}]") + " same in all modes"


@dataclass(frozen=True)
class Energy:
    """A quadratic form of the states never rises in any mode: A'P + PA is not positive."""

    parts: tuple[Part, ...]  # squares and products of states, the terms x^2 and x v

    def rows(self, names: Names, named: set[tuple[int, int]]) -> Iterator[Row]:
        """None: it is a cone."""
        yield from ()

    def named(self, names: Names) -> Iterator[tuple[int, int]]:
        """None."""
        yield from ()

    def form(self, names: Names) -> Array:
        """P, (n_states, n_states)."""
        form = np.zeros((len(names.equations), len(names.equations)))
        places = {
            _usual(text): (i, j)
            for i, one in enumerate(names.equations)
            for j, other in enumerate(names.equations)
            for text in ((f"{one}^2",) if i == j else (f"{one} {other}",))
        }
        for part in self.parts:
            if _usual(part.term) not in places:
                raise ValueError(
                    f'known="{self}" names {part.term}; an energy is of squares and products of '
                    f"the states {', '.join(names.equations)}, such as {names.equations[0]}^2."
                )
            i, j = places[_usual(part.term)]
            form[i, j] += 0.5 * part.weight
            form[j, i] += 0.5 * part.weight
        if not form.any():
            raise ValueError(
                f'known="{self}" says nothing: all of its numbers are zero, and no law makes zero '
                "rise; leave it out or give them."
            )
        return form

    def cone(self, names: Names, mode: int) -> Array:
        """A'P + PA as sums of coefficients, (n_states, n_states, n_modes, n_equations, n_terms)."""
        form, n = self.form(names), len(names.equations)
        half = np.zeros((n, n, *names.shape))
        for place, state in enumerate(names.equations):
            half[:, place, mode, :, names.term(state)] = form
        return half + half.swapaxes(0, 1)

    def direction(self, row: Array, names: Names) -> str:
        """Where a constraint is the rate of the energy; nothing where it is that of no state."""
        mode = int(np.abs(row).max(axis=(1, 2)).argmax())
        block = row[mode][:, [names.term(one) for one in names.equations]]
        _, sizes, directions = np.linalg.svd(block)
        if np.count_nonzero(row) < 2 or sizes[1:].max(initial=0.0) > 1e-9 * sizes[0]:
            return ""
        state = directions[0] * np.sign(directions[0][np.abs(directions[0]).argmax()])
        at = (f"{one} = {value:.2g}" for one, value in zip(names.equations, state, strict=True))
        where = f"in mode {mode} " if names.n_modes > 1 else ""
        return f"rate of the energy {where}at {', '.join(at)}"

    def bent(self, names: Names) -> NDArray[np.bool_]:
        """Coefficients of which there must be none, that laws are linear, as `names.shape`."""
        state = "|".join(re.escape(one) for one in names.equations)
        word = re.compile(rf"(?<![\w'])(?:{state})(?![\w'])")
        terms = [one not in names.equations and bool(word.search(one)) for one in names.terms]
        used = np.asarray(self.form(names).any(axis=0))
        return np.broadcast_to(used[:, None] & np.array(terms), names.shape)

    def __str__(self) -> str:
        return f"energy {_sum((one.weight, _name(one.term)) for one in self.parts)} never rises"


class Guard(ABC):
    """Of which monomials the surfaces between modes are; it says nothing of laws."""

    def rows(self, names: Names, named: set[tuple[int, int]]) -> Iterator[Row]:
        """None."""
        yield from ()

    def named(self, names: Names) -> Iterator[tuple[int, int]]:
        """None."""
        yield from ()

    @abstractmethod
    def span(self, monomials: Names) -> Array:
        """Columns of which surfaces are sums, (n_monomials, n_columns)."""


@dataclass(frozen=True)
class GuardSum(Guard):
    """Modes change where a sum of monomials passes a threshold; one that is sought is None."""

    parts: tuple[Part, ...]
    threshold: float | None

    def span(self, monomials: Names) -> Array:
        """The sum without its threshold, or beside a constant."""
        column = np.zeros(len(monomials.terms))
        for part in self.parts:
            column[monomials.term(part.term)] += part.weight
        constant = np.eye(len(column))[monomials.term("1")]
        if self.threshold is None:
            return np.column_stack([column, constant])
        return (column - self.threshold * constant)[:, None]

    def __str__(self) -> str:
        level = "*" if self.threshold is None else _number(self.threshold)
        return f"guard {_sum((one.weight, _name(one.term)) for one in self.parts)} >= {level}"


@dataclass(frozen=True)
class GuardOnly(Guard):
    """Surfaces have no other monomials than these."""

    terms: tuple[str, ...]

    def span(self, monomials: Names) -> Array:
        """A column for each of them."""
        return np.eye(len(monomials.terms))[:, [monomials.term(one) for one in self.terms]]

    def __str__(self) -> str:
        return f"guard has only {_listed(self.terms)}"


def _nothing(names: Names, equation: int, terms: Sequence[int]) -> Iterator[Row]:
    for mode in range(names.n_modes):
        for term in terms:
            matrix = np.zeros(names.shape)
            matrix[mode, equation, term] = 1.0
            yield Row(matrix, 0.0, 0.0)


def _sum(parts: Iterable[tuple[float, str]]) -> str:
    """A sum as the grammar reads it; a constant term is a number."""
    text = ""
    for weight, name in parts:
        size = abs(weight)
        one = name if size == 1.0 else f"{_number(size)} {name}".removesuffix(" 1")
        sign = "-" if weight < 0.0 else "+"
        text += f" {sign} {one}" if text else one if sign == "+" else f"-{one}"
    return text


def _number(value: float) -> str:
    """The shortest text that is read as the same number."""
    return repr(value).removesuffix(".0")


def _name(name: str) -> str:
    """A name in backquotes, where something in it would be read as more than a name."""
    return name if name == "1" or _PLAIN.fullmatch(name) else f"`{name}`"


def _listed(terms: Sequence[str]) -> str:
    return ", ".join("other terms" if one == REST else _name(one) for one in terms)
