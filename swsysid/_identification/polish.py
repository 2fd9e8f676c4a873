r"""Few passes over all rows, from an answer found on some of them to that of all.

The answer of a sample of m rows is some :math:`1/\sqrt m` away from that of all rows. Each pass
assigns all rows to modes with the vector fields and surfaces at hand, and the summary of the pass
leads to the next ones: exactly, if no residual and no margin moves farther than the width within
which rows were kept. Where this fails the objective tells, and the width grows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from swsysid._identification.passes import Pass, PassResult
from swsysid._identification.problem import Modes
from swsysid._identification.reach import Sampled
from swsysid._results import IterationRecord
from swsysid._surfaces.fitted import FittedSurfaces, HingeSummary
from swsysid._surfaces.margin_program import SurfaceFit

__all__ = ["Polished", "polish"]

# What passes found at surfaces that were no better.
Refused = Sequence[Sequence[HingeSummary]]

# Where what passes kept was too little they keep more, at most so often.
_MOST_TRIES = 3
# Nats a row that are none.
_NOTHING = 1e-9
# Passes for the surfaces alone, at most.
_MOST_LOOKS = 10


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
    stalled : bool
        True if the passes ended because no width was enough.
    """

    look: Pass
    result: PassResult
    fits: list[SurfaceFit]
    history: tuple[IterationRecord, ...]
    converged: bool
    stalled: bool


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
    history, converged = [best.record(1)], False
    refused: list[Sequence[HingeSummary]] = []
    while not converged and len(history) < max_iter and len(refused) <= _MOST_TRIES:
        trial = passes(_next(best, sampled, refused))
        gain = best.objective - trial.objective
        least = tol * abs(best.objective) + _NOTHING * float(best.result.weight.sum())
        if gain >= -least:
            converged = gain <= least or (trial.changes == 0 and trial.look.exact)
            best, refused = (trial if gain >= 0.0 else best), []
            history.append(best.record(len(history) + 1))
        else:  # rows moved farther than they were expected to
            refused.append(trial.result.surfaces)
            best = passes(best.look.widened())
    if not look.problem.coupling:
        best = _with_settled_surfaces(best, passes, sampled, tol)
    stalled, fits = len(refused) > _MOST_TRIES, best.refit(sampled)
    return Polished(best.look, best.result, fits, tuple(history), converged, stalled)


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
            best = passes(best.look.widened())
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
            program = summary.program([], surface.margin, surface.beta, surface.bound)
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

    def refit(self, sampled: Sampled, refused: Refused = ()) -> list[SurfaceFit]:
        """Surfaces for the labels; none for a classifier that cannot be fitted to summaries."""
        if not self.result.surfaces:
            return []
        anchors = sampled.anchors(self.look)
        return self.look.surface.refit(self.result.surfaces, anchors, refused)


def _next(trial: _Trial, sampled: Sampled, refused: Refused) -> Pass:
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
    within = all(
        sampled.is_within(each, mode, coef[mode] - look.coef[mode], modes)
        for mode, each in enumerate(look.reach)
    )
    reach = tuple(
        sampled.nearer(each, mode, look.coef, coef, modes) for mode, each in enumerate(look.reach)
    )
    fits = trial.refit(sampled, refused)
    look = replace(
        look,
        coef=coef,
        reach=reach,
        exact=problem.loss.additive or (within and problem.loss.summary.exact),
    )
    return _with_surfaces(look, fits, sampled, modes)


def _with_surfaces(look: Pass, fits: list[SurfaceFit], sampled: Sampled, modes: Modes) -> Pass:
    """The next pass with these surfaces, and how far they may still move."""
    if not fits:
        return look
    surface = replace(look.surface, coef=np.array([fit.coef for fit in fits]))
    near = sampled.nearer_margin(look.margin_reach, look.surface, surface, modes)
    return replace(look, surface=surface, margin_reach=near)
