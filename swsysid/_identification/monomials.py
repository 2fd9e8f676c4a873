"""The monomials that a surface needs, and the alternation with these alone.

Labels next to a surface of many monomials follow the surface, and the surface then follows them.
A surface of few monomials leaves less room for that, if they are the right ones. They are chosen
by what the velocities say, not by labels: `feature_relevance` gets log ratios of densities, which
are zero where modes cannot be told apart.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from sklearn.base import clone

from swsysid._identification.calibration import log_densities
from swsysid._identification.descent import AlternateFrom, Alternation
from swsysid._identification.problem import Modes, SwitchingProblem
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
