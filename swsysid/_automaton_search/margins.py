r"""The guard of one transition in discrete time: the margin program of the paper.

A guard is below zero at every row of its mode and not at the row at which its transition is taken.
Of few columns it is the one as far from both as it can be,

.. math::

    \max_{a, m, \xi \ge 0} m - \beta \sum_i \xi_i \quad \text{with} \quad
    s_i\, a \cdot \phi(c_i) \ge m - \xi_i, \quad
    \tfrac1n \sum_k a \cdot \big(\phi(c_k) - \phi(c_{k-1})\big) = 1 ,

whose scale is that in which it rises by one where it is crossed. The fewest columns are taken that
tell the sides (section IV of the paper; there a box gives the scale).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

from swsysid._automaton_search.few_columns import FewColumns, cheapest_guard, known
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array


def guard_with_margin(below: Array, last: Array, reached: Array, degree: int) -> FoundGuard | None:
    """The guard of fewest columns.

    Parameters
    ----------
    below : ndarray of shape (n_rows, n_columns)
        Columns at rows of the mode.
    last, reached : ndarray of shape (n_switches, n_columns)
        Columns at the row before each switch, and those that the guard was given at it.
    degree : int
    """
    return cheapest_guard(
        below.shape[1], lambda some: _guard_of(below, last, reached, some, degree)
    )


def _guard_of(
    below: Array, last: Array, reached: Array, some: NDArray[np.intp], degree: int
) -> FoundGuard | None:
    seen = known(last, some) & known(reached, some)
    basis = FewColumns.of(below, some, degree)
    if basis is None or not seen.any() or len(basis.powers) > seen.sum() + 1:
        return None
    rows = basis.values(below[known(below, some)])
    before, at = basis.values(last[seen]), basis.values(reached[seen])
    rising = (at - before).mean(axis=0)
    if not np.linalg.norm(rising) > 0.0:
        return None
    coef = _separating(np.vstack([rows, before]), at, rising)
    if coef is None:
        return None
    wrong = np.maximum(0.0, rows @ coef).sum() + np.maximum(0.0, -(at @ coef)).sum()
    cost = SETTINGS.slack_price * wrong + basis.price(
        len(seen), int((~seen).sum()), SETTINGS.unexplained
    )
    misses = np.full(len(seen), np.nan)
    misses[seen] = np.maximum(0.0, -(at @ coef))
    return FoundGuard(basis.guard(coef), float(cost), misses, some)


def _separating(below: Array, above: Array, rising: Array) -> Array | None:
    """Coefficients of the program; rows enter it as they are violated."""
    coef = rising / (rising @ rising)
    used = np.zeros(len(below), dtype=bool)
    for _ in range(SETTINGS.turns_of_rows):
        values = below @ coef
        most = np.partition(values, -min(len(values), SETTINGS.first_rows))[
            -min(len(values), SETTINGS.first_rows)
        ]
        new = (values >= most) & ~used
        if not new.any():
            break
        used |= new
        solved = _program(below[used], above, rising)
        if solved is None:
            return None
        coef, margin = solved
        if (below[~used] @ coef <= -margin).all():
            break
    return coef


def _program(below: Array, above: Array, rising: Array) -> tuple[Array, float] | None:
    """Coefficients and margin of some rows."""
    signed = np.vstack([-below, above])
    n, n_terms = signed.shape
    done = linprog(
        np.concatenate([np.zeros(n_terms), [-1.0], np.full(n, SETTINGS.slack_price)]),
        A_ub=np.hstack([-signed, np.ones((n, 1)), -np.eye(n)]),
        b_ub=np.zeros(n),
        A_eq=np.concatenate([rising, np.zeros(n + 1)])[None, :],
        b_eq=[1.0],
        bounds=[(None, None)] * n_terms + [(0.0, None)] * (n + 1),
        method="highs",
    )
    return (done.x[:n_terms], float(done.x[n_terms])) if done.status == 0 else None
