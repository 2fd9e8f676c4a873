r"""Multiple shooting: residuals of all segments, their Jacobian, and what it says about certainty.

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

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from swsysid._results import Array
from swsysid.refinement._integrate import rollout
from swsysid.refinement._parameters import Parametrization
from swsysid.refinement._segments import Segments
from swsysid.refinement._system import Maps, ParameterSets, RowSystem

__all__ = ["Blocks", "Shooting"]

STEP = 1e-6  # of a difference quotient, times the size of a parameter or a state
# Up to so many entries a Jacobian is dense and its trust-region step exact.
DENSE = 2_000_000


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


class Shooting:
    """The least-squares problem of one set of segments.

    Parameters
    ----------
    maps : Maps
    parameters : Parametrization
    segments : Segments
    observed : ndarray of int
        Measured states, or all columns of the output.
    noise : ndarray of shape (n_outputs,)
        Unit in which the residuals of each channel count.
    scale : ndarray of shape (n_states,)
        Unit in which the defects of each state count.
    sizes : ndarray of shape (n_parameters,)
    bound : ndarray of shape (n_states,)
        Magnitude at which a diverging state is held.
    """

    def __init__(self, maps: Maps, parameters: Parametrization, segments: Segments, **options):
        self.maps, self.parameters, self.segments = maps, parameters, segments
        self.observed, self.noise = options["observed"], options["noise"]
        self.scale, self.sizes = options["scale"], options["sizes"]
        self.bound = options["bound"]
        self.measured = np.isfinite(segments.y)
        self.segment = np.nonzero(self.measured.transpose(1, 0, 2))[0]  # of each residual
        self.n_parameters, self.n_states = len(parameters), maps.n_states

    # -- the vector of unknowns ------------------------------------------------------------

    def join(self, vector: Array, starts: Array) -> Array:
        """Unknowns from parameters and starts; both in units of their sizes."""
        return np.concatenate([vector / self.sizes, (starts / self.scale).ravel()])

    def split(self, unknowns: Array) -> tuple[Array, Array]:
        """Parameters and starts, (n_segments, n_states)."""
        starts = unknowns[self.n_parameters :].reshape(len(self.segments), -1)
        return unknowns[: self.n_parameters] * self.sizes, starts * self.scale

    # -- residuals -------------------------------------------------------------------------

    def outputs(self, vectors: Array, starts: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Readings and ends for every owner: (n_owners, n_times, n_segments, n_outputs), ..."""
        sets = self.parameters.sets(vectors)
        states, bounded = rollout(self.maps, sets, self.segments.stretch, starts, self.bound)
        ends = states[self.segments.count, :, np.arange(len(self.segments))].swapaxes(0, 1)
        return self._read(sets, states), ends, bounded

    def _read(self, sets: ParameterSets, states: Array) -> Array:
        """What the sensors read, (n_owners, n_times, n_segments, n_outputs)."""
        if self.maps.output is None:
            return states[..., self.observed].swapaxes(0, 1)
        n_times, n_owners, n_segments, n_states = states.shape
        owners = np.tile(np.repeat(np.arange(n_owners), n_segments), n_times)
        inputs = np.repeat(self.segments.stretch.inputs[:, None], n_owners, axis=1)
        system = RowSystem(self.maps, sets, owners)
        with np.errstate(all="ignore"):
            read = system.output(states.reshape(-1, n_states), inputs.reshape(len(owners), -1))
        return read.reshape(n_times, n_owners, n_segments, -1)[..., self.observed].swapaxes(0, 1)

    def residuals(self, unknowns: Array, weight: float) -> Array:
        """Residuals of the samples, then weighted defects."""
        vector, starts = self.split(unknowns)
        read, ends, _ = self.outputs(vector[None], starts[None])
        return np.concatenate([self.misfit(read)[0], weight * self._defects(ends[0], starts)])

    def misfit(self, read: Array) -> Array:
        """Residuals in units of the noise, (n_owners, n_residuals), segment by segment."""
        scaled = (read - self.segments.y) / self.noise
        return scaled.transpose(0, 2, 1, 3)[:, self.measured.transpose(1, 0, 2)]

    def _defects(self, ends: Array, starts: Array) -> Array:
        before = np.flatnonzero(self.segments.follower)
        return ((ends[before] - starts[before + 1]) / self.scale).ravel()

    def ends(self, vector: Array, starts: Array) -> tuple[Array, Array, Array]:
        """Readings, ends of the segments, and their derivatives by the starts, in plain units."""
        n_states = self.n_states
        all_starts = np.tile(starts, (1 + n_states, 1, 1))
        all_starts[1 + np.arange(n_states), :, np.arange(n_states)] += STEP * self.scale[:, None]
        read, ends, _ = self.outputs(np.tile(vector, (1 + n_states, 1)), all_starts)
        slopes = (ends[1:] - ends[0]).transpose(1, 2, 0) / (STEP * self.scale)
        return read[0], ends[0], slopes

    def whole_states(self, vector: Array, starts: Array) -> tuple[Array, Array]:
        """Readings and states at all samples, (n_times, n_segments, ...)."""
        sets, stretch = self.parameters.sets(vector[None]), self.segments.stretch
        states, _ = rollout(self.maps, sets, stretch, starts[None], self.bound)
        return self._read(sets, states)[0], states[:, 0]

    # -- derivatives -----------------------------------------------------------------------

    def blocks(self, vector: Array, starts: Array) -> Blocks:
        """Residuals, ends and their derivatives in units of the unknowns."""
        n_parameters, n_states = self.n_parameters, self.n_states
        vectors = np.tile(vector, (1 + n_parameters + n_states, 1))
        vectors[1 : n_parameters + 1] += np.diag(STEP * self.sizes)
        all_starts = np.tile(starts, (len(vectors), 1, 1))
        moved = n_parameters + 1 + np.arange(n_states)
        all_starts[moved, :, np.arange(n_states)] += STEP * self.scale[:, None]
        read, ends, _ = self.outputs(vectors, all_starts)
        misfit = self.misfit(read)
        slopes = (misfit[1:] - misfit[0]).T / STEP
        end_slopes = (ends[1:] - ends[0]).transpose(1, 2, 0) / STEP / self.scale[:, None]
        return Blocks(
            misfit[0],
            slopes[:, :n_parameters],
            slopes[:, n_parameters:],
            ends[0],
            end_slopes[:, :, :n_parameters],
            end_slopes[:, :, n_parameters:],
        )

    def jacobian(self, unknowns: Array, weight: float):
        """Jacobian of `residuals`, dense where it is small."""
        blocks = self.blocks(*self.split(unknowns))
        p, n = self.n_parameters, self.n_states
        before = np.flatnonzero(self.segments.follower)
        samples = _rows_of(blocks.by_parameters, self.segment, blocks.by_start)
        ends = np.repeat(before, n)
        by_parameters = blocks.end_by_parameters[before].reshape(-1, p)
        defects = _rows_of(by_parameters, ends, blocks.end_by_start[before].reshape(-1, n))
        shape = (len(blocks.residuals) + len(ends), p + n * len(self.segments))
        values, columns = (np.concatenate(pair) for pair in zip(samples, defects, strict=True))
        values[len(blocks.residuals) :] *= weight
        starts = np.arange(shape[0] + 1) * values.shape[1]
        whole = sparse.csr_matrix((values.ravel(), columns.ravel(), starts), shape=shape)
        following = p + n * np.repeat(before + 1, n) + np.tile(np.arange(n), len(before))
        rows = len(blocks.residuals) + np.arange(len(ends))
        ones = np.full(len(ends), weight)
        whole = whole - sparse.csr_matrix((ones, (rows, following)), shape=shape)
        return whole.toarray() if shape[0] * shape[1] <= DENSE else whole.tocsr()


def _rows_of(by_parameters, segment, by_start):
    """Values and column numbers of the nonzero entries, row by row."""
    n_rows, p = by_parameters.shape
    n = by_start.shape[1]
    columns = np.empty((n_rows, p + n), dtype=np.int64)
    columns[:, :p] = np.arange(p)
    columns[:, p:] = p + n * segment[:, None] + np.arange(n)
    return np.hstack([by_parameters, by_start]), columns
