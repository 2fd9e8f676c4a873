"""One refinement from its data to its estimate: preparation, stages, verdict, certainty."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from swsysid._checks.arrays import numbers, refuse_overflow, refuse_vanishing, truth_values
from swsysid._checks.parameters import shown
from swsysid._results import Array, Status
from swsysid._simulation.model import fitted_system
from swsysid.refinement._certainty import robust_covariance
from swsysid.refinement._continuous import WholeRollouts
from swsysid.refinement._integrate import rollout, substeps_for
from swsysid.refinement._losses import LOSSES, inner_scale, robust_loss
from swsysid.refinement._parameters import Parametrization
from swsysid.refinement._segments import (
    Record,
    Segments,
    filled_channels,
    first_states,
    observed_states,
    read_trajectories,
)
from swsysid.refinement._shooting import DENSE, Shooting
from swsysid.refinement._system import Maps, RowSystem

__all__ = ["Estimate", "Estimation"]

N_SEGMENTS, SHORTEST = 32, 10
# A state so many times larger than anything measured has diverged.
DIVERGED = 1e3
# Weights of the defects in the stages before whole rollouts, where the start's are poor.
EARLIER_WEIGHTS = (1.0, 10.0)
TOLERANCE = 1e-8
REFUSED = 1e6  # residual of a trial at which the model has no value
MOST_LOOKS = 3
MOST_ROWS = 500  # at which rates and sizes are looked at


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
    """The refinement of one model on some trajectories; the options are those of `refine`."""

    def __init__(
        self,
        model: Any,
        trajectories: Any,
        *,
        integrated: Callable[[], object] = int,  # called after each integration
        **options: Any,
    ):
        system = fitted_system(model)
        output = getattr(model, "output", None)
        self.maps = Maps(system, output)
        names = system.feature_map.names_in
        free = _free(model, system, options["free"])
        self.parameters = Parametrization(model, system, output, free, options["fit_surface"])
        if options["frozen"]:
            self.parameters.freeze()
        elif not len(self.parameters):
            raise ValueError("no parameter is free; free a coefficient or name a parameter.")
        self.observed = self._channels(names, options["observed"])
        n_inputs = len(names) - self.maps.n_states
        self.records = read_trajectories(trajectories, n_inputs, len(self.observed))
        self.limits = self.parameters.bounds(options["bounds"])
        self.loss, self.linear = options["loss"], options["linear"]
        self.noise = _noise(self.records, options["noise"])
        guess = self._guess(names, options["initial_states"])
        self._measure(guess)
        self._cut(guess, options["segment_length"])
        self.integrated = integrated

    # -- preparation -----------------------------------------------------------------------

    def _channels(self, names, observed) -> NDArray[np.intp]:
        """Columns of the output that are measured."""
        if self.maps.output is None:
            return observed_states(observed, names, self.maps.n_states)
        if observed is not None:
            raise ValueError(
                "observed is given for a model with an output; leave it out, the output says what "
                "the columns of x measure."
            )
        named = {name: np.array([value]) for name, value in self.parameters.named.items()}
        return np.arange(self.maps.output(np.ones((1, len(names))), named).shape[1])

    def _guess(self, names, initial_states) -> list[Array]:
        """States of each record, (n_samples, n_states): measured, or carried by the model."""
        n_states = self.maps.n_states
        starts = first_states(initial_states, names[:n_states], len(self.records))
        measured = self.observed if self.maps.output is None else self.observed[:0]
        given = np.isfinite(starts)
        starts = np.where(given, starts, 0.0)
        reach = np.nanmax(np.abs(np.vstack([record.y for record in self.records])), axis=0)
        limit = np.maximum(np.abs(starts).max(axis=0), max(1.0, float(reach.max())))
        limit[measured] = np.maximum(reach[: len(measured)], np.abs(starts[:, measured]).max(0))
        self.bound = DIVERGED * np.where(limit > 0.0, limit, 1.0)
        guess = []
        for record, start, known in zip(self.records, starts, given, strict=True):
            filled = filled_channels(record)[:, : len(measured)]
            start[measured] = np.where(known[measured], start[measured], filled[0])
            guess.append(self._carried(record, start, measured, filled))
        return guess

    def _carried(self, record: Record, start, measured, filled) -> Array:
        """Hidden states by the given model, with the measured ones reset at every sample."""
        if len(measured) == self.maps.n_states:
            whole = np.empty((len(record.t), self.maps.n_states))
            whole[:, measured], whole[0] = filled, start
            return whole
        sets = self.parameters.sets(self.parameters.start[None])
        length = len(record.t) - 1 if not len(measured) else 1
        pieces = Segments([record], length, linear=self.linear, substeps=1)
        carried = np.tile(start, (len(record.t), 1))
        for k in range(len(pieces)):
            first, now = pieces.first[k], carried[[[pieces.first[k]]]]
            run, _ = rollout(self.maps, sets, pieces.part(k), now, self.bound)
            carried[first : first + len(run)] = run[:, 0, 0]
            carried[first + len(run) - 1, measured] = filled[first + len(run) - 1]
        return carried

    def _measure(self, guess: list[Array]) -> None:
        """Sizes of states, features and parameters, and the steps of the integration."""
        x, u = np.vstack(guess), np.vstack([record.u for record in self.records])
        self.scale = _spread(x)
        rows = np.unique(np.linspace(0, len(x) - 1, MOST_ROWS).astype(int))
        self._points = x[rows], u[rows]
        sets = self.parameters.sets(self.parameters.start[None])
        system = RowSystem(self.maps, sets, np.zeros(len(rows), dtype=np.intp))
        features = self.maps.features(np.hstack(self._points), system.named)
        velocities = system.field(system.modes(*self._points))(*self._points)
        self._typical = features, velocities
        self.parameter_sizes = self.parameters.sizes(features, velocities)
        self.substeps = self._substeps(self.parameters.start)

    def _substeps(self, vector: Array) -> int:
        longest = max(float(np.quantile(np.diff(record.t), 0.99)) for record in self.records)
        return substeps_for(self.maps, self.parameters.sets(vector[None]), *self._points, longest)

    def _cut(self, guess: list[Array], length: int | None) -> None:
        """Segments of which the given model stays bounded on each."""
        longest = max(len(record.t) for record in self.records) - 1
        n_steps = sum(len(record.t) - 1 for record in self.records)
        chosen = length or max(SHORTEST, -(-n_steps // N_SEGMENTS))
        self.length = min(chosen, longest)
        while True:
            self.shooting = self._shooting(self.length)
            nodes = [guess[k][i] for k, i in self.shooting.segments.places]
            self.nodes = np.clip(np.array(nodes), -self.bound, self.bound)
            vector = self.parameters.start
            _, _, bounded = self.shooting.outputs(vector[None], self.nodes[None])
            if bounded.all():
                return
            if length is not None or self.length == 1:
                where = f"segments of {self.length} samples" if self.length > 1 else "one sample"
                raise ValueError(
                    f"the rollout of the start diverges within {where}; give a shorter "
                    "segment_length (None chooses one), or better coefficients to start from."
                )
            self.length = max(1, self.length // 2)

    def _shooting(self, length: int) -> Shooting:
        segments = Segments(self.records, length, linear=self.linear, substeps=self.substeps)
        return Shooting(
            self.maps,
            self.parameters,
            segments,
            observed=self.observed,
            noise=self.noise,
            scale=self.scale,
            sizes=self.parameter_sizes,
            bound=self.bound,
        )

    # -- stages ----------------------------------------------------------------------------

    def solve(self, joined: bool, max_nfev: int) -> Estimate:
        """Fit the segments by themselves, then whole rollouts; keep what makes these better."""
        self.joined = joined
        vector, nodes, nfev = self.parameters.start, self.nodes, 0
        for weight in EARLIER_WEIGHTS if joined and self._starts_poorly() else ():
            answer = self._tied(vector, nodes, weight, max(1, (max_nfev - nfev) // 4))
            vector, nodes = self.shooting.split(answer.x)
            nfev += answer.nfev
            vector, _ = self._settled(vector)
        for _ in range(MOST_LOOKS):
            whole = self._whole(nodes)
            answer = self._joined(whole, vector, nodes, max(1, max_nfev - nfev))
            (vector, starts), nodes = whole.split(answer.x), whole.nodes
            nodes[whole.first] = starts
            nfev += answer.nfev
            vector, settled = self._settled(vector)
            if settled or nfev >= max_nfev:
                break
        status = Status.OPTIMAL if answer.status > 0 else Status.ITERATION_LIMIT
        return self._verdict(vector, nodes, nfev, status)

    def _starts_poorly(self) -> bool:
        """True if whole rollouts of the given model are worse than the mean of the channels."""
        uncut = self._shooting(max(len(record.t) for record in self.records))
        nodes = self.nodes[self.shooting.segments.first == 0]
        read, _, bounded = uncut.outputs(self.parameters.start[None], nodes[None])
        spread = _spread(np.vstack([record.y for record in self.records]))
        error = np.sqrt(np.nanmean(np.square(read[0] - uncut.segments.y), axis=(0, 1)))
        return not bounded.all() or bool((error > spread).any())

    def initial_states(self, max_nfev: int) -> Array:
        """Initial states of whole rollouts of the given model, (n_records, n_states)."""
        self.joined = True
        whole = self._whole(self.nodes)
        answer = self._joined(whole, self.parameters.start, self.nodes, max_nfev)
        return whole.split(answer.x)[1]

    def _settled(self, vector: Array) -> tuple[Array, bool]:
        """The parameters, and whether they are still those of the problem that was solved.

        A model that became faster needs shorter steps, a surface that turned another scale; both
        need another look.
        """
        pivoted = self.parameters.pivoted(vector)
        needed = self._substeps(pivoted)
        settled = needed <= self.substeps and np.array_equal(pivoted, vector)
        if not settled:
            self.substeps = max(needed, self.substeps)
            self.parameter_sizes = self.parameters.sizes(*self._typical)
            self.shooting = self._shooting(self.length)
        return pivoted, settled

    def _whole(self, nodes: Array) -> WholeRollouts:
        uncut = self._shooting(max(len(record.t) for record in self.records))
        return WholeRollouts(self.shooting, uncut, nodes, self.joined)

    def _tied(self, vector: Array, nodes: Array, weight: float, max_nfev: int):
        """Segments tied to each other by weighted defects."""
        shooting = self.shooting
        start = shooting.join(vector, nodes)
        return self._least_squares(
            lambda trial: shooting.residuals(trial, weight),
            lambda trial: shooting.jacobian(trial, weight),
            start,
            max_nfev,
        )

    def _joined(self, whole: WholeRollouts, vector: Array, nodes: Array, max_nfev: int):
        """Whole rollouts."""
        start = whole.join(vector, nodes[whole.first])
        return self._least_squares(whole.residuals, whole.jacobian, start, max_nfev)

    def _least_squares(self, function, jacobian, start, max_nfev):
        first, n_residuals = function(start), len(self.shooting.segment)
        self.f_scale = inner_scale(first[:n_residuals]) if self.loss != "linear" else 1.0

        def residuals(trial):
            self.integrated()
            try:
                return function(trial)
            except ValueError:  # the features have no value there: the step was too long
                return np.full_like(first, REFUSED)

        n_starts = len(start) - len(self.parameters)
        low, high = (
            np.concatenate([limit / self.parameter_sizes, np.full(n_starts, infinite)])
            for limit, infinite in zip(self.limits, (-np.inf, np.inf), strict=True)
        )
        small = len(first) * len(start) <= DENSE
        options = {"atol": 1e-10, "btol": 1e-10, "maxiter": 2 * len(start)}
        return least_squares(
            residuals,
            np.clip(start, low, high),
            jacobian,
            bounds=(low, high),
            loss=robust_loss(self.loss, n_residuals),
            f_scale=self.f_scale,
            x_scale="jac",
            ftol=TOLERANCE,
            xtol=TOLERANCE,
            gtol=TOLERANCE,
            max_nfev=max_nfev,
            tr_solver="exact" if small else "lsmr",
            tr_options={} if small else options,
        )

    # -- verdict ---------------------------------------------------------------------------

    def _verdict(self, vector, nodes, nfev, status) -> Estimate:
        """Whole rollouts of the given model, of it from the new starts, and of the new one."""
        whole = self._whole(nodes)
        judge = whole.whole if self.joined else self.shooting
        vectors = np.stack([self.parameters.start, self.parameters.start, vector])
        starts = np.stack([self.nodes, nodes, nodes])[:, whole.first]
        read, _, bounded = judge.outputs(vectors, starts)
        costs = np.array([self._cost(judge, *one) for one in zip(read, bounded, strict=True)])
        best = 2 if costs[2] < costs[:2].min() else 0
        return Estimate(
            vector=vectors[best],
            starts=(nodes if best else self.nodes)[self.shooting.segments.first == 0],
            nodes=nodes if best else self.nodes,
            cost_before=float(costs[0]),
            cost_after=float(costs[best]),
            rmse_before=self._rmse(judge, read[0], bounded[0]),
            rmse_after=self._rmse(judge, read[best], bounded[best]),
            nfev=nfev,
            status=status,
        )

    def _cost(self, judge: Shooting, read: Array, bounded) -> float:
        if not bounded.all():
            return np.inf
        z = np.square(judge.misfit(read[None])[0] / self.f_scale)
        return 0.5 * self.f_scale**2 * float(LOSSES[self.loss](z)[0].sum())

    def _rmse(self, judge: Shooting, read: Array, bounded) -> Array:
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
        whole = self._whole(found.nodes)
        unknowns = whole.join(found.vector, found.nodes[whole.first])
        slopes, residuals, piece = whole.information(unknowns)
        weight = LOSSES[self.loss](np.square(residuals / self.f_scale))[1]
        unit = self.parameter_sizes
        scaled = robust_covariance(
            slopes, residuals, weight, piece, len(self.observed), len(unknowns)
        )
        return scaled * np.outer(unit, unit)


def _free(model, system, free) -> NDArray[np.bool_]:
    given = getattr(model, "free", None) if free is None else free
    chosen = truth_values("free", system.coef != 0.0 if given is None else given)
    if chosen.shape != system.coef.shape:
        raise ValueError(
            f"free has shape {chosen.shape} and the coefficients {system.coef.shape}; give one "
            "truth value for each coefficient."
        )
    return chosen


def _noise(records: list[Record], noise) -> Array:
    y = np.vstack([record.y for record in records])
    empty = ~np.isfinite(y).any(axis=0)
    if empty.any():
        raise ValueError(
            f"column {empty.argmax()} of x holds no finite value; name only measured states."
        )
    if noise is None:
        return _spread(y)
    chosen = numbers("noise", noise)
    refuse_overflow("noise", chosen)
    refuse_vanishing("noise", chosen[None])
    if chosen.shape not in ((), y.shape[1:]) or not (chosen > 0.0).all():
        raise ValueError(
            f"noise={shown(noise)}; give a positive standard deviation for each channel."
        )
    return np.broadcast_to(chosen, y.shape[1:])


def _spread(columns: Array) -> Array:
    spread = np.nanstd(columns, axis=0)
    size = np.nanmax(np.abs(columns), axis=0)
    return np.where(spread > 0.0, spread, np.where(size > 0.0, size, 1.0))
