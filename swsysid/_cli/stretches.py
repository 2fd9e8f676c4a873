"""Rollouts over stretches of recordings that a model has not seen, each from its best start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.settings import JUDGING
from swsysid._data.trajectories import Record
from swsysid._results import Array
from swsysid._simulation.model import SwitchingModel
from swsysid.refinement._rollout import Segments, rollout, substeps_for
from swsysid.refinement._settings import SETTINGS as ROLLOUTS
from swsysid.refinement._system import Maps, ParameterSets, RowSystem


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
        shots, size = _Shots(system, self, noise), np.vstack(self.guess).std(axis=0)
        size = np.maximum(size, np.finfo(float).tiny)
        starts = np.array([rough[0] for rough in self.guess])
        left, slopes = shots.varied(starts, size)
        damping = np.full(len(starts), JUDGING.damping)
        for _ in range(JUDGING.turns):
            trial = starts - size * _damped(slopes, left, damping)
            again, varied = shots.varied(trial, size)
            better = np.square(again).sum(axis=1) < np.square(left).sum(axis=1)
            damping *= np.where(better, 0.2, 5.0)
            starts[better], left[better], slopes[better] = (
                new[better] for new in (trial, again, varied)
            )
        return shots.rows(left)


class _Shots:
    """All stretches side by side under one model; residuals are in units of the noise."""

    def __init__(self, system: SwitchingModel, stretches: Stretches, noise: Array):
        maps, parts = Maps(system), stretches.parts
        surface = np.empty((0, 0)) if maps.linear is None else maps.linear.coef
        n_owners = maps.n_states + 1
        self.maps, self.noise = maps, noise
        self.sets = ParameterSets(
            np.tile(system.coef, (n_owners, 1, 1, 1)), {}, np.tile(surface, (n_owners, 1, 1))
        )
        x, u = np.vstack(stretches.guess), np.vstack([part.u for part in parts])
        rows = np.unique(np.linspace(0, len(x) - 1, ROLLOUTS.most_rows).astype(int))
        at_rows = RowSystem(maps, self.sets, np.zeros(len(rows), dtype=np.intp))
        longest = max(float(np.diff(part.t).max()) for part in parts)
        substeps = substeps_for(at_rows, x[rows], u[rows], longest)
        most = max(len(part.t) for part in parts)
        self.segments = Segments(parts, most, linear=True, substeps=substeps)
        self.bound = ROLLOUTS.diverged * np.maximum(np.abs(x).max(axis=0), x.std(axis=0))
        self.lengths = [len(part.t) for part in parts]

    def varied(self, starts: Array, size: Array) -> tuple[Array, Array]:
        """Residuals (n_stretches, n_values), zero where none, and slopes by starts over `size`."""
        moves = ROLLOUTS.step * np.vstack([np.zeros(len(size)), np.diag(size)])
        moved = starts + moves[:, None]
        states, _ = rollout(self.maps, self.sets, self.segments, moved, self.bound)
        y = self.segments.y
        left = np.nan_to_num((states[..., : y.shape[2]] - y[:, None]) / self.noise)
        left = left.transpose(1, 2, 0, 3).reshape(len(moves), len(starts), -1)
        return left[0], (left[1:] - left[0]).transpose(1, 2, 0) / ROLLOUTS.step

    def rows(self, left: Array) -> Array:
        """Residuals in the units of the channels, the samples one after the other."""
        y = self.segments.y
        each = left.reshape(len(left), len(y), y.shape[2]) * self.noise
        each = np.where(np.isfinite(y.transpose(1, 0, 2)), each, np.nan)
        return np.concatenate([own[:n] for own, n in zip(each, self.lengths, strict=True)])


def _damped(slopes: Array, left: Array, damping: Array) -> Array:
    """Steps of all stretches, unknowns in units in which the diagonal is one."""
    matrix = slopes.transpose(0, 2, 1) @ slopes
    right = (slopes.transpose(0, 2, 1) @ left[:, :, None])[:, :, 0]
    diagonal = np.einsum("sii->si", matrix)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrix * unit[:, :, None] * unit[:, None]
    scaled += (damping[:, None] + 1e-12)[:, :, None] * np.eye(matrix.shape[1])
    return np.linalg.solve(scaled, (right * unit)[:, :, None])[:, :, 0] * unit
