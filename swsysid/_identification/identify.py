"""From starts to one answer: seed, alternate from every seed, keep the best, tidy up."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from swsysid._data.rows import spread_rows
from swsysid._identification.alternation import Alternation, alternate, relabel
from swsysid._identification.monomials import SurfaceChoice, choose_monomials
from swsysid._identification.number_of_modes import (
    ModeCandidate,
    compare_mode_counts,
    smallest_sufficient,
    smooth_rival,
)
from swsysid._identification.problem import Modes, SwitchingProblem, one_hot
from swsysid._identification.scale import calibrate
from swsysid._identification.sparsity import sparse_support
from swsysid._results import Array
from swsysid._seeding.search import same_partition
from swsysid._seeding.seeding import Seed, seed_modes

__all__ = ["Identification", "Search", "identify"]


@dataclass(frozen=True)
class Search:
    """How to look for the best start.

    Attributes
    ----------
    init : str or ndarray
        ``"auto"``, ``"random"``, labels (n_samples,) or coefficients
        (n_modes, n_states, n_features_out).
    n_init : int or None
        Number of starts, None for the default of `init`.
    max_iter : int
    tol : float
    sparsity : float, "auto" or None
    gate_degree : int
    chooses_n_modes : bool
        The number of modes is chosen, up to `max_modes`, by what held-out rows say.
    max_modes : int
    trajectory : ndarray of shape (n_samples,), int
        Trajectory of every row, kept whole where rows are held out.
    n_jobs : int or None
    verbose : int
    """

    init: str | NDArray
    n_init: int | None
    max_iter: int
    tol: float
    sparsity: float | str | None
    gate_degree: int
    chooses_n_modes: bool
    max_modes: int
    trajectory: Modes
    n_jobs: int | None
    verbose: int


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


@dataclass(frozen=True)
class _Starts:
    """Memberships to start from, the most promising first, and what is known of them.

    Attributes
    ----------
    memberships : list of ndarray of shape (n_samples, n_modes)
    hits : list of int
        How often each was found; most starts of the seeding are thrown out early and count for
        none.
    n_drawn : int
    suspected : ndarray of shape (n_samples,), bool
        Samples that the best start takes for outliers.
    log_likelihood_gap : float
        As in `Identification`.
    """

    memberships: list[Array]
    hits: list[int]
    n_drawn: int
    suspected: NDArray[np.bool_]
    log_likelihood_gap: float = np.inf


def identify(problem: SwitchingProblem, search: Search, random_state) -> Identification:
    """Alternate from every start and keep the smallest joint objective."""
    candidates: tuple[ModeCandidate, ...] = ()
    smooth_degree = None
    if search.chooses_n_modes:
        draws = deepcopy(random_state)  # the same rows are held out for both comparisons
        candidates = compare_mode_counts(problem, search, random_state)
        problem = replace(problem, n_modes=smallest_sufficient(candidates))
        smooth_degree = smooth_rival(problem, search, problem.n_modes, draws)
    asked = problem.n_modes
    if isinstance(search.init, str):  # more modes than distinct rows would only be dropped again
        problem = replace(problem, n_modes=min(asked, len(problem.weight)))
    starts = _starts(problem, search, random_state)
    if problem.coupling:
        # The scale is fixed once, from the best start: objectives of all starts must compare.
        first = starts.memberships[0]
        suspected = replace(problem, coupling=0.0, outlying=starts.suspected)
        problem = calibrate(problem, suspected.estimate(first), first.argmax(axis=1))
    best, hits = _best_of(problem, starts, search)
    problem, best, choice = choose_monomials(
        problem, best, max_iter=search.max_iter, tol=search.tol
    )
    if search.sparsity is not None:
        problem, best = _sparsify(problem, best, search, search.sparsity)
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
        monomials=choice,
        smooth_degree=smooth_degree,
        log_likelihood_gap=starts.log_likelihood_gap,
    )


def _best_of(problem: SwitchingProblem, starts: _Starts, search: Search) -> tuple[Alternation, int]:
    """The best alternation, and how many starts ended in it.

    Of very many rows some decide between the starts, and the best goes on with all rows.
    """
    rows = _deciding_rows(problem)
    few = problem if rows is None else problem.some(rows)
    descent = partial(alternate, max_iter=search.max_iter, tol=search.tol)
    runs = Parallel(n_jobs=search.n_jobs)(
        delayed(descent)(few, start if rows is None else start[rows])
        for start in tqdm(starts.memberships, desc="starts", disable=not search.verbose)
    )
    best = min(runs, key=lambda run: run.objective)
    hits = sum(
        count for run, count in zip(runs, starts.hits, strict=True) if _same_answer(run, best, few)
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


def _starts(problem, search: Search, random_state) -> _Starts:
    no_outliers = np.zeros(len(problem.targets), dtype=bool)
    if isinstance(search.init, np.ndarray):
        return _Starts([_given_start(problem, search.init)], [1], 1, no_outliers)
    if problem.n_modes == 1:
        return _Starts([np.ones((len(problem.targets), 1))], [1], 1, no_outliers)
    if search.init == "random":
        starts = [
            one_hot(_random_cells(problem, random_state), problem.n_modes)
            for _ in range(search.n_init or problem.settings.random_starts)
        ]
        return _Starts(starts, [1] * len(starts), len(starts), no_outliers)
    seeds = seed_modes(
        problem.features,
        problem.targets,
        problem.coordinates,
        n_modes=problem.n_modes,
        gate_degree=search.gate_degree,
        sample_weight=problem.weight,
        n_starts=search.n_init or "auto",
        random_state=random_state,
    )
    return _Starts(
        [one_hot(seed.labels, problem.n_modes) for seed in seeds],
        [max(seed.hits, 1) for seed in seeds],
        seeds[0].n_starts,
        seeds[0].inlier < 0.5,
        _log_likelihood_gap(seeds, problem.weight, problem.settings.different),
    )


def _log_likelihood_gap(seeds: list[Seed], weight: Array, different: float) -> float:
    """How far the likelihood of the next really different partition is behind, in nats."""
    first = seeds[0]
    return min(
        (
            first.log_likelihood - seed.log_likelihood
            for seed in seeds[1:]
            if not same_partition(first.labels, seed.labels, weight, different)
        ),
        default=np.inf,
    )


def _given_start(problem: SwitchingProblem, init: Array) -> Array:
    if init.ndim == 1:
        return one_hot(init, problem.n_modes)
    expected = (problem.n_modes, problem.targets.shape[1], problem.features.shape[1])
    if init.shape != expected:
        raise ValueError(
            f"init has shape {init.shape}; coefficients to start from must have the shape "
            f"(n_modes, n_states, n_features_out) = {expected}."
        )
    return replace(problem, coupling=0.0).assign(init).membership


def _random_cells(problem: SwitchingProblem, random_state) -> Modes:
    """Cells of the samples nearest to random ones, in standardised coordinates."""
    probability = problem.weight / problem.weight.sum()
    spread = problem.coordinates.std(axis=0)
    points = problem.coordinates / np.where(spread > 0, spread, 1.0)
    centres = points[random_state.choice(len(points), problem.n_modes, p=probability)]
    return np.square(points[:, None, :] - centres).sum(axis=2).argmin(axis=1)


def _same_answer(run: Alternation, best: Alternation, problem: SwitchingProblem) -> bool:
    """True if two runs label the same samples together, but for few of them."""
    if run is best:
        return True
    table = np.zeros((problem.n_modes, problem.n_modes))
    np.add.at(table, (run.modes, best.modes), problem.weight)
    return table.max(axis=1).sum() >= problem.settings.same * problem.weight.sum()


def _sparsify(
    problem: SwitchingProblem, best: Alternation, search: Search, sparsity: float | str
) -> tuple[SwitchingProblem, Alternation]:
    """Drop needless terms and let the alternation settle without them, until no choice changes."""
    support = None
    for _ in range(problem.settings.most_choices):
        previous, support = support, sparse_support(problem, best.coef, best.modes, sparsity)
        if previous is not None and np.array_equal(support, previous):
            break
        problem = replace(problem, support=support)
        start = one_hot(best.modes, problem.n_modes)
        best = alternate(problem, start, max_iter=search.max_iter, tol=search.tol)
    return problem, best


def _canonical_order(problem: SwitchingProblem, best: Alternation) -> Modes:
    """Modes by decreasing number of samples, equal ones by their coefficients; no empty ones."""
    size = np.bincount(best.modes, weights=problem.weight, minlength=problem.n_modes)
    order = sorted(range(problem.n_modes), key=lambda mode: (-size[mode], *best.coef[mode].ravel()))
    return np.array([mode for mode in order if size[mode] > 0], dtype=np.intp)
