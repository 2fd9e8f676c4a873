"""Whether there is a guard: does the state say which mode is active."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import softmax
from sklearn.base import clone
from sklearn.model_selection import StratifiedKFold

from swsysid._data.rows import spread_rows
from swsysid._identification.calibration import calibrate
from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._results import Array
from swsysid._surfaces.surface import fit_weighted, offers_penalty

__all__ = ["GuardCheck", "check_guard"]


@dataclass(frozen=True)
class GuardSettings:
    """Which samples judge a guard, and what they must show.

    Attributes
    ----------
    doubt : float
        The residuals of a sample decide its mode if the odds against it are below this.
    n_neighbours, n_agreeing : int
        The neighbours predict the mode of a sample if so many of so many share it.
    fewest : int
        Fewer decided samples of the smallest mode, or contradictions, allow no judgement.
    n_folds : int
        Of a flexible classifier, which has learned the modes of its own samples by heart.
    most_rows : int
        More decided samples say no more.
    n_iterations : int
        For the shares of the modes.
    tolerated : float
        Samples that contradict the state, as a share of the decided ones: a fitted surface that
        is a little off leaves about a thousandth.
    """

    doubt: float = float(np.exp(-4.0))
    n_neighbours: int = 10
    n_agreeing: int = 3
    fewest: int = 5
    n_folds: int = 3
    most_rows: int = 3000
    n_iterations: int = 10
    tolerated: float = 0.0075


_SETTINGS = GuardSettings()


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
        return excess > _SETTINGS.tolerated and excess * self.n_decided > _SETTINGS.fewest


def check_guard(problem: SwitchingProblem, coef: Array, modes: Modes, surface: Any) -> GuardCheck:
    r"""Compare what the residuals say about the modes with what the state says.

    The labels of the joint assignment follow the surface, so they cannot judge it. Here a sample
    counts if its residuals alone decide its mode: with residuals :math:`r_{ij}` in units of their
    scale, whose sizes are nats of the joint objective, and the shares :math:`\pi_j` of the modes,

    .. math:: p_{ij} \propto \pi_j \exp(-\| r_{ij} \|_1), \qquad \max_j p_{ij} \ge 1 - e^{-4} .

    Normal noise would decide more: where vector fields leave something over, squares of many
    scales call samples decided that are not.

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
    decided = np.flatnonzero((doubt <= _SETTINGS.doubt) & ~problem.outlying)
    if len(decided) > _SETTINGS.most_rows:
        decided = decided[spread_rows(len(decided), _SETTINGS.most_rows)]
    labels, weight = probability[decided].argmax(axis=1), problem.weight[decided]
    if np.bincount(labels, minlength=problem.n_modes).min() < _SETTINGS.fewest:
        return GuardCheck(np.nan, 0.0, 0.0, len(decided))
    points = problem.coordinates[decided]
    missed = _surface_modes(surface, points, labels, weight) != labels
    missed_shares = np.bincount(labels, weight * missed) / np.bincount(labels, weight)
    contradicted = missed & ~_agrees_with_neighbours(points, labels)
    return GuardCheck(
        score=1.0 - float(np.mean(missed_shares)),
        contradicted=float(weight @ contradicted / weight.sum()),
        expected=float(weight @ doubt[decided] / weight.sum()),
        n_decided=len(decided),
    )


def _mode_probabilities(problem: SwitchingProblem, coef: Array) -> Array:
    """Posterior of the modes given the residuals, (n_samples, n_modes); their shares by EM."""
    residuals = (problem.targets - problem.velocities(coef)) / problem.scale
    log_density = -np.abs(residuals).sum(axis=2).T
    weight = problem.informative_weight / problem.informative_weight.sum()
    shares = np.full(problem.n_modes, 1.0 / problem.n_modes)
    for _ in range(_SETTINGS.n_iterations):
        probability: Array = softmax(log_density + np.log(shares), axis=1)
        shares = np.maximum(weight @ probability, 1e-6)
    return probability


def _surface_modes(surface: Any, points: Array, labels: Modes, weight: Array) -> Modes:
    """Modes by the surface: held out, unless it is as stiff as a polynomial of the margin LP."""
    if offers_penalty(surface):
        return np.asarray(surface.predict(points))
    predicted = np.empty_like(labels)
    for train, test in StratifiedKFold(_SETTINGS.n_folds).split(points, labels):
        fitted = fit_weighted(clone(surface), points[train], labels[train], weight[train])
        predicted[test] = fitted.predict(points[test])
    return predicted


def _agrees_with_neighbours(points: Array, labels: Modes):
    """True for the rows that share their label with some of their neighbours, (n_rows,)."""
    spread = points.std(axis=0)
    standardised = points / np.where(spread > 0, spread, 1.0)
    # a row is among its own neighbours
    count = min(_SETTINGS.n_neighbours + 1, len(points))
    _, neighbours = cKDTree(standardised).query(standardised, count)
    agreeing = (labels[neighbours] == labels[:, None]).sum(axis=1) - 1
    return agreeing >= _SETTINGS.n_agreeing
