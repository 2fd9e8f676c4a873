"""One refinement from its data to its estimate: preparation, stages, verdict, certainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from swsysid._checks.arrays import numbers, refuse_overflow, refuse_vanishing, truth_values
from swsysid._checks.parameters import shown
from swsysid._results import Array, Status
from swsysid._simulation.model import SwitchingModel, fitted_system
from swsysid.refinement._certainty import robust_covariance
from swsysid.refinement._continuous import WholeRollouts
from swsysid.refinement._guess import guessed_states
from swsysid.refinement._losses import LOSSES, robust_loss, robust_scale
from swsysid.refinement._parameters import Parametrization, output_of
from swsysid.refinement._rollout import substeps_for
from swsysid.refinement._segments import Segments
from swsysid.refinement._settings import SETTINGS, Settings
from swsysid.refinement._shooting import Shooting, Units
from swsysid.refinement._stated import StatedModel
from swsysid.refinement._system import Maps, RowSystem
from swsysid.refinement._trajectories import (
    Record,
    first_states,
    observed_states,
    read_trajectories,
    spread,
)

__all__ = ["Estimate", "Estimation"]


@dataclass(frozen=True)
class Estimate:
    """Best parameters and starts, with their rollouts compared to those of the given model."""

    vector: Array
    starts: Array
    nodes: Array
    cost_before: float
    cost_after: float
    rmse_before: Array
    rmse_after: Array
    nfev: int
    status: Status


class Estimation:
    """The refinement of one model on some trajectories; the options are those of `refine`.

    `frozen` leaves nothing free but the initial states; `integrated` is called after each
    integration.
    """

    def __init__(
        self,
        model: Any,
        trajectories: Any,
        *,
        observed: Any = None,
        initial_states: Any = None,
        segment_length: int | None = None,
        loss: str = "linear",
        fit_surface: bool = False,
        free: Any = None,
        bounds: Mapping[str, tuple[float, float]] | None = None,
        noise: Any = None,
        linear: bool = False,
        joined: bool = True,
        frozen: bool = False,
        integrated: Callable[[], object] = int,
        settings: Settings = SETTINGS,
    ):
        system = fitted_system(model)
        self.settings, self.integrated = settings, integrated
        self.loss, self.linear, self.joined = loss, linear, joined
        self.maps = maps = Maps(system, output_of(model))
        self.parameters = Parametrization(model, maps, _free(model, system, free), fit_surface)
        if frozen:
            self.parameters.freeze()
        elif not len(self.parameters):
            raise ValueError("no parameter is free; free a coefficient or name a parameter.")
        names = system.feature_map.names_in
        self.observed = self._channels(names, observed)
        self.records = read_trajectories(
            trajectories, len(names) - maps.n_states, len(self.observed)
        )
        self.limits = self.parameters.bounds({} if bounds is None else bounds)
        noise = _noise(self.records, noise)
        starts = first_states(initial_states, names[: maps.n_states], len(self.records))
        measured = self.observed if maps.output is None else self.observed[:0]
        guess, bound = guessed_states(
            maps, self._start_sets, self.records, starts, measured, linear, settings
        )
        self._measure(guess, noise, bound)
        self._cut(guess, segment_length)

    # -- preparation -----------------------------------------------------------------------

    @property
    def _start_sets(self):
        return self.parameters.sets(self.parameters.start[None])

    def _channels(self, names: list[str], observed: Any) -> NDArray[np.intp]:
        """Columns of the output that are measured."""
        if self.maps.output is None:
            return observed_states(observed, names, self.maps.n_states)
        if observed is not None:
            raise ValueError(
                "observed is given for a model with an output; leave it out, the output says what "
                "the columns of x measure."
            )
        row = np.ones((1, len(names)))
        return np.arange(self.maps.output(row, self._start_named).shape[1])

    @property
    def _start_named(self) -> dict[str, Array]:
        return {name: np.array([value]) for name, value in self.parameters.named.items()}

    def _measure(self, guess: list[Array], noise: Array, bound: Array) -> None:
        """Units of states and parameters, and the steps of the integration."""
        x, u = np.vstack(guess), np.vstack([record.u for record in self.records])
        rows = np.unique(np.linspace(0, len(x) - 1, self.settings.most_rows).astype(int))
        self._points = x[rows], u[rows]
        system = RowSystem(self.maps, self._start_sets, np.zeros(len(rows), dtype=np.intp))
        named = {name: np.repeat(value, len(rows)) for name, value in self._start_named.items()}
        features = self.maps.features(np.hstack(self._points), named)
        velocities = system.field(system.modes(*self._points))(*self._points)
        self._typical = features, velocities
        sizes = self.parameters.sizes(features, velocities)
        self.units = Units(sizes, spread(x), noise, bound)
        self.substeps = self._needed_substeps(self.parameters.start)

    def _needed_substeps(self, vector: Array) -> int:
        longest = max(float(np.quantile(np.diff(record.t), 0.99)) for record in self.records)
        sets = self.parameters.sets(vector[None])
        return substeps_for(self.maps, sets, *self._points, longest, self.settings)

    def _cut(self, guess: list[Array], length: int | None) -> None:
        """Segments of which the given model stays bounded on each."""
        n_steps = [len(record.t) - 1 for record in self.records]
        chosen = length or max(self.settings.shortest, -(-sum(n_steps) // self.settings.n_segments))
        self.length = min(chosen, max(n_steps))
        while True:
            self.shooting = self._shooting(self.length)
            nodes = [guess[k][i] for k, i in self.shooting.segments.places]
            self.nodes = np.clip(np.array(nodes), -self.units.bound, self.units.bound)
            _, _, bounded = self.shooting.outputs(self.parameters.start[None], self.nodes[None])
            if bounded.all():
                return
            if length is not None or self.length == 1:
                where = f"segments of {self.length} samples" if self.length > 1 else "one sample"
                raise ValueError(
                    f"the rollout of the start diverges within {where}; give a shorter "
                    "segment_length (None chooses one), or better coefficients to start from."
                )
            self.length = max(1, self.length // 2)

    def _shooting(self, length: int | None = None) -> Shooting:
        """Segments of a length; None leaves the records uncut."""
        length = max(len(record.t) for record in self.records) if length is None else length
        segments = Segments(self.records, length, linear=self.linear, substeps=self.substeps)
        return Shooting(
            self.maps, self.parameters, segments, self.observed, self.units, self.settings
        )

    # -- stages ----------------------------------------------------------------------------

    def solve(self, max_nfev: int) -> Estimate:
        """Fit the segments by themselves, then whole rollouts; keep what makes these better."""
        vector, nodes, nfev = self.parameters.start, self.nodes, 0
        earlier = self.settings.earlier_weights if self.joined and self._starts_poorly() else ()
        for weight in earlier:
            answer = self._fit_tied(vector, nodes, weight, max(1, (max_nfev - nfev) // 4))
            vector, nodes = self.shooting.split(answer.x)
            nfev += answer.nfev
            vector, _ = self._settled(vector)
        for _ in range(self.settings.most_rounds):
            whole = self.whole(nodes)
            answer = self._fit_whole(whole, vector, nodes, max(1, max_nfev - nfev))
            (vector, starts), nodes = self.shooting.split(answer.x), whole.nodes
            nodes[whole.first] = starts
            nfev += answer.nfev
            vector, settled = self._settled(vector)
            if settled or nfev >= max_nfev:
                break
        status = Status.OPTIMAL if answer.status > 0 else Status.ITERATION_LIMIT
        return self._verdict(vector, nodes, nfev, status)

    def initial_states(self, max_nfev: int) -> Array:
        """Initial states of whole rollouts of the given model, (n_records, n_states)."""
        whole = self.whole(self.nodes)
        answer = self._fit_whole(whole, self.parameters.start, self.nodes, max_nfev)
        return self.shooting.split(answer.x)[1]

    def whole(self, nodes: Array) -> WholeRollouts:
        """The problem of whole rollouts, their segments beginning about `nodes`."""
        return WholeRollouts(self.shooting, self._shooting(), nodes, self.joined)

    def _starts_poorly(self) -> bool:
        """True if whole rollouts of the given model are worse than the mean of the channels."""
        uncut = self._shooting()
        nodes = self.nodes[self.shooting.segments.first == 0]
        read, _, bounded = uncut.outputs(self.parameters.start[None], nodes[None])
        error = np.sqrt(np.nanmean(np.square(read[0] - uncut.segments.y), axis=(0, 1)))
        usual = spread(np.vstack([record.y for record in self.records]))
        return not bounded.all() or bool((error > usual).any())

    def _settled(self, vector: Array) -> tuple[Array, bool]:
        """The parameters, and whether they are still those of the problem that was solved.

        A model that became faster needs shorter steps, a surface that turned another scale; both
        need another round.
        """
        pivoted = self.parameters.pivoted(vector)
        needed = self._needed_substeps(pivoted)
        settled = needed <= self.substeps and np.array_equal(pivoted, vector)
        if not settled:
            self.substeps = max(needed, self.substeps)
            sizes = self.parameters.sizes(*self._typical)
            self.units = Units(sizes, self.units.states, self.units.noise, self.units.bound)
            self.shooting = self._shooting(self.length)
        return pivoted, settled

    def _fit_tied(self, vector: Array, nodes: Array, weight: float, max_nfev: int):
        """Segments tied to each other by weighted defects."""
        shooting = self.shooting
        return self._least_squares(
            lambda trial: shooting.residuals(trial, weight),
            lambda trial: shooting.jacobian(trial, weight),
            shooting.join(vector, nodes),
            max_nfev,
        )

    def _fit_whole(self, whole: WholeRollouts, vector: Array, nodes: Array, max_nfev: int):
        start = self.shooting.join(vector, nodes[whole.first])
        return self._least_squares(whole.residuals, whole.jacobian, start, max_nfev)

    def _least_squares(
        self, function: Callable, jacobian: Callable, start: Array, max_nfev: int
    ) -> OptimizeResult:
        first, n_residuals = function(start), len(self.shooting.segment)
        self.f_scale = robust_scale(first[:n_residuals]) if self.loss != "linear" else 1.0

        def residuals(trial):
            self.integrated()
            try:
                return function(trial)
            except ValueError:  # the features have no value there: the step was too long
                return np.full_like(first, self.settings.refused)

        n_starts = len(start) - len(self.parameters)
        low, high = (
            np.concatenate([limit / self.units.parameters, np.full(n_starts, infinite)])
            for limit, infinite in zip(self.limits, (-np.inf, np.inf), strict=True)
        )
        small = len(first) * len(start) <= self.settings.dense
        return least_squares(
            residuals,
            np.clip(start, low, high),
            jacobian,
            bounds=(low, high),
            loss=robust_loss(self.loss, n_residuals),
            f_scale=self.f_scale,
            x_scale="jac",
            **dict.fromkeys(("ftol", "xtol", "gtol"), self.settings.tolerance),
            max_nfev=max_nfev,
            tr_solver="exact" if small else "lsmr",
            tr_options={} if small else dict(atol=1e-10, btol=1e-10, maxiter=2 * len(start)),
        )

    # -- verdict ---------------------------------------------------------------------------

    def _verdict(self, vector: Array, nodes: Array, nfev: int, status: Status) -> Estimate:
        """Whole rollouts of the given model, of it from the new starts, and of the new one."""
        whole = self.whole(nodes)
        judge = whole.whole if self.joined else self.shooting
        vectors = np.stack([self.parameters.start, self.parameters.start, vector])
        starts = np.stack([self.nodes, nodes, nodes])[:, whole.first]
        read, _, bounded = judge.outputs(vectors, starts)
        costs = np.array([self._cost(judge, *one) for one in zip(read, bounded, strict=True)])
        best = 2 if costs[2] < costs[:2].min() else 0
        nodes = nodes if best else self.nodes
        return Estimate(
            vector=vectors[best],
            starts=nodes[self.shooting.segments.first == 0],
            nodes=nodes,
            cost_before=float(costs[0]),
            cost_after=float(costs[best]),
            rmse_before=self._rmse(judge, read[0], bounded[0]),
            rmse_after=self._rmse(judge, read[best], bounded[best]),
            nfev=nfev,
            status=status,
        )

    def _cost(self, judge: Shooting, read: Array, bounded: NDArray[np.bool_]) -> float:
        if not bounded.all():
            return float("inf")
        z = np.square(judge.misfit(read[None])[0] / self.f_scale)
        return float(0.5 * self.f_scale**2 * LOSSES[self.loss](z)[0].sum())

    def _rmse(self, judge: Shooting, read: Array, bounded: NDArray[np.bool_]) -> Array:
        """Errors of each record and channel."""
        error = np.square(read - judge.segments.y)
        table = np.empty((len(self.records), len(self.observed)))
        for k in range(len(self.records)):
            own = judge.segments.record == k
            seen = error[:, own].reshape(-1, error.shape[2])
            table[k] = np.sqrt(np.nanmean(seen, axis=0)) if bounded[own].all() else np.inf
        return table

    # -- certainty -------------------------------------------------------------------------

    def covariance(self, found: Estimate) -> Array:
        """Covariance of the parameters; infinite where the data say nothing."""
        whole = self.whole(found.nodes)
        unknowns = self.shooting.join(found.vector, found.nodes[whole.first])
        slopes, residuals, piece = whole.information(unknowns)
        weight = LOSSES[self.loss](np.square(residuals / self.f_scale))[1]
        scaled = robust_covariance(
            slopes, residuals, weight, piece, len(self.observed), len(unknowns), self.settings
        )
        unit = self.units.parameters
        return scaled * np.outer(unit, unit)


def _free(model: Any, system: SwitchingModel, free: Any) -> NDArray[np.bool_]:
    if free is None:
        free = model.free if isinstance(model, StatedModel) else system.coef != 0.0
    chosen = truth_values("free", free)
    if chosen.shape != system.coef.shape:
        raise ValueError(
            f"free has shape {chosen.shape} and the coefficients {system.coef.shape}; give one "
            "truth value for each coefficient."
        )
    return chosen


def _noise(records: list[Record], noise: Any) -> Array:
    y = np.vstack([record.y for record in records])
    empty = ~np.isfinite(y).any(axis=0)
    if empty.any():
        raise ValueError(
            f"column {empty.argmax()} of x holds no finite value; name only measured states."
        )
    if noise is None:
        return spread(y)
    chosen = numbers("noise", noise)
    refuse_overflow("noise", chosen)
    refuse_vanishing("noise", chosen[None])
    if chosen.shape not in ((), y.shape[1:]) or not (chosen > 0.0).all():
        raise ValueError(
            f"noise={shown(noise)}; give a positive standard deviation for each channel."
        )
    return np.broadcast_to(chosen, y.shape[1:])
