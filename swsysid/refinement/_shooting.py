r"""Multiple shooting: residuals of all segments and their Jacobian.

The unknowns are the parameters :math:`\theta` and the states :math:`s_k` at which the segments
begin. The residuals are those of the measured channels and, times a weight, the defects
:math:`x_k(\theta, s_k) - s_{k+1}` between the end of a segment and the begin of the next.

One batched integration gives the whole Jacobian: owner 0 has the parameters themselves, the next
ones each parameter moved, the last ones one component of all :math:`s_k` moved. Its structure is

    [ dense in theta | block of s_k                    ]   samples of segment k
    [ dense in theta | block of s_k, minus one at s_k+1]   defect after segment k

so a row has as many nonzero columns as there are parameters and states, however many segments.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from swsysid._results import Array
from swsysid.refinement._parameters import Parametrization
from swsysid.refinement._rollout import rollout
from swsysid.refinement._segments import Segments
from swsysid.refinement._settings import SETTINGS, Settings
from swsysid.refinement._system import Maps, ParameterSets, RowSystem

__all__ = ["Blocks", "Shooting", "Units"]


@dataclass(frozen=True)
class Units:
    """In what the unknowns and the residuals count.

    Attributes
    ----------
    parameters : ndarray of shape (n_parameters,)
    states : ndarray of shape (n_states,)
    noise : ndarray of shape (n_outputs,)
    bound : ndarray of shape (n_states,)
        Magnitude at which a diverging state is held.
    """

    parameters: Array
    states: Array
    noise: Array
    bound: Array


@dataclass(frozen=True)
class Blocks:
    """Residuals of the samples and their derivatives, and the same for the ends of segments.

    Attributes
    ----------
    residuals : ndarray of shape (n_residuals,)
    by_parameters, by_start : ndarrays of shape (n_residuals, n_parameters or n_states)
    end : ndarray of shape (n_segments, n_states)
    end_by_parameters, end_by_start : ndarrays (n_segments, n_states, n_parameters or n_states)
    """

    residuals: Array
    by_parameters: Array
    by_start: Array
    end: Array
    end_by_parameters: Array
    end_by_start: Array


@dataclass(frozen=True)
class Shooting:
    """The least-squares problem of one set of segments.

    Attributes
    ----------
    maps : Maps
    parameters : Parametrization
    segments : Segments
    observed : ndarray of int
        Measured states, or all columns of the output.
    units : Units
    """

    maps: Maps
    parameters: Parametrization
    segments: Segments
    observed: NDArray[np.intp]
    units: Units
    settings: Settings = SETTINGS
    measured: NDArray[np.bool_] = field(init=False)

    def __post_init__(self) -> None:
        measured = np.isfinite(self.segments.y).transpose(1, 0, 2)
        object.__setattr__(self, "measured", measured)  # segment by segment

    @property
    def segment(self) -> NDArray[np.intp]:
        """Segment of each residual."""
        return np.nonzero(self.measured)[0]

    @property
    def n_parameters(self) -> int:
        """Number of free parameters."""
        return len(self.units.parameters)

    # -- the vector of unknowns ------------------------------------------------------------

    def join(self, vector: Array, starts: Array) -> Array:
        """Unknowns from parameters and any number of states, both in their units."""
        return np.concatenate(
            [vector / self.units.parameters, (starts / self.units.states).ravel()]
        )

    def split(self, unknowns: Array) -> tuple[Array, Array]:
        """Parameters and states, (n_starts, n_states)."""
        p = self.n_parameters
        starts = unknowns[p:].reshape(-1, self.maps.n_states)
        return unknowns[:p] * self.units.parameters, starts * self.units.states

    # -- residuals -------------------------------------------------------------------------

    def outputs(self, vectors: Array, starts: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Readings and ends for every owner: (n_owners, n_times, n_segments, n_outputs), ..."""
        sets = self.parameters.sets(vectors)
        states, bounded = self._states(sets, starts)
        ends = states[self.segments.count, :, np.arange(len(self.segments))].swapaxes(0, 1)
        return self._read(sets, states), ends, bounded

    def whole_states(self, vector: Array, starts: Array) -> tuple[Array, Array]:
        """Readings and states at all samples, (n_times, n_segments, ...)."""
        sets = self.parameters.sets(vector[None])
        states, _ = self._states(sets, starts[None])
        return self._read(sets, states)[0], states[:, 0]

    def _states(self, sets: ParameterSets, starts: Array) -> tuple[Array, NDArray[np.bool_]]:
        return rollout(self.maps, sets, self.segments.grid, starts, self.units.bound)

    def _read(self, sets: ParameterSets, states: Array) -> Array:
        """What the sensors read, (n_owners, n_times, n_segments, n_outputs)."""
        if self.maps.output is None:
            return states[..., self.observed].swapaxes(0, 1)
        n_times, n_owners, n_segments, n_states = states.shape
        owners = np.tile(np.repeat(np.arange(n_owners), n_segments), n_times)
        inputs = np.repeat(self.segments.grid.inputs[:, None], n_owners, axis=1)
        system = RowSystem(self.maps, sets, owners)
        with np.errstate(all="ignore"):
            read = system.output(states.reshape(-1, n_states), inputs.reshape(len(owners), -1))
        return read.reshape(n_times, n_owners, n_segments, -1)[..., self.observed].swapaxes(0, 1)

    def misfit(self, read: Array) -> Array:
        """Residuals in units of the noise, (n_owners, n_residuals), segment by segment."""
        scaled = (read - self.segments.y) / self.units.noise
        return scaled.transpose(0, 2, 1, 3)[:, self.measured]

    def residuals(self, unknowns: Array, weight: float) -> Array:
        """Residuals of the samples, then weighted defects."""
        vector, starts = self.split(unknowns)
        read, ends, _ = self.outputs(vector[None], starts[None])
        before = np.flatnonzero(self.segments.follower)
        defects = (ends[0, before] - starts[before + 1]) / self.units.states
        return np.concatenate([self.misfit(read)[0], weight * defects.ravel()])

    # -- derivatives -----------------------------------------------------------------------

    def ends(self, vector: Array, starts: Array) -> tuple[Array, Array, Array]:
        """Readings, ends of the segments, and their derivatives by the starts, in plain units."""
        read, ends = self._varied(np.empty((0, len(vector))), vector, starts)
        slopes = (ends[1:] - ends[0]).transpose(1, 2, 0) / (self.settings.step * self.units.states)
        return read[0], ends[0], slopes

    def blocks(self, vector: Array, starts: Array) -> Blocks:
        """Residuals, ends and their derivatives in units of the unknowns."""
        p, step = self.n_parameters, self.settings.step
        read, ends = self._varied(np.diag(step * self.units.parameters), vector, starts)
        misfit = self.misfit(read)
        slopes = (misfit[1:] - misfit[0]).T / step
        end_slopes = (ends[1:] - ends[0]).transpose(1, 2, 0) / step / self.units.states[:, None]
        return Blocks(
            misfit[0], slopes[:, :p], slopes[:, p:],
            ends[0], end_slopes[:, :, :p], end_slopes[:, :, p:],
        )  # fmt: skip

    def _varied(self, moves: Array, vector: Array, starts: Array) -> tuple[Array, Array]:
        """Readings and ends as they are, for moves of the parameters, and of each state."""
        n_states = self.maps.n_states
        vectors = np.tile(vector, (1 + len(moves) + n_states, 1))
        vectors[1 : 1 + len(moves)] += moves
        all_starts = np.tile(starts, (len(vectors), 1, 1))
        moved = 1 + len(moves) + np.arange(n_states)
        states = self.settings.step * self.units.states
        all_starts[moved, :, np.arange(n_states)] += states[:, None]
        read, ends, _ = self.outputs(vectors, all_starts)
        return read, ends

    def jacobian(self, unknowns: Array, weight: float):
        """Jacobian of `residuals`, dense where it is small."""
        blocks = self.blocks(*self.split(unknowns))
        p, n = self.n_parameters, self.maps.n_states
        before = np.flatnonzero(self.segments.follower)
        ends = np.repeat(before, n)
        by_parameters = blocks.end_by_parameters[before].reshape(-1, p)
        by_start = blocks.end_by_start[before].reshape(-1, n)
        values = np.vstack(
            [
                np.hstack([blocks.by_parameters, blocks.by_start]),
                weight * np.hstack([by_parameters, by_start]),
            ]
        )
        segment = np.concatenate([self.segment, ends])
        columns = np.empty(values.shape, dtype=np.int64)
        columns[:, :p] = np.arange(p)
        columns[:, p:] = p + n * segment[:, None] + np.arange(n)
        shape = (len(values), p + n * len(self.segments))
        rows = np.arange(len(values) + 1) * values.shape[1]
        whole = sparse.csr_matrix((values.ravel(), columns.ravel(), rows), shape=shape)
        following = p + n * np.repeat(before + 1, n) + np.tile(np.arange(n), len(before))
        places = (len(blocks.residuals) + np.arange(len(ends)), following)
        whole = whole - sparse.csr_matrix((np.full(len(ends), weight), places), shape=shape)
        small = shape[0] * shape[1] <= self.settings.dense
        return whole.toarray() if small else whole.tocsr()
