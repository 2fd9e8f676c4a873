r"""Rollouts of least error: parameters of a plant, and the states at which recordings begin.

.. math:: \min_{\theta, s} \tfrac12 \sum_i
          \rho\Big( \Big(\frac{h(x(t_i; \theta, s); \theta) - y_i}{\sigma}\Big)^2 \Big)

Surfaces tell modes, states may be hidden behind the map h of sensors, and the loss may be robust.
What unknowns of laws, surfaces and sensors are in terms of parameters a plant says: several may be
one, and each may have bounds. All nodes follow the start of their recording, so that a row of the
Jacobian has as many entries as there are parameters and states, however many recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.optimize import OptimizeResult, least_squares

from swsysid._results import Array
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Features, Laws, Modes, slopes_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.rollouts import Rolled, nowhere, rolled_out
from swsysid._stays.sensitivities import RolledNodes, sensitivities

REFUSED = 1e6  # misfit where a rollout has no value
# entries and unknowns up to which a Jacobian is dense and its trust-region step exact: with the
# starts of 180 stretches that takes six times as long
_DENSE, _FEW = 2_000_000, 200


class Sensor(NamedTuple):
    """What is read of rows (states, inputs)."""

    read: Features  # (n_rows, n_outputs)
    inside: Sequence[tuple[int, Features]] = ()  # number of a parameter, and derivatives by it


class Parts(NamedTuple):
    """What a plant is for some parameters."""

    laws: Laws
    guards: Guards
    sensor: Sensor


class Plant(Protocol):
    """Laws, surfaces and sensors as functions of a vector of parameters."""

    @property
    def limits(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the parameters, perhaps infinite."""

    @property
    def by_parameters(self) -> Array:
        """Unknowns of laws, then of surfaces, by parameters, (n_unknowns, n_parameters)."""

    def parts(self, vector: Array, /) -> Parts:
        """The plant of some parameters."""


class KnownLaws(NamedTuple):
    """Laws of which nothing is sought, without surfaces; states are read."""

    laws: Laws

    @property
    def limits(self) -> tuple[Array, Array]:
        """Of no parameters."""
        return np.zeros(0), np.zeros(0)

    @property
    def by_parameters(self) -> Array:
        """Of no unknowns by no parameters."""
        return np.zeros((0, 0))

    def parts(self, vector: Array) -> Parts:
        """The laws as they are."""
        n_states = len(self.laws.spread)
        return Parts(self.laws, nowhere(self.laws.spread), Sensor(lambda X: X[:, :n_states]))


def _soft_l1(z: Array) -> tuple[Array, Array]:
    root = np.sqrt(1.0 + z)
    return 2.0 * (root - 1.0), 1.0 / root


def _huber(z: Array) -> tuple[Array, Array]:
    root = np.sqrt(np.maximum(z, 1.0))
    return np.where(z <= 1.0, z, 2.0 * root - 1.0), 1.0 / root


# value and derivative for squared residuals
LOSSES: dict[str, Callable[[Array], tuple[Array, Array]]] = {
    "linear": lambda z: (z, np.ones_like(z)),
    "soft_l1": _soft_l1,
    "huber": _huber,
    "cauchy": lambda z: (np.log1p(z), 1.0 / (1.0 + z)),
}


