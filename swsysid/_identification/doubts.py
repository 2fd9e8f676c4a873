"""What may be wrong with a fit, and what a user is told of it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

from sklearn.exceptions import ConvergenceWarning

from swsysid._identification.answer import Answer
from swsysid._identification.guard import GuardCheck, check_guard
from swsysid._identification.identify import Identification
from swsysid._identification.rows import TrainingRows
from swsysid._identification.setup import input_names
from swsysid._results import GuardWarning, IdentificationWarning, MisfitWarning, Status
from swsysid._seeding.designs import centre_and_scale
from swsysid._seeding.misfit import Misfit, MissingConstant, missing_constant, shared_residual

__all__ = ["Doubts", "examine", "warn_about"]

# Frames between `warnings.warn` and the user's call of `fit`.
_STACK_LEVEL = 4


@dataclass(frozen=True)
class Doubts:
    """What may be wrong with an answer, whatever its objective says.

    Attributes
    ----------
    guard : GuardCheck
    shared : Misfit
        What neighbouring samples share of their residuals.
    constant : MissingConstant or None
        None where the user chose the library, or where states are missing in `X`.
    """

    guard: GuardCheck
    shared: Misfit
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
    )
    constant = None
    if default_library and problem.targets.shape[1] <= problem.coordinates.shape[1]:
        inlying = problem.informative_weight
        constant = missing_constant(problem.features, problem.targets, modes, inlying)
    return Doubts(check_guard(problem, coef, modes, answer.surface), shared, constant)


def warn_about(estimator: Any, answer: Answer, doubts: Doubts) -> None:
    """Warn if the data do not determine the answer, or if it is not converged or not stable."""
    found, guard = answer.found, doubts.guard
    n_rows, n_unknowns = len(found.problem.weight), found.n_modes_asked * estimator.coef_.shape[2]
    if n_rows < n_unknowns:
        _warn(
            f"{n_rows} distinct samples for {n_unknowns} unknown coefficients of each state: the "
            "coefficients of smallest norm were chosen; measure more or use a smaller "
            "feature_library.",
            IdentificationWarning,
        )
    if estimator.n_modes_ < found.n_modes_asked:
        _warn(
            f"Only {estimator.n_modes_} of {found.n_modes_asked} modes explain any sample, and the "
            "others were dropped; use a smaller n_modes.",
            IdentificationWarning,
        )
    if answer.stalled:
        _warn(
            "The passes over all rows could not improve the answer of a sample: a few rows far "
            "from the others decide; leave them out, or use a smaller feature_library or a smaller "
            "degree.",
            ConvergenceWarning,
        )
    elif not estimator.converged_:
        _warn(
            f"The alternation stopped after max_iter={estimator.max_iter} iterations. "
            f"{Status.ITERATION_LIMIT.advice}",
            ConvergenceWarning,
        )
    if found.has_low_hit_rate:
        _warn(
            f"The best answer was found by only {found.hits} of {found.n_starts} starts: a better "
            "one may exist; increase n_init, measure more, or use a smaller feature_library.",
            ConvergenceWarning,
        )
    if found.has_rival:
        _warn(
            "The answer is not stable: another partition of the samples into modes explains them "
            f"as well (log likelihood {found.log_likelihood_gap:.1f} lower); measure more, above "
            "all of the rarer mode, with less noise, or use a smaller feature_library or degree.",
            ConvergenceWarning,
        )
    # One mode is often fitted for comparison, a start of the user's own may lead anywhere, and
    # bounded coefficients leave something over.
    searched = isinstance(estimator.init, str) and estimator.init == "auto"
    free = searched and estimator.coef_bound is None and estimator.n_modes_ > 1
    misfit = _misfit_in_words(estimator, found, doubts) if free else None
    if misfit is not None:
        _warn(misfit, MisfitWarning)
    if guard.missing:
        _warn(
            f"Of {guard.n_decided} samples whose residuals decide their mode, "
            f"{guard.contradicted:.1%} lie where the surface and the neighbouring samples are in "
            "another mode: the switching is not a function of the state. Add what drives it (a "
            "time, an input) to X; if the state does drive it, raise the degree of the surface.",
            GuardWarning,
        )


def _misfit_in_words(estimator: Any, found: Identification, doubts: Doubts) -> str | None:
    """The strongest finding about what the model leaves over, None if that is noise."""
    constant, shared = doubts.constant, doubts.shared
    if constant is not None and constant.helps:
        return (
            f"A constant would explain {constant.share:.0%} of the squared residuals of "
            f"{_rate(estimator, constant.output)} in mode {constant.mode}, and the library has "
            "none: use feature_library=1 (a constant and the columns of X)."
        )
    if found.smooth_degree is not None:
        return (
            f"One law with all monomials up to degree {found.smooth_degree} predicts held-out "
            f"samples better than {estimator.n_modes_} modes: they may only tile a smooth term "
            "that the library lacks; compare with n_modes=1, "
            f"feature_library={found.smooth_degree}."
        )
    if shared.structured:
        return (
            f"Samples at neighbouring states share {shared.share:.0%} of the residuals of "
            f"{_rate(estimator, shared.output)} (RMS {shared.size:.2g} of its standard deviation), "
            "so these are no noise: use a richer feature_library, more modes, or a larger n_init."
        )
    return None


def _rate(estimator: Any, output: int) -> str:
    """Name of a velocity."""
    return f"{input_names(estimator)[output]}'"


def _warn(message: str, category: type[Warning]) -> None:
    warnings.warn(message, category, stacklevel=_STACK_LEVEL)
