r"""The descent over all rows in passes, from an answer found on some of them.

The answer of a sample of m rows is some :math:`1/\sqrt m` away from that of all rows. Each pass
assigns all rows to modes with the vector fields and surfaces at hand, and the summary of the pass
leads to the next ones: exactly, if no residual and no margin moves farther than the trust region
within which rows were kept. Where this fails the objective tells, and the trust region grows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from swsysid._identification.descent import descend
from swsysid._identification.estimate import Estimate
from swsysid._identification.passes import Pass, PassResult
from swsysid._identification.trust_region import Sampled
from swsysid._results import Array, IterationRecord
from swsysid._surfaces.fitted import FittedSurfaces, HingeSummary
from swsysid._surfaces.margin_program import SurfaceFit

__all__ = ["AllRowsAnswer", "descend_over_all_rows"]

# What passes found at surfaces that were no better.
Refused = Sequence[Sequence[HingeSummary]]
RunPass = Callable[[Pass, NDArray[np.int8] | None], PassResult]


@dataclass(frozen=True)
class AllRowsAnswer:
    """The answer of all rows.

    Attributes
    ----------
    given : Pass
        With the vector fields, and the surfaces that the labels were coupled to.
    result : PassResult
        Of that pass.
    fits : list of SurfaceFit
        Surfaces fitted to these labels; empty for a classifier that is no `FittedSurfaces`.
    history : tuple of IterationRecord
    converged : bool
    stalled : bool
        True if the passes ended because no trust region was enough.
    """

    given: Pass
    result: PassResult
    fits: list[SurfaceFit]
    history: tuple[IterationRecord, ...]
    converged: bool
    stalled: bool


def descend_over_all_rows(
    run: RunPass, first: Pass, sampled: Sampled, *, max_iter: int, tol: float
) -> AllRowsAnswer:
    """Pass over all rows until neither labels nor objective change.

    Parameters
    ----------
    run : callable
        The result of a pass over all rows, given the labels of the pass before.
    first : Pass
    sampled : Sampled
        Some of the rows.
    max_iter : int
    tol : float
        Relative improvement of the joint objective below which nothing more is to be had.
    """
    rows = _InPasses(run, sampled, tol)
    found = descend(rows, _Passed(first), max_iter=max_iter, tol=tol)
    last = found.last
    if not first.problem.coupling:
        last = rows.with_converged_surfaces(last)
    fits = rows.refit(last)
    return AllRowsAnswer(
        last.given, last.result, fits, found.history, found.converged, found.stalled
    )


@dataclass(frozen=True)
class _Passed:
    """Vector fields and surfaces, and what a pass with them found; nothing yet for a start."""

    given: Pass
    found: PassResult | None = None
    mode_changes: int = 0
    seconds: float = 0.0

    @property
    def result(self) -> PassResult:
        assert self.found is not None, "no pass has been made"
        return self.found

    @property
    def objective(self) -> float:
        """The joint objective J."""
        costs, complexity = self.result.costs, self.given.estimate.complexity
        return self.given.problem.joint_objective(costs.loss, costs.slack + complexity)

    @property
    def measures(self) -> tuple[float]:
        return (self.objective,)

    @property
    def is_fixed(self) -> bool:
        return self.mode_changes == 0 and self.given.exact

    @property
    def no_gain(self) -> float:
        return self.given.problem.settings.no_gain * float(self.result.weight.sum())

    def record(self, iteration: int) -> IterationRecord:
        """What the history says of it; labels of so many rows are not kept."""
        costs = self.result.costs
        return IterationRecord(
            iteration=iteration,
            objective=self.objective,
            loss=costs.hard_loss,
            lower_bound=costs.relaxed_loss,
            mode_changes=self.mode_changes,
            tightness=costs.tight / float(self.result.weight.sum()),
            seconds=self.seconds,
            modes=np.empty(0, dtype=np.int8),
        )

    @property
    def surface_objective(self) -> float:
        """Objective of the margin LPs; zero for a classifier that solves none."""
        surface = self.given.estimate.surface
        if not isinstance(surface, FittedSurfaces):
            return 0.0
        return surface.objective(self.result.surfaces)


class _InPasses:
    """All rows, seen in passes, each of which may build on the one before."""

    def __init__(self, run: RunPass, sampled: Sampled, tol: float):
        self.run, self.sampled, self.tol = run, sampled, tol
        self.before: PassResult | None = None

    def next(self, iterate: _Passed) -> _Passed | None:
        """The next vector fields and surfaces, with a wider trust region if they are worse."""
        if iterate.found is None:
            return self._passed(iterate.given)
        refused: list[Sequence[HingeSummary]] = []
        best = iterate
        while len(refused) <= best.given.problem.settings.most_tries:
            trial = self._passed(self._following(best, refused))
            loss = trial.objective - best.objective
            if loss <= self.tol * abs(best.objective) + best.no_gain:
                return best if loss > 0.0 else trial
            refused.append(trial.result.surfaces)  # rows moved farther than they were expected to
            best = self._passed(best.given.widened())
        return None

    def renewed(self, iterate: _Passed) -> _Passed:
        """The same: the mode-book of the sample is that of all rows."""
        return iterate

    def refit(self, iterate: _Passed, refused: Refused = ()) -> list[SurfaceFit]:
        """Surfaces for the labels; none for a classifier that cannot be fitted to summaries."""
        given, surface = iterate.given, iterate.given.estimate.surface
        if not isinstance(surface, FittedSurfaces):
            return []
        anchors = self.sampled.anchors(given.estimate, surface, given.region)
        return surface.refit(iterate.result.surfaces, anchors, refused)

    def with_converged_surfaces(self, best: _Passed) -> _Passed:
        """A pass over all rows with surfaces that its summaries cannot improve.

        Without coupling the labels converge whether the surfaces have converged or not.
        """
        for _ in range(best.given.problem.settings.most_surface_passes):
            fits = self.refit(best)
            within_reach = sum(fit.objective for fit in fits)
            if best.surface_objective - within_reach <= self.tol * best.surface_objective:
                break
            trial = self._passed(self._moved(best.given, best.given.estimate.coef, fits))
            if trial.surface_objective < best.surface_objective:
                best = trial
            else:
                best = self._passed(best.given.widened())
        return best

    def _passed(self, given: Pass) -> _Passed:
        started, before, loss = perf_counter(), self.before, given.problem.loss
        if before is None:
            result = self.run(given, None)
            changes = len(result.labels)
        else:
            result = self.run(given, before.labels if loss.additive else None)
            changes = int(np.count_nonzero(result.labels != before.labels))
            if loss.additive:
                pairs = zip(before.dynamics, result.dynamics, strict=True)
                result = replace(result, dynamics=tuple(map(loss.summary.joined, pairs)))
        self.before = result
        return _Passed(given, result, changes, perf_counter() - started)

    def _following(self, iterate: _Passed, refused: Refused) -> Pass:
        """A pass with better vector fields and surfaces."""
        given, result = iterate.given, iterate.result
        problem, coef = given.problem, given.estimate.coef.copy()
        bound = np.inf if problem.coef_bound is None else float(problem.coef_bound)
        support = problem.support
        if support is None:
            support = np.ones(coef.shape, dtype=bool)
        for mode in np.flatnonzero(result.weight):  # one without samples keeps its vector field
            coef[mode] = result.dynamics[mode].fit(coef[mode], bound, support[mode])
        return self._moved(given, coef, self.refit(iterate, refused))

    def _moved(self, given: Pass, coef: Array, fits: list[SurfaceFit]) -> Pass:
        """The pass with other vector fields and surfaces, and how far these may still move."""
        sampled, before, loss = self.sampled, given.estimate, given.problem.loss
        modes = before.modes_of(sampled.problem)
        surface = before.surface
        if isinstance(surface, FittedSurfaces):
            surface = replace(
                surface, coef=np.reshape([fit.coef for fit in fits], surface.coef.shape)
            )
        now = Estimate(coef, surface)
        within = sampled.holds(given.region, coef - before.coef, modes)
        return replace(
            given,
            estimate=now,
            region=sampled.after(given.region, before, now, modes),
            exact=loss.additive or (within and loss.summary.exact),
        )
