r"""What an effect contributes, along the channel that it is a function of, and how sure that is.

The prediction is linearised in the coefficients of the library, in those of the effects, and in
the nonlinear parameters theta, whose column is the derivative of the effect's contribution. With
J that design, w the weights of a Student-t regression and e the residuals, the covariance of the
M-estimate is

.. math:: (J^\top D J)^{-1} \; J^\top \mathrm{diag}(w^2 e^2) \, J \; (J^\top D J)^{-1},
    \qquad D = \mathrm{diag}(d(w e)/d e),

which holds whatever the variance of each row is (Huber 1967, White 1980). The derivative counts
that a residual changes its own weight: with w in its place, intervals are a quarter too narrow.

Where the rows' influences on a parameter are correlated in time, their sum has a variance that is
larger than that of independent rows by their correlation time. Standard errors grow by its root.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.optimize import approx_fprime

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.candidates import row_weights
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.settings import SETTINGS
from swsysid._noise import STUDENT, memory, root_mean_square
from swsysid._results import Array
from swsysid.effects import Parameter, PlacedEffect, ResetEffect, UnknownFunction
from swsysid.effects._placed import corrected

_LEVEL = 0.95  # of confidence intervals and bands
_STEP = 0.05  # of a derivative, as a share of the distance between values of the scan


NORMAL_QUANTILE = float(stats.norm.ppf(0.5 + 0.5 * _LEVEL))
_JUMP = 0.02  # neighbours of a function differ by less than this share of its range
_SMALLEST_FACTOR = 0.5  # of its usual size: a function is told where it is larger
_STRETCH = 300  # samples of one trajectory that are shown where time is the axis


def parameter_intervals(
    fit: JointFit, covariances: list[Array], records: Records
) -> list[dict[str, tuple[float, float]]]:
    """Intervals of the physical parameters of every term of a fit to all rows."""
    # `covariances` are those of `term_covariances`; terms without columns have no intervals.
    seen = corrected(fit.terms, records)
    quantile = float(stats.t.ppf(0.5 + 0.5 * _LEVEL, max(len(records) - 1, 1)))
    return [
        _physical_intervals(fit, place, seen, own, quantile) if len(own) else {}
        for place, own in enumerate(covariances)
    ]


def term_covariances(fit: JointFit, data: SearchData) -> list[Array]:
    """Covariance of the coefficients and then theta of every term; empty without columns."""
    weight = row_weights(fit, data)
    errors = fit.residuals(data.records, data.rows, data.targets)
    seen = corrected(fit.terms, data.records)
    features = fit.features(seen, data.rows)
    answers = [np.empty((0, 0)) for _ in fit.terms]
    for target in range(data.targets.shape[1]):
        columns = {
            place: linearised(fit, place, seen, data.rows, fit.modes)
            for place, term in enumerate(fit.terms)
            if term.target == target and term.effect.terms
        }
        if columns:
            every, start = np.column_stack(list(columns.values())), 0
            support = fit.laws.support[:, target]
            covariance = _covariance(
                fit.modes, weight, features, support, every, errors[:, target], data.folds.series
            )
            for place, part in columns.items():
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
        values = replace(term, theta=theta).columns(records, rows)
        return term.design(values, modes, fit.n_modes)

    parts = [columns(term.theta)]
    ranges = term.effect.parameters(records, term.place)
    for number, (value, parameter) in enumerate(zip(term.theta, ranges, strict=True)):
        step = small_step(parameter, value)
        ends = [
            columns((*term.theta[:number], value + sign * step, *term.theta[number + 1 :])) @ coef
            for sign in (1.0, -1.0)
        ]
        parts.append(((ends[0] - ends[1]) / (2.0 * step))[:, None])
    return np.column_stack(parts)


def deviations(columns: Array, covariance: Array) -> Array:
    """Standard deviation of what coefficients with a covariance make of columns, row by row."""
    variance = np.einsum("ij,jk,ik->i", columns, covariance, columns)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def small_step(parameter: Parameter, value: float) -> float:
    """Of a nonlinear parameter, over which an effect is nearly linear."""
    return _STEP * _spacing(parameter.values, value) or 1e-6 * (abs(value) or 1.0)


def _spacing(values: Array, value: float) -> float:
    """Distance between the two values of a scan about a value; 0 if there is only one."""
    if len(values) < 2:
        return 0.0
    above = int(np.clip(np.searchsorted(values, value), 1, len(values) - 1))
    return float(values[above] - values[above - 1])


def _covariance(
    modes: NDArray[np.intp],
    weight: Array,
    features: Array,
    support: NDArray[np.bool_],
    columns: Array,
    errors: Array,
    series: list[NDArray[np.intp]],
) -> Array:
    """Sandwich covariance of the columns' coefficients beside the library in each mode."""
    blocks = [
        features[:, support[mode]] * (modes == mode)[:, None] for mode in range(modes.max() + 1)
    ]
    design = np.column_stack([*blocks, columns])
    size = np.linalg.norm(design, axis=0)
    size[size == 0.0] = 1.0
    used = 1.0 * (weight > 0.0)
    scaled, (pull, slope) = design / size, STUDENT.influence(errors)
    pull *= used
    # the mean of the slopes: single ones are negative where outliers are
    slope_here = pull * (used @ slope / max(float(used @ pull), 1e-300))
    inverse = np.linalg.pinv((scaled * slope_here[:, None]).T @ scaled, rcond=1e-12, hermitian=True)
    spread = scaled * (pull * errors)[:, None]
    n_used, n_columns = int(np.sum(pull > 0)), design.shape[1]
    share = n_used / max(n_used - n_columns, 1)
    influence = spread @ inverse[:, -columns.shape[1] :] / size[-columns.shape[1] :]
    longer = np.sqrt([memory(column, series) for column in influence.T])
    return np.asarray(share * influence.T @ influence * np.outer(longer, longer))


