"""Where descents begin: memberships that are given, random, or of seeds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.parameters import whole
from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._identification.settings import Parameters
from swsysid._results import Array
from swsysid._seeding.search import same_partition
from swsysid._seeding.seeding import Seed, seed_modes
from swsysid._surfaces.surface import option
from swsysid.relaxations._base import one_hot


@dataclass(frozen=True)
class Search:
    """How to look for the answer on some rows: the regressor's parameters, and what they mean."""

    parameters: Parameters
    init: str | NDArray  # ``"auto"``, ``"random"``, labels of these rows or coefficients
    trajectory: Modes  # of every row, kept whole where rows are held out

    @property
    def gate_degree(self) -> int:
        """Degree of the gate: that of the surface."""
        return whole("degree", option(self.parameters.surface, "degree", 2), least=0)


@dataclass(frozen=True)
class Starts:
    """Memberships to start from, the most promising first, and what is known of them."""

    memberships: list[Array]  # each (n_samples, n_modes)
    # How often each was found; most starts of the seeding are thrown out early and count for none.
    hits: list[int]
    n_drawn: int
    suspected: NDArray[np.bool_]  # (n_samples,): samples that the best start takes for outliers
    log_likelihood_gap: float = np.inf  # as in `Identification`


def draw_starts(problem: SwitchingProblem, search: Search, random_state) -> Starts:
    """The starts that `search.init` asks for."""
    no_outliers = np.zeros(len(problem.targets), dtype=bool)
    if isinstance(search.init, np.ndarray):
        return Starts([_given_start(problem, search.init)], [1], 1, no_outliers)
    if problem.n_modes == 1:
        return Starts([np.ones((len(problem.targets), 1))], [1], 1, no_outliers)
    n_init = search.parameters.n_init
    if search.init == "random":
        n_starts = problem.settings.random_starts if n_init == "auto" else int(n_init)
        starts = [
            one_hot(_random_cells(problem, random_state), problem.n_modes) for _ in range(n_starts)
        ]
        return Starts(starts, [1] * len(starts), len(starts), no_outliers)
    seeds = seed_modes(
        problem.features,
        problem.targets,
        problem.coordinates,
        n_modes=problem.n_modes,
        gate_degree=search.gate_degree,
        sample_weight=problem.weight,
        n_starts=n_init,
        random_state=random_state,
        settings=problem.settings.seeding,
    )
    return Starts(
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
