"""Comparisons that rounding does not decide: equal values are ties, the first of them is taken.

Candidates may be one and the same function of the data, and starts may end in one optimum. Which of
them has the smaller value is then a matter of the last bits, and these depend on the processor. So
values that rounding may have parted count as equal, and an order that means something decides: that
in which the candidates are listed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import compress
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

T = TypeVar("T")

# Share of a value below which differences are rounding. What normal equations say of a column is
# right to eps / s where the others leave the share s of its square; that is 1e-9 for s = 2e-7, far
# beyond columns that anyone would tell apart. Sums of a million rows add 1e-10 at most.
ROUNDING = 1e-9


def first_largest(values: ArrayLike, axis: int = -1) -> NDArray[np.intp]:
    """Places of the largest values along an axis, the first of those that rounding has parted."""
    return np.asarray(np.argmax(_largest(np.asarray(values, dtype=float), axis), axis=axis))


def first_least(values: ArrayLike, axis: int = -1) -> NDArray[np.intp]:
    """Places of the least values along an axis, the first of those that rounding has parted."""
    return first_largest(-np.asarray(values, dtype=float), axis)


def largest_first(values: ArrayLike) -> NDArray[np.intp]:
    """Places in the order of decreasing values, ties in the order in which they are given."""
    given = np.asarray(values, dtype=float)
    order = np.argsort(-given, kind="stable")
    falls = -np.diff(given[order], prepend=given[order][:1])
    level = np.cumsum(falls > ROUNDING * np.abs(given).max(initial=0.0))
    return np.asarray(order[np.lexsort((order, level))])


def least_of(options: Iterable[T], *values: Callable[[T], float]) -> T:
    """The option whose first value is least; of ties that whose next one is, then the first."""
    left = list(options)
    for value in values:
        of_each = np.array([value(option) for option in left], dtype=float)
        left = list(compress(left, _largest(-of_each, 0))) or left
    return left[0]


def _largest(values: NDArray[np.float64], axis: int) -> NDArray[np.bool_]:
    """Which values are the largest or ties with it; none where no value is a number."""
    largest = np.fmax.reduce(values, axis=axis, keepdims=True)
    apart = np.where(np.isfinite(largest), ROUNDING * np.abs(largest), 0.0)
    return np.asarray(values >= largest - apart)
