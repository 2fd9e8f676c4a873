"""From starts to one answer: seed, alternate from every seed, keep the best, tidy up."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from swsysid._alternation import Alternation, alternate, relabel
from swsysid._monomials import SurfaceChoice, choose_monomials
from swsysid._problem import Modes, SwitchingProblem, one_hot
from swsysid._results import Array
from swsysid._rows import spread_rows
from swsysid._scale import calibrate
from swsysid._seeding.seeding import seed_modes
from swsysid._selection import ModeCandidate, compare_mode_counts, smallest_sufficient
from swsysid._sparsity import sparse_support

__all__ = ["Identification", "Search", "identify"]

# An answer that fewer than one start in this many finds again is no more than the best so far.
_SELDOM = 32
# As many rows as this decide between starts as well as all rows do.
_DECIDING = 20_000


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
    n_jobs : int or None
    verbose : int
    """

    init: Any
    n_init: int | None
    max_iter: int
    tol: float
    sparsity: Any
    gate_degree: int
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
    """

    best: Alternation
    problem: SwitchingProblem
    hits: int
    stability: float
    n_starts: int
    n_modes_asked: int
    candidates: tuple[ModeCandidate, ...]
    monomials: SurfaceChoice | None

    @property
    def seldom_found(self) -> bool:
        """True if the winner was found once among several starts, or by one in 32 of them."""
        return 1 < self.n_starts and self.hits <= max(1, self.n_starts // _SELDOM)


def identify(problem: SwitchingProblem, search: Search, random_state) -> Identification:
    """Alternate from every start and keep the smallest joint objective."""
    candidates: tuple[ModeCandidate, ...] = ()
    if problem.n_modes == "auto":
        candidates = compare_mode_counts(problem, search, random_state)
        problem = replace(problem, n_modes=smallest_sufficient(candidates))
    asked = problem.n_modes
    if isinstance(search.init, str):  # more modes than distinct rows would only be dropped again
        problem = replace(problem, n_modes=min(asked, len(problem.weight)))
    starts, counts, drawn = _starts(problem, search, random_state)
    if problem.coupling:
        # The scale is fixed once, from the best start: objectives of all starts must compare.
        first = replace(problem, coupling=0.0).estimate(starts[0])
        problem = calibrate(problem, first, starts[0].argmax(axis=1))
    rows = _deciding_rows(problem)
    few = problem if rows is None else problem.some(rows)
    runs = Parallel(n_jobs=search.n_jobs)(
        delayed(alternate)(
            few,
            start if rows is None else start[rows],
            max_iter=search.max_iter,
            tol=search.tol,
        )
        for start in tqdm(starts, desc="starts", disable=not search.verbose)
    )
    winner = min(range(len(runs)), key=lambda run: runs[run].objective)
    first = best = runs[winner]
    agreeing = sum(
        count for run, count in zip(runs, counts, strict=True) if _same_answer(run, best, few)
    )
    problem, best, choice = choose_monomials(
        problem, first, max_iter=search.max_iter, tol=search.tol
    )
    if rows is not None and best is first:
        best = alternate(problem, starts[winner], max_iter=search.max_iter, tol=search.tol)
    if search.sparsity is not None:
        problem, best = _sparsify(problem, best, search)
    order = _canonical_order(problem, best)
    return Identification(
        best=relabel(best, order),
        problem=replace(problem, n_modes=len(order)),
        hits=agreeing,
        stability=agreeing / sum(counts),
        n_starts=drawn,
        n_modes_asked=asked,
        candidates=candidates,
        monomials=choice,
    )


def _deciding_rows(problem: SwitchingProblem) -> Modes | None:
    """Rows on which starts are compared before the best of them goes on with all; None for all.

    Without coupling it is the paper's method, and every iteration is on all rows.
    """
    n_rows = len(problem.weight)
    if problem.coupling == 0.0 or n_rows <= 2 * _DECIDING:
        return None
    return spread_rows(n_rows, _DECIDING)


def _starts(problem, search: Search, random_state) -> tuple[list[Array], list[int], int]:
    """Memberships to start from, the most promising first, how often each was found, of how many.

    Most starts of the seeding are thrown out early and count for no membership.
    """
    if isinstance(search.init, np.ndarray):
        return [_given_start(problem, search.init)], [1], 1
    if problem.n_modes == 1:
        return [np.ones((len(problem.targets), 1))], [1], 1
    if search.init == "random":
        starts = [
            one_hot(_random_cells(problem, random_state), problem.n_modes)
            for _ in range(search.n_init or 10)
        ]
        return starts, [1] * len(starts), len(starts)
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
    starts = [one_hot(seed.labels, problem.n_modes) for seed in seeds]
    return starts, [max(seed.hits, 1) for seed in seeds], seeds[0].n_starts


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
    """True if two runs label the same samples together, but for one in two hundred."""
    if run is best:
        return True
    table = np.zeros((problem.n_modes, problem.n_modes))
    np.add.at(table, (run.modes, best.modes), problem.weight)
    return table.max(axis=1).sum() >= 0.995 * problem.weight.sum()


def _sparsify(problem, best: Alternation, search: Search) -> tuple[SwitchingProblem, Alternation]:
    """Drop needless terms, then let the alternation settle without them."""
    support = sparse_support(problem, best.coef, best.modes, search.sparsity)
    problem = replace(problem, support=support)
    start = one_hot(best.modes, problem.n_modes)
    return problem, alternate(problem, start, max_iter=search.max_iter, tol=search.tol)


def _canonical_order(problem: SwitchingProblem, best: Alternation) -> Modes:
    """Modes by decreasing number of samples, equal ones by their coefficients; no empty ones."""
    size = np.bincount(best.modes, weights=problem.weight, minlength=problem.n_modes)
    order = sorted(range(problem.n_modes), key=lambda mode: (-size[mode], *best.coef[mode].ravel()))
    return np.array([mode for mode in order if size[mode] > 0], dtype=np.intp)
