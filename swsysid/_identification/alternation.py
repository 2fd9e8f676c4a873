"""The descent of rows in memory, from one start."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from swsysid._identification.descent import descend
from swsysid._identification.problem import (
    Costs,
    CoupledSurface,
    Modes,
    SwitchingProblem,
    one_hot,
)
from swsysid._results import Array, IterationRecord

__all__ = ["AlternateFrom", "Alternation", "alternate", "relabel"]


@dataclass(frozen=True)
class Alternation:
    """Where the alternation from one start ended.

    Attributes
    ----------
    coef : ndarray of shape (n_modes, n_states, n_features_out)
    membership : ndarray of shape (n_samples, n_modes)
        Of the last assignment, which was made for `coef`.
    modes : ndarray of shape (n_samples,), int
        The hardened membership.
    surface : classifier or None
        The one the last assignment was coupled to, None if it was not coupled.
    objective : float
        Joint objective of `coef`, `modes` and `surface`.
    history : tuple of IterationRecord
    converged : bool
    """

    coef: Array
    membership: Array
    modes: Modes
    surface: Any
    objective: float
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
    found = descend(_InMemory(problem), start, max_iter=max_iter, tol=tol)
    last = found.last
    if not (found.converged and last.is_fixed):
        last = _hardened(problem, last)
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

    def next(self, iterate: _Assigned) -> _Assigned:
        """Vector fields for the memberships, memberships for these, a surface for their labels."""
        started, problem, surface = perf_counter(), self.problem, iterate.surface
        coef = problem.estimate(iterate.membership, iterate.coef)
        velocities = problem.velocities(coef)
        assignment = problem.assign_velocities(velocities, _penalty(surface))
        modes, costs = assignment.modes, problem.costs(velocities, assignment)
        mode_changes = int(np.sum(modes != iterate.modes))
        if surface is not None and mode_changes:
            surface = problem.refit_surface(modes, surface)
        return _Assigned(
            coef=coef,
            membership=assignment.membership,
            modes=modes,
            surface=surface,
            objective=_objective(problem, costs.loss, modes, surface),
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


def _hardened(problem: SwitchingProblem, last: _Assigned) -> _Assigned:
    """Vector fields for the hard labels, then the labels that these fields ask for."""
    coef = problem.estimate(one_hot(last.modes, problem.n_modes), last.coef)
    velocities = problem.velocities(coef)
    assignment = problem.assign_velocities(velocities, _penalty(last.surface))
    modes = assignment.modes
    loss = problem.costs(velocities, assignment).loss
    objective = _objective(problem, loss, modes, last.surface)
    return replace(
        last, coef=coef, membership=assignment.membership, modes=modes, objective=objective
    )


def _objective(problem, loss: float, modes: Modes, surface: CoupledSurface | None) -> float:
    cost = 0.0 if surface is None else problem.surface_cost(surface, modes)
    return problem.joint_objective(loss, cost)


def _penalty(surface: CoupledSurface | None) -> Array | None:
    return None if surface is None else surface.penalty


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