def beside_conventions(covariance: Array, places: NDArray[np.intp], columns: Array) -> Array:
    """A covariance without what no row tells of some of its coefficients, which have `columns`.

    Friction of two sizes is the same function as one of their mean beside a constant: how much of
    it a constant of the law has is a convention. What is told is the covariance where such shares
    are held; of all else that is the covariance itself.
    """
    sizes = np.linalg.norm(columns, axis=0)
    sizes[sizes == 0.0] = 1.0
    _, values, directions = np.linalg.svd(np.linalg.qr(columns / sizes, mode="r"))
    least = np.sqrt(SETTINGS.spanned) * values.max(initial=0.0)
    directions = directions[np.sum(values > least) :] / sizes
    along = np.zeros((len(directions), len(covariance)))
    along[:, places] = directions
    shared = covariance @ along.T
    inverse = np.linalg.pinv(along @ shared, hermitian=True)
    return np.asarray(covariance - shared @ inverse @ shared.T)


def _physical_intervals(
    fit: JointFit, place: int, records: Records, covariance: Array, quantile: float
) -> dict[str, tuple[float, float]]:
    """Intervals of what a physicist calls the parameters, by the delta method."""
    term, n_coef = fit.terms[place], len(fit.coef[place])
    values = np.concatenate([fit.coef[place], term.theta])
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))

    def physical(vector: Array) -> dict[str, float]:
        return term.physical(records, vector[:n_coef], vector[n_coef:])

    steps = np.maximum(1e-3 * deviation, np.maximum(1e-9 * np.abs(values), 1e-300))
    slopes = approx_fprime(values, lambda vector: np.array(list(physical(vector).values())), steps)
    jacobian, here = np.atleast_2d(slopes), physical(values)
    errors = deviations(jacobian, covariance)
    return {
        name: (value - quantile * error, value + quantile * error)
        for (name, value), error in zip(here.items(), errors.tolist(), strict=True)
    }


# -- shapes ----------------------------------------------------------------------------------------

_TIME, _ROW = "time", "row"


