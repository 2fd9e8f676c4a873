"""What a function without a name is told as: a formula where one serves, and a table otherwise.

The formulas are a short list, the usual expressions of the field. Each is fitted and judged as
every other candidate, on the same folds, in the place of the shape. One is claimed only if its
held-out error is within a standard error of that of the shape. A table has the curve of a shape, or
the course of a disturbance.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.coloured_noise import Stretches, coloured
from swsysid._effect_search.contributions import NORMAL_QUANTILE, deviations
from swsysid._effect_search.scan import refined, scan
from swsysid._effect_search.settings import SETTINGS
from swsysid._results import Array
from swsysid.effects import (
    Effect,
    Formula,
    Parameter,
    PlacedEffect,
    UnknownFunction,
    UnmeasuredDisturbance,
)
from swsysid.effects._base import Place, figure, quantile_levels, spread
from swsysid.effects._placed import corrected

_POINTS = 101  # of the curve of a function without a name


@dataclass(frozen=True)
class _Form:
    """A function of z with parameters, as text and as numbers."""

    text: str  # the argument is {0}, the parameters are {1}, ...
    law: Callable[..., Array]
    parameters: tuple[str, ...]


FORMS = (
    _Form("{0}^2 / ({0}^2 + {1}^2)", lambda z, a: z**2 / (z**2 + a**2), ("width",)),
    _Form("{0} / ({0}^2 + {1}^2)", lambda z, a: z * a / (z**2 + a**2), ("width",)),
    _Form("tanh({0} / {1})", lambda z, a: np.tanh(z / a), ("width",)),
    _Form("{0} / ({1} + |{0}|)", lambda z, a: z / (a + np.abs(z)), ("width",)),
    _Form("{0} exp(-|{0}| / {1})", lambda z, a: z / a * np.exp(-np.abs(z) / a), ("width",)),
    _Form("exp({0} / {1})", lambda z, a: np.exp((z - z.max()) / a), ("width",)),
    _Form("exp(-{0} / {1})", lambda z, a: np.exp((z.min() - z) / a), ("width",)),
    _Form("|{0}|^{1}", lambda z, p: np.abs(z) ** p, ("exponent",)),
    _Form("sign({0}) |{0}|^{1}", lambda z, p: np.sign(z) * np.abs(z) ** p, ("exponent",)),
    _Form("sin({1} {0})", lambda z, k: np.sin(k * z), ("wavenumber",)),
    _Form(
        "exp(-(({0} - {1}) / {2})^2)",
        lambda z, c, a: np.exp(-(((z - c) / a) ** 2)),
        ("centre", "width"),
    ),
    _Form(
        "1 / (1 + exp(-({0} - {1}) / {2}))",
        lambda z, c, a: 0.5 * (1.0 + np.tanh(0.5 * (z - c) / a)),
        ("centre", "width"),
    ),
)


class Expression(Effect):
    """A form in the place of a shape, as a function of the same argument."""

    kind = "expression"

    def __init__(self, form: _Form, shape: UnknownFunction):
        self.form = form
        self.shape = shape

    def places(self, records: Records) -> Sequence[Place]:
        return self.shape.places(records)

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        z = self.shape.points(records)[:, 0]
        values = {
            "width": np.geomspace(0.01, 1.0, 12) * spread(z),
            "exponent": np.linspace(0.25, 4.0, 16),
            "wavenumber": np.geomspace(np.pi, 12.0 * np.pi, 24) / spread(z),
            "centre": quantile_levels(z, 0.05, 0.95, 10),
        }
        return tuple(Parameter(name, values[name]) for name in self.form.parameters)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        shape = self.shape
        return (self.form.law(shape.points(records)[:, 0], *theta) * shape.factor(records))[:, None]


def formulas(base: CandidateContext, term: PlacedEffect) -> tuple[Formula, ...]:
    """Formulas of a shape beside a fit without it, the best for its parameters first."""
    shape = term.effect
    if not isinstance(shape, UnknownFunction) or shape.n_arguments > 1:
        return ()
    base = replace(base, kept={})
    own = _of_the_place(base, term, shape)
    effects = [Expression(form, shape) for form in FORMS]
    trials = [trial for effect in effects for trial in _of_the_place(base, term, effect)]
    if not own or not trials:
        return ()
    level = base.level_with(own[0], trials)
    behind = (base.gains(own) - base.gains(trials)).sum(axis=1)
    a_parameter = 0.5 * np.log(len(base.data.rows))
    order = sorted(
        range(len(trials)),
        key=lambda place: behind[place] + a_parameter * trials[place].candidate.n_parameters,
    )
    names = base.records.names
    least = _error(base, own[0])
    return tuple(
        _formula(trials[place], names, _error(base, trials[place]) / least, place in level)
        for place in order
    )


def _of_the_place(base: CandidateContext, term: PlacedEffect, effect: Effect) -> list[Trial]:
    """The refined trial of an effect in the equation and mode of a term."""
    return [
        refined(base, trial)
        for trial in scan(base, effect)
        if (trial.candidate.target, trial.candidate.mode) == (term.target, term.mode)
    ]


def _error(base: CandidateContext, trial: Trial) -> float:
    """Root mean square error of rows that the trial has not seen, outliers aside."""
    left = base.held_out[:, trial.candidate.target] - trial.change
    return float(np.sqrt(np.average(left**2, weights=base.regression.weight)))


def _formula(trial: Trial, names: Sequence[str], error: float, ties: bool) -> Formula:
    effect, theta = trial.candidate.effect, trial.candidate.theta
    assert isinstance(effect, Expression)
    (name,) = effect.shape.arguments(names)
    text = effect.form.text.format(f"({name})" if " " in name else name, *map(figure, theta))
    if effect.shape.reference is not None:
        factor = names[effect.shape.channels[1]]
        text = factor + (text[1:] if text.startswith("1 /") else f" {text}")
    return Formula(text, dict(zip(effect.form.parameters, theta, strict=True)), error, ties)


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
        along = np.linspace(arguments.min(), arguments.max(), _POINTS)[:, None]
    else:
        along = np.array(effect.knots)
    basis = effect.basis(along)
    contribution = basis @ _beyond_the_law(fit, place, seen)
    deviation = deviations(basis, covariance) if len(covariance) else np.zeros(len(along))
    columns = dict(zip(effect.arguments(records.names), along.T, strict=True))
    return {**columns, "contribution": contribution, "half_width": NORMAL_QUANTILE * deviation}


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
    order, where = Stretches.of(records)
    left = (targets - fit.predict(records))[order, target]
    force, deviation = coloured(left, where).course(left, where)
    return {
        "trajectory": where.stretch.astype(float),
        "t": where.t,
        "contribution": force,
        "half_width": NORMAL_QUANTILE * deviation,
    }
