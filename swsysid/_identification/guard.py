"""Whether there is a guard: does the state say which mode is active."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from sklearn.base import clone
from sklearn.model_selection import StratifiedKFold

from swsysid._data.rows import spread_rows
from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._identification.scale import calibrate
from swsysid._results import Array
from swsysid._surfaces.surface import fit_weighted, offers_penalty

__all__ = ["GuardCheck", "check_guard"]

# A sample's residuals decide its mode if the odds against it are below exp(-4).
_DOUBT = np.exp(-4.0)
_NEIGHBOURS, _AGREEING = 10, 3
# Fewer decided samples than this of the smallest mode allow no judgement.
_LEAST = 5
_FOLDS = 3
_MOST_ROWS = 3000
_PRIOR_ITERATIONS = 10
# Samples that contradict the state, as a share of the decided ones: a fitted surface that is a
# little off leaves about a thousandth.
_TOLERATED = 0.0075


@dataclass(frozen=True)
class GuardCheck:
    """How well the state predicts the modes that the residuals decide by themselves.

    Attributes
    ----------
    score : float
        Share of the decided samples of a mode that the surface gives to it, averaged over the
        modes; NaN without a judgement.
    contradicted : float
        Share of the decided samples whose mode neither the surface nor their neighbours have.
    expected : float
        Share that the residuals are expected to have decided wrongly.
    n_decided : int
    """

    score: float
    contradicted: float
    expected: float
    n_decided: int

    @property
    def missing(self) -> bool:
        """True if the switching is not a function of the state."""
        excess = self.contradicted - self.expected
        return bool(excess > _TOLERATED and excess * self.n_decided > _LEAST)


def check_guard(problem: SwitchingProblem, coef: Array, modes: Modes, surface: Any) -> GuardCheck:
    r"""Compare what the residuals say about the modes with what the state says.

    The labels of the joint assignment follow the surface, so they cannot judge it. Here a
    sample counts if its residuals alone decide its mode: with Laplace residuals :math:`r_{ij}`
    in units of their scale and the shares :math:`\pi_j` of the modes,

    .. math:: p_{ij} \propto \pi_j \exp(-\| r_{ij} \|_1), \qquad \max_j p_{ij} \ge 1 - e^{-4} .

    The state predicts its mode if the surface does, or if three of its ten nearest neighbours
    among the other decided samples share it: a surface of too low a degree is no proof that the
    state does not matter. Where both contradict the residuals, samples at almost the same
    state are in different modes.
    """
    if problem.n_modes == 1:
        return GuardCheck(np.nan, 0.0, 0.0, 0)
    problem = calibrate(problem, coef, modes)
    probability = _mode_probabilities(problem, coef)
    doubt = 1.0 - probability.max(axis=1)
    decided = np.flatnonzero((doubt <= _DOUBT) & ~problem.outlying)
    if len(decided) > _MOST_ROWS:
        decided = decided[spread_rows(len(decided), _MOST_ROWS)]
    labels, weight = probability[decided].argmax(axis=1), problem.weight[decided]
    if not len(decided) or np.bincount(labels, minlength=problem.n_modes).min() < _LEAST:
        return GuardCheck(np.nan, 0.0, 0.0, len(decided))
    points = problem.coordinates[decided]
    missed = _surface_modes(surface, points, labels, weight) != labels
    contradicted = missed.copy()
    contradicted[missed] = ~_near_one(points, labels, np.flatnonzero(missed))
    return GuardCheck(
        score=1.0 - float(np.mean(_share_of_each_mode(labels, weight, missed))),
        contradicted=float(weight @ contradicted / weight.sum()),
        expected=float(weight @ doubt[decided] / weight.sum()),
        n_decided=len(decided),
    )


def _mode_probabilities(problem: SwitchingProblem, coef: Array) -> Array:
    """Posterior of the modes given the residuals, (n_samples, n_modes); priors by EM."""
    scaled = np.abs(problem.targets - problem.velocities(coef)) / problem.scale
    misfit = scaled.sum(axis=2).T
    likelihood = np.exp(misfit.min(axis=1, keepdims=True) - misfit)
    shares = np.full(problem.n_modes, 1.0 / problem.n_modes)
    weight = problem.informative_weight / problem.informative_weight.sum()
    for _ in range(_PRIOR_ITERATIONS):
        probability: Array = likelihood * shares
        probability /= probability.sum(axis=1, keepdims=True)
        shares = np.maximum(weight @ probability, 1e-6)
    return probability


def _surface_modes(surface: Any, points: Array, labels: Modes, weight: Array) -> Modes:
    """Modes by the surface: held out, unless it is as stiff as a polynomial of the margin LP."""
    if offers_penalty(surface):
        predicted: Modes = surface.predict(points)
        return predicted
    predicted = np.empty_like(labels)
    for train, test in StratifiedKFold(_FOLDS).split(points, labels):
        fitted = fit_weighted(clone(surface), points[train], labels[train], weight[train])
        predicted[test] = fitted.predict(points[test])
    return predicted


def _share_of_each_mode(labels: Modes, weight: Array, chosen: NDArray[np.bool_]) -> Array:
    return np.bincount(labels, weight * chosen) / np.bincount(labels, weight)


def _near_one(points: Array, labels: Modes, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
    """True for the rows that share their label with some of their neighbours."""
    spread = points.std(axis=0)
    standardised = points / np.where(spread > 0, spread, 1.0)
    n_neighbours = min(_NEIGHBOURS, len(points) - 1)
    _, neighbours = cKDTree(standardised).query(standardised[rows], n_neighbours + 1)
    # A row is among its own neighbours and agrees with itself.
    agreeing = (labels[neighbours] == labels[rows, None]).sum(axis=1) - 1
    return agreeing >= _AGREEING
