"""Formulas as trees, which any tool can be told.

An `Expression` is a leaf (a number, the state ``x``, the input ``u``, the clocks ``dwell`` and
``time``) or an operation on others. Functions of NumPy and Python's operators make expressions of
expressions, so that a function of columns is written down by calling it once (`traced`). What a
tree means in a tool is a table of operations (`Expression.folded`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TypeVar

import numpy as np

LEAVES = ("number", "x", "u", "dwell", "time", "name")
Meaning = TypeVar("Meaning")


class NoFormulaError(TypeError):
    """What cannot be written as a formula; the message says what to do."""


@dataclass(frozen=True)
class Expression:
    """A leaf, whose argument is its number or its value, or an operation on expressions.

    A leaf ``name`` stands for a formula that a text has named. Sums and products have any number of
    arguments. ``positive`` is one above zero and else zero, ``where`` its second argument where the
    first is above zero and else its third.

    Examples
    --------
    >>> x, v = Expression("x", (0,)), Expression("x", (1,))
    >>> evaluated(-0.5 * np.sign(v) + np.sin(x) ** 2, {"x": [0.0, -3.0]})
    0.5
    """

    kind: str
    arguments: tuple = ()

    def folded(
        self,
        leaf: Callable[[str, float], Meaning],
        operations: Mapping[str, Callable[..., Meaning]],
    ) -> Meaning:
        """What the tree means where leaves and operations have these meanings."""
        if self.kind in LEAVES:
            return leaf(self.kind, self.arguments[0] if self.arguments else 0)
        if self.kind not in operations:
            raise NoFormulaError(f"there is no {self.kind}")
        parts = (part.folded(leaf, operations) for part in self.arguments)
        return operations[self.kind](*parts)

    def parts(self) -> Iterator[Expression]:
        """Itself and all that it is made of, the inner ones first."""
        if self.kind not in LEAVES:
            for part in self.arguments:
                yield from part.parts()
        yield self

    def mapped(self, change: Callable[[Expression], Expression | None]) -> Expression:
        """With other expressions in the place of those for which `change` gives one."""
        known: dict[Expression, Expression] = {}

        def made(part: Expression) -> Expression:
            if part not in known:
                changed = change(part)
                if changed is None:
                    is_leaf = part.kind in LEAVES
                    changed = part if is_leaf else operation(part.kind, *map(made, part.arguments))
                known[part] = changed
            return known[part]

        return made(self)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.kind, self.arguments))

    @cached_property
    def depth(self) -> int:
        """How many operations stand above one another in it."""
        return 0 if self.kind in LEAVES else 1 + max(part.depth for part in self.arguments)

    @cached_property
    def leaves(self) -> frozenset[str]:
        """Kinds of its leaves."""
        if self.kind in LEAVES:
            return frozenset({self.kind})
        return frozenset().union(*(part.leaves for part in self.arguments))

    @property
    def value(self) -> float | None:
        """Its value if it is a number."""
        return float(self.arguments[0]) if self.kind == "number" else None

    # -- what Python and NumPy make of it --------------------------------------------------------

    def __add__(self, other):
        return operation("add", self, other)

    def __radd__(self, other):
        return operation("add", other, self)

    def __sub__(self, other):
        return operation("add", self, operation("mul", -1.0, other))

    def __rsub__(self, other):
        return operation("add", other, operation("mul", -1.0, self))

    def __mul__(self, other):
        return operation("mul", self, other)

    def __rmul__(self, other):
        return operation("mul", other, self)

    def __truediv__(self, other):
        return operation("div", self, other)

    def __rtruediv__(self, other):
        return operation("div", other, self)

    def __pow__(self, other):
        return operation("pow", self, other)

    def __rpow__(self, other):
        return operation("pow", other, self)

    def __neg__(self):
        return operation("mul", -1.0, self)

    def __pos__(self):
        return self

    def __abs__(self):
        return operation("abs", self)

    def __gt__(self, other):
        return operation("positive", self - other)

    def __lt__(self, other):
        return operation("positive", other - self)

    def __ge__(self, other):
        return 1.0 - (self < other)

    def __le__(self, other):
        return 1.0 - (self > other)

    def __and__(self, other):
        return self * other

    def __getitem__(self, place):
        return self  # a column of one number

    def astype(self, kind):
        """Itself: there are no types."""
        return self

    def clip(self, low, high):
        """Held between two values."""
        return operation("min", operation("max", self, low), high)

    def __bool__(self):
        raise NoFormulaError("it asks whether a column is true")

    def __float__(self):
        raise NoFormulaError("it makes a number of a column")

    def __array_ufunc__(self, function, method, *inputs, **options):
        written = _UNIVERSAL.get(function)
        if method != "__call__" or written is None or options:
            raise NoFormulaError(f"numpy.{function.__name__} is no formula here")
        return written(*map(as_expression, inputs))

    def __array_function__(self, function, types, arguments, options):
        if function is np.where and len(arguments) == 3:
            return operation("where", *arguments)
        if function is np.clip and len(arguments) == 3 and not options:
            return self.clip(*arguments[1:])
        if function in (np.column_stack, np.hstack) and not options:
            return list(arguments[0])
        raise NoFormulaError(f"numpy.{function.__name__} is no formula here")


def number(value: float) -> Expression:
    """A constant."""
    return Expression("number", (float(value),))


ZERO, ONE = number(0.0), number(1.0)


def as_expression(value: object) -> Expression:
    """An expression as it is, a number as one."""
    if isinstance(value, Expression):
        return value
    given = np.asarray(value)
    if given.size != 1 or given.dtype.kind not in "fiub":
        raise NoFormulaError(f"it takes the value {str(value)[:40]}, which is no number")
    return number(float(given.ravel()[0]))


def operation(kind: str, *arguments: object) -> Expression:
    """An operation on expressions and numbers; numbers are worked out, zeros and ones left out."""
    given = tuple(map(as_expression, arguments))
    if kind in ("add", "mul"):
        return _collected(kind, given)
    if all(one.value is not None for one in given):
        with np.errstate(all="ignore"):
            return number(NUMBERS[kind](*(one.value for one in given)))
    first, last = given[0], given[-1]
    if kind == "div":
        if last.value is not None:
            return (
                operation("mul", 1.0 / last.value, first) if last.value else Expression(kind, given)
            )
        return ZERO if first == ZERO else Expression(kind, given)
    if kind == "pow" and last.value in (0.0, 1.0):
        return ONE if last == ZERO else first
    if kind == "where" and given[1] == given[2]:
        return last
    return Expression(kind, given)


def _collected(kind: str, given: Sequence[Expression]) -> Expression:
    """A sum or a product of factors, its numbers as one, those of inner ones included."""
    flat = [part for one in given for part in (one.arguments if one.kind == kind else (one,))]
    constant, start = (0.0, 0.0) if kind == "add" else (1.0, 1.0)
    for one in flat:
        if one.value is not None:
            constant = constant + one.value if kind == "add" else constant * one.value
    if kind == "mul" and constant == 0.0:
        return ZERO
    rest = [one for one in flat if one.value is None]
    parts = ([number(constant)] if constant != start or not rest else []) + rest
    return parts[0] if len(parts) == 1 else Expression(kind, tuple(parts))


def least(*values: Expression | None) -> Expression:
    """The least of some values; those that are None, or one for always, left out."""
    kept = [value for value in values if value not in (None, ONE)] or [ONE]
    found = kept[0]
    for value in kept[1:]:
        found = operation("min", found, value)
    return found


def traced(function: Callable, columns: Sequence[Expression], name: str) -> Expression:
    """What a function of columns makes of expressions; refused in a sentence if it is no formula.

    Examples
    --------
    >>> traced(lambda x: np.maximum(x - 2.0, 0.0), [Expression("x", (0,))], "overflow").kind
    'max'
    """
    try:
        return as_expression(function(*columns))
    except (NoFormulaError, TypeError, AttributeError, IndexError, ValueError) as error:
        raise NoFormulaError(
            f"{name} cannot be written as a formula ({str(error).rstrip('.')}); make it of "
            "arithmetic and functions of NumPy, element by element."
        ) from None


# -- their meaning in numbers, and their derivatives -----------------------------------------------

#: Operations as functions of numbers or arrays.
NUMBERS: dict[str, Callable] = {
    "add": lambda *parts: sum(parts[1:], parts[0]),
    "mul": lambda *parts: float(np.prod(parts)) if np.ndim(parts[-1]) == 0 else np.prod(
        np.broadcast_arrays(*parts), axis=0
    ),
    "div": lambda a, b: np.divide(a, b),
    "pow": lambda a, b: np.power(np.asarray(a, dtype=float), b),
    "min": np.minimum, "max": np.maximum, "abs": np.abs, "sign": np.sign, "sqrt": np.sqrt,
    "exp": np.exp, "log": np.log, "sin": np.sin, "cos": np.cos, "tan": np.tan, "asin": np.arcsin,
    "acos": np.arccos, "atan": np.arctan, "sinh": np.sinh, "cosh": np.cosh, "tanh": np.tanh,
    "atan2": np.arctan2,
    "positive": lambda a: np.where(np.asarray(a) > 0.0, 1.0, 0.0),
    "where": lambda c, a, b: np.where(np.asarray(c) > 0.0, a, b),
}  # fmt: skip


def evaluated(expression: Expression, point: Mapping[str, object]) -> float:
    """The value at a point: ``{"x": states, "u": inputs, "dwell": 0.0, "time": 0.0}``."""

    def leaf(kind: str, argument: float) -> float:
        if kind == "number":
            return argument
        given = np.asarray(point.get(kind, 0.0), dtype=float)
        return float(given[int(argument)] if given.ndim else given)

    with np.errstate(all="ignore"):
        return float(expression.folded(leaf, NUMBERS))


def _same(kind: str) -> Callable[..., Expression]:
    return lambda *parts: operation(kind, *parts)


_UNIVERSAL: dict[np.ufunc, Callable[..., Expression]] = {
    np.add: _same("add"), np.multiply: _same("mul"), np.true_divide: _same("div"),
    np.subtract: lambda a, b: a - b, np.negative: lambda a: -a, np.positive: lambda a: a,
    np.power: _same("pow"), np.float_power: _same("pow"), np.square: lambda a: a**2,
    np.reciprocal: lambda a: 1.0 / a, np.sqrt: _same("sqrt"), np.absolute: _same("abs"),
    np.fabs: _same("abs"), np.sign: _same("sign"), np.exp: _same("exp"), np.log: _same("log"),
    np.log10: lambda a: operation("log", a) / np.log(10.0), np.exp2: lambda a: 2.0**a,
    np.log2: lambda a: operation("log", a) / np.log(2.0), np.cbrt: lambda a: np.sign(a)
    * abs(a) ** (1.0 / 3.0), np.log1p: lambda a: operation("log", 1.0 + a),
    np.expm1: lambda a: operation("exp", a) - 1.0, np.hypot: lambda a, b: np.sqrt(a**2 + b**2),
    np.sin: _same("sin"), np.cos: _same("cos"), np.tan: _same("tan"), np.arcsin: _same("asin"),
    np.arccos: _same("acos"), np.arctan: _same("atan"), np.arctan2: _same("atan2"),
    np.sinh: _same("sinh"), np.cosh: _same("cosh"), np.tanh: _same("tanh"),
    np.maximum: _same("max"), np.minimum: _same("min"), np.fmax: _same("max"),
    np.fmin: _same("min"), np.greater: lambda a, b: a > b, np.less: lambda a, b: a < b,
    np.greater_equal: lambda a, b: a >= b, np.less_equal: lambda a, b: a <= b,
    np.logical_and: lambda a, b: a * b, np.logical_not: lambda a: 1.0 - a,
    np.heaviside: lambda a, b: a > 0.0,
}  # fmt: skip

# The derivative of a function of one argument, of that argument.
_SLOPES: dict[str, Callable[[Expression], Expression]] = {
    "sqrt": lambda a: 0.5 / operation("sqrt", a), "exp": _same("exp"), "log": lambda a: 1.0 / a,
    "sin": _same("cos"), "cos": lambda a: -operation("sin", a),
    "tan": lambda a: 1.0 / operation("cos", a) ** 2,
    "asin": lambda a: 1.0 / operation("sqrt", 1.0 - a**2),
    "acos": lambda a: -1.0 / operation("sqrt", 1.0 - a**2), "atan": lambda a: 1.0 / (1.0 + a**2),
    "sinh": _same("cosh"), "cosh": _same("sinh"),
    "tanh": lambda a: 1.0 - operation("tanh", a) ** 2, "abs": _same("sign"),
}  # fmt: skip


@lru_cache(maxsize=4096)
def derivative(expression: Expression, leaf: Expression) -> Expression:
    """The derivative by a leaf, one side of a kink at the kink itself.

    Examples
    --------
    >>> x = Expression("x", (0,))
    >>> evaluated(derivative(x**3 + np.sin(2.0 * x), x), {"x": [0.0]})
    2.0
    """
    if expression == leaf:
        return ONE
    kind, parts = expression.kind, expression.arguments
    if kind in (*LEAVES, "sign", "positive"):
        return ZERO
    slopes = [derivative(part, leaf) for part in parts]
    if kind == "add":
        return operation("add", *slopes)
    if all(slope == ZERO for slope in slopes):
        return ZERO
    if kind == "mul":
        terms = [
            operation("mul", *parts[:place], slope, *parts[place + 1 :])
            for place, slope in enumerate(slopes)
        ]
        return operation("add", *terms)
    if kind == "div":
        top, bottom = parts
        return slopes[0] / bottom - top * slopes[1] / bottom**2
    if kind == "pow":
        growth = expression * operation("log", parts[0]) * slopes[1]
        return parts[1] * parts[0] ** (parts[1] - 1.0) * slopes[0] + growth
    if kind == "atan2":
        return (parts[1] * slopes[0] - parts[0] * slopes[1]) / (parts[0] ** 2 + parts[1] ** 2)
    if kind in ("min", "max"):
        ahead = parts[0] - parts[1] if kind == "max" else parts[1] - parts[0]
        return operation("where", ahead, *slopes)
    if kind == "where":
        return operation("where", parts[0], *slopes[1:])
    if kind in _SLOPES:
        return _SLOPES[kind](parts[0]) * slopes[0]
    raise NoFormulaError(f"the derivative of {kind} is not known")
