r"""Coefficients of several regressions within linear constraints that tie them together.

.. math:: \min_c \; \sum_b \sum_i w_i L(y_{bi} - c_b^\top d_i) \quad \text{with} \quad
          \ell \le A c \le u

over blocks b, one for each mode and equation (or, with soft memberships, each equation). Equalities
are eliminated, :math:`c = c_0 + N w`. Least squares then are one quadratic program; a loss of norms
is a few of them, its rows weighted by the inverse of their norms (Weiszfeld 1937); least absolute
deviations are one regression for each set of blocks that constraints join, and bounds that it
misses become equalities, as long as it would miss them without.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from swsysid._known.program import Steps
from swsysid._results import Array
from swsysid._solvers.lad import least_absolute_deviations

# Turns of weights, the relative change at which they end, and what no norm counts as less than, of
# the mean; of a bound, by which it may be missed by rounding; of the diagonal, what holds
# coefficients that the rows do not tell.
_TURNS, _SETTLED, _LEAST_NORM, _MISSED, _RIDGE = 100, 1e-9, 1e-7, 1e-9, 1e-12


class Block(NamedTuple):
    """One regression."""

    design: Array  # (n_rows, n_own)
    target: Array  # (n_rows,)
    weight: Array  # (n_rows,)
    rows: NDArray[np.intp]  # (n_rows,): samples that they are of
    places: NDArray[np.intp]  # (n_own,): of its coefficients among all


def least_within(loss: str, blocks: Sequence[Block], steps: Steps) -> Array:
    """The coefficients of least loss, ``"l1"``, ``"l2"`` or ``"squared"``, of the steps.

    Examples
    --------
    Two means that are equal, and the median of both:

    >>> one, other = (
    ...     Block(np.ones((2, 1)), np.array(y), np.ones(2), np.arange(2), np.array([place]))
    ...     for place, y in enumerate(([1.0, 2.0], [3.0, 10.0]))
    ... )
    >>> nothing = np.zeros((0, 2)), np.zeros(0)
    >>> equal = Steps(np.array([[1.0, -1.0]]), np.zeros(1), *nothing)
    >>> least_within("squared", [one, other], equal).round(9).tolist()
    [4.0, 4.0]
    >>> bounded = Steps(*nothing, np.array([[0.0, 1.0]]), np.array([2.5]))
    >>> least_within("l1", [one, other], bounded).round(9)[1].item()
    2.5
    """
    if loss == "l1":
        return _absolute(blocks, steps)
    coef = _squares(blocks, steps, [one.weight for one in blocks])
    n_samples = max((int(one.rows.max(initial=-1)) for one in blocks), default=-1) + 1
    for _ in range(_TURNS if loss == "l2" else 0):
        squares = np.zeros(n_samples)
        for one in blocks:
            np.add.at(squares, one.rows, np.square(one.target - one.design @ coef[one.places]))
        norms = np.maximum(np.sqrt(squares), _LEAST_NORM * np.sqrt(squares.mean()))
        norms = np.maximum(norms, np.finfo(float).tiny)
        before = coef
        coef = _squares(blocks, steps, [one.weight / norms[one.rows] for one in blocks])
        if np.abs(coef - before).max(initial=0.0) <= _SETTLED * np.abs(coef).max(initial=0.0):
            break
    return coef


def _squares(blocks: Sequence[Block], steps: Steps, weights: Sequence[Array]) -> Array:
    n = steps.equal.shape[1]
    matrix, right = np.zeros((n, n)), np.zeros(n)
    for one, weight in zip(blocks, weights, strict=True):
        weighted = one.design * weight[:, None]
        matrix[np.ix_(one.places, one.places)] += weighted.T @ one.design
        right[one.places] += weighted.T @ one.target
    diagonal = np.diag(matrix)
    matrix += np.diag(np.where(diagonal > 0.0, _RIDGE * diagonal, 1.0))
    return steps.least(matrix, right)


def _absolute(blocks: Sequence[Block], steps: Steps) -> Array:
    held = np.zeros(len(steps.room), dtype=bool)
    coef = _deviations(blocks, steps, held)
    for _ in range(2 * len(held)):
        size = np.abs(steps.most) @ np.abs(coef) + np.abs(steps.room)
        missed = (steps.most @ coef - steps.room > _MISSED * size) & ~held
        if not missed.any():
            kept = np.flatnonzero(held).tolist()
            needless = [k for k in kept if _needless(blocks, steps, held, k)][:1]
            if not needless:
                break
            held[needless] = False
        held |= missed
        coef = _deviations(blocks, steps, held)
    return coef


def _needless(blocks: Sequence[Block], steps: Steps, held: NDArray[np.bool_], bound: int) -> bool:
    """True of a bound that is not missed without it."""
    fewer = held.copy()
    fewer[bound] = False
    coef = _deviations(blocks, steps, fewer)
    size = np.abs(steps.most[bound]) @ np.abs(coef) + np.abs(steps.room[bound])
    return bool(steps.most[bound] @ coef - steps.room[bound] < -_MISSED * size)


def _deviations(blocks: Sequence[Block], steps: Steps, held: NDArray[np.bool_]) -> Array:
    """Least absolute deviations with equalities, and some of the bounds as equalities."""
    equal = np.vstack([steps.equal, steps.most[held]])
    gap = np.append(steps.gap, steps.room[held])
    own = Steps(equal, gap, steps.most[:0], steps.room[:0])
    start, N = np.linalg.lstsq(equal, gap, rcond=None)[0], own.basis
    moved = np.zeros(N.shape[1])
    touched = np.array([(N[one.places] != 0.0).any(axis=0) for one in blocks])
    _, group = connected_components(csr_array(touched @ touched.T), directed=False)
    for number in np.unique(group):
        some = np.flatnonzero(group == number).tolist()
        columns = np.flatnonzero(touched[some].any(axis=0))
        if not columns.size:
            continue
        parts = [blocks[k] for k in some]
        fit = least_absolute_deviations(
            np.vstack([one.design @ N[np.ix_(one.places, columns)] for one in parts]),
            np.concatenate([one.target - one.design @ start[one.places] for one in parts])[:, None],
            sample_weight=np.concatenate([one.weight for one in parts]),
        )
        moved[columns] = fit.coef[0]
    return np.asarray(start + N @ moved)
