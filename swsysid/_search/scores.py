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
from scipy.special import logsumexp

from swsysid._data.records import Records
from swsysid._noise import STUDENT, exact_below, robust_weights
from swsysid._results import Array
from swsysid._search.folds import Folds
from swsysid._search.joint_fit import JointFit, corrected
from swsysid._search.regression import Regression, Solution

__all__ = ["held_out_cost", "unseen_cost"]

_SURPRISE = 0.002  # probability that a surface is wrong where it is sure


def held_out_cost(
    fit: JointFit, records: Records, rows: NDArray[np.intp], targets: Array, folds: Folds
) -> Array:
    """Negative log likelihood of every row, from regressions that have not seen it."""
    errors = _errors_by_mode(fit, records, rows, targets, folds)
    own = errors[fit.modes, np.arange(len(rows))]
    cost = STUDENT.cost(errors, STUDENT.scale(own, exact_below(targets))).sum(axis=2)
    with np.errstate(divide="ignore"):
        prior = np.log(_mode_probabilities(fit, records, rows)).T
    return -logsumexp(prior - cost, axis=0)


def unseen_cost(
    fit: JointFit, records: Records, seen: tuple[NDArray, Array], unseen: tuple[NDArray, Array]
) -> Array:
    """Negative log likelihood of rows that no part of a fit has seen, its surface neither.

    `seen` and `unseen` are rows of the record and their targets; the fit is to the former.
    """
    velocities = fit.mode_velocities(records)
    (rows, targets), (new_rows, new_targets) = seen, unseen
    scale = STUDENT.scale(targets - velocities[fit.modes, rows], exact_below(targets))
    cost = STUDENT.cost(new_targets - velocities[:, new_rows], scale).sum(axis=2)
    prior = np.log(_surface_probabilities(fit, records, new_rows)).T
    return -logsumexp(prior - cost, axis=0)


def _mode_probabilities(fit: JointFit, records: Records, rows: NDArray[np.intp]) -> Array:
    """What the surface, or a guard that remembers, says of the modes, (n_rows, n_modes)."""
    if any(term.effect.remembers for term in fit.terms):
        modes = fit.predict_modes(records)
        wrong = _doubt(records, rows, modes, fit.modes)[:, None]
        return _softened(np.eye(fit.n_modes)[modes[rows]], wrong)
    return _surface_probabilities(fit, records, rows)


def _surface_probabilities(fit: JointFit, records: Records, rows: NDArray[np.intp]) -> Array:
    return _softened(fit.mode_proba(records.take(rows)), _SURPRISE)


def _softened(told: Array, wrong: Array | float) -> Array:
    """Probabilities of the modes if what is told of them is wrong now and then."""
    return (1.0 - wrong) * told + wrong / told.shape[1]


def _doubt(records: Records, rows: NDArray[np.intp], modes: NDArray, own: NDArray) -> Array:
    """How often a guard that remembers is wrong, next to its switches and away from them."""
    near = records.along(_next_to_a_switch, modes)[rows] > 0
    wrong = np.empty(len(rows))
    for group in (near, ~near):
        if group.any():
            share = np.mean(modes[rows][group] != own[group])
            wrong[group] = np.clip(2.0 * share, _SURPRISE, 1.0)
    return wrong


def _next_to_a_switch(t: Array, modes: Array) -> Array:
    """1 within two samples of a change of the mode."""
    changed = np.concatenate([[False], modes[1:] != modes[:-1]])
    places = np.flatnonzero(changed)[:, None] + np.arange(-2, 2)
    near = np.zeros(len(modes))
    near[np.clip(places, 0, len(modes) - 1)] = 1.0
    return near


def _errors_by_mode(fit, records, rows, targets, folds) -> Array:
    """Held-out errors of every row in every mode, (n_modes, n_rows, n_states)."""
    seen = corrected(fit.terms, records)
    modes = fit.predict_modes(records)
    modes[rows] = fit.modes
    regression = Regression(
        features=fit.features(seen)[rows],
        targets=targets,
        modes=fit.modes,
        n_modes=fit.n_modes,
        weight=robust_weights(targets - fit.predict(records, modes)[rows], exact_below(targets)),
        folds=folds,
    )
    errors = np.empty((fit.n_modes, *targets.shape))
    acting = {
        target: [term for term in fit.terms if term.target == target and term.effect.terms]
        for target in range(targets.shape[1])
    }
    for target, terms in acting.items():
        columns = [term.effect.columns(seen, term.place, *term.theta)[rows] for term in terms]
        _add_terms(errors, regression, target, terms, columns)
    return errors


def _add_terms(errors: Array, regression: Regression, target: int, terms, columns) -> None:
    """Errors of one state with its effects beside the library, in place."""
    n_modes, everyone = regression.n_modes, np.ones(len(regression.modes), dtype=np.intp)

    def design(modes):
        parts = [
            term.design(part, modes, n_modes) for term, part in zip(terms, columns, strict=True)
        ]
        return np.column_stack(parts)

    here = design(regression.modes) if terms else None
    for fold, (_, test) in enumerate(regression.folds.parts):
        background = regression.background(fold)
        left = regression.targets[:, [target]]
        coef = None
        if here is not None:
            gram, moment, size, _ = background.normal_equations(here[:, None, :])
            solved = Solution.of(gram.sum(axis=0), moment.sum(axis=0), size.sum(axis=0))
            coef = solved.coef[0, :, target]
            left = left - (here @ coef)[:, None]
        library = background.coefficients(left)
        for mode in range(n_modes):
            error = regression.targets[test, target]
            error = error - (regression.features[test] @ library[mode])[:, 0]
            if coef is not None:
                error = error - (design(mode * everyone) @ coef)[test]
            errors[mode, test, target] = error
