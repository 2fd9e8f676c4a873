"""What a fit leaves behind: the answer of all rows, at once or in passes over many of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._data.features import FeatureMap
from swsysid._data.sampling import Thinned, draw_sample
from swsysid._data.sources import RowBlocks, row_blocks
from swsysid._identification.all_rows import Pass, PassResult, descend_over_all_rows
from swsysid._identification.calibration import may_discard
from swsysid._identification.identify import Identification
from swsysid._identification.problem import SwitchingProblem
from swsysid._identification.setup import Search, TrainingRows
from swsysid._identification.trust_region import Estimate, Sampled, rows_to_know
from swsysid._rendering.progress import progress
from swsysid._results import Array, IterationRecord
from swsysid._surfaces.fitted import FittedSurfaces
from swsysid._surfaces.surface import (
    Classifier,
    CoupledClassifier,
    fit_weighted,
    offers_penalty,
    solves_margin_program,
)
from swsysid.relaxations._base import one_hot


@dataclass(frozen=True)
class Answer:
    """The answer for all rows."""

    # Its problem, and the modes of its best alternation, are of the rows it was found on.
    found: Identification
    surface: Classifier
    modes: NDArray  # (n_samples,)
    membership: Array | None  # (n_samples, n_modes); None if it is one-hot
    objective: float  # weighted sum of the losses, in the user's units
    history: list[IterationRecord]
    stalled: bool = False  # True if passes over all rows could not improve the answer of a sample


def answer_of_all(rows: TrainingRows, found: Identification, feature_map: FeatureMap) -> Answer:
    """The answer of rows that were all identified: modes, and the surface fitted to them."""
    # Rows of weight zero took no part; they get the mode that fits them best.
    best, problem, given, distinct = found.best, found.problem, rows.in_memory, rows.distinct
    modes = distinct.restore(best.modes)
    surface = fit_weighted(clone(problem.surface), given.X, modes, given.weight)
    membership = distinct.restore(best.membership)
    dropped = distinct.inverse < 0
    if dropped.any():
        some = given.take(dropped)
        rest = problem.on_rows(feature_map(some.X), some.targets, some.X)
        penalty = rest.penalty(surface) if rest.coupling else None
        membership[dropped] = rest.assign(best.coef, penalty).membership
    return Answer(
        found,
        surface,
        membership.argmax(axis=1),
        membership,
        problem.hard_loss(best.coef, best.modes),
        [replace(record, modes=distinct.restore(record.modes, -1)) for record in best.history],
    )


def answer_of_many(
    rows: TrainingRows, found: Identification, feature_map: FeatureMap, search: Search
) -> Answer:
    """Pass over larger samples, then over all rows, from the answer of the sample in memory."""
    problem, parameters, sample = found.problem, search.parameters, rows.sample
    surface = _fitted_surface(problem, found.best.modes)
    descent = partial(descend_over_all_rows, max_iter=parameters.max_iter, tol=parameters.tol)
    n_larger = int(problem.settings.larger * sample.n_rows ** (2 / 3))
    larger = sample.rows
    if n_larger > len(larger):
        larger = draw_sample(rows.blocks, n_larger, 0).rows
    n_known = len(larger)
    sampled = Sampled(problem, n_known, len(sample.rows))
    source = row_blocks(larger.X, larger.targets, larger.weight)
    first = _first_pass(found, surface, feature_map, sampled)
    passes, fits = descent(partial(_run, source, False), first, sampled)
    for n_rows in stages(sample.n_rows, n_known, problem):
        whole = n_rows == sample.n_rows
        source = rows.blocks if whole else Thinned(rows.blocks, n_rows / sample.n_rows)
        sampled = Sampled(problem, n_rows, n_known)
        given, estimate = passes.last.given, passes.last.given.estimate
        first = replace(
            given, reference=estimate.coef, regions=sampled.around(estimate), exact=False
        )
        passes, fits = descent(partial(_run, source, bool(parameters.verbose)), first, sampled)
        n_known = n_rows

    estimate, result = passes.last.given.estimate, passes.last.result
    order = np.argsort(-result.weight, kind="stable")  # that of the sample may be another
    rank = np.argsort(order)
    modes = rank[estimate.modes_of(problem)]
    if problem.support is not None:
        problem = replace(problem, support=problem.support[order])
    if fits and solves_margin_program(surface):
        rows_in_memory = problem.coordinates, modes, problem.weight
        surface = surface.relabelled(rank).refitted(fits, *rows_in_memory)
    else:
        surface = _fitted_surface(problem, modes)
    best = replace(
        found.best,
        coef=estimate.coef[order],
        membership=one_hot(modes, problem.n_modes),
        modes=modes,
        surface=surface,
        objective=passes.history[-1].objective,
        history=passes.history,
        converged=found.best.converged and passes.converged,
    )
    return Answer(
        replace(found, best=best, problem=problem),
        surface,
        rank.astype(np.int8)[result.modes],
        None,
        result.costs.hard_loss,
        list(passes.history),
        passes.stalled,
    )


def stages(n_rows: int, n_known: int, problem: SwitchingProblem) -> list[int]:
    """Numbers of rows to pass over one after the other, so that each pass keeps few of them."""
    numbers, settings = [n_rows], problem.settings
    shape = problem.features.shape[1], problem.targets.shape[1]
    if problem.loss.additive:
        return numbers
    while (needed := rows_to_know(numbers[0], *shape, settings)) > n_known:
        fewer = min(needed, numbers[0] // settings.fewer)
        if fewer <= n_known:
            break
        numbers.insert(0, fewer)
    return numbers


def _fitted_surface(problem: SwitchingProblem, modes: NDArray) -> Classifier:
    """The classifier fitted to the rows in memory."""
    return fit_weighted(clone(problem.surface), problem.coordinates, modes, problem.weight)


def _first_pass(
    found: Identification, surface: Classifier, feature_map: FeatureMap, sampled: Sampled
) -> Pass:
    """A pass with the vector fields of the rows in memory and their surface."""
    problem, coef = found.problem, found.best.coef
    coupled: FittedSurfaces | CoupledClassifier | None = None
    if problem.n_modes > 1 and solves_margin_program(surface):
        coupled = surface.fitted_surfaces
    elif problem.coupling and offers_penalty(surface):
        coupled = surface
    estimate = Estimate(coef, coupled)
    nothing = np.empty((0, problem.features.shape[1]))
    return Pass(
        problem.on_rows(nothing, problem.targets[:0], problem.coordinates[:0]),
        feature_map,
        estimate,
        reference=coef,
        discards=may_discard(problem, coef, found.best.modes),
        regions=sampled.around(estimate),
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
