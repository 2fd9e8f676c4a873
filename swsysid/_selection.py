"""How many modes: held-out likelihood of the seeding mixture, and parsimony."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._seeding.seeding import held_out_log_likelihood, seed_modes

__all__ = ["ModeCandidate", "compare_mode_counts", "smallest_sufficient"]

# Fraction of the samples held out.
_HELD_OUT = 0.25
# Differences of fewer nats than this are noise whatever their standard error says.
_FREE_NATS = 2.0
# Counts tried beyond the best one before the search gives up.
_PATIENCE = 2


@dataclass(frozen=True)
class ModeCandidate:
    """One number of modes, judged on held-out samples.

    Attributes
    ----------
    n_modes : int
    log_likelihood : float
        Sum over the held-out samples, in nats.
    shortfall : float
        How much the best candidate is better, in nats.
    standard_error : float
        Of `shortfall`, from the paired differences of the samples.
    """

    n_modes: int
    log_likelihood: float
    shortfall: float
    standard_error: float

    @property
    def sufficient(self) -> bool:
        """True if the data do not show that the best candidate is better."""
        return self.shortfall <= self.standard_error + _FREE_NATS


def compare_mode_counts(problem, search, random_state) -> tuple[ModeCandidate, ...]:
    """Held-out likelihoods of 1, 2, ... modes, until two more have not helped.

    A single sample leaves nothing to compare on.
    """
    if len(problem.weight) < 2:
        return ()
    held_out = _hold_out(search.trajectory, problem.weight, random_state)
    train, test = np.flatnonzero(~held_out), np.flatnonzero(held_out)
    scores: list[Array] = []
    for n_modes in range(1, search.max_modes + 1):
        seeds = seed_modes(
            problem.features[train],
            problem.targets[train],
            problem.coordinates[train],
            n_modes=n_modes,
            gate_degree=search.gate_degree,
            sample_weight=problem.weight[train],
            random_state=random_state,
        )
        scores.append(
            held_out_log_likelihood(
                seeds[0],
                problem.features[test],
                problem.targets[test],
                problem.coordinates[test],
            )
        )
        totals = [problem.weight[test] @ score for score in scores]
        if len(totals) - 1 - int(np.argmax(totals)) >= _PATIENCE:
            break
    return tuple(_candidates(scores, problem.weight[test]))


def smallest_sufficient(candidates: tuple[ModeCandidate, ...]) -> int:
    """The smallest number of modes that is not shown to be worse than the best; 1 of none."""
    return min((candidate.n_modes for candidate in candidates if candidate.sufficient), default=1)


def _candidates(scores: list[Array], weight: Array):
    best = max(scores, key=lambda score: weight @ score)
    n_samples = weight.sum()
    for n_modes, score in enumerate(scores, start=1):
        difference = best - score
        mean = (weight @ difference) / n_samples
        spread = np.sqrt((weight @ (difference - mean) ** 2) / n_samples)
        yield ModeCandidate(
            n_modes=n_modes,
            log_likelihood=float(weight @ score),
            shortfall=float(n_samples * mean),
            standard_error=float(spread * np.sqrt(n_samples)),
        )


def _hold_out(trajectory: NDArray[np.intp], weight: Array, random_state) -> NDArray[np.bool_]:
    """Whole trajectories if there are at least four of them, single samples otherwise."""
    n_trajectories = int(trajectory.max()) + 1
    blocks = trajectory if n_trajectories >= 4 else np.arange(len(trajectory))
    n_blocks = int(blocks.max()) + 1
    order = random_state.permutation(n_blocks)
    size = np.bincount(blocks, weights=weight, minlength=n_blocks)[order]
    chosen = order[np.cumsum(size) <= _HELD_OUT * size.sum()]
    return np.isin(blocks, chosen if len(chosen) else order[:1])
