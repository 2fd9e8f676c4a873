"""The guard of one transition, as far as rows of recordings can tell it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._results import Array


@dataclass(frozen=True)
class KnownGuard:
    """The guard of one transition without a clock, in the units of the user."""

    source: int
    target: int
    guard: PolynomialGuard
    width: float  # by how much its zero may be off, in units of its values

    @property
    def reads_clocks(self) -> bool:
        """True if it is of dwell or time, which no row knows."""
        return bool(self.guard.powers[:, -len(CLOCKS) :].any())

    def values(self, columns: Array) -> Array:
        """Values at rows of columns without clocks."""
        clocks = np.zeros((len(columns), len(CLOCKS)))
        return self.guard.values(np.hstack([columns, clocks]))
