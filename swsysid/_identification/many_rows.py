"""Many rows: from the answer of a sample of them to that of all, in passes."""

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
from swsysid._identification.all_rows import AllRowsAnswer, descend_over_all_rows
from swsysid._identification.answer import Answer
from swsysid._identification.calibration import may_discard
from swsysid._identification.estimate import Estimate
from swsysid._identification.identify import Identification
from swsysid._identification.passes import Pass, PassResult
from swsysid._identification.problem import Modes, SwitchingProblem, one_hot
from swsysid._identification.rows import TrainingRows
from swsysid._identification.starts import Search
from swsysid._identification.trust_region import Sampled, rows_to_know
from swsysid._rendering.progress import progress
from swsysid._results import Array
from swsysid._surfaces.surface import fit_weighted, solves_margin_program

__all__ = ["answer_of_many", "stages"]


def answer_of_many(
    rows: TrainingRows, found: Identification, feature_map: FeatureMap, search: Search
) -> Answer:
    """Pass over larger samples, then over all rows, from the answer of the sample in memory."""
    start = _SampleAnswer(found.problem, found.best.coef, found.best.modes)
    descent = partial(descend_over_all_rows, max_iter=search.max_iter, tol=search.tol)
    sample, settings = rows.sample, found.problem.settings
    n_larger = int(settings.larger * sample.n_rows ** (2 / 3))
    larger = sample
    if n_larger > len(sample.rows):
        larger = draw_sample(rows.blocks, n_larger, 0)
    n_known = len(larger.rows)
    sampled = Sampled(start.problem, n_known, len(sample.rows))
    first = start.first_pass(feature_map, sampled)
    answer = descent(partial(_run, _blocks_of(larger), False), first, sampled)
    for n_rows in stages(sample.n_rows, n_known, start.problem):
        whole = n_rows == sample.n_rows
        source = rows.blocks if whole else Thinned(rows.blocks, n_rows / sample.n_rows)
        sampled = Sampled(start.problem, n_rows, n_known)
        estimate = answer.given.estimate
        first = replace(
            answer.given, reference=estimate.coef, region=sampled.around(estimate), exact=False
        )
        answer = descent(partial(_run, source, bool(search.verbose)), first, sampled)
        n_known = n_rows
    return start.answer(found, answer)


def _blocks_of(sample: Sample) -> RowBlocks:
    return row_blocks(sample.rows.X, sample.rows.targets, sample.rows.weight)


def stages(n_rows: int, n_known: int, problem: SwitchingProblem) -> list[int]:
    """Numbers of rows to pass over one after the other, so that each pass keeps few of them."""
    numbers, settings = [n_rows], problem.settings
    shape = problem.features.shape[1], problem.targets.shape[1]
    if problem.loss.additive:
        return numbers
    while (needed := rows_to_know(numbers[0], *shape, settings.most_kept)) > n_known:
        fewer = min(needed, numbers[0] // settings.fewer)
        if fewer <= n_known:
            break
        numbers.insert(0, fewer)
    return numbers


@dataclass(frozen=True)
class _SampleAnswer:
    """Vector fields and modes of the rows in memory, from which the passes begin."""

    problem: SwitchingProblem
    coef: Array
    modes: Modes

    @cached_property
    def surface(self) -> Any:
        """The classifier fitted to the rows in memory."""
        problem = self.problem
        return fit_weighted(clone(problem.surface), problem.coordinates, self.modes, problem.weight)

    def first_pass(self, feature_map: FeatureMap, sampled: Sampled) -> Pass:
        """A pass with these vector fields and this surface."""
        problem, surface = self.problem, None
        if problem.n_modes > 1 and solves_margin_program(self.surface):
            surface = self.surface.fitted_surfaces
        elif problem.coupling:
            surface = self.surface
        nothing = np.empty((0, problem.features.shape[1]))
        estimate = Estimate(self.coef, surface)
        return Pass(
            problem.on_rows(nothing, problem.targets[:0], problem.coordinates[:0]),
            feature_map,
            estimate,
            reference=self.coef,
            discards=may_discard(problem, self.coef, self.modes),
            region=sampled.around(estimate),
        )

    def answer(self, found: Identification, of_all: AllRowsAnswer) -> Answer:
        """What was found in all rows, with its modes in canonical order."""
        problem, estimate, result = self.problem, of_all.given.estimate, of_all.result
        order = np.argsort(-result.weight, kind="stable")  # that of the sample may be another
        rank = np.argsort(order)
        modes = rank[estimate.modes_of(problem)]
        if problem.support is not None:
            problem = replace(problem, support=problem.support[order])
        if of_all.fits:
            surface = self.surface.relabelled(rank).refitted(
                of_all.fits, problem.coordinates, modes, problem.weight
            )
        else:
            surface = _SampleAnswer(problem, estimate.coef, modes).surface
        best = replace(
            found.best,
            coef=estimate.coef[order],
            membership=one_hot(modes, problem.n_modes),
            modes=modes,
            surface=surface,
            objective=of_all.history[-1].objective,
            history=of_all.history,
            converged=found.best.converged and of_all.converged,
        )
        return Answer(
            replace(found, best=best, problem=problem),
            surface,
            rank.astype(np.int8)[result.modes],
            None,
            result.costs.hard_loss,
            list(of_all.history),
            of_all.stalled,
        )


def _run(
    blocks: RowBlocks, verbose: bool, given: Pass, before: NDArray[np.int8] | None
) -> PassResult:
    results = []
    with progress(None, "blocks of a pass", verbose) as bar:
        for result in blocks.map(given, before):
            results.append(result)
            bar.update()
    return PassResult.joined(results)
