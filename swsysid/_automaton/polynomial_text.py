"""Polynomials in named columns: from text, and what of them follows from others.

A polynomial is a dict from exponents, one for each column, to coefficients. The reader is one of
arithmetic that knows names and runs no code.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import isfinite

import numpy as np
from scipy.optimize import nnls

from swsysid._automaton.columns import other_names
from swsysid._checks.parameters import real, shown

Powers = tuple[int, ...]
Polynomial = dict[Powers, float]

MOST_TERMS = 3000  # of a polynomial beyond which it is a slip of the hand

_NAME = r"[^\W\d]\w*(?:\[k(?:\s*-\s*\d+)?\])?"
_TOKEN = re.compile(
    rf"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>{_NAME})"
    r"|(?P<sign>\*\*|[-+*/^()]))"
)
_JOINED = re.compile(r"(?:^|\s)and(?:\s|$)|&&?", re.IGNORECASE)
_CHAIN = re.compile(r"(<=|>=|==|=|<|>)")
_RELATION = re.compile(r"<=|>=|==|=|<|>")

# relative rounding of coefficients that are equal by construction
_ROUNDING = 1e-9


def total(left: Polynomial, right: Polynomial, sign: float = 1.0) -> Polynomial:
    """``left + sign * right``."""
    found = dict(left)
    for powers, coef in right.items():
        found[powers] = found.get(powers, 0.0) + sign * coef
    return found


def product(left: Polynomial, right: Polynomial) -> Polynomial:
    """``left * right``."""
    found: Polynomial = {}
    for one, a in left.items():
        for other, b in right.items():
            powers = tuple(p + q for p, q in zip(one, other, strict=True))
            found[powers] = found.get(powers, 0.0) + a * b
    return found


def nonzero(value: Polynomial) -> Polynomial:
    """Without the terms that are zero."""
    return {powers: coef for powers, coef in value.items() if coef != 0.0}


def negative(value: Polynomial) -> Polynomial:
    """``-value``."""
    return {powers: -coef for powers, coef in value.items()}


def rate(value: Polynomial, laws: Mapping[int, Polynomial]) -> Polynomial | None:
    """The time derivative along laws of some columns, the Lie derivative.

    None where the polynomial has a column without a law, such as an input.

    Examples
    --------
    The height h of a ball changes with its speed v:

    >>> rate({(1, 0): -1.0}, {0: {(0, 1): 1.0}, 1: {(0, 0): -9.81}})
    {(0, 1): -1.0}
    """
    found: Polynomial = {}
    for powers, coef in value.items():
        for column, power in enumerate(powers):
            if not power:
                continue
            if column not in laws:
                return None
            lower = tuple(p - (place == column) for place, p in enumerate(powers))
            found = total(found, product({lower: coef * power}, laws[column]))
    return nonzero(found)


def substituted(value: Polynomial, columns: Mapping[int, Polynomial]) -> Polynomial:
    """The polynomial with other polynomials in the place of some columns.

    Examples
    --------
    >>> substituted({(2,): 1.0}, {0: {(1,): 1.0, (0,): 1.0}})
    {(2,): 1.0, (1,): 2.0, (0,): 1.0}
    """
    found: Polynomial = {}
    for powers, coef in value.items():
        left = tuple(0 if column in columns else power for column, power in enumerate(powers))
        term: Polynomial = {left: coef}
        for column, replacement in columns.items():
            for _ in range(powers[column]):
                term = product(term, replacement)
        found = total(found, term)
    return nonzero(found)


def follows(
    claim: Polynomial, zero: Sequence[Polynomial] = (), positive: Sequence[Polynomial] = ()
) -> bool:
    """Whether a claim is shown not to be negative where others are zero or not negative.

    It is where it is a sum of these with weights, not negative but for those that are zero, and of
    a number that is not negative: for affine polynomials that is all there is to know (Farkas).

    Examples
    --------
    Where T is 22, T - 20 is not negative; nothing tells its sign where T is unknown:

    >>> claim = {(1,): 1.0, (0,): -20.0}
    >>> follows(claim, zero=[{(1,): 1.0, (0,): -22.0}]), follows(claim)
    (True, False)
    """
    if not claim:
        return True
    one: Polynomial = {(0,) * len(next(iter(claim))): 1.0}
    given = [one, *zero, *map(negative, zero), *positive]
    keys = sorted({powers for each in (claim, *given) for powers in each})
    table = np.array([[each.get(powers, 0.0) for each in (*given, claim)] for powers in keys])
    table /= np.maximum(np.abs(table).max(axis=0), 1e-300)
    # each monomial of the claim counts alike: which is large on the data is not known
    sizes = np.where(table[:, -1] != 0.0, table[:, -1], np.abs(table).max(axis=1))
    rows = table / np.maximum(np.abs(sizes), 1e-300)[:, None]
    _, residual = nnls(rows[:, :-1], rows[:, -1])
    return bool(residual <= _ROUNDING)


def read_polynomial(text: object, columns: Sequence[str], constants: Mapping[str, float]):
    """The polynomial in named columns that a text or a number stands for.

    It may have numbers, the names of columns and constants, ``+ - * /``, powers (``^`` or ``**``)
    and brackets; factors may stand side by side. A divisor must be a number.

    Examples
    --------
    >>> read_polynomial("2 x^2 - (x - v) / g", ["x", "v"], {"g": 10.0})
    {(2, 0): 2.0, (1, 0): -0.1, (0, 1): 0.1}
    """
    if isinstance(text, (int, float)) and not isinstance(text, bool):
        return nonzero({(0,) * len(columns): real("a coefficient", text)})
    if not isinstance(text, str):
        raise TypeError(f"{shown(text)} is no polynomial; give a text, such as '2 x^2 - v'.")
    reader = _Reader(text, columns, constants)
    try:
        value = reader.sum()
    except RecursionError:
        raise reader.refusal("has too many brackets in each other") from None
    if reader.peek() is not None:
        raise reader.refusal(f"ends in {reader.peek()!r}, which cannot be read")
    if not all(map(isfinite, value.values())):
        raise reader.refusal("has coefficients that are not finite")
    return nonzero(value)


def read_inequality(text: object, columns: Sequence[str], constants: Mapping[str, float]):
    """The polynomial that rises to zero where an inequality becomes true.

    Examples
    --------
    >>> read_inequality("T >= 22", ["T"], {}), read_inequality("h <= 0", ["h"], {})
    ({(1,): 1.0, (0,): -22.0}, {(1,): -1.0})
    """
    sides = _RELATION.split(text) if isinstance(text, str) else []
    relations = _RELATION.findall(text) if isinstance(text, str) else []
    if len(sides) != 2 or relations[0] in ("=", "=="):
        raise ValueError(
            f"{shown(text)} is no condition; give inequalities between polynomials, such as "
            "'x^2 + v >= 3', joined by 'and' where all must hold."
        )
    left, right = (read_polynomial(side, columns, constants) for side in sides)
    if "<" in relations[0]:
        left, right = right, left
    return nonzero(total(left, right, -1.0))


def inequalities_in(text: str) -> list[str]:
    """Single inequalities of those that are joined, or stand in a chain.

    Examples
    --------
    >>> inequalities_in("0 <= x <= 1 and v > 2")
    ['0 <= x', 'x <= 1', 'v > 2']
    """
    found = []
    for part in _JOINED.split(text):
        pieces = [piece.strip() for piece in _CHAIN.split(part)]
        last = max(1, len(pieces) - 2)
        found += [" ".join(pieces[place : place + 3]) for place in range(0, last, 2)]
    return found


class _Reader:
    """Recursive descent over the tokens of one text."""

    def __init__(self, text: str, columns: Sequence[str], constants: Mapping[str, float]):
        self.text, self.constants = text, constants
        self.constant = (0,) * len(columns)
        self.units = {
            name: tuple(int(place == column) for place in range(len(columns)))
            for column, name in enumerate(columns)
        }
        self.tokens: list[tuple[str, str]] = []
        at, end = 0, len(text.rstrip())
        while at < end:
            match = _TOKEN.match(text, at)
            if match is None:
                raise self.refusal(f"has {text[at:].strip()[:1]!r}, which cannot be read")
            self.tokens.append((str(match.lastgroup), match[str(match.lastgroup)]))
            at = match.end()
        self.tokens.reverse()

    def refusal(self, why: str) -> ValueError:
        return ValueError(
            f"the polynomial {shown(self.text)} {why}; give one in "
            f"{', '.join([*self.units, *self.constants])}."
        )

    def peek(self) -> str | None:
        """The next token."""
        return self.tokens[-1][1] if self.tokens else None

    def sum(self) -> Polynomial:
        value = self.product()
        while self.peek() in ("+", "-"):
            sign = 1.0 if self.tokens.pop()[1] == "+" else -1.0
            value = total(value, self.product(), sign)
        return value

    def product(self) -> Polynomial:
        value = self.signed()
        while self.tokens and self.peek() not in ("+", "-", ")"):
            if self.peek() == "/":
                self.tokens.pop()
                value = self.quotient(value, self.signed())
                continue
            if self.peek() == "*":
                self.tokens.pop()
            value = self.times(value, self.signed())
        return value

    def signed(self) -> Polynomial:
        if self.peek() in ("+", "-"):
            negated = self.tokens.pop()[1] == "-"
            return negative(self.signed()) if negated else self.signed()
        return self.power()

    def power(self) -> Polynomial:
        base = self.atom()
        if self.peek() not in ("^", "**"):
            return base
        self.tokens.pop()
        kind, exponent = self.tokens.pop() if self.tokens else ("", "")
        if kind != "number" or not float(exponent).is_integer():
            raise self.refusal("has a power that is no whole number")
        value: Polynomial = {self.constant: 1.0}
        for _ in range(int(min(float(exponent), MOST_TERMS))):
            value = self.times(value, base)
        return value

    def atom(self) -> Polynomial:
        kind, token = self.tokens.pop() if self.tokens else ("", "")
        if kind == "number":
            return {self.constant: float(token)}
        if token in self.constants:
            return {self.constant: float(self.constants[token])}
        if kind == "name":
            name = "".join(token.split())
            for known in other_names(name):
                if known in self.units:
                    return {self.units[known]: 1.0}
            raise self.refusal(f"has the unknown name {name!r}")
        if token != "(":
            raise self.refusal(f"lacks a value before {token!r}" if token else "ends too early")
        value = self.sum()
        if self.peek() != ")":
            raise self.refusal("has a bracket that is not closed")
        self.tokens.pop()
        return value

    def times(self, left: Polynomial, right: Polynomial) -> Polynomial:
        if len(left) * len(right) > MOST_TERMS:
            raise self.refusal("has too many terms")
        return product(left, right)

    def quotient(self, value: Polynomial, by: Polynomial) -> Polynomial:
        divisor = by.get(self.constant, 0.0)
        if len(nonzero(by)) != 1 or not divisor:
            raise self.refusal("divides by something that is no number other than zero")
        return {powers: coef / divisor for powers, coef in value.items()}