@dataclass(frozen=True)
class OutputError:
    """The misfits of rollouts along recordings, which have samples where something is read."""

    plant: Plant
    grid: Recordings
    y: Array  # (n_samples, n_outputs): what was read, NaN where nothing was
    noise: Array  # (n_outputs,), or like y
    bound: Array  # (n_states,): magnitude of a state that has diverged
    loss: str = "linear"
    scale: float = 1.0  # of misfits, beyond which a robust loss bends

    @cached_property
    def sampled(self) -> NDArray[np.intp]:
        """Nodes of the samples."""
        first = np.cumsum(self.grid.lengths) - self.grid.lengths
        rows = zip(first, self.grid.sampled, strict=True)
        return np.concatenate([begin + places for begin, places in rows])

    @cached_property
    def inputs(self) -> Array:
        """At the samples."""
        return self.grid.joined(self.grid.u)

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """Which entries of `y` there are, each a residual."""
        return np.isfinite(self.y)

    @cached_property
    def recording(self) -> NDArray[np.intp]:
        """Recording of each residual, ascending."""
        groups = np.repeat(self.grid.groups[:, None], self.y.shape[1], axis=1)
        return np.asarray(groups[self.measured])

    def begun(self, vector: Array, starts: Array, near: Rollouts | None = None) -> Rollouts:
        """Rollouts of some parameters from starts, which lead roughly where others do."""
        if near is not None and near.problem.grid is self.grid:
            return Rollouts(self, vector, starts, near.states, [one.modes for one in near.runs])
        return Rollouts(self, vector, starts, self.grid.in_a_row(self.grid.guess))

    def value(self, rollouts: Rollouts) -> float:
        """What is minimised; infinite where a rollout diverges."""
        if not rollouts.bounded.all():
            return float("inf")
        z = np.square(rollouts.misfit / self.scale)
        return float(0.5 * self.scale**2 * LOSSES[self.loss](z)[0].sum())

    def least(
        self, start: Rollouts, max_nfev: int, tolerance: float, tried: Callable[[], object] = int
    ) -> tuple[Rollouts, OptimizeResult]:
        """Rollouts of least error near some, by trust regions; `tried` is called after each trial.

        Whole rollouts that graze a surface, and poles that are far off, make ridges. There steps of
        trust regions end lower than those of `descent`: at 27.3 for 28.5 to 28.9 with a damper of
        two modes, at 114 for 428 with the poles of two drives (`benchmarks.measured`).
        """
        edges = np.linalg.norm(start.slopes, axis=0)
        of_vector, of_start = np.split(edges, [len(start.vector)])
        edges = np.append(of_vector, np.tile(of_start, len(start.starts)))
        unit = 1.0 / np.where(edges > 0.0, edges, 1.0)  # what moves the residuals by one
        low, high = self.plant.limits
        nowhere = np.full(start.starts.size, np.inf)
        limits = np.append(low, -nowhere) / unit, np.append(high, nowhere) / unit
        asked = np.clip(start.unknowns / unit, *limits)
        found = based = start

        def rollouts(unknowns: Array) -> Rollouts:
            nonlocal asked, found
            if not np.array_equal(unknowns, asked):
                asked, found = unknowns.copy(), based.moved(unknowns * unit - based.unknowns)
            return found

        def residuals(unknowns: Array) -> Array:
            misfit = rollouts(unknowns).misfit
            tried()
            return misfit

        def jacobian(unknowns: Array) -> Array | sparse.csr_matrix:
            nonlocal based
            based = rollouts(unknowns)
            whole = self._jacobian(based.slopes, unit)
            return whole.toarray() if exactly else whole

        exactly = len(unit) <= _FEW and len(start.misfit) * len(unit) <= _DENSE
        answer = least_squares(
            residuals,
            asked,
            jacobian,
            bounds=limits,
            loss=self.loss,
            f_scale=self.scale,
            x_scale="jac",
            **dict.fromkeys(("ftol", "xtol", "gtol"), tolerance),
            max_nfev=max_nfev,
            tr_solver="exact" if exactly else "lsmr",
            tr_options={} if exactly else dict(atol=1e-10, btol=1e-10, maxiter=2 * len(unit)),
        )
        return rollouts(answer.x), answer

    def _jacobian(self, slopes: Array, unit: Array) -> sparse.csr_matrix:
        """Of the residuals, by parameters and all starts in some units."""
        n_states, n_starts = len(self.bound), len(self.grid)
        n_parameters = slopes.shape[1] - n_states
        columns = np.empty(slopes.shape, dtype=np.int64)
        columns[:, :n_parameters] = np.arange(n_parameters)
        columns[:, n_parameters:] = (
            n_parameters + n_states * self.recording[:, None] + np.arange(n_states)
        )
        shape = len(slopes), n_parameters + n_states * n_starts
        rows = np.arange(len(slopes) + 1) * slopes.shape[1]
        entries = (slopes * unit[columns]).ravel()
        return sparse.csr_matrix((entries, columns.ravel(), rows), shape=shape)


