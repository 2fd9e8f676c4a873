"""The likelihood of the samples, with legs tied to each other through switches and jumps."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_shooting.equations import JointEquations, add_blocks
from swsysid._automaton_shooting.estimate import Flown, JointEstimate
from swsysid._results import Array
from swsysid._stays.information import covariance_of

Numbers = NDArray[np.intp]


@dataclass(frozen=True)
class JointObjective:
    """Half the sum of squares; `noise` are standard deviations (n_states,).

    Legs are tied within `tie` of the noise, and crossings lie on their guards within `guard_time`.
    Where more than `most_beyond` samples are beyond a guard the modes are others: infinite.
    """

    noise: Array
    tie: float
    guard_time: float
    sources: Numbers
    most_beyond: int

    def allows(self, estimate: JointEstimate) -> bool:
        """True if instants are in order and modes are those that guards allow."""
        return estimate.is_in_order and estimate.beyond(self.sources) <= self.most_beyond

    def value(self, estimate: JointEstimate) -> float:
        """Half the sum of squares."""
        if not self.allows(estimate):
            return np.inf
        squares = [
            np.square(part).sum() for part in self._residuals(estimate, estimate.plainly_flown)
        ]
        return float(0.5 * sum(squares))

    def normal_equations(self, estimate: JointEstimate) -> JointEquations:
        """Gauss and Newton's equations, instants held by half a nat for an interval."""
        equations = self._equations(estimate)
        return replace(equations, matrix=equations.matrix + np.diag(estimate.hold))

    def _equations(self, estimate: JointEstimate) -> JointEquations:
        done = estimate.flown()
        misfit, gaps, misses = self._residuals(estimate, done)
        # a last row and column take what belongs to no unknown
        n_unknowns = estimate.n_unknowns
        matrix, right = np.zeros((n_unknowns + 1, n_unknowns + 1)), np.zeros(n_unknowns + 1)
        columns = _columns(estimate)
        assert done.varied is not None
        seen = np.isfinite(done.grid.y)[..., None]
        slopes = np.where(seen, done.varied, 0.0) / self.noise[:, None]
        n, width = columns.shape
        add_blocks(
            matrix, right, columns,
            slopes.transpose(1, 0, 2, 3).reshape(n, -1, width),
            misfit.transpose(1, 0, 2).reshape(n, -1),
        )  # fmt: skip
        self._add_ties(matrix, right, estimate, done, columns, gaps)
        self._add_guards(matrix, right, estimate, done, columns, misses)
        value = 0.5 * sum(np.square(part).sum() for part in (misfit, gaps, misses))
        return JointEquations(matrix[:-1, :-1], right[:-1], float(value))

    def covariance(self, estimate: JointEstimate) -> Array:
        """Of the unknowns of the automaton; the others are eliminated.

        Infinite where no sample and no switch says anything.
        """
        n = estimate.n_shared
        return covariance_of(self._equations(estimate).matrix)[:n, :n]

    # -- parts -------------------------------------------------------------------------------------

    def _misfit(self, done: Flown) -> Array:
        return np.nan_to_num((done.grid.y - done.states) / self.noise)

    def _residuals(self, estimate: JointEstimate, done: Flown) -> tuple[Array, Array, Array]:
        """Misfits of samples, gaps between legs, and times by which guards are missed."""
        legs = np.flatnonzero(estimate.legs.followed)
        landed, _, _ = estimate.resets.landings(_taken(estimate, legs), done.states[-1, legs])
        gaps = (estimate.starts[legs + 1] - landed) / (self.tie * self.noise)
        columns, rates = estimate.crossed(done)
        transitions, told = estimate.legs.transitions, estimate.legs.guarded
        values, slopes, _ = estimate.guards.values(transitions[told], columns[told])
        rises = np.abs(np.einsum("kc,kc->k", slopes, np.nan_to_num(rates[told])))
        return self._misfit(done), gaps, values / rises / self.guard_time

    def _add_ties(
        self,
        matrix: Array,
        right: Array,
        estimate: JointEstimate,
        done: Flown,
        columns: Numbers,
        gaps: Array,
    ) -> None:
        """Add what legs say that do not meet."""
        legs, n_states = np.flatnonzero(estimate.legs.followed), estimate.starts.shape[1]
        x, by_start, by_end = _at_ends(estimate, done, legs)
        _, jacobian, by_reset = estimate.resets.landings(_taken(estimate, legs), x)
        ahead = np.tile(-np.eye(n_states), (len(legs), 1, 1))
        slopes = [jacobian @ by_start, (jacobian @ by_end[..., None]), by_reset, ahead]
        first = estimate.laws.n_free + estimate.guards.n_free
        resets = np.tile(first + np.arange(estimate.resets.n_free), (len(legs), 1))
        starts = estimate.n_shared + (legs[:, None] + 1) * n_states + np.arange(n_states)
        places = [columns[legs], _instants(estimate, estimate.legs.ended_by[legs])[:, None]]
        add_blocks(
            matrix, right, np.hstack([*places, resets, starts]),
            np.concatenate(slopes, axis=2) / (self.tie * self.noise)[:, None],
            gaps,
        )  # fmt: skip

    def _add_guards(
        self,
        matrix: Array,
        right: Array,
        estimate: JointEstimate,
        done: Flown,
        columns: Numbers,
        misses: Array,
    ) -> None:
        """Add what crossings say that miss their guards."""
        told = np.flatnonzero(estimate.legs.guarded)
        legs, n_states = estimate.ending[told], estimate.starts.shape[1]
        at, rates = (part[told] for part in estimate.crossed(done))
        transitions = estimate.legs.transitions[told]
        _, by_columns, by_guard = estimate.guards.values(transitions, at)
        by_columns = np.nan_to_num(by_columns)
        _, by_start, _ = _at_ends(estimate, done, legs)
        scale = np.abs(np.einsum("kc,kc->k", by_columns, rates)) * self.guard_time
        slopes = np.column_stack([
            np.einsum("kx,kxz->kz", by_columns[:, :n_states], by_start),
            np.einsum("kc,kc->k", by_columns, rates),
            -by_columns[:, -2],  # an instant later at which the mode was entered, a shorter dwell
            by_guard,
        ])  # fmt: skip
        first = estimate.laws.n_free
        guards = np.tile(first + np.arange(estimate.guards.n_free), (len(told), 1))
        entered = _instants(estimate, estimate.legs.entered_by[legs])
        own = _instants(estimate, estimate.legs.ended_by[legs])
        places = np.hstack([columns[legs], own[:, None], entered[:, None], guards])
        add_blocks(matrix, right, places, (slopes / scale[:, None])[:, None, :], -misses[:, None])


