r"""The bilevel alternation: estimate, assign, refit the surface, record, stop.

There is one loop and one joint objective for any number of rows,

.. math:: J = \sum_i w_i \, \mathrm{loss}_i / s + \kappa \Big( \sum_i w_i \, \mathrm{slack}_i
    + \beta \| a \|_1 \Big) .

What differs is how the rows are seen: in memory all at once (`alternation`), or in passes over
their blocks that keep the few rows whose sign may still change (`passes`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from swsysid._results import IterationRecord

__all__ = ["Descent", "Iterate", "Rows", "descend"]


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
    """Where a descent ended.

    Attributes
    ----------
    last : Iterate
    history : tuple of IterationRecord
    converged : bool
    stalled : bool
        True if the rows could not improve the last iterate although it has not converged.
    """

    last: State
    history: tuple[IterationRecord, ...]
    converged: bool
    stalled: bool


def descend(rows: Rows[State], start: State, *, max_iter: int, tol: float) -> Descent[State]:
    """Iterate until an assignment repeats, or no measure decreases by more than `tol`, relatively.

    `start` needs labels, or vector fields and a surface; it is not recorded.
    """
    history: list[IterationRecord] = []
    last, converged = start, False
    while not converged and len(history) < max_iter:
        following = rows.next(last)
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
