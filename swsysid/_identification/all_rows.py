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

from swsysid._identification.descent import Descent, descend
from swsysid._identification.passes import Pass, PassResult
from swsysid._identification.trust_region import Estimate, Sampled
from swsysid._results import Array, IterationRecord
from swsysid._surfaces.fitted import FittedSurfaces, HingeSummary
from swsysid._surfaces.margin_program import SurfaceFit

# What passes found at surfaces that were no better.
Refused = Sequence[Sequence[HingeSummary]]
RunPass = Callable[[Pass, NDArray[np.int8] | None], PassResult]


def descend_over_all_rows(
    run: RunPass, first: Pass, sampled: Sampled, *, max_iter: int, tol: float
) -> tuple[Descent[Passed], list[SurfaceFit]]:
    """Pass over all rows until neither labels nor objective change; `run` makes one pass.

    Where the descent ended, and surfaces fitted to its labels: none for a classifier that is no
    `FittedSurfaces`.
    """
    rows = _InPasses(run, sampled, tol)
    descent = descend(rows, Passed(first), max_iter=max_iter, tol=tol)
    if not first.problem.coupling:
        descent = replace(descent, last=rows.with_converged_surfaces(descent.last))
    return descent, rows.refit(descent.last)


@dataclass(frozen=True)
class Passed:
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

    def next(self, iterate: Passed) -> Passed | None:
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

    def renewed(self, iterate: Passed) -> Passed:
        """The same: the mode-book of the sample is that of all rows."""
        return iterate

    def refit(self, iterate: Passed, refused: Refused = ()) -> list[SurfaceFit]:
        """Surfaces for the labels; none for a classifier that cannot be fitted to summaries."""
        given, surface = iterate.given, iterate.given.estimate.surface
        if not isinstance(surface, FittedSurfaces):
            return []
        anchors = self.sampled.anchors(given.estimate, surface, given.regions)
        return surface.refit(iterate.result.surfaces, anchors, refused)

    def with_converged_surfaces(self, best: Passed) -> Passed:
        """A pass over all rows with surfaces that its summaries cannot improve."""
        # Without coupling the labels converge whether the surfaces have converged or not.
        for _ in range(best.given.problem.settings.most_surface_passes):
            fits = self.refit(best)
            attained = sum(fit.objective for fit in fits)
            if best.surface_objective - attained <= self.tol * best.surface_objective:
                break
            trial = self._passed(self._moved(best.given, best.given.estimate.coef, fits))
            if trial.surface_objective < best.surface_objective:
                best = trial
            else:
                best = self._passed(best.given.widened())
        return best

    def _passed(self, given: Pass) -> Passed:
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
        return Passed(given, result, changes, perf_counter() - started)

    def _following(self, iterate: Passed, refused: Refused) -> Pass:
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
        within = sampled.holds(given.regions, coef - before.coef, modes)
        return replace(
            given,
            estimate=now,
            regions=sampled.after(given.regions, before, now, modes),
            exact=loss.additive or (within and loss.summary.exact),
        )
