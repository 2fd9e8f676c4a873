"""What a joint refinement gained, and whether it is kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.assembly import Assembled
from swsysid._automaton_search.joint import JointEstimate
from swsysid._results import Array, Trajectory

# An objective beyond it is none of a fit: its digits say nothing, nor do its curvatures. Of a ball
# between two stops of a beam it was 1e102, and guards had standard errors of 5e49.
DIVERGED = 1e9


@dataclass(frozen=True, repr=False)
class AutomatonRefinement:
    """Laws, guards and resets refined together: what it gained, and how certain they are.

    Attributes
    ----------
    kept : bool
        Whether the refined automaton is the answer.
    objective_before, objective_after : float
        Half the sum of squared misfits of the samples, in units of the noise, that rollouts leave
        which follow the recorded modes: from the best starts, with the automaton that was found
        part by part and with the refined one.
    rollout_before, rollout_after : float
        Mean deviation of free rollouts from the samples, in units of the noise.
    coef_standard_errors : ndarray of shape (n_modes, n_states, n_features_out)
        Of the laws; 0 where a coefficient is fixed.
    guard_standard_errors : tuple of ndarray
        Of the coefficients of the guard of each transition; the one that sets its scale has none.
    reset_standard_errors : tuple of ndarray or None
        Of offset and matrix of the reset of each transition, (n_states, 1 + n_states).
    covariance : ndarray of shape (n_parameters, n_parameters) or None
        Of all of these, in the order of `HybridAutomaton.parameters`; infinite on the diagonal
        where nothing tells. None in files of versions that did not keep it.
    """

    kept: bool
    objective_before: float
    objective_after: float
    rollout_before: float
    rollout_after: float
    coef_standard_errors: Array
    guard_standard_errors: tuple[Array, ...]
    reset_standard_errors: tuple[Array | None, ...]
    covariance: Array | None = None

    @property
    def standard_errors(
        self,
    ) -> tuple[Array, tuple[Array, ...], tuple[Array | None, ...]]:
        """Of laws, guards and resets."""
        return (
            self.coef_standard_errors,
            self.guard_standard_errors,
            self.reset_standard_errors,
        )

    @property
    def advice(self) -> str:
        """What to do about it."""
        if self.kept:
            return "The refined automaton is the answer; nothing to do."
        is_a_fit = self.objective_after < DIVERGED
        told = "Rollouts of the recordings" if is_a_fit else "Laws and guards refined together"
        told += " became worse" if is_a_fit else " do not follow the recordings"
        return (
            f"{told}, and the automaton stays as it was found part "
            "by part: try a larger library or guard_degree, or look for switches that were missed."
        )

    def __str__(self) -> str:
        if not self.objective_after < DIVERGED:
            return self.advice
        sizes = self.objective_before, self.objective_after
        change = " -> ".join(f"{one:.1f}" if abs(one) < DIVERGED else f"{one:.3g}" for one in sizes)
        rolled = f"{self.rollout_before:.3g} -> {self.rollout_after:.3g}"
        said = f"Refined together: objective {change}, misfit of rollouts {rolled} of the noise."
        return said if self.kept else f"{said} {self.advice}"

    __repr__ = __str__


@dataclass(frozen=True)
class FreeRollouts:
    """Rollouts of an automaton that begin where the courses of an estimate do."""

    estimate: JointEstimate
    runs: list[Trajectory]
    names: NDArray[np.intp]  # in the automaton, of each mode that was found

    @classmethod
    def of(cls, assembled: Assembled, estimate: JointEstimate) -> FreeRollouts:
        """Those of an automaton, one for each course."""
        nodes, names, runs = estimate.nodes, np.argsort(assembled.order), []
        for first, (t, _, u) in zip(nodes.first, _samples(estimate), strict=True):
            runs.append(
                assembled.automaton.simulate(
                    estimate.states[first],
                    t,
                    u if u.shape[1] else None,
                    mode=int(names[nodes.modes[first]]),
                    input_hold="linear",
                )
            )
        return cls(estimate, runs, names)

    def misfit(self, noise: Array) -> float:
        """Mean deviation from the samples, in units of the noise.

        A rollout that ends early, or is far off, counts as one that stays at the mean.
        """
        total, count = 0.0, 0
        for (_, y, _), run in zip(_samples(self.estimate), self.runs, strict=True):
            rolled = np.full(y.shape, np.inf)
            rolled[: len(run.x)] = run.x
            seen = np.isfinite(y).any(axis=0)
            off = np.minimum(np.abs(y - rolled)[:, seen], np.nanstd(y[:, seen], axis=0))
            off = off / noise[seen]
            total, count = total + float(np.nansum(off)), count + int(np.isfinite(y).sum())
        return total / max(1, count)

    def missed(self, pairs: Sequence[tuple[int, int]]) -> Array:
        """Times by which they miss the switches of the courses, (n_switches,); inf where none is.

        `pairs` are the modes that each transition leads from and to.
        """
        missed = []
        for course, run in zip(self.estimate.nodes.stays, self.runs, strict=True):
            for instant, number in zip(course.instants, course.transitions, strict=True):
                source, target = self.names[list(pairs[number])]
                seen = [
                    one.time for one in run.events if (one.before, one.after) == (source, target)
                ]
                missed.append(np.abs(np.array(seen) - instant).min(initial=np.inf))
        return np.array(missed)


def _samples(estimate: JointEstimate) -> Iterator[tuple[Array, Array, Array]]:
    """Times, measured states and inputs at the samples of each course."""
    recordings = estimate.nodes.recordings
    for k, (t, places) in enumerate(zip(recordings.times, recordings.sampled, strict=True)):
        yield t[places], recordings.y[places, k], recordings.u[places, k]