@dataclass(frozen=True, eq=False)
class Shape:
    """What one effect contributes to the velocity of its state, in increasing order of `values`."""

    axis: str  # name of what `values` are: a channel, a monomial or the time
    target: int  # state whose velocity is changed
    values: Array
    contribution: Array
    half_width: Array  # of the 95 % confidence band; NaN for an effect without a term of its own
    wanted: Array  # contribution and residual: what the measured velocities ask of the effect
    modes: NDArray[np.intp]  # 0 everywhere unless the effect has other coefficients in other modes
    is_function: bool  # of `values`; otherwise it is drawn as dots
    where: str = ""  # the value of another channel for which all of it is told


def effect_shape(
    declared: JointFit,
    fit: JointFit,
    place: int,
    covariance: Array,
    records: Records,
    targets: Array,
) -> Shape:
    """Shape of the term at `place` of a fit on some records."""
    # An effect without columns (of a sensor, of the modes) contributes the difference between the
    # predictions with and without the effects, in the state in which that is largest.
    term, modes = fit.terms[place], fit.predict_modes(records)
    predicted, target = fit.predict(records, modes), term.target
    everything = np.arange(len(records))
    half_width = np.full(len(records), np.nan)
    if term.effect.terms:
        # the function itself: a filter that smears it in time leaves no function of the channel
        seen = replace(corrected(fit.terms, records), average=None)
        slopes = linearised(fit, place, seen, everything, modes)
        contribution = slopes[:, : len(fit.coef[place])] @ fit.coef[place]
        if len(covariance):
            half_width = NORMAL_QUANTILE * deviations(slopes, covariance)
    else:
        change = predicted - declared.predict(records)
        spread = targets.std(axis=0)
        share = root_mean_square(change) / np.where(spread > 0, spread, np.inf)
        target = target if isinstance(term.effect, ResetEffect) else int(np.argmax(share))
        contribution = change[:, target]
    axis, values, shown = _axis(term, records)
    if term.mode is not None:
        shown = shown[modes[shown] == term.mode]
    wanted, where = (targets - predicted)[:, target] + contribution, ""
    if isinstance(term.effect, UnknownFunction) and term.effect.reference is not None:
        # what the data want of a function that is multiplied by little is noise
        factor = term.effect.factor(corrected(fit.terms, records))
        shown = shown[np.abs(factor[shown]) >= _SMALLEST_FACTOR]
        factor = np.where(factor == 0.0, np.inf, factor)
        contribution, wanted = contribution / factor, wanted / factor
        half_width = half_width / np.abs(factor)
        where = term.effect.condition(records.names)
    order = shown[np.argsort(values[shown], kind="stable")]
    own = modes if term.effect.terms and term.replaced is not None else np.zeros_like(modes)
    own, change = own[order], contribution[order]
    in_time = axis in (_TIME, _ROW) and records.ordered
    return Shape(
        axis=axis,
        target=target,
        values=values[order],
        contribution=change,
        half_width=half_width[order],
        wanted=wanted[order],
        modes=own,
        is_function=in_time or all(_is_function(change[own == mode]) for mode in np.unique(own)),
        where=where,
    )


def _axis(term: PlacedEffect, records: Records) -> tuple[str, Array, NDArray[np.intp]]:
    """What to draw an effect over: name, values, and the rows to show."""
    everything = np.arange(len(records))
    in_time = "time" in term.effect.needs and term.effect.terms
    if isinstance(term.place, (int, np.integer)) and not in_time:
        return records.names[term.place], records.channel(int(term.place)), everything
    if isinstance(term.effect, UnknownFunction):
        name = term.effect.arguments(records.names)[0]
        return name, term.effect.points(records)[:, 0], everything
    if isinstance(term.place, tuple) and not in_time and term.effect.terms:
        channels = sorted(set(term.place))
        if len(channels) == 1:
            return records.names[channels[0]], records.channel(channels[0]), everything
        values = term.columns(records)[:, 0]
        return term.label(records.names), values, everything
    if records.t is None:
        return _ROW, everything.astype(float), everything
    longest = max(records.trajectories, key=len)[:_STRETCH]
    return (_TIME if records.timed else _ROW), records.t, longest


def _is_function(contribution: Array) -> bool:
    """True if neighbours along the axis are close."""
    span = np.ptp(contribution) if len(contribution) > 2 else 0.0
    return bool(span == 0.0 or np.median(np.abs(np.diff(contribution))) <= _JUMP * span)
