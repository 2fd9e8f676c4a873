r"""Shooting: residuals of rollouts over records or pieces of them, and their Jacobian.

The unknowns are the parameters :math:`\theta` and the states :math:`s_k` at which the rollouts
begin. These locate their switches (`_stays/rollouts`), and follow the unknowns as flows and
saltation matrices say (`_stays/sensitivities`). A row of the Jacobian has as many nonzero columns
as there are parameters and states, however many pieces.

Losses of the residuals may be robust.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from swsysid._data.recordings import Record
from swsysid._noise import robust_scale
from swsysid._results import Array
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.rollouts import Rolled, rolled_out
from swsysid._stays.sensitivities import RolledNodes, sensitivities
from swsysid.refinement._parameters import Parametrization
from swsysid.refinement._settings import SETTINGS
from swsysid.refinement._system import System, Values


@dataclass(frozen=True)
class Units:
    """In what the unknowns and the residuals count."""

    parameters: Array
    states: Array
    inputs: Array
    noise: Array  # of the outputs
    bound: Array  # magnitude of a state that has diverged


@dataclass(frozen=True)
class Pieces:
    """Records cut into pieces of so many steps.

    A piece ends at the sample with which the next one begins, which counts there; the last of a
    record is shorter.
    """

    parts: list[Record]
    guess: list[Array]  # states of each part, roughly
    record: NDArray[np.intp]
    first: NDArray[np.intp]  # sample of the record
    follower: NDArray[np.bool_]  # true if the next piece continues it

    @classmethod
    def of(cls, records: Sequence[Record], guess: Sequence[Array], length: int) -> Pieces:
        """All records in pieces of a length."""
        places = [
            (k, first)
            for k, record in enumerate(records)
            for first in range(0, len(record.t) - 1, length)
        ]
        record, first = np.array(places).T
        parts = [records[k].part(begin, length) for k, begin in places]
        states = [guess[k][begin : begin + length + 1] for k, begin in places]
        return cls(parts, states, record, first, np.append(np.diff(record) == 0, False))

    def __len__(self) -> int:
        return len(self.parts)


def grid_of(
    system: System, records: Sequence[Record], guess: Sequence[Array], *, held: bool
) -> Recordings:
    """Records side by side to roll out; in discrete time they count turns."""
    turns = system.model.discrete_time
    parts = [
        Record(np.arange(len(one.t), dtype=float) if turns else one.t, one.y[:, :0], one.u)
        for one in records
    ]
    return Recordings.of(parts, guess, held=held)


class Rollout(NamedTuple):
    """Rollouts for some unknowns, and what was integrated."""

    laws: Laws
    guards: Guards
    values: Values
    runs: list[Rolled]
    states: Array  # (n_nodes, n_states)
    read: Array  # (n_samples, n_outputs)
    bounded: NDArray[np.bool_]  # (n_pieces,)


@dataclass
class Shooting:
    """The least-squares problem of some pieces; inputs between samples are held or `linear`."""

    system: System
    parameters: Parametrization
    pieces: Pieces
    observed: NDArray[np.intp]  # measured states, or all columns of the output
    units: Units
    substeps: int
    linear: bool
    _near: tuple[Array, Array, Array] | None = field(default=None, init=False)
    _last: tuple[Array, Rollout] | None = field(default=None, init=False)

    def __post_init__(self) -> None:
        parts, follower = self.pieces.parts, self.pieces.follower
        grid = grid_of(self.system, parts, self.pieces.guess, held=not self.linear)
        self.grid = replace(grid.divided(self.substeps), first_step=1.0)
        length = -(-len(grid.steps) // SETTINGS.n_segments)
        self.piece_of_runs = max(SETTINGS.shortest, length) * self.substeps
        self.node = np.cumsum(self.grid.lengths) - self.grid.lengths  # at which each begins
        rows = zip(self.node, self.grid.sampled, strict=True)
        self.sampled = np.concatenate([first + places for first, places in rows])
        self.piece = np.repeat(np.arange(len(parts)), [len(one.t) for one in parts])  # of a sample
        self.inputs = np.concatenate([one.u for one in parts])
        self.y = np.concatenate([one.y for one in parts])
        ends = np.cumsum([len(one.t) for one in parts]) - 1
        self.y[ends[follower]] = np.nan
        self.measured = np.isfinite(self.y)
        # of each residual
        self.segment = np.repeat(self.piece[:, None], self.y.shape[1], axis=1)[self.measured]
        self.guess = [
            self.grid.guess[:n, place] for place, n in enumerate(self.grid.lengths.tolist())
        ]

    @property
    def begins(self) -> Array:
        """States at which the pieces begin, roughly."""
        nodes = np.array([one[0] for one in self.pieces.guess])
        return np.clip(nodes, -self.units.bound, self.units.bound)

    @property
    def n_states(self) -> int:
        """Number of states."""
        return self.system.n_states

    # -- the vector of unknowns ------------------------------------------------------------

    def join(self, vector: Array, starts: Array) -> Array:
        """Unknowns from parameters and any number of states, both in their units."""
        return np.concatenate(
            [vector / self.units.parameters, (starts / self.units.states).ravel()]
        )

    def split(self, unknowns: Array) -> tuple[Array, Array]:
        """Parameters and states, (n_starts, n_states)."""
        vector, starts = np.split(unknowns, [len(self.units.parameters)])
        starts = starts.reshape(-1, self.n_states)
        return vector * self.units.parameters, starts * self.units.states

    # -- residuals -------------------------------------------------------------------------

    def rolled(self, unknowns: Array) -> Rollout:
        """The rollouts of all pieces."""
        if self._last is None or not np.array_equal(self._last[0], unknowns):
            self._last = unknowns.copy(), self._rolled(unknowns)
        return self._last[1]

    def _rolled(self, unknowns: Array) -> Rollout:
        (vector, starts), guess = self.split(unknowns), self._guess(unknowns)
        values, free = self.parameters.at(vector), self.parameters.split(self.parameters.free)
        laws = self.system.laws(values, free[0], self._named(), self.units.states)
        columns = np.concatenate([self.units.states, self.units.inputs])
        guards = self.system.guards(values.surface, free[2], columns)
        with np.errstate(all="ignore"):  # a diverging trial is no warning
            runs = rolled_out(laws, guards, self.grid, starts, guess, self.piece_of_runs)
            states = np.concatenate([run.states for run in runs])
            read = self._read(values.named, states[self.sampled])
            inside = (np.abs(states) <= self.units.bound).all(axis=1)
        bounded = np.logical_and.reduceat(inside, self.node)
        return Rollout(laws, guards, values, runs, states, read, bounded)

    def _guess(self, unknowns: Array) -> list[Array]:
        """States at all nodes, roughly: as the last derivatives say."""
        if self._near is None:
            return self.guess
        at, states, slopes = self._near
        moved, starts = np.split(unknowns - at, [len(self.parameters)])
        starts = starts.reshape(-1, self.n_states).repeat(self.grid.lengths, axis=0)
        moves = np.hstack([np.tile(moved, (len(starts), 1)), starts])
        return np.split(states + np.einsum("ksc,kc->ks", slopes, moves), self.node[1:])

    def _read(self, named: dict[str, float], states: Array) -> Array:
        columns = np.concatenate([states, self.inputs], axis=1)
        return self.system.read(columns, named)[:, self.observed]

    def misfit(self, read: Array) -> Array:
        """Residuals in units of the noise, sample by sample."""
        scaled = ((read - self.y) / self.units.noise)[self.measured]
        most = SETTINGS.refused
        return np.clip(np.nan_to_num(scaled, nan=most), -most, most)

    def residuals(self, unknowns: Array) -> Array:
        """Residuals of the samples."""
        return self.misfit(self.rolled(unknowns).read)

    # -- derivatives -----------------------------------------------------------------------

    def slopes(self, unknowns: Array) -> Array:
        """Derivatives of residuals by the parameters and the start of their piece.

        In units of the unknowns, (n_residuals, n_parameters + n_states).
        """
        found, n = self.rolled(unknowns), self.n_states
        with np.errstate(all="ignore"):
            nodes = RolledNodes(self.grid, found.runs)
            moves = np.nan_to_num(sensitivities(found.laws, found.guards, nodes))
            by_states, by_named = self._slopes_of_reading(found)
        p, size = len(self.parameters), self.units
        every = np.zeros((len(moves), n, p + n))
        every[:, :, p:] = moves[:, :, :n] * size.states
        places, factors = self._places()
        every[:, :, places] = moves[:, :, n:] * factors * size.parameters[places]
        self._near = unknowns.copy(), found.states, every
        of_samples = by_states @ every[self.sampled]
        of_samples[:, :, :p] += by_named * size.parameters
        of_samples /= size.noise[:, None]
        return np.nan_to_num(of_samples[self.measured])

    def _named(self) -> dict[str, float]:
        """Free named parameters, and their sizes."""
        free = self.parameters.split(self.parameters.free)
        names = [name for name, own in zip(self.parameters.named, free[1], strict=True) if own]
        sizes = self.units.parameters[int(free[0].sum()) :].tolist()
        return dict(zip(names, sizes, strict=False))

    def _places(self) -> tuple[NDArray[np.intp], Array]:
        """Place among the parameters of each unknown of laws and guards, and its factor."""
        coef, _, surface = self.parameters.split(self.parameters.free)
        own, n_coef, form = self.system.classes, int(coef.sum()), self.system.linear
        number = (np.cumsum(coef.ravel()) - 1).reshape(coef.shape)[own]
        places = np.append(number[coef[own]], np.arange(n_coef, len(self.parameters)))
        factors = np.ones(len(places))
        if surface.any() and form is not None:
            factors[-surface.sum() :] = 1.0 / form.scale[np.nonzero(surface)[0]]
        return places.astype(np.intp), factors

    def _slopes_of_reading(self, found: Rollout) -> tuple[Array, Array]:
        """By the states, (n_samples, n_outputs, n_states), and by the parameters."""
        n, p, step = self.n_states, len(self.parameters), SETTINGS.step
        shape = len(self.sampled), len(self.observed)
        by_parameters = np.zeros((*shape, p))
        if self.system.output is None:
            return np.broadcast_to(np.eye(n)[self.observed], (*shape, n)), by_parameters
        states, named = found.states[self.sampled], found.values.named
        by_states = np.empty((*shape, n))
        for k, size in enumerate(self.units.states * step):
            moved = states.copy()
            moved[:, k] += size
            by_states[:, :, k] = (self._read(named, moved) - found.read) / size
        first = int(self.parameters.split(self.parameters.free)[0].sum())
        for k, (name, size) in enumerate(self._named().items(), first):
            moved = {**named, name: named[name] + step * size}
            by_parameters[:, :, k] = (self._read(moved, states) - found.read) / (step * size)
        return by_states, by_parameters

    def jacobian(self, unknowns: Array):
        """Jacobian of `residuals`, dense where it is small."""
        slopes, n, p = self.slopes(unknowns), self.n_states, len(self.parameters)
        columns = np.empty(slopes.shape, dtype=np.int64)
        columns[:, :p] = np.arange(p)
        columns[:, p:] = p + n * self.segment[:, None] + np.arange(n)
        shape = (len(slopes), p + n * len(self.pieces))
        rows = np.arange(len(slopes) + 1) * slopes.shape[1]
        whole = sparse.csr_matrix((slopes.ravel(), columns.ravel(), rows), shape=shape)
        return whole.toarray() if shape[0] * shape[1] <= SETTINGS.dense else whole

    def information(self, unknowns: Array) -> Array:
        """Slopes by the parameters alone, (n_residuals, n_parameters), the starts eliminated."""
        slopes, by_starts = np.split(self.slopes(unknowns), [len(self.parameters)], axis=1)
        for k in range(len(self.pieces)):
            rows = self.segment == k
            basis, sizes, _ = np.linalg.svd(by_starts[rows], full_matrices=False)
            basis = basis[:, sizes > 1e-10 * max(sizes.max(initial=0.0), 1e-300)]
            slopes[rows] -= basis @ (basis.T @ slopes[rows])
        return slopes


def _soft_l1(z: Array) -> tuple[Array, Array]:
    root = np.sqrt(1.0 + z)
    return 2.0 * (root - 1.0), 1.0 / root


def _huber(z: Array) -> tuple[Array, Array]:
    root = np.sqrt(np.maximum(z, 1.0))
    return np.where(z <= 1.0, z, 2.0 * root - 1.0), 1.0 / root


# value and derivative for squared residuals, by the names of `scipy.optimize.least_squares`
LOSSES: dict[str, Callable[[Array], tuple[Array, Array]]] = {
    "linear": lambda z: (z, np.ones_like(z)),
    "soft_l1": _soft_l1,
    "huber": _huber,
    "cauchy": lambda z: (np.log1p(z), 1.0 / (1.0 + z)),
}


def inner_scale(residuals: Array) -> float:
    """Standard deviation of the inner residuals: beyond it a robust loss bends."""
    return float(robust_scale(residuals)) or 1.0
