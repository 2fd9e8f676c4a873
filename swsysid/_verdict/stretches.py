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
from swsysid._stays.output_error import OutputError
from swsysid._verdict.settings import JUDGING
from swsysid.refinement._parameters import ParametrizedPlant
from swsysid.refinement._system import grid_of, substeps_for


@dataclass(frozen=True)
class Stretches:
    """Recordings cut into stretches of about as many samples, with all states roughly."""

    parts: list[Record]
    guess: list[Array]  # of each part, (n_samples, n_states)

    @classmethod
    def of(cls, records: Sequence[Record], guess: Sequence[Array], length: int) -> Stretches:
        """Of about so many samples each, none of which is in two stretches."""
        parts, states = [], []
        for record, rough in zip(records, guess, strict=True):
            count = max(1, round(len(record.t) / length))
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

        The start of every stretch is the one of highest likelihood, all of them sought at once.
        `noise` are the standard deviations of the channels.
        """
        problem = self._problem(system, noise)
        begun = problem.begun(np.zeros(0), np.array([one[0] for one in self.guess]))
        best, _ = problem.least(begun, JUDGING.turns, JUDGING.settled)
        found = np.full(problem.y.shape, np.nan)
        found[problem.measured] = best.misfit
        return found * noise

    def _problem(self, model: SwitchingModel, noise: Array) -> OutputError:
        """Rollouts of all stretches, of which nothing but their starts is free."""
        guess, u = np.vstack(self.guess), np.vstack([part.u for part in self.parts])
        columns, n_states = np.hstack([guess, u]), guess.shape[1]
        sizes = spread(columns)
        longest = max(float(np.diff(part.t).max()) for part in self.parts)
        plant = ParametrizedPlant.known(model, sizes, len(noise))
        steps = substeps_for(plant.parts(np.zeros(0)).laws, columns, longest)
        return OutputError(
            plant,
            grid_of(plant.system, self.parts, self.guess, held=False, substeps=steps),
            np.concatenate([part.y for part in self.parts]),
            noise,
            np.full(n_states, np.inf),
        )
