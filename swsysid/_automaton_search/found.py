"""One transition as it was found."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.guards import FoundGuard
from swsysid._automaton_search.resets import FoundReset
from swsysid._results import Array


@dataclass(frozen=True)
class FoundTransition:
    """Guard and reset of a transition, and when it was taken."""

    source: int
    target: int
    recording: NDArray[np.intp]  # (n_switches,)
    times: Array  # (n_switches,)
    guard: FoundGuard | None
    reset: FoundReset | None

    def __len__(self) -> int:
        return len(self.times)

    @property
    def is_one(self) -> bool:
        """True if something changes: the mode, or the state."""
        return self.jumps or self.source != self.target

    @property
    def jumps(self) -> bool:
        """True if the state does not go on."""
        return self.reset is not None and bool(self.reset.changed.any())