@dataclass(frozen=True)
class Rollouts:
    """Rollouts for some parameters and starts, made when they are asked for."""

    problem: OutputError
    vector: Array
    starts: Array  # (n_recordings, n_states)
    guess: Array  # (n_nodes, n_states): roughly
    told: Sequence[Modes] = ()  # at the nodes, roughly

    @property
    def unknowns(self) -> Array:
        """Parameters, then starts."""
        return np.append(self.vector, self.starts)

    @cached_property
    def parts(self) -> Parts:
        """The plant."""
        return self.problem.plant.parts(self.vector)

    @cached_property
    def runs(self) -> list[Rolled]:
        """States, modes and events of every recording."""
        laws, guards, _ = self.parts
        grid = self.problem.grid
        guess = np.split(self.guess, np.cumsum(grid.lengths)[:-1])
        with np.errstate(all="ignore"):  # a diverging trial is no warning
            try:
                return rolled_out(laws, guards, grid, self.starts, guess, self.told)
            except ValueError:  # the features have no value there: the step was too long
                nothing = np.full_like(self.guess, np.nan)
                return [
                    Rolled(own, np.zeros(len(own), dtype=np.intp), [])
                    for own in np.split(nothing, np.cumsum(grid.lengths)[:-1])
                ]

    @cached_property
    def states(self) -> Array:
        """Of all nodes, (n_nodes, n_states)."""
        return np.concatenate([run.states for run in self.runs])

    @property
    def bounded(self) -> NDArray[np.bool_]:
        """Recordings whose rollouts do not diverge."""
        lengths = self.problem.grid.lengths
        with np.errstate(invalid="ignore"):
            inside = (np.abs(self.states) <= self.problem.bound).all(axis=1)
        return np.logical_and.reduceat(inside, np.cumsum(lengths) - lengths)

    @property
    def columns(self) -> Array:
        """States and inputs at the samples."""
        return np.hstack([self.states[self.problem.sampled], self.problem.inputs])

    @cached_property
    def read(self) -> Array:
        """What sensors read at the samples, (n_samples, n_outputs)."""
        with np.errstate(all="ignore"):
            return self.parts.sensor.read(self.columns)

    @cached_property
    def misfit(self) -> Array:
        """Residuals in units of the noise."""
        scaled = ((self.read - self.problem.y) / self.problem.noise)[self.problem.measured]
        return np.clip(np.nan_to_num(scaled, nan=REFUSED), -REFUSED, REFUSED)

    @property
    def weight(self) -> Array:
        """How much each residual counts."""
        z = np.square(self.misfit / self.problem.scale)
        return LOSSES[self.problem.loss](z)[1]

    @cached_property
    def varied(self) -> Array:
        """Derivatives of the nodes by parameters and the start, (n_nodes, n_states, ...)."""
        laws, guards, _ = self.parts
        with np.errstate(all="ignore"):
            nodes = RolledNodes(self.problem.grid, self.runs)
            moves = np.nan_to_num(sensitivities(laws, guards, nodes))
        by_start, by_unknowns = np.split(moves, [self.starts.shape[1]], axis=2)
        return np.concatenate([by_unknowns @ self.problem.plant.by_parameters, by_start], axis=2)

    @cached_property
    def slopes(self) -> Array:
        """Derivatives of the residuals by parameters and the start, (n_residuals, ...)."""
        sensor, columns, spread = self.parts.sensor, self.columns, self.parts.laws.spread
        with np.errstate(all="ignore"):
            slopes = slopes_of(sensor.read, columns, spread)[1] @ self.varied[self.problem.sampled]
            for number, by_parameter in sensor.inside:
                slopes[:, :, number] += by_parameter(columns)
        return np.nan_to_num((slopes / self.problem.noise[..., None])[self.problem.measured])

    @property
    def slopes_of_parameters(self) -> Array:
        """Those by the parameters alone, the starts eliminated."""
        return self.without_starts(self.slopes[:, : len(self.vector)])

    def without_starts(self, columns: Array) -> Array:
        """What moving the starts leaves of columns (n_residuals, n_columns)."""
        left, by_starts = columns.copy(), self.slopes[:, len(self.vector) :]
        for k in range(len(self.starts)):
            rows = self.problem.recording == k
            basis, sizes, _ = np.linalg.svd(by_starts[rows], full_matrices=False)
            basis = basis[:, sizes > 1e-10 * max(sizes.max(initial=0.0), 1e-300)]
            left[rows] -= basis @ (basis.T @ left[rows])
        return left

    def moved(self, step: Array) -> Rollouts:
        """Others: parameters within their bounds, then starts."""
        of_parameters, of_starts = np.split(step, [len(self.vector)])
        vector = np.clip(self.vector + of_parameters, *self.problem.plant.limits)
        of_starts = of_starts.reshape(self.starts.shape)
        moves = np.hstack([
            np.tile(vector - self.vector, (len(of_starts), 1)), of_starts
        ]).repeat(self.problem.grid.lengths, axis=0)  # fmt: skip
        return replace(
            self,
            vector=vector,
            starts=self.starts + of_starts,
            guess=self.states + np.einsum("ksc,kc->ks", self.varied, moves),
            told=[run.modes for run in self.runs],
        )
