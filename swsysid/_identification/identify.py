"""From starts to one answer: seed, alternate from every seed, keep the best, tidy up."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from swsysid._data.rows import spread_rows
from swsysid._identification.alternation import AlternateFrom, Alternation, alternate, relabel
from swsysid._identification.calibration import calibrate
from swsysid._identification.monomials import SurfaceChoice, choose_monomials
from swsysid._identification.number_of_modes import (
    ModeCandidate,
    compare_mode_counts,
    smallest_sufficient,
    smooth_rival,
)
from swsysid._identification.problem import Modes, SwitchingProblem, one_hot
from swsysid._identification.sparsity import choose_terms
from swsysid._identification.starts import Search, Starts, draw_starts
from swsysid._seeding.search import same_partition

__all__ = ["Identification", "identify"]


@dataclass(frozen=True)
class Identification:
    """The winner among the starts.

    Attributes
    ----------
    best : Alternation
        With its modes in canonical order, the most populated first, and none empty.
    problem : SwitchingProblem
        What `best` solves, scale and outlying rows included.
    hits : int
        How many starts ended in the winner.
    stability : float
        Their share among the starts that were not thrown out early.
    n_starts : int
        How many starts were drawn.
    n_modes_asked : int
        Before empty modes were dropped.
    candidates : tuple of ModeCandidate
        Numbers of modes that were compared.
    monomials : SurfaceChoice or None
        Surfaces of few monomials against those of all.
    smooth_degree : int or None
        Degree of one polynomial law that predicts held-out samples better than the modes found by
        ``n_modes="auto"``; None without one.
    log_likelihood_gap : float
        By how much the best partition of the seeding is more likely than the next that really
        differs, in nats; infinite without one.
    """

    best: Alternation
    problem: SwitchingProblem
    hits: int
    stability: float
    n_starts: int
    n_modes_asked: int
    candidates: tuple[ModeCandidate, ...]
    monomials: SurfaceChoice | None
    smooth_degree: int | None
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
    descent = partial(alternate, max_iter=search.max_iter, tol=search.tol)
    problem, counted = _with_number_of_modes(problem, search, random_state)
    asked = problem.n_modes
    if isinstance(search.init, str):  # more modes than distinct rows would only be dropped again
        problem = replace(problem, n_modes=min(asked, len(problem.weight)))
    starts = draw_starts(problem, search, random_state)
    problem = _with_scale(problem, starts)
    best, hits = _best_of(problem, starts, descent, search)
    problem, best, monomials = choose_monomials(problem, best, descent)
    if search.sparsity is not None:
        problem, best = choose_terms(problem, best, search.sparsity, descent)
    order = _canonical_order(problem, best)
    support = None if problem.support is None else problem.support[order]
    return Identification(
        best=relabel(best, order),
        problem=replace(problem, n_modes=len(order), support=support),
        hits=hits,
        stability=hits / sum(starts.hits),
        n_starts=starts.n_drawn,
        n_modes_asked=asked,
        candidates=counted.candidates,
        monomials=monomials,
        smooth_degree=counted.smooth_degree,
        log_likelihood_gap=starts.log_likelihood_gap,
    )


class _Counted(NamedTuple):
    """Numbers of modes that were compared, and a law without modes that does as well."""

    candidates: tuple[ModeCandidate, ...] = ()
    smooth_degree: int | None = None


def _with_number_of_modes(
    problem: SwitchingProblem, search: Search, random_state
) -> tuple[SwitchingProblem, _Counted]:
    if not search.chooses_n_modes:
        return problem, _Counted()
    draws = deepcopy(random_state)  # the same rows are held out for both comparisons
    candidates = compare_mode_counts(problem, search, random_state)
    problem = replace(problem, n_modes=smallest_sufficient(candidates))
    return problem, _Counted(candidates, smooth_rival(problem, search, problem.n_modes, draws))


def _with_scale(problem: SwitchingProblem, starts: Starts) -> SwitchingProblem:
    """The problem with the scale of the best start: objectives of all starts must compare."""
    if not problem.coupling:
        return problem
    first = starts.memberships[0]
    suspected = replace(problem, coupling=0.0, outlying=starts.suspected)
    return calibrate(problem, suspected.estimate(first), first.argmax(axis=1))


def _best_of(
    problem: SwitchingProblem, starts: Starts, descent: AlternateFrom, search: Search
) -> tuple[Alternation, int]:
    """The best alternation, and how many starts ended in it.

    Of very many rows some decide between the starts, and the best goes on with all rows.
    """
    rows = _deciding_rows(problem)
    few = problem if rows is None else problem.some(rows)
    runs = Parallel(n_jobs=search.n_jobs)(
        delayed(descent)(few, start if rows is None else start[rows])
        for start in tqdm(starts.memberships, desc="starts", disable=not search.verbose)
    )
    best = min(runs, key=lambda run: run.objective)
    different = 1.0 - problem.settings.same
    hits = sum(
        count
        for run, count in zip(runs, starts.hits, strict=True)
        if same_partition(run.modes, best.modes, few.weight, different)
    )
    if rows is not None:
        modes = problem.assign(best.coef, problem.penalty(best.surface)).modes
        best = descent(problem, one_hot(modes, problem.n_modes))
    return best, hits


def _deciding_rows(problem: SwitchingProblem) -> Modes | None:
    """Rows on which starts are compared before the best of them goes on with all; None for all.

    Without coupling it is the paper's method, and every iteration is on all rows.
    """
    n_rows, n_deciding = len(problem.weight), problem.settings.deciding
    if problem.coupling == 0.0 or n_rows <= 2 * n_deciding:
        return None
    return spread_rows(n_rows, n_deciding)


def _canonical_order(problem: SwitchingProblem, best: Alternation) -> Modes:
    """Modes by decreasing number of samples, equal ones by their coefficients; no empty ones."""
    size = np.bincount(best.modes, weights=problem.weight, minlength=problem.n_modes)
    order = sorted(range(problem.n_modes), key=lambda mode: (-size[mode], *best.coef[mode].ravel()))
    return np.array([mode for mode in order if size[mode] > 0], dtype=np.intp)
