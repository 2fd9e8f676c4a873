"""The bilevel alternation from one start: assign, estimate, refit the surface, record, stop."""

from __future__ import annotations

from dataclasses import dataclass, replace
from time import perf_counter
from typing import Any

import numpy as np

from swsysid._identification.problem import CoupledSurface, Modes, SwitchingProblem, one_hot
from swsysid._results import Array, Assignment, IterationRecord

__all__ = ["Alternation", "alternate"]


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


def alternate(
    problem: SwitchingProblem, membership: Array, *, max_iter: int, tol: float
) -> Alternation:
    """Alternate the three convex programs from a starting membership.

    Stops when an assignment repeats, or when an iteration improves neither the joint objective
    nor the relaxed loss by more than `tol`, relatively.
    """
    modes = membership.argmax(axis=1)
    surface = problem.fit_surface(modes)
    coef, history, converged = None, [], False
    for iteration in range(1, max_iter + 1):
        started = perf_counter()
        coef = problem.estimate(membership, coef)
        assignment = problem.assign(coef, _penalty(surface))
        if surface is not None and not np.array_equal(assignment.modes, modes):
            surface = problem.refit_surface(assignment.modes, surface)
        history.append(
            _record(problem, iteration, coef, assignment, modes, surface, perf_counter() - started)
        )
        membership, modes = assignment.membership, assignment.modes
        if converged := _has_converged(history, tol):
            renewed = None if surface is None else problem.renew_book(modes, surface)
            if renewed is surface:
                break
            surface, converged = renewed, False
    return _settle(problem, coef, membership, surface, history, converged)


def _record(problem, iteration, coef, assignment: Assignment, previous: Modes, surface, seconds):
    modes = assignment.modes
    return IterationRecord(
        iteration=iteration,
        objective=problem.joint_objective(coef, modes, surface),
        loss=problem.hard_loss(coef, modes),
        lower_bound=problem.relaxed_loss(coef, assignment.membership),
        mode_changes=int(np.sum(modes != previous)),
        tightness=float(np.average(assignment.tightness, weights=problem.weight)),
        seconds=seconds,
        modes=modes.astype(np.int8),
    )


def _penalty(surface: CoupledSurface | None) -> Array | None:
    return None if surface is None else surface.penalty


def _has_converged(history: list[IterationRecord], tol: float) -> bool:
    if len(history) < 2:
        return False
    last, before = history[-1], history[-2]
    if last.mode_changes == 0 and last.tightness == 1.0:
        return True  # a fixed point: the next iteration would be the same
    return before.objective - last.objective <= tol * abs(
        before.objective
    ) and before.lower_bound - last.lower_bound <= tol * abs(before.lower_bound)


def _settle(problem, coef, membership, surface, history, converged) -> Alternation:
    """Harden: vector fields for the hard labels, then the labels these fields ask for.

    Nothing is left to do where the last assignment repeated itself and was one-hot already.
    """
    if not (converged and history[-1].mode_changes == 0 and history[-1].tightness == 1.0):
        coef = problem.estimate(one_hot(membership.argmax(axis=1), problem.n_modes), coef)
        membership = problem.assign(coef, _penalty(surface)).membership
    modes = membership.argmax(axis=1)
    return Alternation(
        coef=coef,
        membership=membership,
        modes=modes,
        surface=None if surface is None else surface.classifier,
        objective=problem.joint_objective(coef, modes, surface),
        history=tuple(history),
        converged=converged,
    )


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
