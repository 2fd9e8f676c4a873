r"""Rows that a smoother has made: what it does to a model, and which of them share nothing.

The smoother makes the velocity of a row of a window of measurements. Neighbours share most of them
and so their noise, and a row next to a switch is a mixture of two laws: correlation in time, a
dependence on what came before, and larger residuals near the surface are then the smoother's own.
It also bends what is curved over a window: with M the mean that a slope shows, :math:`M - 1` of a
velocity, and for laws that are linear nearly, of the states and inputs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._data.windows import Windows, stays_of
from swsysid._residual_report.channels import without
from swsysid._residual_report.settings import SETTINGS
from swsysid._results import Array


@dataclass(frozen=True)
class Smoothed:
    """Windows of a smoother within the modes that a model says."""

    windows: Windows

    @classmethod
    def of(cls, records: Records, modes: NDArray | None, window: int) -> Smoothed:
        """Those of a record in order of time."""
        assert records.t is not None
        modes = np.zeros(len(records)) if modes is None else modes
        stays = stays_of(modes, records.trajectories)
        return cls(Windows(records.t, stays, window // 2, SETTINGS.degree))

    @property
    def apart(self) -> NDArray[np.intp]:
        """Rows a window apart whose windows lie in one mode."""
        return self.windows.whole(self.windows.length)

    def straightened(self, residual: Array, X: Array, predicted: Array, modes: NDArray) -> Array:
        """The residual without what windows bend of states, inputs and velocities.

        A fitted model has taken of that what is linear in them, mode by mode.
        """
        rows = self.windows.whole()
        columns = np.hstack([X, predicted])
        bent = (self.windows.means @ columns - columns)[rows]
        own = np.column_stack([np.ones(len(rows)), columns[rows]])
        for mode in np.unique(modes[rows]):
            here = modes[rows] == mode
            bent[here] = without(own[here], bent[here])
        answer = residual.copy()
        answer[rows] = without(bent, residual[rows])
        return answer
