r"""Few passes over all rows, from an answer found on some of them to that of all.

The answer of a sample of m rows is some :math:`1/\sqrt m` away from that of all rows. Each pass
assigns all rows to modes with the vector fields and surfaces at hand, and the summary of the pass
leads to the next ones: exactly, if no residual and no margin moves farther than the width within
which rows were kept. Where this fails the objective tells, and the width grows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from swsysid._passes import Pass, PassResult
from swsysid._problem import Modes, SwitchingProblem
from swsysid._results import Array, IterationRecord
from swsysid._seeding.designs import whiten
from swsysid._solvers.summaries import Reach
from swsysid._surfaces.fitted import Anchors, FittedSurfaces
from swsysid._surfaces.margin_program import SurfaceFit

__all__ = ["Polished", "Sampled", "polish"]

# Standard deviations that a residual may move from the vector fields of a sample to those of all
# rows, and rows kept at least for each column.
_DEVIATIONS, _FEWEST = 4.0, 10
# Rows kept next to a margin, in units of p / m, and never fewer than some for each feature.
_KEPT_NEAR, _FEWEST_NEAR = 10.0, 20
# Rows that a pass keeps at most, over all outputs.
_MOST_KEPT = 400_000
# Residuals and margins may move this share of what they moved in the step before.
_REACH = 0.3
# Where the width was too small it grows by this factor, at most so often.
_WIDER, _MOST_TRIES = 2.0, 3
# Passes for the surfaces alone, at most.
_MOST_LOOKS = 10
# Residuals that are smaller than this share of the targets' spread are none.
_EXACT = 1e-9
# Below this share of the rows, quantiles are extrapolated from the density there.
_RESOLVED = 0.1


@dataclass(frozen=True)
class Sampled:
    """Rows of a sample as a problem, to judge distances by.

    Attributes
    ----------
    problem : SwitchingProblem
    n_rows : int
        How many rows the sample stands for.
    n_known : int
        How many rows the vector fields and surfaces are known from when the passes begin.
    """

    problem: SwitchingProblem
    n_rows: int
    n_known: int

    def reach(self, coef: Array, modes: Modes) -> tuple[Reach, ...]:
        r"""How far the residuals of each mode may move from vector fields of as many rows.

        Coefficients of least absolute deviations have the covariance :math:`\tau^2 G^{-1}` with
        :math:`\tau = 1 / (2 f(0))`, where f is the density of the residuals (Koenker and Bassett
        1978). Coefficients of an output that a mode meets exactly stay.
        """
        return tuple(self._reach(coef, modes, mode) for mode in range(len(coef)))

    def _reach(self, coef: Array, modes: Modes, mode: int) -> Reach:
        rows = self._members(modes, mode)
        features = self.problem.features[rows]
        if not rows.size:
            return Reach(np.zeros((features.shape[1], 0)), np.full(coef.shape[1], -1.0), 0.0)
        metric = whiten(features, np.ones(len(rows))).transform / np.sqrt(self._known(rows))
        sizes = np.abs(self.problem.residuals(coef, modes)[rows])
        leverage = _leverage(features, metric)
        moving = self._within_memory(_DEVIATIONS * leverage.mean()) / leverage.mean()
        exact = np.median(sizes, axis=0) <= _EXACT * np.ptp(self.problem.targets, axis=0)
        size = np.where(exact, -1.0, moving * _sparsity(sizes))
        return Reach(metric, size, float(leverage.max()))

    def nearer(self, reach: Reach, mode: int, coef: Array, moved: Array, modes: Modes) -> Reach:
        """The reach after a step of one mode from `coef` to `moved`."""
        rows = self._members(modes, mode)
        if not rows.size:
            return reach
        features, n_known = self.problem.features[rows], self._known(rows)
        step = np.sqrt(n_known * np.square(features @ (moved[mode] - coef[mode]).T).mean(axis=0))
        sparsity = _sparsity(np.abs(self.problem.residuals(moved, modes)[rows]))
        leverage = _leverage(features, reach.metric).mean()
        n_rows = self.n_rows * len(rows) / len(modes)
        fewest = _FEWEST * features.shape[1] / (n_rows * leverage) * sparsity
        return replace(reach, size=np.minimum(reach.size, np.maximum(_REACH * step, fewest)))

    def _members(self, modes: Modes, mode: int) -> Modes:
        return np.flatnonzero((modes == mode) & ~self.problem.outlying)

    def _known(self, rows: Modes) -> float:
        """From how many rows the vector field of these rows is known."""
        return self.n_known * len(rows) / len(self.problem.weight)

    def margin_width(self, surface: FittedSurfaces, modes: Modes) -> float:
        """Distances to the margins up to which rows are kept in the first pass."""
        distance = self._distance(surface, modes)
        return self._near(distance, _KEPT_NEAR * surface.coef.shape[1] / self.n_known)

    def narrower_margin(
        self, width: float, surface: FittedSurfaces, moved: FittedSurfaces, modes: Modes
    ) -> float:
        """Distances for the pass after a step from `surface` to `moved`."""
        distance = self._distance(moved, modes)
        n_features = surface.coef.shape[1]
        near = distance <= _quantile(distance, _RESOLVED)
        X = self.problem.coordinates[near]
        step = np.abs(moved.values(X) - surface.values(X)).max(initial=0.0)
        fewest = self._near(distance, _FEWEST_NEAR * n_features / self.n_rows)
        return float(min(width, max(_REACH * step, fewest)))

    def _distance(self, surface: FittedSurfaces, modes: Modes) -> Array:
        """Distance of every row to the nearest margin."""
        place = np.searchsorted(surface.classes, modes)
        return np.abs(surface.distance(self.problem.coordinates, place)).min(axis=1)

    def anchors(self, look: Pass) -> Anchors:
        """The rows that hold the surfaces of a pass."""
        problem = self.problem
        labels = np.searchsorted(look.surface.classes, look.modes_of(problem))
        weight = problem.weight * (self.n_rows / len(problem.weight))
        return Anchors(problem.coordinates, labels, weight, look.margin_width)

    def _near(self, distance: Array, share: float) -> float:
        return float(_quantile(distance, self._within_memory(share)))

    def _within_memory(self, share: float) -> float:
        n_outputs = self.problem.targets.shape[1]
        return min(share, _MOST_KEPT / (self.n_rows * n_outputs))


@dataclass(frozen=True)
class Polished:
    """The answer of all rows.

    Attributes
    ----------
    look : Pass
        With the vector fields, and the surfaces that the labels were coupled to.
    result : PassResult
        Of that pass.
    fits : list of SurfaceFit
        Surfaces fitted to these labels; empty for a classifier that is no `FittedSurfaces`.
    history : tuple of IterationRecord
    converged : bool
    """

    look: Pass
    result: PassResult
    fits: list[SurfaceFit]
    history: tuple[IterationRecord, ...]
    converged: bool


def polish(
    run: Callable[[Pass, NDArray[np.int8] | None], PassResult],
    look: Pass,
    sampled: Sampled,
    *,
    max_iter: int,
    tol: float,
) -> Polished:
    """Pass over all rows until neither labels nor objective change.

    Parameters
    ----------
    run : callable
        The result of a pass over all rows, given the labels of the pass before.
    look : Pass
        The first one.
    sampled : Sampled
        Some of the rows.
    max_iter : int
    tol : float
        Relative improvement of the joint objective below which nothing more is to be had.
    """
    passes = _Passes(run)
    best = passes(look)
    history, converged, tries = [best.record(1)], False, 0
    while not converged and len(history) < max_iter:
        trial = passes(_next(best, sampled))
        gain = best.objective - trial.objective
        solved = trial.changes == 0 and look.problem.loss.summary.exact
        settled = solved or abs(gain) <= tol * abs(best.objective)
        if settled or gain > 0.0:
            converged, tries = settled, 0
            best = trial if gain >= 0.0 else best
            history.append(best.record(len(history) + 1))
        elif tries < _MOST_TRIES:  # rows moved farther than they were expected to
            tries += 1
            best = passes(best.look.widened(_WIDER**tries))
        else:
            converged = True
    if not look.problem.coupling:
        best = _with_settled_surfaces(best, passes, sampled, tol)
    return Polished(best.look, best.result, best.refit(sampled), tuple(history), converged)


def _with_settled_surfaces(best: _Trial, passes: _Passes, sampled: Sampled, tol: float) -> _Trial:
    """A pass that looks at all rows with surfaces that their summaries cannot improve.

    Without coupling the labels settle whether the surfaces have settled or not.
    """
    for _ in range(_MOST_LOOKS):
        fits = best.refit(sampled)
        within_reach = sum(fit.objective for fit in fits)
        if best.surface_objective - within_reach <= tol * best.surface_objective:
            break
        trial = passes(
            _with_surfaces(best.look, fits, sampled, best.look.modes_of(sampled.problem))
        )
        if trial.surface_objective < best.surface_objective:
            best = trial
        else:
            best = passes(best.look.widened(_WIDER))
    return best


class _Passes:
    """Passes over all rows, each of which may build on the one before."""

    def __init__(self, run: Callable[[Pass, NDArray[np.int8] | None], PassResult]):
        self.run = run
        self.before: PassResult | None = None

    def __call__(self, look: Pass) -> _Trial:
        started, before = perf_counter(), self.before
        loss, changes = look.problem.loss, 0
        if before is None:
            result = self.run(look, None)
            changes = len(result.labels)
        else:
            result = self.run(look, before.labels if loss.additive else None)
            changes = int(np.count_nonzero(result.labels != before.labels))
            if loss.additive:
                pairs = zip(before.dynamics, result.dynamics, strict=True)
                result = replace(result, dynamics=tuple(map(loss.summary.joined, pairs)))
        self.before = result
        return _Trial(look, result, changes, perf_counter() - started)


@dataclass(frozen=True)
class _Trial:
    """Vector fields and surfaces, and what a pass with them found."""

    look: Pass
    result: PassResult
    changes: int
    seconds: float

    @property
    def objective(self) -> float:
        """The joint objective; see `SwitchingProblem`."""
        surface, result = self.look.surface, self.result
        coupling = self.look.problem.coupling
        complexity = 0.0
        if isinstance(surface, FittedSurfaces):
            complexity = surface.beta * float(np.abs(surface.coef).sum())
        return result.loss + coupling * (result.slack + complexity)

    @property
    def surface_objective(self) -> float:
        """Objective of the margin LPs; zero for a classifier that solves none."""
        surface, total = self.look.surface, 0.0
        for summary, coef in zip(self.result.surfaces, getattr(surface, "coef", ()), strict=True):
            nothing = np.empty((0, len(coef))), np.empty(0)
            program = summary.program(nothing, surface.margin, surface.beta, surface.bound)
            total += program.objective(coef, program.signed @ coef)
        return total

    def record(self, iteration: int) -> IterationRecord:
        """What the history says of it; labels of so many rows are not kept."""
        result = self.result
        return IterationRecord(
            iteration=iteration,
            objective=self.objective,
            loss=result.hard_loss,
            lower_bound=result.relaxed_loss,
            mode_changes=self.changes,
            tightness=result.tight / float(result.weight.sum()),
            seconds=self.seconds,
            modes=np.empty(0, dtype=np.int8),
        )

    def refit(self, sampled: Sampled) -> list[SurfaceFit]:
        """Surfaces for the labels; none for a classifier that cannot be fitted to summaries."""
        if not self.result.surfaces:
            return []
        return self.look.surface.refit(self.result.surfaces, sampled.anchors(self.look))


def _next(trial: _Trial, sampled: Sampled) -> Pass:
    """Better vector fields and surfaces, and how far they may still move."""
    look, result, problem = trial.look, trial.result, trial.look.problem
    bound = np.inf if problem.coef_bound is None else float(problem.coef_bound)
    support = problem.support
    if support is None:
        support = np.ones(look.coef.shape, dtype=bool)
    coef = look.coef.copy()
    for mode in np.flatnonzero(result.weight):  # a mode without samples keeps its vector field
        coef[mode] = result.dynamics[mode].fit(coef[mode], bound, support[mode])
    modes = look.modes_of(sampled.problem)
    reach = tuple(
        sampled.nearer(each, mode, look.coef, coef, modes) for mode, each in enumerate(look.reach)
    )
    fits = trial.refit(sampled)
    return _with_surfaces(replace(look, coef=coef, reach=reach), fits, sampled, modes)


def _with_surfaces(look: Pass, fits: list[SurfaceFit], sampled: Sampled, modes: Modes) -> Pass:
    """The next pass with these surfaces, and how far they may still move."""
    if not fits:
        return look
    surface = replace(look.surface, coef=np.array([fit.coef for fit in fits]))
    near = sampled.narrower_margin(look.margin_width, look.surface, surface, modes)
    return replace(look, surface=surface, margin_width=near)


def _leverage(features: Array, metric: Array) -> Array:
    """Root of the leverage of every row."""
    return np.asarray(np.linalg.norm(features @ metric, axis=1), dtype=float)


def _sparsity(sizes: Array) -> Array:
    """1 / (2 f(0)) of every column, where f is the density of residuals of these sizes."""
    return np.asarray(np.quantile(sizes, _RESOLVED, axis=0)) / _RESOLVED


def _quantile(values: Array, share: float) -> Array:
    """Quantile of each column; where it is not resolved, in proportion to one that is."""
    if share >= _RESOLVED:
        return np.asarray(np.quantile(values, min(share, 1.0), axis=0))
    return np.asarray(np.quantile(values, _RESOLVED, axis=0) * (share / _RESOLVED))
