"""What a method has found, in the terms in which it is judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from numpy.typing import NDArray

from benchmarks.automata.plant import Array, Start

__all__ = ["Found", "Guard", "Rollout"]

Guard = Callable[[Array], Array]


class Rollout(NamedTuple):
    """States at the sample times reached, and when it switched or jumped."""

    x: Array
    instants: Array


@dataclass(frozen=True)
class Found:
    """An automaton as a method tells it.

    Attributes
    ----------
    n_modes : int
    modes : ndarray of shape (n_rows,), int
        Of the rows that it was given.
    instants : list of ndarray
        When each of its recordings switches or jumps.
    roll : callable
        The rollout from a start, its mode one of those found, at times and with inputs.
    guard : callable
        For a source and a target among the modes found, a function of rows of columns of laws,
        dwell and time, (n_rows, n_columns) -> (n_rows,), that rises to zero at the transition;
        None if there is no such transition.
    """

    n_modes: int
    modes: NDArray
    instants: list[Array]
    roll: Callable[[Start, Array, Array | None], Rollout]
    guard: Callable[[int, int], Guard | None]
