r"""The reset of one transition: what becomes of the state, found across its switches.

Component c goes on where nothing is said against it. Otherwise its jump is affine in few states,

.. math:: x_c^+ - x_c^- = b_c + \sum_d D_{cd}\, x_d^- ,

those few for which :math:`n \log \sum_k |r_k| + m \log n` is least: least absolute
deviations, so that a switch that is none does not count.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import AffineReset
from swsysid._automaton_search.found import FoundReset
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.arrow import covariance_of

# Turns of least absolute deviations; errors by which terms must differ.
_TURNS_OF_DEVIATIONS = 20
_TOLD_APART = 10.0


def best_reset(before: Array, after: Array, errors: Array, held: NDArray[np.intp]) -> FoundReset:
    """The reset of fewest terms; `errors` are those in which states are known, (n_states,).

    Components that are held go on.
    """
    n, n_states = before.shape
    matrix, offset = np.eye(n_states), np.zeros(n_states)
    changed, total = np.zeros(n_states, dtype=bool), 0.0
    of_errors = np.zeros((n_states, 1 + n_states))
    sizes = np.maximum(before.std(axis=0), np.finfo(float).tiny)
    regressors = np.column_stack([np.ones(n), before])
    # in units in which an error of a state is one
    told = np.column_stack([np.ones(n) * (sizes / errors).max(), before / errors])
    for component in range(n_states):
        most = 0 if component in held else SETTINGS.most_columns
        jump = after[:, component] - before[:, component]
        cost, terms, coef = _few_terms(regressors, told, jump, errors[component], most)
        total += cost
        changed[component] = bool(len(terms))
        full = np.zeros(n_states + 1)
        full[terms] = coef
        of_errors[component, terms] = _errors(regressors[:, terms], jump, coef)
        offset[component] = full[0]
        matrix[component] += full[1:]
    matrix[np.abs(matrix) < SETTINGS.exact] = 0.0
    reset = AffineReset(matrix, offset)
    return FoundReset(reset, after - before @ matrix.T - offset, changed, total, of_errors)


def _errors(regressors: Array, jump: Array, coef: Array) -> Array:
    """Standard errors of the terms of a jump by what they leave.

    Infinite where that is nothing, since there are no more jumps than terms.
    """
    n, n_terms = regressors.shape
    if n <= n_terms:
        return np.full(n_terms, np.inf)
    left = np.square(jump - regressors @ coef).sum() / (n - n_terms)
    return np.sqrt(left * np.diag(covariance_of(regressors.T @ regressors)))


def _few_terms(
    regressors: Array, told: Array, jump: Array, error: float, most: int
) -> tuple[float, NDArray[np.intp], Array]:
    n = len(jump)
    best: tuple[float, NDArray[np.intp], Array] | None = None
    for count in range(min(most, regressors.shape[1], n // 2) + 1):
        for some in combinations(range(regressors.shape[1]), count):
            terms = np.array(some, dtype=np.intp)
            if count > 1 and _least_seen(told[:, terms]) < _TOLD_APART:
                continue
            coef = _least_deviations(regressors[:, terms], jump)
            left = np.abs(jump - regressors[:, terms] @ coef).mean()
            cost = n * np.log(max(float(left), error)) + count * np.log(max(2, n))
            if best is None or cost < best[0] - SETTINGS.better:
                best = cost, terms, coef
    assert best is not None, "no term at all is always tried"
    return best


def _least_seen(columns: Array) -> float:
    """How far terms differ from each other in the direction in which they differ least.

    At the switches of one guard states are bound to each other, and terms to the constant.
    """
    return float(np.linalg.svd(columns, compute_uv=False)[-1] / np.sqrt(len(columns)))


def _least_deviations(regressors: Array, target: Array) -> Array:
    """Least absolute deviations by least squares with weights, in turns."""
    weights, coef = np.ones(len(target)), np.zeros(regressors.shape[1])
    if not len(coef):
        return coef
    size = max(float(np.abs(target).max()), np.finfo(float).tiny)
    for _ in range(_TURNS_OF_DEVIATIONS):
        solved = np.linalg.lstsq(regressors * weights[:, None], target * weights, rcond=None)[0]
        coef = np.asarray(solved, dtype=float)
        left = np.abs(target - regressors @ coef)
        weights = np.maximum(left, SETTINGS.exact * size) ** -0.5
    return coef
