r"""The descent over all rows in passes, from an answer found on some of them.

The answer of a sample of m rows is some :math:`1/\sqrt m` away from that of all rows. Each pass
assigns all rows to modes with the vector fields and surfaces at hand, and the summary of the pass
leads to the next ones: exactly, if no residual and no margin moves farther than the trust region
within which rows were kept. Where this fails the objective tells, and the trust region grows.

A pass looks at every block of rows on its own: it assigns the rows to modes, values the joint
objective, and summarises the rows for the next vector fields and surfaces. Its answer is small, and
answers of blocks are joined in the order of the blocks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from swsysid._data.features import FeatureMap
from swsysid._data.sources import Rows
from swsysid._identification.descent import Descent, descend
from swsysid._identification.problem import Costs, Modes, SwitchingProblem
from swsysid._identification.trust_region import Estimate, Sampled, TrustRegions
from swsysid._identification.within import better_within
from swsysid._results import Array, IterationRecord
from swsysid._surfaces.fitted import FittedSurfaces, HingeSummary
from swsysid._surfaces.margin_program import SurfaceFit


@dataclass(frozen=True)
class PassResult:
    """What a pass found in some rows."""

    # (n_rows,): mode of every row; ``-1 - mode`` for a row that no mode explains.
    labels: NDArray[np.int8]
    costs: Costs
    weight: Array  # (n_modes,): of the rows of every mode
    dynamics: tuple  # a summary of the rows of every mode, of the kind that the loss has
    surfaces: tuple[HingeSummary, ...]

    @classmethod
    def joined(cls, parts: Sequence[PassResult]) -> PassResult:
        """The result for the rows of several, one after the other."""
        dynamics = zip(*(part.dynamics for part in parts), strict=True)
        surfaces = zip(*(part.surfaces for part in parts), strict=True)
        return cls(
            np.concatenate([part.labels for part in parts]),
            sum((part.costs for part in parts), Costs(0.0, 0.0, 0.0, 0.0, 0.0)),
            np.sum([part.weight for part in parts], axis=0),
            tuple(type(of_mode[0]).joined(of_mode) for of_mode in dynamics),
            tuple(HingeSummary.joined(of_surface) for of_surface in surfaces),
        )

    @property
    def modes(self) -> NDArray[np.int8]:
        """Mode of every row."""
        modes, outlying = self.labels.copy(), np.flatnonzero(self.labels < 0)
        modes[outlying] = -1 - modes[outlying]
        return modes


@dataclass(frozen=True)
class Pass:
    """A pass over rows with one estimate."""

    problem: SwitchingProblem  # without rows
    feature_map: FeatureMap
    estimate: Estimate
    # (n_modes, n_states, n_features_out): vector fields that say which rows no mode explains. They
    # stay while those of the estimate move: else rows would come and go, and the objective with
    # them.
    reference: Array
    discards: NDArray[np.bool_]  # (n_modes,): modes whose rows may be outliers
    regions: TrustRegions  # how far residuals and margins may move; rows within it are kept
    # True if the vector fields are known to be optimal for the labels of the pass before.
    exact: bool = False

    def __call__(self, rows: Rows, before: NDArray[np.int8] | None = None) -> PassResult:
        """The result for a block; `before` are its labels of the pass before."""
        results, start = [], 0
        for piece in rows.pieces():
            end = start + len(piece)
            results.append(self._piece(piece, None if before is None else before[start:end]))
            start = end
        return PassResult.joined(results)

    def widened(self) -> Pass:
        """The same pass, which keeps more rows."""
        return replace(self, regions=self.regions.widened(self.problem.settings))

    def _piece(self, rows: Rows, before: NDArray[np.int8] | None) -> PassResult:
        # In memory one state after the other, as velocities are: passes over few long columns.
        targets = np.asfortranarray(rows.targets)
        problem = self.problem.on_rows(self.feature_map(rows.X), targets, rows.X)
        velocities = problem.velocities(self.estimate.coef)
        losses = problem.loss.values((problem.targets - velocities) / problem.scale)
        problem = replace(problem, weight=rows.weight, outlying=self._outlying(problem, losses))
        values = self.estimate.surface_values(rows.X)
        penalty = self.estimate.penalty(problem, values)
        assignment = problem.assign_velocities(velocities, penalty)
        modes = assignment.modes
        labels = np.where(problem.outlying, -1 - modes, modes).astype(np.int8)
        return PassResult(
            labels,
            costs=problem.costs(velocities, assignment, penalty),
            weight=np.bincount(modes, rows.weight, problem.n_modes).astype(float),
            dynamics=self._dynamics(problem, labels, before),
            surfaces=self._surfaces(rows, values, modes),
        )

    def _outlying(self, problem, losses) -> NDArray[np.bool_]:
        """Rows that their best mode of the reference does not explain either; see `calibrate`."""
        outlying = np.zeros(len(problem.targets), dtype=bool)
        if not (problem.coupling and self.discards.any()):
            return outlying
        # A loss is at least that of its largest residual.
        calibration = problem.settings.calibration
        near = np.full(len(problem.scale), calibration.suspected * calibration.outlying)
        near[1:] *= not problem.loss.separable
        far = np.flatnonzero(losses.min(axis=0) > problem.loss.values(near))
        some = problem.on_rows(
            problem.features[far], problem.targets[far], problem.coordinates[far]
        )
        residuals = (some.targets - some.velocities(self.reference)) / problem.scale
        own = problem.loss.values(residuals).argmin(axis=0)
        size = np.abs(residuals[own, np.arange(len(far))])
        if not problem.loss.separable:
            size = size.mean(axis=1, keepdims=True)
        beyond = size.max(axis=1, initial=0.0) > calibration.outlying
        outlying[far] = beyond & self.discards[own]
        return outlying

    def _dynamics(self, problem: SwitchingProblem, labels, before) -> tuple:
        """Summaries of every mode; of the rows that joined or left it, if `before` says which."""

        def summary(mode: int, members: NDArray[np.bool_], sign: float = 1.0):
            rows = np.flatnonzero(members)
            return problem.loss.summary.of(
                np.take(problem.features.T, rows, axis=1).T,
                problem.targets[rows],
                sign * problem.weight[rows],
                self.estimate.coef[mode],
                self.regions.residuals[mode],
            )

        modes = range(problem.n_modes)
        if before is None or not problem.loss.additive:
            return tuple(summary(mode, labels == mode) for mode in modes)
        changed = labels != before
        joining = (summary(mode, changed & (labels == mode)) for mode in modes)
        leaving = (summary(mode, changed & (before == mode), -1.0) for mode in modes)
        return tuple(map(problem.loss.summary.joined, zip(joining, leaving, strict=True)))

    def _surfaces(self, rows: Rows, values: Array | None, modes: Modes) -> tuple[HingeSummary, ...]:
        surface = self.estimate.surface
        if values is None or not isinstance(surface, FittedSurfaces):
            return ()
        place = np.full(self.problem.n_modes, -1)
        place[surface.classes] = np.arange(len(surface.classes))
        labels = place[modes]
        known = labels >= 0
        if not known.all():  # a mode without samples has no surface
            rows, values, labels = rows.take(known), values[known], labels[known]
        margins = self.regions.margins
        return tuple(surface.summarise(rows.X, values, labels, rows.weight, margins))


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
        if (region := problem.region) is not None:
            coef = better_within(region, problem.loss.name, result.dynamics, coef, support)
        else:
            for mode in np.flatnonzero(result.weight):  # one without samples keeps its own
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
