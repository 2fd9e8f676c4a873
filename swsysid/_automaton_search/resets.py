r"""The reset of one transition: what becomes of the state, found across its switches.

Component c goes on where nothing is said against it. Otherwise its jump is affine in few states,

.. math:: x_c^+ - x_c^- = b_c + \sum_d D_{cd}\, x_d^- ,

those few for which :math:`n \log \sum_k |r_k| + m \log n` is least: least absolute
deviations, so that a switch that is none does not count.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import AffineReset
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array


@dataclass(frozen=True)
class FoundReset:
    """A reset and what it leaves of the states after the jump."""

    reset: AffineReset
    left: Array  # (n_switches, n_states)
    changed: NDArray[np.bool_]  # (n_states,): components that do not go on
    cost: float  # the sum above over the components

    @property
    def sizes(self) -> Array:
        """What is left of each component in the mean, (n_states,)."""
        return np.asarray(np.abs(self.left).mean(axis=0))


def best_reset(before: Array, after: Array, errors: Array) -> FoundReset:
    """The reset of fewest terms; `errors` are those in which states are known, (n_states,)."""
    n, n_states = before.shape
    matrix, offset = np.eye(n_states), np.zeros(n_states)
    changed, total = np.zeros(n_states, dtype=bool), 0.0
    regressors = np.column_stack([np.ones(n), before])
    for component in range(n_states):
        jump = after[:, component] - before[:, component]
        cost, terms, coef = _few_terms(regressors, jump, errors[component])
        total += cost
        changed[component] = bool(len(terms))
        full = np.zeros(n_states + 1)
        full[terms] = coef
        offset[component] = full[0]
        matrix[component] += full[1:]
    reset = AffineReset(matrix, offset)
    return FoundReset(reset, after - before @ matrix.T - offset, changed, total)


def _few_terms(
    regressors: Array, jump: Array, error: float
) -> tuple[float, NDArray[np.intp], Array]:
    n = len(jump)
    best: tuple[float, NDArray[np.intp], Array] | None = None
    most = min(SETTINGS.most_columns, regressors.shape[1], n // 2)
    for count in range(most + 1):
        for some in combinations(range(regressors.shape[1]), count):
            terms = np.array(some, dtype=np.intp)
            coef = _least_deviations(regressors[:, terms], jump)
            left = np.abs(jump - regressors[:, terms] @ coef).mean()
            cost = n * np.log(max(float(left), error)) + count * np.log(max(2, n))
            if best is None or cost < best[0] - SETTINGS.better:
                best = cost, terms, coef
    assert best is not None, "no term at all is always tried"
    return best


def _least_deviations(regressors: Array, target: Array) -> Array:
    """Least absolute deviations by least squares with weights, in turns."""
    weights, coef = np.ones(len(target)), np.zeros(regressors.shape[1])
    if not len(coef):
        return coef
    size = max(float(np.abs(target).max()), np.finfo(float).tiny)
    for _ in range(SETTINGS.turns_of_deviations):
        coef = np.linalg.lstsq(regressors * weights[:, None], target * weights, rcond=None)[0]
        left = np.abs(target - regressors @ coef)
        weights = np.maximum(left, SETTINGS.exact * size) ** -0.5
    return np.asarray(coef, dtype=float)