def _taken(estimate: JointEstimate, legs: Numbers) -> Numbers:
    """The transitions at the ends of legs, -1 where there is none."""
    ended_by = estimate.legs.ended_by[legs]
    return np.where(ended_by >= 0, np.append(estimate.legs.transitions, -1)[ended_by], -1)


def _at_ends(estimate: JointEstimate, done: Flown, legs: Numbers) -> tuple[Array, Array, Array]:
    """States at the ends of legs, and how they change with what comes before and with the end."""
    assert done.varied is not None
    x = done.states[-1, legs]
    moves = estimate.laws.velocities(estimate.legs.modes[legs], x, done.grid.u[-1, legs])
    return x, done.varied[-1, legs], moves


def _instants(estimate: JointEstimate, switches: Numbers) -> Numbers:
    """Unknowns of the instants of switches, the last one for none."""
    first = estimate.n_unknowns - len(estimate.instants)
    return np.where(switches >= 0, first + switches, estimate.n_unknowns)


def _columns(estimate: JointEstimate) -> Numbers:
    """Unknown of every column of the sensitivities, (n_legs, n_states + n_free + 1)."""
    n, n_states = estimate.starts.shape
    own = estimate.n_shared + np.arange(n * n_states).reshape(n, n_states)
    shared = np.tile(np.arange(estimate.laws.n_free), (n, 1))
    begun = _instants(estimate, estimate.legs.begun_by)
    return np.hstack([own, shared, begun[:, None]])
