r"""What a structure is worth: how well it predicts rows that its regressions have not seen.

The mode of a row is what the surface says, which next to the surface is not sure: the likelihood
of a row is the mixture

.. math:: p(\dot x \mid x) = \sum_j p_j(x) \prod_k t_4\bigl((\dot x_k - f_{jk}(x)) / s_k\bigr) / s_k

with the surface's probabilities p_j and Student-t errors. Modes that no surface can tell apart
are then worth nothing, and one row on the wrong side of the surface costs little.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.regression import Regression
from swsysid._noise import STUDENT, exact_below, robust_weights
from swsysid._results import Array
from swsysid.effects import PlacedEffect
from swsysid.effects._placed import corrected

__all__ = ["held_out_cost", "unseen_cost"]

Rows = NDArray[np.intp]
Modes = NDArray[np.intp]


def held_out_cost(fit: JointFit, data: SearchData) -> Array:
    """Negative log likelihood of every row, from regressions that have not seen it."""
    errors = _errors_by_mode(fit, data)
    own = errors[fit.modes, np.arange(len(data.rows))]
    return _mixture_cost(errors, STUDENT.scale(own, data.exact), _mode_probabilities(fit, data))


def unseen_cost(fit: JointFit, data: SearchData, train: Rows, test: Rows) -> Array:
    """Negative log likelihood of rows that no part of a fit to others has seen.

    `train` and `test` are numbers among the rows of the search.
    """
    velocities = fit.mode_velocities(data.records)
    rows, targets = data.rows[train], data.targets[train]
    scale = STUDENT.scale(targets - velocities[fit.modes, rows], exact_below(targets))
    errors = data.targets[test] - velocities[:, data.rows[test]]
    told = fit.mode_proba(data.records.take(data.rows[test]))
    return _mixture_cost(errors, scale, _softened(told, data.settings.surprise))


def _mixture_cost(errors: Array, scale: Array, probabilities: Array) -> Array:
    """Of errors (n_modes, n_rows, n_states) and probabilities (n_rows, n_modes)."""
    cost = STUDENT.cost(errors, scale).sum(axis=2)
    with np.errstate(divide="ignore"):
        prior = np.log(probabilities).T
    return np.asarray(-logsumexp(prior - cost, axis=0))


# -- probabilities of the modes --------------------------------------------------------------------


def _mode_probabilities(fit: JointFit, data: SearchData) -> Array:
    """What the surface, or a guard that remembers, says of the modes, (n_rows, n_modes)."""
    surprise = data.settings.surprise
    if fit.guard is None:
        return _softened(fit.mode_proba(data.records.take(data.rows)), surprise)
    modes = fit.predict_modes(data.records)
    near = data.records.along(_next_to_a_switch, modes.astype(float))[data.rows] > 0
    predicted, wrong = modes[data.rows], np.empty(len(data.rows))
    for group in (near, ~near):  # a guard that remembers is wrong next to its switches
        if group.any():
            share = np.mean(predicted[group] != fit.modes[group])
            wrong[group] = np.clip(2.0 * share, surprise, 1.0)
    return _softened(np.eye(fit.n_modes)[predicted], wrong[:, None])


def _softened(told: Array, wrong: Array | float) -> Array:
    """Probabilities of the modes if what is told of them is wrong now and then."""
    return np.asarray((1.0 - wrong) * told + wrong / told.shape[1])


def _next_to_a_switch(t: Array, modes: Array) -> Array:
    """1 within two samples of a change of the mode."""
    changed = np.concatenate([[False], modes[1:] != modes[:-1]])
    places = np.flatnonzero(changed)[:, None] + np.arange(-2, 2)
    near = np.zeros(len(modes))
    near[np.clip(places, 0, len(modes) - 1)] = 1.0
    return near


# -- errors ----------------------------------------------------------------------------------------


def _errors_by_mode(fit: JointFit, data: SearchData) -> Array:
    """Held-out errors of every row in every mode, (n_modes, n_rows, n_states)."""
    seen = corrected(fit.terms, data.records)
    residuals = fit.residuals(data.records, data.rows, data.targets)
    regression = Regression(
        features=fit.features(seen)[data.rows],
        targets=data.targets,
        modes=fit.modes,
        n_modes=fit.n_modes,
        weight=robust_weights(residuals, data.exact),
        folds=data.folds,
    )
    errors = np.empty((fit.n_modes, *data.targets.shape))
    for target in range(data.targets.shape[1]):
        terms = [term for term in fit.terms if term.target == target and term.effect.terms]
        errors[:, :, target] = _errors_of_state(regression, target, terms, seen, data.rows)
    return errors


def _errors_of_state(
    regression: Regression, target: int, terms: Sequence[PlacedEffect], seen: Records, rows: Rows
) -> Array:
    """Held-out errors of one state with its effects beside the library, (n_modes, n_rows)."""
    n_modes, n_rows = regression.n_modes, len(rows)
    columns = [term.columns(seen)[rows] for term in terms]

    def design(modes: Modes) -> Array:
        parts = [
            term.design(part, modes, n_modes) for term, part in zip(terms, columns, strict=True)
        ]
        return np.column_stack([np.empty((n_rows, 0)), *parts])

    here = design(regression.modes)
    in_mode = [design(np.full(n_rows, mode)) for mode in range(n_modes)]
    errors, values = np.empty((n_modes, n_rows)), regression.targets[:, target]
    for fold, (_, test) in enumerate(regression.folds.parts):
        background = regression.background(fold)
        coef = np.zeros(0)
        if terms:
            coef = background.normal_equations(here[:, None, :]).solve(None).coef[0, :, target]
        library = background.coefficients((values - here @ coef)[:, None])
        for mode in range(n_modes):
            predicted = regression.features[test] @ library[mode][:, 0]
            errors[mode, test] = values[test] - predicted - in_mode[mode][test] @ coef
    return errors
