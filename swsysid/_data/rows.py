"""Rows in canonical order: sorted, repetitions merged into weights, weight-zero rows dropped.

A weight means repetition, and the order of the rows means nothing. An optimum that is not
unique, or a start drawn by position, could still depend on both; estimators therefore work on
the canonical rows and carry per-row answers back with `CanonicalRows.restore`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks.arrays import numbers, refuse_overflow, refuse_vanishing
from swsysid._results import Array


@dataclass(frozen=True)
class CanonicalRows:
    """The distinct rows of some arrays, in lexicographic order."""

    arrays: tuple[NDArray, ...]  # the given ones with distinct rows only, (n_distinct, ...)
    weight: Array  # (n_distinct,): sum of the weights of the rows that were merged; positive
    inverse: NDArray[np.intp]  # (n_samples,): where each row is in `arrays`, -1 for weight zero

    @property
    def first(self) -> NDArray[np.intp]:
        """Number of the first original row that each row of `arrays` stands for, (n_distinct,)."""
        kept = np.flatnonzero(self.inverse >= 0)[::-1]
        numbers = np.empty(len(self.weight), dtype=np.intp)
        numbers[self.inverse[kept]] = kept  # the last one written is the first row
        return numbers

    @property
    def counted(self) -> CanonicalRows:
        """The same with the largest weight for 1 where all are smaller.

        As counts these would let the price of a surface outweigh all rows.
        """
        return replace(self, weight=self.weight / min(1.0, self.weight.max()))

    def restore(self, values: NDArray, dropped: float = 0.0) -> NDArray:
        """Values of the original rows, `dropped` where the weight was zero."""
        restored = values[self.inverse]
        restored[self.inverse < 0] = dropped
        return restored


def canonical_rows(*arrays: ArrayLike, sample_weight: ArrayLike | None = None) -> CanonicalRows:
    """Sort rows lexicographically over all arrays, merge equal ones and drop weight zero.

    The arrays are parallel, (n_samples,) or (n_samples, n_columns). The answer is the same, bit
    for bit, for any order of the rows and for any way to express the same repetitions by integer
    weights.

    Examples
    --------
    >>> rows = canonical_rows([[2.0], [1.0], [2.0]], [0, 1, 0], sample_weight=[1, 1, 3])
    >>> rows.arrays[0].ravel(), rows.arrays[1], rows.weight, rows.inverse
    (array([1., 2.]), array([1, 0]), array([1., 4.]), array([1, 0, 1]))
    """
    given = [np.asarray(array) for array in arrays]
    n_samples = len(given[0])
    weight = check_sample_weight(sample_weight, n_samples)
    kept = np.flatnonzero(weight > 0)
    # -0.0 equals 0.0 but is printed and divided by differently: merged rows must not depend
    # on which of the two came first.
    given = [array[kept] + 0 if array.dtype.kind == "f" else array[kept] for array in given]
    weight = weight[kept]
    columns = [column for array in given for column in np.atleast_2d(array.T)]

    order = np.argsort(columns[0], kind="stable")
    if (columns[0][order[1:]] == columns[0][order[:-1]]).any():
        # The weight comes last, so that equal rows are summed in an order of their own.
        order = np.lexsort((weight, *columns[::-1]))
    differs = [column[order[1:]] != column[order[:-1]] for column in columns]
    is_first = np.r_[True, np.any(differs, axis=0)]
    group = np.cumsum(is_first) - 1
    starts = np.flatnonzero(is_first)
    inverse = np.full(n_samples, -1, dtype=np.intp)
    inverse[kept[order]] = group
    return CanonicalRows(
        arrays=tuple(array[order[starts]] for array in given),
        weight=np.add.reduceat(weight[order], starts),
        inverse=inverse,
    )


def common_factor(weight: Array) -> float:
    """Factor of all weights of distinct rows, 1 if one of them counts as a row.

    A weight counts rows. Weights that are all smaller than 1 or all larger say how rows compare
    to each other, as inverse variances do: as counts they would let the price of a surface
    outweigh all rows, or take each row for so many measurements.

    Examples
    --------
    >>> common_factor(np.array([1e-6, 5e-7])), common_factor(np.array([1e6, 3e6]))
    (1e-06, 1000000.0)
    >>> common_factor(np.array([0.5, 3.0]))
    1.0
    """
    return float(np.clip(1.0, weight.min(), weight.max()))


def spread_rows(n_samples: int, n_chosen: int) -> NDArray[np.intp]:
    """About `n_chosen` distinct rows, spread evenly but without a period.

    Multiples of the golden ratio modulo one leave no gap much larger than another, and no
    periodic signal in the rows can hide between them.
    """
    golden = (np.sqrt(5.0) - 1.0) / 2.0
    return np.unique((np.arange(1, n_chosen + 1) * golden % 1.0 * n_samples).astype(np.intp))


def thinned_rows(weight: Array, limit: int) -> tuple[NDArray[np.intp], Array]:
    """At most `limit` rows and their weights: all that have weight, or a sample of that size.

    The sample takes equal steps of the weight: every stretch of the rows gives as many as its
    share of the weight says. Where the rows are in canonical order a stretch is a slice of space.
    """
    rows = np.flatnonzero(weight > 0)
    if len(rows) <= limit:
        return rows, weight[rows]
    below = np.cumsum(weight[rows])
    steps = (np.arange(limit) + 0.5) / limit * below[-1]
    rows, counts = np.unique(rows[np.searchsorted(below, steps)], return_counts=True)
    return rows, counts.astype(float)


def places_between(X: Array, n_chosen: int = 2000) -> Array:
    """Places on the lines between far apart pairs of rows, (at most n_chosen, n_features).

    They fill the region that the rows span, where no row is as well.
    """
    some = X[spread_rows(len(X), n_chosen)]
    share = (np.arange(1, len(some) + 1) * (np.sqrt(2.0) - 1.0) % 1.0)[:, None]
    return share * some + (1.0 - share) * np.roll(some, len(some) // 2, axis=0)


def check_sample_weight(sample_weight: ArrayLike | None, n_samples: int) -> Array:
    """Weights as floats, one for each sample; ones for None; unusable ones are refused."""
    if sample_weight is None:
        return np.ones(n_samples)
    weight = numbers("sample_weight", sample_weight)
    if weight.shape != (n_samples,):
        raise ValueError(
            f"sample_weight has shape {weight.shape}; give one weight for each of the "
            f"{n_samples} samples."
        )
    refuse_overflow("sample_weight", weight)
    if (weight < 0).any():
        raise ValueError(
            "sample_weight contains negative weights; give repetition counts, which are not."
        )
    if not (weight > 0).any():
        raise ValueError("all sample weights are zero; give at least one sample a positive weight.")
    refuse_vanishing("sample_weight", weight)
    return weight
