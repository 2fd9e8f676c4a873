"""One refinement from its data to its result: preparation, stages, verdict, certainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult, least_squares

from swsysid._checks.arrays import truth_values
from swsysid._results import Array, Status
from swsysid._simulation.model import FittedModel, SwitchingModel, fitted_system
from swsysid.refinement._certainty import robust_covariance
from swsysid.refinement._continuous import WholeRollouts
from swsysid.refinement._losses import LOSSES, inner_scale, robust_loss
from swsysid.refinement._parameters import Parametrization, fitted_and_free, output_of
from swsysid.refinement._result import RefinementResult
from swsysid.refinement._rollout import Segments, guessed_states, substeps_for
from swsysid.refinement._settings import SETTINGS
from swsysid.refinement._shooting import Shooting, Units
from swsysid.refinement._stated import StatedModel
from swsysid.refinement._system import Maps, RowSystem
from swsysid.refinement._trajectories import (
    Observed,
    Recording,
    channel_noise,
    first_states,
    observed_states,
    read_trajectories,
    spread,
)


class Estimation:
    """The refinement of one model on some trajectories; the options are those of `refine`.

    `frozen` leaves nothing free but the initial states; `integrated` is called after each
    integration.
    """

    def __init__(
        self,
        model: FittedModel,
        trajectories: Recording | Iterable[Recording],
        *,
        observed: Observed | None = None,
        initial_states: ArrayLike | Mapping[str, float] | None = None,
        segment_length: int | None = None,
        loss: str = "linear",
        fit_surface: bool = False,
        free: ArrayLike | None = None,
        bounds: Mapping[str, tuple[float, float]] | None = None,
        noise: ArrayLike | None = None,
        linear: bool = False,
        joined: bool = True,
        frozen: bool = False,
        integrated: Callable[[], object] = int,
    ):
        system = fitted_system(model)
        self.integrated = integrated
        self.loss, self.linear, self.joined = loss, linear, joined
        self.maps = maps = Maps(system, output_of(model))
        chosen = _free(model, system, free)
        self.parameters = Parametrization(model, maps, chosen, fit_surface, frozen)
        if not frozen and not len(self.parameters):
            raise ValueError("no parameter is free; free a coefficient or name a parameter.")
        names = system.feature_map.names_in
        states = names[: maps.n_states]
        self.observed = self._channels(states, len(names), observed)
        self.records = read_trajectories(
            trajectories, len(names) - maps.n_states, len(self.observed)
        )
        self.limits = self.parameters.bounds({} if bounds is None else bounds)
        deviations = channel_noise(self.records, noise)
        starts = first_states(initial_states, states, len(self.records))
        measured = self.observed if maps.output is None else self.observed[:0]
        sets = self.parameters.sets(self.start[None])
        guess, bound = guessed_states(maps, sets, self.records, starts, measured, linear)
        # units of states and parameters, and the steps of the integration, from some points
        x, u = np.vstack(guess), np.vstack([record.u for record in self.records])
        rows = np.unique(np.linspace(0, len(x) - 1, SETTINGS.most_rows).astype(int))
        self._points = x[rows], u[rows]
        at_points = self._at_points(self.start)
        velocities = at_points.field(at_points.modes(*self._points))(*self._points)
        self._typical = at_points.features(*self._points), velocities
        self.units = Units(self.parameters.sizes(*self._typical), spread(x), deviations, bound)
        self.substeps = self._needed_substeps(self.start)
        self._cut(guess, segment_length)

    # -- preparation -----------------------------------------------------------------------

    @property
    def start(self) -> Array:
        """The parameters of the given model; which of them are free may change."""
        return self.parameters.start

    def _channels(
        self, states: list[str], n_columns: int, observed: Observed | None
    ) -> NDArray[np.intp]:
        """Columns of the output that are measured."""
        if self.maps.output is None:
            return observed_states(observed, states)
        if observed is not None:
            raise ValueError(
                "observed is given for a model with an output; leave it out, the output says what "
                "the columns of x measure."
            )
        sets = self.parameters.sets(self.start[None])
        return np.arange(self.maps.output(np.ones((1, n_columns)), sets.named).shape[1])

    def _at_points(self, vector: Array) -> RowSystem:
        """The system at the points at which rates and sizes are looked at."""
        owners = np.zeros(len(self._points[0]), dtype=np.intp)
        return RowSystem(self.maps, self.parameters.sets(vector[None]), owners)

    def _needed_substeps(self, vector: Array) -> int:
        longest = max(float(np.quantile(np.diff(record.t), 0.99)) for record in self.records)
        return substeps_for(self._at_points(vector), *self._points, longest)

    def _cut(self, guess: list[Array], length: int | None) -> None:
        """Segments of which the given model stays bounded on each."""
        n_steps = [len(record.t) - 1 for record in self.records]
        chosen = length or max(SETTINGS.shortest, -(-sum(n_steps) // SETTINGS.n_segments))
        self.length = min(chosen, max(n_steps))
        while True:
            self.shooting = self._shooting(self.length)
            nodes = [guess[k][i] for k, i in self.shooting.segments.places]
            self.nodes = np.clip(np.array(nodes), -self.units.bound, self.units.bound)
            _, _, bounded = self.shooting.outputs(self.start[None], self.nodes[None])
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
        return Shooting(self.maps, self.parameters, segments, self.observed, self.units)

    # -- stages ----------------------------------------------------------------------------

    def refined(self, max_nfev: int) -> RefinementResult:
        """Fit the segments by themselves, then whole rollouts; keep what makes these better."""
        vector, nodes, nfev = self.start, self.nodes, 0
        for weight in SETTINGS.earlier_weights if self._starts_poorly() else ():
            answer = self._least_squares(
                partial(self.shooting.residuals, weight=weight),
                partial(self.shooting.jacobian, weight=weight),
                self.shooting.join(vector, nodes),
                max(1, (max_nfev - nfev) // 4),
            )
            vector, nodes = self.shooting.split(answer.x)
            nfev += answer.nfev
            vector, _ = self._settled(vector)
        for _ in range(SETTINGS.most_rounds):
            whole = self.whole(nodes)
            answer = self._fit_whole(whole, vector, max(1, max_nfev - nfev))
            (vector, starts), nodes = self.shooting.split(answer.x), whole.nodes
            nodes[whole.first] = starts
            nfev += answer.nfev
            vector, settled = self._settled(vector)
            if settled or nfev >= max_nfev:
                break
        status = Status.OPTIMAL if answer.status > 0 else Status.ITERATION_LIMIT
        return self._result(vector, nodes, nfev, status)

    def initial_states(self, max_nfev: int) -> Array:
        """Initial states of whole rollouts of the given model, (n_records, n_states)."""
        answer = self._fit_whole(self.whole(self.nodes), self.start, max_nfev)
        return self.shooting.split(answer.x)[1]

    def whole(self, nodes: Array) -> WholeRollouts:
        """The problem of whole rollouts, their segments beginning about `nodes`."""
        return WholeRollouts(self.shooting, self._shooting(), nodes, self.joined)

    def _starts_poorly(self) -> bool:
        """True if whole rollouts of the given model are worse than the mean of the channels."""
        if not self.joined:
            return False
        uncut = self._shooting()
        nodes = self.nodes[self.shooting.segments.first == 0]
        read, _, bounded = uncut.outputs(self.start[None], nodes[None])
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
            self.units = replace(self.units, parameters=self.parameters.sizes(*self._typical))
            self.shooting = self._shooting(self.length)
        return pivoted, settled

    def _fit_whole(self, whole: WholeRollouts, vector: Array, max_nfev: int) -> OptimizeResult:
        start = self.shooting.join(vector, whole.nodes[whole.first])
        return self._least_squares(whole.residuals, whole.jacobian, start, max_nfev)

    def _least_squares(
        self, function: Callable, jacobian: Callable, start: Array, max_nfev: int
    ) -> OptimizeResult:
        first, n_residuals = function(start), len(self.shooting.segment)
        self.f_scale = inner_scale(first[:n_residuals]) if self.loss != "linear" else 1.0

        def residuals(trial):
            self.integrated()
            try:
                return function(trial)
            except ValueError:  # the features have no value there: the step was too long
                return np.full_like(first, SETTINGS.refused)

        n_starts = len(start) - len(self.parameters)
        low, high = (
            np.concatenate([limit / self.units.parameters, np.full(n_starts, infinite)])
            for limit, infinite in zip(self.limits, (-np.inf, np.inf), strict=True)
        )
        small = len(first) * len(start) <= SETTINGS.dense
        return least_squares(
            residuals,
            np.clip(start, low, high),
            jacobian,
            bounds=(low, high),
            loss=robust_loss(self.loss, n_residuals),
            f_scale=self.f_scale,
            x_scale="jac",
            **dict.fromkeys(("ftol", "xtol", "gtol"), SETTINGS.tolerance),
            max_nfev=max_nfev,
            tr_solver="exact" if small else "lsmr",
            tr_options={} if small else dict(atol=1e-10, btol=1e-10, maxiter=2 * len(start)),
        )

    # -- verdict and certainty -------------------------------------------------------------

    def _result(self, vector: Array, nodes: Array, nfev: int, status: Status) -> RefinementResult:
        """Compare whole rollouts of the given model, of it from the new starts, and of the new."""
        whole, parameters = self.whole(nodes), self.parameters
        judge = whole.whole if self.joined else self.shooting
        vectors = np.stack([self.start, self.start, vector])
        starts = np.stack([self.nodes, nodes, nodes])[:, whole.first]
        read, _, bounded = judge.outputs(vectors, starts)
        costs = np.array([self._cost(judge, *one) for one in zip(read, bounded, strict=True)])
        best = 2 if costs[2] < costs[:2].min() else 0
        vector, nodes = vectors[best], nodes if best else self.nodes
        covariance = self._covariance(vector, nodes)
        errors = np.zeros(len(parameters.values))
        errors[parameters.free] = np.sqrt(np.diag(covariance))
        names = parameters.names
        return RefinementResult(
            model=parameters.apply(vector),
            names=names,
            values=vector,
            covariance=covariance,
            coef_standard_errors=parameters.split(errors)[0],
            initial_states=nodes[self.shooting.segments.first == 0],
            cost_before=float(costs[0]),
            cost_after=float(costs[best]),
            rmse_before=self._rmse(judge, read[0], bounded[0]),
            rmse_after=self._rmse(judge, read[best], bounded[best]),
            nfev=nfev,
            segment_length=self.length,
            substeps=self.substeps,
            status=status,
            advice=_advice(names, covariance, costs[best] < costs[0], status),
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

    def _covariance(self, vector: Array, nodes: Array) -> Array:
        """Covariance of the parameters; infinite where the data say nothing."""
        whole = self.whole(nodes)
        unknowns = self.shooting.join(vector, nodes[whole.first])
        slopes, residuals, piece = whole.information(unknowns)
        weight = LOSSES[self.loss](np.square(residuals / self.f_scale))[1]
        scaled = robust_covariance(
            slopes, residuals, weight, piece, len(self.observed), len(unknowns)
        )
        unit = self.units.parameters
        return scaled * np.outer(unit, unit)


def _free(model: FittedModel, system: SwitchingModel, free: ArrayLike | None) -> NDArray[np.bool_]:
    if free is None:
        free = model.free if isinstance(model, StatedModel) else fitted_and_free(system.coef)
    chosen = truth_values("free", free)
    if chosen.shape != system.coef.shape:
        raise ValueError(
            f"free has shape {chosen.shape} and the coefficients {system.coef.shape}; give one "
            "truth value for each coefficient."
        )
    return chosen


def _advice(names: list[str], covariance: Array, improved: bool, status: Status) -> str:
    known = np.isfinite(np.diag(covariance))
    if not known.all():
        undetermined = [name for name, is_known in zip(names, known, strict=True) if not is_known]
        return (
            f"The data do not determine {', '.join(undetermined)}; fix them by free, or measure "
            "where they matter."
        )
    if not improved:
        return (
            "No progress: the rollouts of the start are the best found, and it is returned "
            "unchanged; try another start, a shorter segment_length, or more terms."
        )
    if status is Status.ITERATION_LIMIT:
        return "Still improving when max_nfev was reached; increase it."
    return "Converged; nothing to do."
