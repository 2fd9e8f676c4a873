"""Many rows: identify on a sample of them, then pass over all."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._data.features import FeatureMap
from swsysid._data.sampling import Sample, Thinned, draw_sample
from swsysid._data.sources import RowBlocks, row_blocks
from swsysid._identification.answer import Answer
from swsysid._identification.identify import Identification, Search
from swsysid._identification.passes import Pass, PassResult
from swsysid._identification.polish import Polished, polish
from swsysid._identification.problem import Modes, SwitchingProblem, one_hot
from swsysid._identification.reach import Sampled, rows_to_know
from swsysid._identification.scale import may_discard
from swsysid._losses.summaries import Reach
from swsysid._rendering.progress import progress
from swsysid._results import Array
from swsysid._surfaces.fitted import FittedSurfaces
from swsysid._surfaces.surface import fit_weighted, solves_margin_program

__all__ = ["IDENTIFIED", "WHOLE", "drawn_rows", "fit_all_rows"]

# Data of at most this many rows are fitted as a whole. Of more, this many are identified, ...
WHOLE, IDENTIFIED = 40_000, 10_000
# ... then a larger sample is passed over, and then all rows. It is this many times the rows to the
# power 2/3, as are those that a pass keeps.
_LARGER = 4.0
# If a pass over all rows would keep too many of them, passes over fewer rows come before, at least
# this many times fewer.
_FEWER = 4


def drawn_rows(blocks: RowBlocks) -> Sample:
    """All rows, if they are not too many, or a sample for `fit_all_rows`."""
    return draw_sample(blocks, IDENTIFIED, WHOLE)


def fit_all_rows(
    blocks: RowBlocks,
    sample: Sample,
    found: Identification,
    feature_map: FeatureMap,
    search: Search,
) -> Answer:
    """Pass over larger samples, then over all rows, from the answer of the first sample."""
    n_larger = int(_LARGER * sample.n_rows ** (2 / 3))
    larger = sample if n_larger <= len(sample.rows) else draw_sample(blocks, n_larger, 0)
    in_memory = row_blocks(larger.rows.X, larger.rows.targets, larger.rows.weight)
    settle = partial(polish, max_iter=search.max_iter, tol=search.tol)

    def passed_over(start: _Start) -> Polished:
        n_known = len(larger.rows)
        sampled = Sampled(start.problem, n_known, len(sample.rows))
        polished = settle(
            partial(_run, in_memory, False), start.look(feature_map, sampled), sampled
        )
        for n_rows in _stages(sample.n_rows, n_known, start.problem):
            whole = n_rows == sample.n_rows
            source = blocks if whole else Thinned(blocks, n_rows / sample.n_rows)
            sampled = Sampled(start.problem, n_rows, n_known)
            look = _with_reach(polished.look, sampled)
            polished = settle(partial(_run, source, bool(search.verbose)), look, sampled)
            n_known = n_rows
        return polished

    start = _Start(found.problem, found.best.coef, found.best.modes)
    polished = passed_over(start)
    order = np.argsort(-polished.result.weight, kind="stable")
    if (order[1:] < order[:-1]).any():  # the most populated mode is another one than in the sample
        start = start.reordered(order, polished.look)
        polished = passed_over(start)
    return start.answer(found, polished)


def _stages(n_rows: int, n_known: int, problem: SwitchingProblem) -> list[int]:
    """Numbers of rows to pass over one after the other, so that each pass keeps few of them."""
    stages = [n_rows]
    shape = problem.features.shape[1], problem.targets.shape[1]
    while not problem.loss.additive and (needed := rows_to_know(stages[0], *shape)) > n_known:
        fewer = min(needed, stages[0] // _FEWER)
        if fewer <= n_known:
            break
        stages.insert(0, fewer)
    return stages


@dataclass(frozen=True)
class _Start:
    """Vector fields and modes of the sampled rows, from which the passes begin."""

    problem: SwitchingProblem
    coef: Array
    modes: Modes

    @cached_property
    def surface(self) -> Any:
        """The classifier fitted to the sampled rows."""
        problem = self.problem
        return fit_weighted(clone(problem.surface), problem.coordinates, self.modes, problem.weight)

    def look(self, feature_map: FeatureMap, sampled: Sampled) -> Pass:
        """The first pass."""
        problem, surface = self.problem, None
        if problem.n_modes > 1 and solves_margin_program(self.surface):
            surface = self.surface.fitted_surfaces
        elif problem.coupling:
            surface = self.surface
        nothing = np.empty((0, problem.features.shape[1]))
        look = Pass(
            problem.on_rows(nothing, problem.targets[:0], problem.coordinates[:0]),
            feature_map,
            self.coef,
            self.coef,
            surface,
            may_discard(problem, self.coef, self.modes),
            (),
            Reach(np.empty((0, 0)), np.empty(0)),
        )
        return _with_reach(look, sampled)

    def reordered(self, order: Modes, look: Pass) -> _Start:
        """The start with its modes in another order, at the vector fields of a pass."""
        problem, rank = self.problem, np.argsort(order)
        if problem.support is not None:
            problem = replace(problem, support=problem.support[order])
        return _Start(problem, look.coef[order], rank[look.modes_of(self.problem)])

    def answer(self, found: Identification, polished: Polished) -> Answer:
        """What was found, with the sampled rows as all rows say."""
        problem, look, result = self.problem, polished.look, polished.result
        modes = look.modes_of(problem)
        surface: Any = replace(self, coef=look.coef, modes=modes).surface
        if polished.fits:
            surface = self.surface.refitted(
                polished.fits, problem.coordinates, modes, problem.weight
            )
        best = replace(
            found.best,
            coef=look.coef,
            membership=one_hot(modes, problem.n_modes),
            modes=modes,
            surface=surface,
            objective=polished.history[-1].objective,
            history=polished.history,
            converged=found.best.converged and polished.converged,
        )
        found = replace(found, best=best, problem=problem)
        history = list(polished.history)
        objective = result.hard_loss
        return Answer(found, surface, result.modes, None, objective, history, polished.stalled)


def _run(
    blocks: RowBlocks, verbose: bool, look: Pass, before: NDArray[np.int8] | None
) -> PassResult:
    results = []
    with progress(None, "blocks of a pass", verbose) as bar:
        for result in blocks.map(look, before):
            results.append(result)
            bar.update()
    return PassResult.joined(results)


def _with_reach(look: Pass, sampled: Sampled) -> Pass:
    modes = look.modes_of(sampled.problem)
    look = replace(look, reach=sampled.reach(look.coef, modes), reference=look.coef)
    if not isinstance(look.surface, FittedSurfaces):
        return look
    return replace(look, margin_reach=sampled.margin_reach(look.surface, modes))
