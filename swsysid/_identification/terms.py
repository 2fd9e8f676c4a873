"""Which terms of the library a mode needs, and which monomials a surface needs.

Labels next to a surface of many monomials follow the surface, and the surface then follows them. A
surface of few monomials leaves less room for that, if they are the right ones. They are chosen by
what the velocities say, not by labels: `feature_relevance` gets log ratios of densities, which are
zero where modes cannot be told apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._identification.descent import AlternateFrom, Alternation
from swsysid._identification.problem import Modes, SwitchingProblem, log_densities
from swsysid._journal import step
from swsysid._noise import robust_scale
from swsysid._results import Array
from swsysid._surfaces.relevance import Relevance, feature_relevance
from swsysid._surfaces.surface import (
    Classifier,
    MarginClassifier,
    fit_weighted,
    option,
    solves_margin_program,
    takes_relevance,
)
from swsysid.relaxations._base import one_hot

# A coefficient whose whole contribution is below this fraction of the velocity is round-off.
_NEGLIGIBLE = 1e-9


@step
def choose_terms(
    problem: SwitchingProblem, best: Alternation, sparsity: float | str, descent: AlternateFrom
) -> tuple[SwitchingProblem, Alternation]:
    """Drop needless terms and descend again without them, until the choice repeats."""
    support = None
    for _ in range(problem.settings.most_choices):
        previous, support = support, sparse_support(problem, best.coef, best.modes, sparsity)
        if previous is not None and np.array_equal(support, previous):
            break
        problem = replace(problem, support=support)
        best = descent(problem, one_hot(best.modes, problem.n_modes))
    return problem, best


def sparse_support(
    problem: SwitchingProblem, coef: Array, modes: Modes, sparsity: float | str
) -> NDArray[np.bool_]:
    """Coefficients to keep, shape (n_modes, n_states, n_features_out)."""
    # A number removes the coefficients below it in size, refits, and repeats (sequential
    # thresholding). ``"auto"`` removes, one at a time, the least significant term of each equation
    # while its squared t-statistic is below 2 log(n), the point where a Bayesian information
    # criterion with a penalty for the choice among the terms prefers the smaller model.
    support = np.ones(coef.shape, dtype=bool)
    for mode in range(problem.n_modes):
        rows = np.flatnonzero((modes == mode) & (problem.informative_weight > 0))
        if len(rows) == 0:
            continue
        fit = _Refit(problem, rows, mode)
        for state in range(coef.shape[1]):
            automatic = sparsity == "auto"
            choice = fit.significant(state) if automatic else fit.large(state, float(sparsity))
            support[mode, state] = choice
    return support if problem.region is None else problem.region.closed(support)


def _middle(sizes: Array, weight: Array, n_left_out: int) -> Array:
    """The two middle ones of sizes that are repeated by weight, without the smallest ones."""
    order = np.argsort(sizes)
    ends = np.cumsum(np.maximum(np.rint(weight[order]), 1.0))
    first = min(float(n_left_out), ends[-1] - 1.0)
    last = first + ends[-1] - 1.0
    return sizes[order[np.searchsorted(ends, [last // 2.0, (last + 1.0) // 2.0], side="right")]]


class _Refit:
    """Regressions of one velocity on some of the terms, on the rows of one mode."""

    def __init__(self, problem: SwitchingProblem, rows, mode: int):
        self.loss, self.solver, self.bound = problem.loss, problem.solver, problem.coef_bound
        self.design, self.targets = problem.features[rows], problem.targets[rows]
        if problem.region is not None:  # what is known of the law is no choice
            told, values = problem.region.fixed
            self.targets = self.targets - self.design @ np.where(told, values, 0.0)[mode].T
        self.weight = problem.weight[rows]

    def coef(self, state: int, kept: NDArray[np.bool_]) -> Array:
        return self.loss.fit(
            self.design,
            self.targets[:, [state]],
            sample_weight=self.weight,
            coef_bound=self.bound,
            solver=self.solver,
            support=kept[None, :],
        ).coef[0]

    def squared_t(self, state: int, coef: Array, kept: NDArray[np.bool_]) -> Array:
        """Squared t-statistics of the kept terms."""
        # The scale is the median size of the residuals, without as many of the smallest as there
        # are terms: so many samples an l1 fit meets exactly.
        # Columns in units of their sizes: others than these would decide what counts as dependent.
        design, coef = self.design[:, kept], coef[kept]
        size = np.sqrt(np.average(design**2, axis=0, weights=self.weight))
        size[size == 0.0] = 1.0
        root = np.linalg.qr(np.sqrt(self.weight)[:, None] * (design / size), mode="r")
        residual = np.abs(self.targets[:, state] - design @ coef)
        sigma = robust_scale(_middle(residual, self.weight, len(coef)))
        velocity = np.sqrt(np.average(self.targets[:, state] ** 2, weights=self.weight))
        variance = sigma**2 * np.square(np.linalg.pinv(root)).sum(axis=1)
        least = np.maximum(variance, (_NEGLIGIBLE * velocity) ** 2)
        return np.square(size * coef) / np.maximum(least, np.finfo(float).tiny)

    def significant(self, state: int) -> NDArray[np.bool_]:
        """Terms that are left when none is insignificant any more."""
        kept = np.ones(self.design.shape[1], dtype=bool)
        limit = 2.0 * np.log(max(self.weight.sum(), 2.0))
        while kept.any():
            squared_t = self.squared_t(state, self.coef(state, kept), kept)
            weakest = squared_t.argmin()
            if squared_t[weakest] >= limit:
                break
            kept[np.flatnonzero(kept)[weakest]] = False
        return kept

    def large(self, state: int, smallest: float) -> NDArray[np.bool_]:
        """Terms that are left when none is small any more."""
        kept = np.ones(self.design.shape[1], dtype=bool)
        while kept.any():
            still = kept & (np.abs(self.coef(state, kept)) >= smallest)
            if still.sum() == kept.sum():
                break
            kept = still
        return kept


@dataclass(frozen=True)
class SurfaceChoice:
    """Surfaces of few monomials against those of all."""

    # Log evidence of the best few monomials minus that of all, in nats, over all surfaces.
    advantage: float
    # (n_surface_features,): posterior probability that a surface needs the monomial; the largest of
    # the surfaces.
    relevance: Array


@dataclass(frozen=True)
class SurfaceCandidate:
    """One of the surfaces between which the samples (nearly) leave the choice.

    Attributes
    ----------
    surface : PolynomialSurfaceClassifier or other classifier
        Fitted to the modes of the training samples.
    n_monomials : int or None
        How many monomials it has, in all its surfaces; None if it does not say.
    shortfall : float
        By how much the other candidate's log evidence is larger, in nats; not positive for the
        one that was chosen.
    """

    surface: Classifier
    n_monomials: int | None
    shortfall: float


@step
def choose_monomials(
    problem: SwitchingProblem, best: Alternation, descent: AlternateFrom
) -> tuple[SwitchingProblem, Alternation, SurfaceChoice | None]:
    """Alternate again with the relevant monomials if they explain the velocities better."""
    # Nothing is chosen without coupling (the paper's method), for one mode, for more surfaces than
    # it takes to separate a handful of modes, or for a surface that knows no relevance or was given
    # one.
    surface = best.surface
    if not (solves_margin_program(surface) and takes_relevance(problem.surface)):
        return problem, best, None
    if not 1 <= surface.mode_book_.shape[1] <= problem.settings.most_surfaces:
        return problem, best, None
    density = log_densities(problem, best.coef)
    features = surface.fitted_surfaces.basis.of_relevance(problem.coordinates)
    found = [
        feature_relevance(features, *_sides(problem, surface, density, column))
        for column in range(surface.mode_book_.shape[1])
    ]
    choice = SurfaceChoice(
        advantage=sum(each.advantage for each in found),
        relevance=np.max([each.share for each in found], axis=0),
    )
    if not choice.relevance.any():  # the velocities ask for no surface at all
        return problem, best, None
    if choice.advantage < problem.settings.no_advantage:
        return problem, best, choice
    sparse = clone(problem.surface).set_params(relevance=choice.relevance)
    problem = replace(problem, surface=sparse)
    start = one_hot(_gated_modes(surface, density, features, found), problem.n_modes)
    return problem, descent(problem, start), choice


def surface_candidates(
    problem: SwitchingProblem, choice: SurfaceChoice | None, chosen: Classifier, modes: Modes
) -> list[SurfaceCandidate]:
    """The chosen surface, and the other one where all monomials and few nearly tie."""
    # The other is fitted to the same modes; two surfaces that nearly tie differ on few of them.
    if choice is None:
        return [SurfaceCandidate(chosen, _n_monomials(chosen), 0.0)]
    lead = abs(choice.advantage)
    candidates = [SurfaceCandidate(chosen, _n_monomials(chosen), -lead)]
    if lead < problem.settings.nearly_tied:
        relevance = choice.relevance if option(problem.surface, "relevance", None) is None else None
        other = clone(problem.surface).set_params(relevance=relevance)
        fit_weighted(other, problem.coordinates, modes, problem.weight)
        candidates.append(SurfaceCandidate(other, _n_monomials(other), lead))
    return candidates


def _n_monomials(surface: Classifier) -> int | None:
    return int(np.count_nonzero(surface.coef_)) if solves_margin_program(surface) else None


def _sides(
    problem: SwitchingProblem, surface: MarginClassifier, density: Array, column: int
) -> tuple[Array, Array]:
    """Log ratio of the two sides of one surface, and the weight of the samples it separates."""
    # With two modes that is the ratio of their densities. With more, the modes of a side count as
    # far as the other surfaces allow them, at a nat for each margin of violation.
    book = surface.mode_book_
    agreement = surface.surface_values(problem.coordinates)[:, None, :] * book
    violation = np.maximum(0.0, surface.margin_ - agreement) / surface.margin_
    violation[:, book == 0] = 0.0
    violation[:, :, column] = 0.0
    allowed = density[:, surface.classes_] - violation.sum(axis=2)
    signs = book[:, column]
    ratio = _log_sum(allowed[:, signs > 0]) - _log_sum(allowed[:, signs < 0])
    concerned = _log_sum(allowed[:, signs != 0]) - _log_sum(allowed)
    return ratio, problem.weight * np.exp(concerned)


def _log_sum(values: Array) -> Array:
    total: Array = np.logaddexp.reduce(values, axis=1)
    return total


def _gated_modes(
    surface: MarginClassifier, density: Array, features: Array, found: list[Relevance]
) -> Modes:
    """Most probable modes by the densities and the averaged gates."""
    gates = features @ np.array([each.gate for each in found]).T
    agreement = gates[:, None, :] * surface.mode_book_
    refused = np.where(surface.mode_book_ == 0, 0.0, np.logaddexp(0.0, -agreement)).sum(axis=2)
    modes: Modes = surface.classes_[(density[:, surface.classes_] - refused).argmax(axis=1)]
    return modes
