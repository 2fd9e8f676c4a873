"""From starts to one answer: seed, alternate from every seed, keep the best, tidy up."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from joblib import Parallel, delayed

from swsysid._data.rows import spread_rows
from swsysid._identification.calibration import calibrate
from swsysid._identification.descent import AlternateFrom, Alternation, alternate, relabel
from swsysid._identification.number_of_modes import (
    ModeCandidate,
    compare_mode_counts,
    smallest_sufficient,
    smooth_rival,
)
from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._identification.settings import Parameters
from swsysid._identification.setup import Search, Starts, draw_starts
from swsysid._identification.terms import SurfaceChoice, choose_monomials, choose_terms
from swsysid._noise import root_mean_square
from swsysid._rendering.progress import watched
from swsysid._results import Array
from swsysid._seeding.search import same_partition
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
    runs = Parallel(n_jobs=parameters.n_jobs)(
        delayed(descent)(few, start)
        for start in watched(memberships, "starts", bool(parameters.verbose))
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
