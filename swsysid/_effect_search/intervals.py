r"""How sure the parameters of the effects are.

The prediction is linearised in the coefficients of the library, in those of the effects, and in
the nonlinear parameters theta, whose column is the derivative of the effect's contribution. With
J that design, w the weights of a Student-t regression and e the residuals, the covariance of the
M-estimate is

.. math:: (J^\top D J)^{-1} \; J^\top \mathrm{diag}(w^2 e^2) \, J \; (J^\top D J)^{-1},
    \qquad D = \mathrm{diag}(d(w e)/d e),

which holds whatever the variance of each row is (Huber 1967, White 1980). The derivative counts
that a residual changes its own weight: with w in its place, intervals are a quarter too narrow.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.candidates import candidate_context
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.regression import Regression
from swsysid._effect_search.settings import SETTINGS
from swsysid._noise import STUDENT
from swsysid._results import Array
from swsysid.effects._placed import corrected

__all__ = ["linearised", "parameter_intervals", "term_covariances"]


def parameter_intervals(fit: JointFit, data: SearchData) -> list[dict[str, tuple[float, float]]]:
    """Intervals of the physical parameters of every term with columns; empty for the others."""
    seen = corrected(fit.terms, data.records)
    level = 0.5 + 0.5 * data.settings.level
    quantile = float(stats.t.ppf(level, max(len(data.rows) - 1, 1)))
    return [
        _physical_intervals(fit, place, seen, own, quantile) if len(own) else {}
        for place, own in enumerate(term_covariances(fit, data))
    ]


def term_covariances(fit: JointFit, data: SearchData) -> list[Array]:
    """Covariance of the coefficients and then theta of every term; empty without columns."""
    regression = candidate_context(fit, data).regression
    errors = fit.residuals(data.records, data.rows, data.targets)
    seen = corrected(fit.terms, data.records)
    features = fit.features(seen)[data.rows]
    answers = [np.empty((0, 0)) for _ in fit.terms]
    for target in range(data.targets.shape[1]):
        places = [
            place
            for place, term in enumerate(fit.terms)
            if term.target == target and term.effect.terms
        ]
        if not places:
            continue
        columns = [linearised(fit, place, seen, data.rows, fit.modes) for place in places]
        covariance = _covariance(regression, features, np.column_stack(columns), errors[:, target])
        start = 0
        for place, part in zip(places, columns, strict=True):
            own = slice(start, start + part.shape[1])
            answers[place], start = covariance[own, own], own.stop
    return answers


def linearised(
    fit: JointFit,
    place: int,
    records: Records,
    rows: NDArray[np.intp],
    modes: NDArray[np.intp],
) -> Array:
    """Columns of a term and the derivatives of its contribution, (n_rows, n_terms + n_theta)."""
    term, coef = fit.terms[place], fit.coef[place]

    def columns(theta: tuple[float, ...]) -> Array:
        values = replace(term, theta=theta).columns(records)[rows]
        return term.design(values, modes, fit.n_modes)

    parts = [columns(term.theta)]
    ranges = term.effect.parameters(records, term.place)
    for number, (value, parameter) in enumerate(zip(term.theta, ranges, strict=True)):
        step = SETTINGS.step * _spacing(parameter.values, value) or 1e-6
        ends = [
            columns((*term.theta[:number], value + sign * step, *term.theta[number + 1 :])) @ coef
            for sign in (1.0, -1.0)
        ]
        parts.append(((ends[0] - ends[1]) / (2.0 * step))[:, None])
    return np.column_stack(parts)


def _spacing(values: Array, value: float) -> float:
    """Distance between the two values of a scan about a value; 0 if there is only one."""
    if len(values) < 2:
        return 0.0
    above = int(np.clip(np.searchsorted(values, value), 1, len(values) - 1))
    return float(values[above] - values[above - 1])


def _covariance(regression: Regression, features: Array, columns: Array, errors: Array) -> Array:
    """Sandwich covariance of the columns' coefficients beside the library in each mode."""
    blocks = [features * (regression.modes == mode)[:, None] for mode in range(regression.n_modes)]
    design = np.column_stack([*blocks, columns])
    size = np.linalg.norm(design, axis=0)
    size[size == 0.0] = 1.0
    used = 1.0 * (regression.weight > 0.0)
    scaled, (weight, slope) = design / size, STUDENT.influence(errors)
    weight *= used
    # the mean of the slopes: single ones are negative where outliers are
    slope_here = weight * (used @ slope / max(float(used @ weight), 1e-300))
    inverse = np.linalg.pinv((scaled * slope_here[:, None]).T @ scaled, rcond=1e-12, hermitian=True)
    spread = scaled * (weight * errors)[:, None]
    n_used, n_columns = int(np.sum(weight > 0)), design.shape[1]
    share = n_used / max(n_used - n_columns, 1)
    covariance = share * inverse @ (spread.T @ spread) @ inverse / np.outer(size, size)
    return covariance[-columns.shape[1] :, -columns.shape[1] :]


def _physical_intervals(
    fit: JointFit, place: int, records: Records, covariance: Array, quantile: float
) -> dict[str, tuple[float, float]]:
    """Intervals of what a physicist calls the parameters, by the delta method."""
    term, n_coef = fit.terms[place], len(fit.coef[place])
    values = np.concatenate([fit.coef[place], term.theta])
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))

    def physical(vector: Array) -> dict[str, float]:
        return term.physical(records, vector[:n_coef], vector[n_coef:])

    here = physical(values)
    slopes = []
    for number, one in enumerate(deviation):
        moved = values.copy()
        step = max(1e-3 * one, 1e-9 * abs(values[number]), 1e-300)
        moved[number] += step
        changed = physical(moved)
        slopes.append([(changed[name] - here[name]) / step for name in here])
    jacobian = np.array(slopes)
    errors = np.sqrt(np.maximum(np.einsum("ij,ik,kj->j", jacobian, covariance, jacobian), 0.0))
    return {
        name: (value - quantile * error, value + quantile * error)
        for (name, value), error in zip(here.items(), errors, strict=True)
    }
