"""A short list of formulas for a function without a name: the usual expressions of the field.

Each is fitted and judged as every other candidate, on the same folds, in the place of the shape.
One is claimed only if its held-out error is within a standard error of that of the shape.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swsysid._data.records import Records
from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.scan import refined, scan
from swsysid._results import Array
from swsysid.effects import Effect, Formula, Parameter, PlacedEffect, UnknownFunction
from swsysid.effects._base import Place, figure, quantile_levels, spread


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


def formulas(beside: CandidateContext, term: PlacedEffect) -> tuple[Formula, ...]:
    """Formulas of a shape beside a fit without it, the best for its parameters first."""
    shape = term.effect
    if not isinstance(shape, UnknownFunction) or shape.n_arguments > 1:
        return ()
    beside = replace(beside, kept={})
    own = _of_the_place(beside, term, shape)
    effects = [Expression(form, shape) for form in FORMS]
    trials = [trial for effect in effects for trial in _of_the_place(beside, term, effect)]
    if not own or not trials:
        return ()
    level = beside.level_with(own[0], trials)
    behind = (beside.gains(own) - beside.gains(trials)).sum(axis=1)
    a_parameter = 0.5 * np.log(len(beside.data.rows))
    order = sorted(
        range(len(trials)),
        key=lambda place: behind[place] + a_parameter * trials[place].candidate.n_parameters,
    )
    names = beside.records.names
    least = _error(beside, own[0])
    return tuple(
        _told(trials[place], names, _error(beside, trials[place]) / least, place in level)
        for place in order
    )


def _of_the_place(beside: CandidateContext, term: PlacedEffect, effect: Effect) -> list[Trial]:
    """The refined trial of an effect in the equation and mode of a term."""
    return [
        refined(beside, trial)
        for trial in scan(beside, effect)
        if (trial.candidate.target, trial.candidate.mode) == (term.target, term.mode)
    ]


def _error(beside: CandidateContext, trial: Trial) -> float:
    """Root mean square error of rows that the trial has not seen, outliers aside."""
    left = beside.held_out[:, trial.candidate.target] - trial.change
    return float(np.sqrt(np.average(left**2, weights=beside.regression.weight)))


def _told(trial: Trial, names: Sequence[str], error: float, ties: bool) -> Formula:
    effect, theta = trial.candidate.effect, trial.candidate.theta
    assert isinstance(effect, Expression)
    (name,) = effect.shape.arguments(names)
    text = effect.form.text.format(f"({name})" if " " in name else name, *map(figure, theta))
    if effect.shape.reference is not None:
        factor = names[effect.shape.channels[1]]
        text = factor + (text[1:] if text.startswith("1 /") else f" {text}")
    return Formula(text, dict(zip(effect.form.parameters, theta, strict=True)), error, ties)
