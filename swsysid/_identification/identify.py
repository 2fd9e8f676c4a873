"""From starts to one answer: seed, alternate from every seed, keep the best, tidy up.

What a fit leaves behind is the answer of all rows, at once or in passes over many of them.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._data.features import FeatureMap
from swsysid._data.rows import spread_rows
from swsysid._data.sampling import Thinned, draw_sample
from swsysid._data.sources import RowBlocks, row_blocks
from swsysid._identification.all_rows import Pass, PassResult, descend_over_all_rows
from swsysid._identification.descent import AlternateFrom, Alternation, alternate, relabel
from swsysid._identification.number_of_modes import (
    ModeCandidate,
    compare_mode_counts,
    smallest_sufficient,
    smooth_rival,
)
from swsysid._identification.problem import Modes, SwitchingProblem, calibrate, may_discard
from swsysid._identification.settings import Parameters
from swsysid._identification.setup import Search, Starts, TrainingRows, draw_starts
from swsysid._identification.terms import SurfaceChoice, choose_monomials, choose_terms
from swsysid._identification.trust_region import Estimate, Sampled, rows_to_know
from swsysid._journal import resumable, step
from swsysid._noise import root_mean_square
from swsysid._rendering.progress import progress, watched
from swsysid._results import Array, IterationRecord
from swsysid._seeding.search import same_partition
from swsysid._surfaces.fitted import FittedSurfaces
from swsysid._surfaces.surface import (
    Classifier,
    CoupledClassifier,
    fit_weighted,
    offers_penalty,
    solves_margin_program,
)
from swsysid._ties import least_of
from swsysid.relaxations._base import one_hot

_HALF_THE_DIGITS = 8  # of a number: what a least squares solution of condition 1e8 keeps of 16


@dataclass(frozen=True)
class Identification:
    """The winner among the starts."""

    best: Alternation  # with its modes in canonical order, the most populated first, and none empty
    problem: SwitchingProblem  # what `best` solves, scale and outlying rows included
    hits: int  # how many starts ended in the winner
    stability: float  # their share among the starts that were not thrown out early
    n_starts: int  # how many starts were drawn
    n_modes_asked: int  # before empty modes were dropped
    candidates: tuple[ModeCandidate, ...]  # numbers of modes that were compared
    monomials: SurfaceChoice | None  # surfaces of few monomials against those of all
    # Degree of one polynomial law that predicts held-out samples better than the modes found by
    # ``n_modes="auto"``; None without one.
    smooth_degree: int | None
    # By how much the best partition of the seeding is more likely than the next that really
    # differs, in nats; infinite without one.
    log_likelihood_gap: float

    @property
    def has_rival(self) -> bool:
        """True if another partition explains the samples as well."""
        return self.log_likelihood_gap < self.problem.settings.open

    @property
    def has_low_hit_rate(self) -> bool:
        """True if the winner was found once among several starts, or by one in many of them."""
        few = self.n_starts // self.problem.settings.seldom
        return 1 < self.n_starts and self.hits <= max(1, few)


@step
def identify(problem: SwitchingProblem, search: Search, random_state) -> Identification:
    """Descend from every start, keep the smallest joint objective, choose monomials and terms."""
    parameters = search.parameters
    descent = partial(alternate, max_iter=parameters.max_iter, tol=parameters.tol)
    candidates: tuple[ModeCandidate, ...] = ()
    smooth_degree = None
    if parameters.n_modes == "auto":
        draws = deepcopy(random_state)  # the same rows are held out for both comparisons
        candidates = compare_mode_counts(problem, search, random_state)
        problem = replace(problem, n_modes=smallest_sufficient(candidates))
        smooth_degree = smooth_rival(problem, search, problem.n_modes, draws)
    asked = problem.n_modes
    if isinstance(search.init, str):  # more modes than distinct rows would only be dropped again
        problem = replace(problem, n_modes=min(asked, len(problem.weight)))
    starts = draw_starts(problem, search, random_state)
    if problem.coupling:  # objectives of all starts must compare: the scale is that of the best
        first = starts.memberships[0]
        suspected = replace(problem, coupling=0.0, outlying=starts.suspected)
        problem = calibrate(problem, suspected.estimate(first), first.argmax(axis=1))
    best, hits = _best_of(problem, starts, descent, parameters)
    problem, best, monomials = choose_monomials(problem, best, descent)
    if parameters.sparsity is not None:
        problem, best = choose_terms(problem, best, parameters.sparsity, descent)
    order = _canonical_order(problem, best)
    support = None if problem.support is None else problem.support[order]
    return Identification(
        best=relabel(best, order),
        problem=replace(problem, n_modes=len(order), support=support),
        hits=hits,
        stability=hits / sum(starts.hits),
        n_starts=starts.n_drawn,
        n_modes_asked=asked,
        candidates=candidates,
        monomials=monomials,
        smooth_degree=smooth_degree,
        log_likelihood_gap=starts.log_likelihood_gap,
    )


def _best_of(
    problem: SwitchingProblem, starts: Starts, descent: AlternateFrom, parameters: Parameters
) -> tuple[Alternation, int]:
    """The best alternation, and how many starts ended in it."""
    # Of very many rows some decide between the starts, and the best goes on with all rows. Without
    # coupling it is the paper's method, and every iteration is on all rows.
    n_rows, settings = len(problem.weight), problem.settings
    some_decide = problem.coupling > 0.0 and n_rows > 2 * settings.deciding
    few, memberships = problem, starts.memberships
    if some_decide:
        rows = spread_rows(n_rows, settings.deciding)
        few, memberships = problem.some(rows), [start[rows] for start in memberships]
    steps = [resumable(descent) for _ in memberships]
    runs = Parallel(n_jobs=parameters.n_jobs)(
        delayed(one)(few, start)
        for one, start in zip(
            steps, watched(memberships, "starts", bool(parameters.verbose)), strict=True
        )
    )
    best = least_of(runs, lambda run: run.objective)
    hits = sum(
        count
        for run, count in zip(runs, starts.hits, strict=True)
        if same_partition(run.modes, best.modes, few.weight, 1.0 - settings.same)
    )
    if some_decide:
        modes = problem.assign(best.coef, problem.penalty(best.surface)).modes
        best = descent(problem, one_hot(modes, problem.n_modes))
    return best, hits


def _canonical_order(problem: SwitchingProblem, best: Alternation) -> Modes:
    """Modes by decreasing number of samples, equal ones by their laws; no empty ones."""
    size = np.bincount(best.modes, weights=problem.weight, minlength=problem.n_modes)
    # A velocity that is another state has the coefficients 0 and 1 in all modes, but for rounding:
    # of what a term gives to a velocity half the digits count.
    units = root_mean_square(problem.features) / _size_of(problem.targets)[:, None]
    laws = np.round(best.coef * units, _HALF_THE_DIGITS).reshape(problem.n_modes, -1)
    order = sorted(range(problem.n_modes), key=lambda mode: (-size[mode], *laws[mode]))
    return np.array([mode for mode in order if size[mode] > 0], dtype=np.intp)


def _size_of(targets: Array) -> Array:
    """Root mean square of each velocity, one where it is zero throughout."""
    size = root_mean_square(targets)
    return np.where(size > 0.0, size, 1.0)


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
    surface = fitted_surface(problem, found.best.modes)
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
        surface = fitted_surface(problem, modes)
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


def fitted_surface(problem: SwitchingProblem, modes: NDArray) -> Classifier:
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


@step
def _run(
    blocks: RowBlocks, verbose: bool, given: Pass, before: NDArray[np.int8] | None
) -> PassResult:
    results = []
    with progress(None, "blocks of a pass", verbose) as bar:
        for result in blocks.map(given, before):
            results.append(result)
            bar.update()
    return PassResult.joined(results)
