"""What has no formula, as a table: the curve of a shape, the course of a disturbance."""

from __future__ import annotations

import numpy as np
from scipy import stats

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.coloured import Stretches, coloured
from swsysid._effect_search.settings import REPORT, SETTINGS
from swsysid._results import Array
from swsysid.effects import UnknownFunction, UnmeasuredDisturbance
from swsysid.effects._placed import corrected

_QUANTILE = float(stats.norm.ppf(0.5 + 0.5 * SETTINGS.level))


def table_of(
    fit: JointFit, place: int, covariance: Array, records: Records, targets: Array
) -> dict[str, Array]:
    """Columns of equal length by name; none for an effect that has a formula."""
    effect = fit.terms[place].effect
    if isinstance(effect, UnknownFunction):
        return _curve(fit, place, effect, covariance, records)
    if isinstance(effect, UnmeasuredDisturbance):
        return _course(fit, fit.terms[place].target, records, targets)
    return {}


def _curve(
    fit: JointFit, place: int, effect: UnknownFunction, covariance: Array, records: Records
) -> dict[str, Array]:
    """A shape along its argument, or at the knots of two, without what the law itself can take."""
    seen = corrected(fit.terms, records)
    arguments = effect.points(seen)
    if effect.n_arguments == 1:
        along = np.linspace(arguments.min(), arguments.max(), REPORT.points)[:, None]
    else:
        along = np.array(effect.knots)
    basis = effect.basis(along)
    contribution = basis @ _beyond_the_law(fit, place, seen)
    variance = np.zeros(len(along))
    if len(covariance):
        variance = np.einsum("ij,jk,ik->i", basis, covariance, basis)
    columns = dict(zip(effect.arguments(records.names), along.T, strict=True))
    half_width = _QUANTILE * np.sqrt(np.maximum(variance, 0.0))
    return {**columns, "contribution": contribution, "half_width": half_width}


def _beyond_the_law(fit: JointFit, place: int, records: Records) -> Array:
    """Coefficients of a shape without the functions of its channels that the library has."""
    # A straight line may stand in the shape or in the law: the curve is told without it.
    term, coef = fit.terms[place], fit.coef[place]
    modes, features = fit.predict_modes(records), fit.features(records)
    columns = term.columns(records)
    left = columns.copy()
    for mode in np.unique(modes):
        rows = modes == mode
        law = features[rows][:, fit.laws.support[mode, term.target]]
        left[rows] -= law @ np.linalg.lstsq(law, columns[rows], rcond=1e-10)[0]
    acting = slice(None) if term.mode is None else modes == term.mode
    columns, left = columns[acting], left[acting]
    _, sizes, directions = np.linalg.svd(left, full_matrices=False)
    taken = directions[sizes <= SETTINGS.spanned * np.linalg.norm(columns)].T
    if not taken.shape[1]:
        return coef
    shared = columns @ taken
    return coef - taken @ np.linalg.lstsq(shared, columns @ coef, rcond=None)[0]


def _course(fit: JointFit, target: int, records: Records, targets: Array) -> dict[str, Array]:
    """A disturbance at the samples, as a smoother sees it."""
    assert records.t is not None
    order = np.concatenate(records.trajectories)
    number = np.repeat(
        np.arange(len(records.trajectories)), [len(rows) for rows in records.trajectories]
    )
    left = (targets - fit.predict(records))[order, target]
    where = Stretches(records.t[order], number)
    force, deviation = coloured(left, where).course(left, where)
    return {
        "trajectory": number.astype(float),
        "t": records.t[order],
        "contribution": force,
        "half_width": _QUANTILE * deviation,
    }
