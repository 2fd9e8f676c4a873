r"""The bilevel alternation: estimate, assign, refit the surface, record, stop.

There is one loop and one joint objective for any number of rows,

.. math:: J = \sum_i w_i \, \mathrm{loss}_i / s + \kappa \Big( \sum_i w_i \, \mathrm{slack}_i
    + \beta \| a \|_1 \Big) .

What differs is how the rows are seen: in memory all at once (`alternate`), or in passes over their
blocks that keep the few rows whose sign may still change (`all_rows`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Generic, Protocol, TypeVar

import numpy as np

from swsysid._identification.problem import Costs, CoupledSurface, Modes, SwitchingProblem
from swsysid._results import Array, IterationRecord
from swsysid._surfaces.surface import Classifier
from swsysid.relaxations._base import one_hot


class Iterate(Protocol):
    """Vector fields and surfaces, and the assignment that they lead to."""

    @property
    def measures(self) -> tuple[float, ...]:
        """What must stop to decrease before the descent has converged: J first."""

    @property
    def is_fixed(self) -> bool:
        """True if the next iterate would be the same."""

    @property
    def no_gain(self) -> float:
        """Decrease of a measure that is no more than a rounding error."""

    def record(self, iteration: int) -> IterationRecord:
        """What the history says of it."""


State = TypeVar("State", bound=Iterate)


class Rows(Protocol[State]):
    """Rows as a descent sees them."""

    def next(self, iterate: State) -> State | None:
        """Vector fields and surfaces for the labels of an iterate, and the assignment to these.

        None if these rows cannot improve the iterate although it has not converged.
        """

    def renewed(self, iterate: State) -> State:
        """A converged iterate with a better mode-book; the same object if there is none."""


@dataclass(frozen=True)
class Descent(Generic[State]):
    """Where a descent ended."""

    last: State
    history: tuple[IterationRecord, ...]
    converged: bool
    # True if the rows could not improve the last iterate although it has not converged.
    stalled: bool


def descend(rows: Rows[State], start: State, *, max_iter: int, tol: float) -> Descent[State]:
    """Iterate until an assignment repeats, or no measure decreases by more than `tol`, relatively.

    `start` needs labels, or vector fields and a surface; it is not recorded.
    """
    history: list[IterationRecord] = []
    last, converged = start, False
    while not converged and len(history) < max_iter:
        following = rows.next(last)  # estimate, assign, refit the surface
        if following is None:
            return Descent(last, tuple(history), False, True)
        history.append(following.record(len(history) + 1))
        converged = len(history) > 1 and _has_settled(last, following, tol)
        last = following
        if converged:
            renewed = rows.renewed(last)
            last, converged = renewed, renewed is last
    return Descent(last, tuple(history), converged, False)


def _has_settled(before: Iterate, last: Iterate, tol: float) -> bool:
    return last.is_fixed or all(
        old - new <= tol * abs(old) + last.no_gain
        for old, new in zip(before.measures, last.measures, strict=True)
    )


@dataclass(frozen=True)
class Alternation:
    """Where the alternation from one start ended."""

    coef: Array  # (n_modes, n_states, n_features_out)
    membership: Array  # (n_samples, n_modes): of the last assignment, which was made for `coef`
    modes: Modes  # (n_samples,): the hardened membership
    surface: Classifier | None  # the one the last assignment was coupled to, if there was one
    objective: float  # joint objective of `coef`, `modes` and `surface`
    history: tuple[IterationRecord, ...]
    converged: bool


# The alternation from a membership, once it is said when to stop.
AlternateFrom = Callable[[SwitchingProblem, Array], Alternation]


def alternate(
    problem: SwitchingProblem, membership: Array, *, max_iter: int, tol: float
) -> Alternation:
    """Descend from a starting membership, and harden what is found."""
    modes = membership.argmax(axis=1)
    start = _Assigned(None, membership, modes, problem.fit_surface(modes))
    rows = _InMemory(problem)
    found = descend(rows, start, max_iter=max_iter, tol=tol)
    last = found.last
    if not (found.converged and last.is_fixed):
        hard = replace(last, membership=one_hot(last.modes, problem.n_modes))
        last = rows.next(hard, refits=False)
    assert last.coef is not None, "a descent makes at least one iteration"
    return Alternation(
        coef=last.coef,
        membership=last.membership,
        modes=last.modes,
        surface=None if last.surface is None else last.surface.classifier,
        objective=last.objective,
        history=found.history,
        converged=found.converged,
    )


@dataclass(frozen=True)
class _Assigned:
    """An iterate of rows in memory; of a start only labels and surface are known."""

    coef: Array | None
    membership: Array
    modes: Modes
    surface: CoupledSurface | None
    objective: float = np.inf
    costs: Costs = Costs(np.inf, np.inf, np.inf, np.inf, 0.0)
    mode_changes: int = 0
    tightness: float = 0.0
    seconds: float = 0.0

    no_gain = 0.0  # vector fields and surfaces are optimal to machine precision

    @property
    def measures(self) -> tuple[float, float]:
        return self.objective, self.costs.relaxed_loss

    @property
    def is_fixed(self) -> bool:
        return self.mode_changes == 0 and self.tightness == 1.0

    def record(self, iteration: int) -> IterationRecord:
        return IterationRecord(
            iteration=iteration,
            objective=self.objective,
            loss=self.costs.hard_loss,
            lower_bound=self.costs.relaxed_loss,
            mode_changes=self.mode_changes,
            tightness=self.tightness,
            seconds=self.seconds,
            modes=self.modes.astype(np.int8),
        )


@dataclass(frozen=True)
class _InMemory:
    """The rows of a problem, seen all at once."""

    problem: SwitchingProblem

    def next(self, iterate: _Assigned, refits: bool = True) -> _Assigned:
        """Vector fields for the memberships, memberships for these, a surface for their labels."""
        started, problem, surface = perf_counter(), self.problem, iterate.surface
        coef = problem.estimate(iterate.membership, iterate.coef)
        velocities = problem.velocities(coef)
        penalty = None if surface is None else surface.penalty
        assignment = problem.assign_velocities(velocities, penalty)
        modes, costs = assignment.modes, problem.costs(velocities, assignment)
        mode_changes = int(np.sum(modes != iterate.modes))
        if surface is not None and mode_changes and refits:
            surface = problem.refit_surface(modes, surface)
        surface_cost = 0.0 if surface is None else problem.surface_cost(surface, modes)
        return _Assigned(
            coef=coef,
            membership=assignment.membership,
            modes=modes,
            surface=surface,
            objective=problem.joint_objective(costs.loss, surface_cost),
            costs=costs,
            mode_changes=mode_changes,
            tightness=float(np.average(assignment.tightness, weights=problem.weight)),
            seconds=perf_counter() - started,
        )

    def renewed(self, iterate: _Assigned) -> _Assigned:
        """With a better mode-book, if there is one."""
        if iterate.surface is None:
            return iterate
        surface = self.problem.renew_book(iterate.modes, iterate.surface)
        return iterate if surface is iterate.surface else replace(iterate, surface=surface)


def relabel(result: Alternation, order: Modes) -> Alternation:
    """The same result with its modes in another order, or without some of them."""
    rank = np.full(result.coef.shape[0], -1, dtype=np.int8)
    rank[order] = np.arange(len(order))
    return replace(
        result,
        coef=result.coef[order],
        membership=result.membership[:, order],
        modes=rank[result.modes].astype(np.intp),
        history=tuple(replace(record, modes=rank[record.modes]) for record in result.history),
    )
