"""What may be wrong with a fit, and what a user is told of it."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sklearn.exceptions import ConvergenceWarning

from swsysid._checks.estimators import column_names
from swsysid._identification.answer import Answer
from swsysid._identification.guard import GuardCheck, check_guard
from swsysid._identification.identify import Identification
from swsysid._identification.rows import TrainingRows
from swsysid._identification.setup import Parameters
from swsysid._results import GuardWarning, IdentificationWarning, MisfitWarning, Status
from swsysid._seeding.designs import centre_and_scale
from swsysid._seeding.misfit import Misfit, MissingConstant, missing_constant, shared_residual

__all__ = ["Doubts", "examine", "warn_about"]

# Frames between `warnings.warn` and the user's call of `fit`.
_STACK_LEVEL = 3


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


def warn_about(estimator: Parameters, answer: Answer, doubts: Doubts) -> None:
    """Warn if the data do not determine the answer, or if it is not converged or not stable."""
    names = column_names(estimator)
    for category, message in (
        *_undetermined(answer.found),
        *_unfinished(answer, estimator.max_iter),
        *_unstable(answer.found),
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


def _unfinished(answer: Answer, max_iter: int) -> Warned:
    if answer.stalled:
        yield (
            ConvergenceWarning,
            "The passes over all rows could not improve the answer of a sample: a few rows far "
            "from the others decide; leave them out, or use a smaller feature_library or a smaller "
            "degree.",
        )
    elif not answer.found.best.converged:
        yield (
            ConvergenceWarning,
            f"The alternation stopped after max_iter={max_iter} iterations. "
            f"{Status.ITERATION_LIMIT.advice}",
        )


def _unstable(found: Identification) -> Warned:
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
    """The strongest finding about what the model leaves over.

    One mode is often fitted for comparison, a start of the user's own may lead anywhere, and
    bounded coefficients leave something over: nothing is said of these.
    """
    n_modes, constant, shared = len(found.best.coef), doubts.constant, doubts.shared
    searched = isinstance(estimator.init, str) and estimator.init == "auto"
    if not searched or estimator.coef_bound is not None or n_modes == 1:
        return
    if constant is not None and constant.helps:
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
