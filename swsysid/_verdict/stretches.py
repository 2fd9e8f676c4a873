"""Rollouts over stretches of recordings that a model has not seen, each from its best start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._data.recordings import Record
from swsysid._data.trajectories import spread
from swsysid._results import Array
from swsysid._simulation.model import SwitchingModel
from swsysid._verdict.settings import JUDGING
from swsysid.refinement._parameters import Parametrization
from swsysid.refinement._shooting import Pieces, Shooting, Units
from swsysid.refinement._system import System, substeps_for


@dataclass(frozen=True)
class Stretches:
    """Recordings cut into stretches of about as many samples, with all states roughly."""

    parts: list[Record]
    guess: list[Array]  # of each part, (n_samples, n_states)

    @classmethod
    def of(cls, records: Sequence[Record], guess: Sequence[Array]) -> Stretches:
        """No sample is in two stretches."""
        parts, states = [], []
        for record, rough in zip(records, guess, strict=True):
            count = max(1, round(len(record.t) / JUDGING.stretch))
            for rows in np.array_split(np.arange(len(record.t)), count):
                parts.append(Record(record.t[rows], record.y[rows], record.u[rows]))
                states.append(rough[rows])
        return cls(parts, states)

    @property
    def blocks(self) -> NDArray[np.intp]:
        """Stretch of every sample."""
        return np.repeat(np.arange(len(self.parts)), [len(part.t) for part in self.parts])

    def left_by(self, system: SwitchingModel, noise: Array) -> Array:
        """What rollouts leave of all samples, (n_samples, n_channels); NaN where none is measured.

        The start of every stretch is the one of highest likelihood, by Levenberg and Marquardt's
        steps for all stretches at once. `noise` are the standard deviations of the channels.
        """
        shooting, every = self._shooting(System(system), noise), len(self.parts)
        starts = shooting.begins / shooting.units.states
        left, slopes = shooting.residuals(starts.ravel()), shooting.slopes(starts.ravel())
        damping = np.full(len(starts), JUDGING.damping)
        for _ in range(JUDGING.turns):
            trial = starts - _damped(slopes, left, shooting.segment, damping)
            again = shooting.residuals(trial.ravel())
            varied = shooting.slopes(trial.ravel())
            sums = (np.bincount(shooting.segment, one**2, every) for one in (again, left))
            better = np.less(*sums)
            damping *= np.where(better, 0.2, 5.0)
            starts[better], own = trial[better], better[shooting.segment]
            left[own], slopes[own] = again[own], varied[own]
        found = np.full(shooting.y.shape, np.nan)
        found[shooting.measured] = left
        return found * noise

    def _shooting(self, system: System, noise: Array) -> Shooting:
        """Rollouts of all stretches, of which nothing but their starts is free."""
        guess, u = np.vstack(self.guess), np.vstack([part.u for part in self.parts])
        columns, n_states = np.hstack([guess, u]), guess.shape[1]
        sizes, places = spread(columns), np.arange(len(self.parts))
        longest = max(float(np.diff(part.t).max()) for part in self.parts)
        return Shooting(
            system,
            Parametrization(system, np.zeros(system.model.coef.shape, bool), False, frozen=True),
            Pieces(self.parts, self.guess, places, 0 * places, places < 0),
            np.arange(len(noise)),
            Units(
                np.zeros(0), sizes[:n_states], sizes[n_states:], noise, np.full(n_states, np.inf)
            ),
            substeps_for(system.known(sizes)[0], columns, longest),
            linear=True,
        )


def _damped(slopes: Array, left: Array, stretch: NDArray[np.intp], damping: Array) -> Array:
    """Steps of all stretches, unknowns in units in which the diagonal is one."""
    n = slopes.shape[1]
    matrix, right = np.zeros((len(damping), n, n)), np.zeros((len(damping), n))
    np.add.at(matrix, stretch, slopes[:, :, None] * slopes[:, None, :])
    np.add.at(right, stretch, slopes * left[:, None])
    diagonal = np.einsum("sii->si", matrix)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrix * unit[:, :, None] * unit[:, None]
    scaled += (damping[:, None] + 1e-12)[:, :, None] * np.eye(n)
    return np.linalg.solve(scaled, (right * unit)[:, :, None])[:, :, 0] * unit
