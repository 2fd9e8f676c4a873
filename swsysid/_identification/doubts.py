"""What may be wrong with a fit, first of all its guard, and what a user is told of it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree
from scipy.special import softmax
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.model_selection import StratifiedKFold

from swsysid._checks.estimators import column_names
from swsysid._data.rows import spread_rows
from swsysid._identification.identify import Answer, Identification
from swsysid._identification.problem import Modes, SwitchingProblem, calibrate
from swsysid._identification.settings import GuardSettings, Parameters
from swsysid._identification.setup import TrainingRows
from swsysid._results import Array, GuardWarning, IdentificationWarning, MisfitWarning, Status
from swsysid._seeding.designs import centre_and_scale
from swsysid._seeding.misfit import Misfit, MissingConstant, missing_constant, shared_residual
from swsysid._surfaces.surface import Classifier, fit_weighted, offers_penalty


@dataclass(frozen=True)
class GuardCheck:
    """How well the state predicts the modes that the residuals decide by themselves."""

    # Share of the decided samples of a mode that the surface gives to it, averaged over the modes;
    # NaN without a judgement.
    score: float
    # Share of the decided samples whose mode neither the surface nor their neighbours have.
    contradicted: float
    expected: float  # share that the residuals are expected to have decided wrongly
    n_decided: int
    missing: bool = False  # True if the switching is not a function of the state


def check_guard(
    problem: SwitchingProblem, coef: Array, modes: Modes, surface: Classifier
) -> GuardCheck:
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
    problem, settings = calibrate(problem, coef, modes), problem.settings.guard
    probability = _mode_probabilities(problem, coef)
    doubt = 1.0 - probability.max(axis=1)
    decided = np.flatnonzero((doubt <= settings.doubt) & ~problem.outlying)
    if len(decided) > settings.most_rows:
        decided = decided[spread_rows(len(decided), settings.most_rows)]
    labels, weight = probability[decided].argmax(axis=1), problem.weight[decided]
    if np.bincount(labels, minlength=problem.n_modes).min() < settings.fewest:
        return GuardCheck(np.nan, 0.0, 0.0, len(decided))
    points = problem.coordinates[decided]
    missed = _surface_modes(surface, points, labels, weight, settings.n_folds) != labels
    missed_shares = np.bincount(labels, weight * missed) / np.bincount(labels, weight)
    both = missed & ~_agrees_with_neighbours(points, labels, settings)
    contradicted, expected = (float(weight @ x / weight.sum()) for x in (both, doubt[decided]))
    excess = contradicted - expected
    missing = excess > settings.tolerated and excess * len(decided) > settings.fewest
    score = 1.0 - float(np.mean(missed_shares))
    return GuardCheck(score, contradicted, expected, len(decided), missing)


def _mode_probabilities(problem: SwitchingProblem, coef: Array) -> Array:
    """Posterior of the modes given the residuals, (n_samples, n_modes); their shares by EM."""
    residuals = (problem.targets - problem.velocities(coef)) / problem.scale
    log_density = -np.abs(residuals).sum(axis=2).T
    weight = problem.informative_weight / problem.informative_weight.sum()
    shares = np.full(problem.n_modes, 1.0 / problem.n_modes)
    for _ in range(problem.settings.guard.n_iterations):
        probability: Array = softmax(log_density + np.log(shares), axis=1)
        shares = np.maximum(weight @ probability, 1e-6)
    return probability


def _surface_modes(
    surface: Classifier, points: Array, labels: Modes, weight: Array, n_folds: int
) -> Modes:
    """Modes by the surface: held out, unless it is as stiff as a polynomial of the margin LP."""
    if offers_penalty(surface):
        return np.asarray(surface.predict(points))
    predicted = np.empty_like(labels)
    for train, test in StratifiedKFold(n_folds).split(points, labels):
        fitted = fit_weighted(clone(surface), points[train], labels[train], weight[train])
        predicted[test] = fitted.predict(points[test])
    return predicted


def _agrees_with_neighbours(points: Array, labels: Modes, settings: GuardSettings):
    """True for the rows that share their label with some of their neighbours, (n_rows,)."""
    spread = points.std(axis=0)
    standardised = points / np.where(spread > 0, spread, 1.0)
    # a row is among its own neighbours
    count = min(settings.n_neighbours + 1, len(points))
    _, neighbours = cKDTree(standardised).query(standardised, count)
    agreeing = (labels[neighbours] == labels[:, None]).sum(axis=1) - 1
    return agreeing >= settings.n_agreeing


# Frames between `warnings.warn` and the user's call of `fit`.
_STACK_LEVEL = 4


@dataclass(frozen=True)
class Doubts:
    """What may be wrong with an answer, whatever its objective says."""

    guard: GuardCheck
    shared: Misfit  # what neighbouring samples share of their residuals
    # None where none helps, where the user chose the library, or where states are missing in `X`.
    constant: MissingConstant | None


def examine(answer: Answer, rows: TrainingRows, *, default_library: bool) -> Doubts:
    """Ask whether the state says the mode, whether neighbours share residuals, or a constant."""
    found, problem, modes = answer.found, answer.found.problem, answer.found.best.modes
    coef, distinct = found.best.coef, rows.distinct
    centre, scale = centre_and_scale(problem.coordinates, problem.weight)
    shared = shared_residual(
        (problem.coordinates - centre) / scale,
        problem.residuals(coef, modes),
        problem.targets.std(axis=0),
        modes,
        distinct.arrays[2],
        distinct.first,
        problem.settings.misfit,
    )
    constant = None
    if default_library and problem.targets.shape[1] <= problem.coordinates.shape[1]:
        inlying = problem.informative_weight
        constant = missing_constant(
            problem.features, problem.targets, modes, inlying, problem.settings.misfit
        )
    return Doubts(check_guard(problem, coef, modes, answer.surface), shared, constant)


def warn_about(estimator: Parameters, answer: Answer, doubts: Doubts) -> None:
    """Warn if the data do not determine the answer, or if it is not converged or not stable."""
    names = column_names(estimator)
    for category, message in (
        *_undetermined(answer.found),
        *_open(estimator, answer.found),
        *_unsure(answer, estimator.max_iter),
        *_misfit(estimator, answer.found, doubts, names),
        *_guardless(doubts.guard),
    ):
        warnings.warn(message, category, stacklevel=_STACK_LEVEL)


Warned = Iterator[tuple[type[Warning], str]]


def _undetermined(found: Identification) -> Warned:
    n_modes, _, n_features = found.best.coef.shape
    n_rows, n_unknowns = len(found.problem.weight), found.n_modes_asked * n_features
    if n_rows < n_unknowns:
        yield (
            IdentificationWarning,
            f"{n_rows} distinct samples for {n_unknowns} unknown coefficients of each state: the "
            "coefficients of smallest norm were chosen; measure more or use a smaller "
            "feature_library.",
        )
    if n_modes < found.n_modes_asked:
        yield (
            IdentificationWarning,
            f"Only {n_modes} of {found.n_modes_asked} modes explain any sample, and the "
            "others were dropped; use a smaller n_modes.",
        )


def _open(estimator: Parameters, found: Identification) -> Warned:
    """Where there may be more modes than were tried."""
    n_modes = len(found.best.coef)
    if len(found.candidates) == estimator.max_modes == n_modes > 1:
        yield (
            IdentificationWarning,
            f'n_modes="auto" found max_modes={n_modes} modes, the most that it tries: there may be '
            "more; raise max_modes.",
        )


def _unsure(answer: Answer, max_iter: int) -> Warned:
    found = answer.found
    if answer.stalled:
        yield (
            ConvergenceWarning,
            "The passes over all rows could not improve the answer of a sample: a few rows far "
            "from the others decide; leave them out, or use a smaller feature_library or a smaller "
            "degree.",
        )
    elif not found.best.converged:
        yield (
            ConvergenceWarning,
            f"The alternation stopped after max_iter={max_iter} iterations. "
            f"{Status.ITERATION_LIMIT.advice}",
        )
    if found.has_low_hit_rate:
        yield (
            ConvergenceWarning,
            f"The best answer was found by only {found.hits} of {found.n_starts} starts: a better "
            "one may exist; increase n_init, measure more, or use a smaller feature_library.",
        )
    if found.has_rival:
        yield (
            ConvergenceWarning,
            "The answer is not stable: another partition of the samples into modes explains them "
            f"as well (log likelihood {found.log_likelihood_gap:.1f} lower); measure more, above "
            "all of the rarer mode, with less noise, or use a smaller feature_library or degree.",
        )


def _misfit(
    estimator: Parameters, found: Identification, doubts: Doubts, names: Sequence[str]
) -> Warned:
    """The strongest finding about what the model leaves over."""
    # One mode is often fitted for comparison, a start of the user's own may lead anywhere, and
    # bounded coefficients leave something over: nothing is said of these.
    n_modes, constant, shared = len(found.best.coef), doubts.constant, doubts.shared
    searched = isinstance(estimator.init, str) and estimator.init == "auto"
    if not searched or estimator.coef_bound is not None or n_modes == 1:
        return
    if constant is not None:
        yield (
            MisfitWarning,
            f"A constant would explain {constant.share:.0%} of the squared residuals of "
            f"{names[constant.output]}' in mode {constant.mode}, and the library has "
            "none: use feature_library=1 (a constant and the columns of X).",
        )
    elif found.smooth_degree is not None:
        yield (
            MisfitWarning,
            f"One law with all monomials up to degree {found.smooth_degree} predicts held-out "
            f"samples better than {n_modes} modes: they may only tile a smooth term "
            "that the library lacks; compare with n_modes=1, "
            f"feature_library={found.smooth_degree}.",
        )
    elif shared.structured:
        yield (
            MisfitWarning,
            f"Samples at neighbouring states share {shared.share:.0%} of the residuals of "
            f"{names[shared.output]}' (RMS {shared.size:.2g} of its standard deviation), "
            "so these are no noise: use a richer feature_library, more modes, or a larger n_init.",
        )


def _guardless(guard: GuardCheck) -> Warned:
    if guard.missing:
        yield (
            GuardWarning,
            f"Of {guard.n_decided} samples whose residuals decide their mode, "
            f"{guard.contradicted:.1%} lie where the surface and the neighbouring samples are in "
            "another mode: the switching is not a function of the state. Add what drives it (a "
            "time, an input) to X; if the state does drive it, raise the degree of the surface.",
        )
