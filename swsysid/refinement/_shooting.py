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

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from swsysid._results import Array
from swsysid.refinement._parameters import Parametrization
from swsysid.refinement._rollout import Segments, rollout
from swsysid.refinement._settings import SETTINGS
from swsysid.refinement._system import Maps, ParameterSets, RowSystem


@dataclass(frozen=True)
class Units:
    """In what the unknowns and the residuals count."""

    parameters: Array
    states: Array
    noise: Array  # of the outputs
    bound: Array  # magnitude at which a diverging state is held


@dataclass(frozen=True)
class Shooting:
    """The least-squares problem of one set of segments."""

    maps: Maps
    parameters: Parametrization
    segments: Segments
    observed: NDArray[np.intp]  # measured states, or all columns of the output
    units: Units

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """Measured values, segment by segment."""
        return np.isfinite(self.segments.y).transpose(1, 0, 2)

    @cached_property
    def segment(self) -> NDArray[np.intp]:
        """Segment of each residual."""
        return np.nonzero(self.measured)[0]

    # -- the vector of unknowns ------------------------------------------------------------

    def join(self, vector: Array, starts: Array) -> Array:
        """Unknowns from parameters and any number of states, both in their units."""
        return np.concatenate(
            [vector / self.units.parameters, (starts / self.units.states).ravel()]
        )

    def split(self, unknowns: Array) -> tuple[Array, Array]:
        """Parameters and states, (n_starts, n_states)."""
        vector, starts = np.split(unknowns, [len(self.units.parameters)])
        starts = starts.reshape(-1, self.maps.n_states)
        return vector * self.units.parameters, starts * self.units.states

    # -- residuals -------------------------------------------------------------------------

    def outputs(self, vectors: Array, starts: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Readings and ends for every owner: (n_owners, n_times, n_segments, n_outputs), ..."""
        read, states, bounded = self.states(vectors, starts)
        ends = states[self.segments.count, :, np.arange(len(self.segments))].swapaxes(0, 1)
        return read, ends, bounded

    def states(self, vectors: Array, starts: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Readings for every owner, and states at all samples (n_times, n_owners, ...)."""
        sets = self.parameters.sets(vectors)
        states, bounded = rollout(self.maps, sets, self.segments, starts, self.units.bound)
        return self._read(sets, states), states, bounded

    def _read(self, sets: ParameterSets, states: Array) -> Array:
        """What the sensors read, (n_owners, n_times, n_segments, n_outputs)."""
        if self.maps.output is None:
            return states[..., self.observed].swapaxes(0, 1)
        n_times, n_owners, n_segments, n_states = states.shape
        owners = np.tile(np.repeat(np.arange(n_owners), n_segments), n_times)
        inputs = np.repeat(self.segments.inputs[:, None], n_owners, axis=1)
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
        slopes = (ends[1:] - ends[0]).transpose(1, 2, 0) / (SETTINGS.step * self.units.states)
        return read[0], ends[0], slopes

    def slopes(self, vector: Array, starts: Array) -> tuple[Array, Array]:
        """Derivatives of residuals and ends by the parameters and the start of their segment.

        In units of the unknowns, (n_residuals, n_parameters + n_states) and (n_segments,
        n_states, n_parameters + n_states).
        """
        step = SETTINGS.step
        read, ends = self._varied(np.diag(step * self.units.parameters), vector, starts)
        misfit = self.misfit(read)
        end_slopes = (ends[1:] - ends[0]).transpose(1, 2, 0) / step / self.units.states[:, None]
        return (misfit[1:] - misfit[0]).T / step, end_slopes

    def _varied(self, moves: Array, vector: Array, starts: Array) -> tuple[Array, Array]:
        """Readings and ends as they are, for moves of the parameters, and of each state."""
        n_states = self.maps.n_states
        vectors = np.tile(vector, (1 + len(moves) + n_states, 1))
        vectors[1 : 1 + len(moves)] += moves
        all_starts = np.tile(starts, (len(vectors), 1, 1))
        moved = 1 + len(moves) + np.arange(n_states)
        states = SETTINGS.step * self.units.states
        all_starts[moved, :, np.arange(n_states)] += states[:, None]
        read, ends, _ = self.outputs(vectors, all_starts)
        return read, ends

    def jacobian(self, unknowns: Array, weight: float):
        """Jacobian of `residuals`, dense where it is small."""
        slopes, end_slopes = self.slopes(*self.split(unknowns))
        n = self.maps.n_states
        p = slopes.shape[1] - n
        before = np.flatnonzero(self.segments.follower)
        values = np.vstack([slopes, weight * end_slopes[before].reshape(-1, p + n)])
        segment = np.concatenate([self.segment, np.repeat(before, n)])
        columns = np.empty(values.shape, dtype=np.int64)
        columns[:, :p] = np.arange(p)
        columns[:, p:] = p + n * segment[:, None] + np.arange(n)
        shape = (len(values), p + n * len(self.segments))
        rows = np.arange(len(values) + 1) * values.shape[1]
        whole = sparse.csr_matrix((values.ravel(), columns.ravel(), rows), shape=shape)
        defect = np.arange(len(slopes), len(values))
        following = p + n * np.repeat(before + 1, n) + np.tile(np.arange(n), len(before))
        weights = np.full(len(defect), weight)
        whole = whole - sparse.csr_matrix((weights, (defect, following)), shape=shape)
        small = shape[0] * shape[1] <= SETTINGS.dense
        return whole.toarray() if small else whole.tocsr()
