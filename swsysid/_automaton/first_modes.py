"""The mode in which a rollout starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import Transition
from swsysid._results import Array


@dataclass(frozen=True, eq=False)
class FirstModes:
    """States of the recordings with their modes, which tell the mode that a rollout starts in.

    Attributes
    ----------
    states : ndarray of shape (n_rows, n_states * (lags + 1))
        The columns of states of the laws, newest first.
    modes : ndarray of shape (n_rows,), int
    """

    states: Array
    modes: NDArray[np.intp]

    def nearest(self, state: Array, among: Sequence[int]) -> int | None:
        """The mode, of some, whose recorded states come nearest in units of their deviation.

        None where none of them was recorded.
        """
        spread = self.states.std(axis=0)
        distances = (self.states - state) / np.where(spread > 0.0, spread, 1.0)
        known = np.isin(self.modes, among)
        if not known.any():
            return None
        return int(self.modes[np.where(known, (distances**2).sum(axis=1), np.inf).argmin()])


def first_mode(
    transitions: Sequence[Transition],
    n_modes: int,
    columns: Array,
    state: Array,
    recorded: FirstModes | None,
) -> int:
    """The only mode that no guard leads out of at the start, else the one recorded nearest.

    `columns` are those of guards at the start; `state` its columns of states.
    """
    left = {one.source for one in transitions if one.guard.at(columns) >= 0.0}
    possible = [mode for mode in range(n_modes) if mode not in left] or list(range(n_modes))
    if len(possible) == 1:
        return possible[0]
    nearest = None if recorded is None else recorded.nearest(state, possible)
    if nearest is None:
        listed = ", ".join(map(str, possible))
        raise ValueError(f"the guards leave the modes {listed} possible at the start; give mode.")
    return nearest
