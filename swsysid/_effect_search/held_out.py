r"""What a structure is worth: how well it predicts rows that its regressions have not seen.

The mode of a row is what the surface says, which next to the surface is not sure: the likelihood
of a row is the mixture

.. math:: p(\dot x \mid x) = \sum_j p_j(x) \prod_k t_4\bigl((\dot x_k - f_{jk}(x)) / s_k\bigr) / s_k

with the surface's probabilities p_j and Student-t errors. Modes that no surface can tell apart
are then worth nothing, and one row on the wrong side of the surface costs little.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.special import logsumexp

from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.regression import Regression
from swsysid._effect_search.settings import SETTINGS
from swsysid._journal import step
from swsysid._noise import STUDENT, exact_below, robust_weights
from swsysid._results import Array
from swsysid.effects import PlacedEffect
from swsysid.effects._placed import corrected

Rows = NDArray[np.intp]


@step
def held_out_cost(fit: JointFit, data: SearchData) -> Array:
    """Negative log likelihood of every row, from regressions that have not seen it."""
    errors = _errors_by_mode(fit, data)
    own = errors[fit.modes, np.arange(len(data.rows))]
    return _mixture_cost(errors, STUDENT.scale(own, data.exact), _mode_probabilities(fit, data))


def held_out_errors(fit: JointFit, data: SearchData) -> Array:
    """Errors of every row in its mode, (n_rows, n_states), of regressions that have not seen it."""
    return _errors_by_mode(fit, data)[fit.modes, np.arange(len(data.rows))]


def unseen_cost(fit: JointFit, data: SearchData, train: Rows, test: Rows) -> Array:
    """Negative log likelihood of rows that no part of a fit to others has seen."""
    # `train` and `test` are numbers among the rows of the search.
    velocities = fit.mode_velocities(data.records)
    rows, targets = data.rows[train], data.targets[train]
    scale = STUDENT.scale(targets - velocities[fit.modes, rows], exact_below(targets))
    errors = data.targets[test] - velocities[:, data.rows[test]]
    probabilities = fit.mode_proba(data.records.take(data.rows[test]))
    return _mixture_cost(errors, scale, _softened(probabilities, SETTINGS.surprise))


def _mixture_cost(errors: Array, scale: Array, probabilities: Array) -> Array:
    """Of errors (n_modes, n_rows, n_states) and probabilities (n_rows, n_modes)."""
    cost = STUDENT.cost(errors, scale).sum(axis=2)
    with np.errstate(divide="ignore"):
        prior = np.log(probabilities).T
    return np.asarray(-logsumexp(prior - cost, axis=0))


# -- probabilities of the modes --------------------------------------------------------------------


def _mode_probabilities(fit: JointFit, data: SearchData) -> Array:
    """What the surface, or a guard that remembers, says of the modes, (n_rows, n_modes)."""
    surprise = SETTINGS.surprise
    if fit.guard is None:
        return _softened(fit.mode_proba(data.records.take(data.rows)), surprise)
    return _of_a_sure_guard(fit, data)


def _of_a_sure_guard(fit: JointFit, data: SearchData) -> Array:
    """Probabilities by a guard that remembers, which is wrong next to its switches."""
    modes = fit.predict_modes(data.records)
    near = data.records.along(_next_to_a_switch, modes.astype(float))[data.rows] > 0
    predicted, wrong = modes[data.rows], np.empty(len(data.rows))
    for group in (near, ~near):
        if group.any():
            share = np.mean(predicted[group] != fit.modes[group])
            wrong[group] = np.clip(2.0 * share, SETTINGS.surprise, 1.0)
    return _softened(np.eye(fit.n_modes)[predicted], wrong[:, None])


def _softened(probabilities: Array, wrong: Array | float) -> Array:
    """Probabilities of the modes if what is told of them is wrong now and then."""
    return np.asarray((1.0 - wrong) * probabilities + wrong / probabilities.shape[1])


def _next_to_a_switch(t: Array, modes: Array) -> Array:
    """1 within two samples of a change of the mode."""
    near_rows = np.flatnonzero(np.diff(modes, prepend=modes[:1]))[:, None] + np.arange(-2, 2)
    near = np.zeros(len(modes))
    near[np.clip(near_rows, 0, len(modes) - 1)] = 1.0
    return near


# -- errors ----------------------------------------------------------------------------------------


def _errors_by_mode(fit: JointFit, data: SearchData) -> Array:
    """Held-out errors of every row in every mode, (n_modes, n_rows, n_states)."""
    seen = corrected(fit.terms, data.records)
    targets = fit.on_time(data.records, data.rows, data.targets)
    regression = Regression(
        features=fit.features(seen, data.rows),
        targets=targets,
        modes=fit.modes,
        n_modes=fit.n_modes,
        weight=robust_weights(fit.residuals(data.records, data.rows, data.targets), data.exact),
        folds=data.folds,
        support=fit.laws.support,
    )
    folds = [(regression.background(fold), test) for fold, (_, test) in enumerate(data.folds.parts)]
    modes, errors = range(fit.n_modes), np.empty((fit.n_modes, *targets.shape))
    for target, values in enumerate(targets.T):
        terms = [term for term in fit.terms if term.target == target and term.effect.terms]
        columns = [(term, term.columns(seen, data.rows)) for term in terms]
        here = _design(columns, fit.modes, fit.n_modes)
        prior = block_diag(*(term.prior(fit.n_modes) for term in terms))
        in_mode = [_design(columns, np.full_like(fit.modes, mode), fit.n_modes) for mode in modes]
        for background, test in folds:
            coef = np.zeros(0)
            if terms:
                equations = background.normal_equations(here[:, None, :], prior)
                coef = equations.solve(None).coef[0, 0, :, target]
            library = background.coefficients((values - here @ coef)[:, None], target)
            for mode in modes:
                predicted = regression.features[test] @ library[mode][:, 0]
                errors[mode, test, target] = values[test] - predicted - in_mode[mode][test] @ coef
    return errors


def _design(columns: list[tuple[PlacedEffect, Array]], modes: Rows, n_modes: int) -> Array:
    """Columns of the effects of one state if the rows have these modes."""
    parts = [term.design(part, modes, n_modes) for term, part in columns]
    return np.column_stack([np.empty((len(modes), 0)), *parts])
