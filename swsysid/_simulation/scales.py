"""In what the states of a rollout are counted: tolerances, limits and differences follow them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swsysid._data.extent import Extent
from swsysid._results import Array
from swsysid._simulation.settings import SETTINGS


@dataclass(frozen=True)
class Scales:
    """Origin and size of every state, and how far from a middle it may go."""

    origin: Array  # (n_states,): the integrator's states are counted from here
    size: Array  # (n_states,)
    atol: Array  # (n_states,)
    middle: Array  # (n_states,)
    bound: Array  # (n_states,)

    @classmethod
    def of(
        cls, extent: Extent | None, x0: Array, atol: float | None, state_bound: float | None
    ) -> Scales:
        """Sizes are spreads of the data; where nobody knows these, the first state tells.

        A state that starts at zero is then as large as a small part of the largest one.
        """
        origin = np.zeros(len(x0)) if extent is None else extent.centre
        away = np.nan_to_num(np.abs(x0 - origin), posinf=0.0)
        size = np.maximum(away, SETTINGS.least_size * (away.max(initial=0.0) or 1.0))
        if not away.any():
            size = np.ones(len(x0))
        if extent is not None:
            size = np.where(extent.spread > 0.0, extent.spread, size)
        tolerance = SETTINGS.atol * size if atol is None else np.full(len(x0), atol)
        if state_bound is not None:
            return cls(origin, size, tolerance, 0.0 * origin, np.full(len(x0), state_bound))
        return cls(origin, size, tolerance, origin, SETTINGS.state_bound * np.maximum(size, away))

    def repeated(self, n_rows: int) -> Scales:
        """Those of so many rows of states in one vector."""
        return Scales(*(np.tile(part, n_rows) for part in vars(self).values()))
