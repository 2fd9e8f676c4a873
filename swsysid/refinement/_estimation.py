"""One refinement from its data to its result: preparation, stages, verdict, certainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult, least_squares

from swsysid._checks.arrays import truth_values
from swsysid._data.trajectories import spread
from swsysid._results import Array, Status
from swsysid._simulation.model import FittedModel, SwitchingModel, fitted_system
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws
from swsysid._stays.rollouts import modes_at
from swsysid.refinement._parameters import Parametrization, fitted_and_free, output_of
from swsysid.refinement._result import RefinementResult, robust_covariance
from swsysid.refinement._settings import SETTINGS
from swsysid.refinement._shooting import (
    LOSSES,
    Pieces,
    Rollout,
    Shooting,
    Units,
    grid_of,
    inner_scale,
)
from swsysid.refinement._stated import StatedModel
from swsysid.refinement._system import System, substeps_for
from swsysid.refinement._trajectories import (
    Observed,
    Recording,
    channel_noise,
    first_states,
    observed_states,
    read_trajectories,
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
        fitted = fitted_system(model)
        self.model, self.integrated = model, integrated
        self.loss, self.linear, self.joined = loss, linear, joined
        self.system = system = System(fitted, output_of(model))
        chosen = _free(model, fitted, free)
        self.parameters = Parametrization(system, chosen, fit_surface, frozen)
        if not frozen and not len(self.parameters):
            raise ValueError("no parameter is free; free a coefficient or name a parameter.")
        names, n_states = fitted.feature_map.names_in, system.n_states
        self.observed = self._channels(names[:n_states], len(names), observed)
        self.records = read_trajectories(trajectories, len(names) - n_states, len(self.observed))
        self.limits = self.parameters.bounds({} if bounds is None else bounds)
        deviations = channel_noise(self.records, noise)
        starts = first_states(initial_states, names[:n_states], len(self.records))
        measured = self.observed if system.output is None else self.observed[:0]
        self.guess, bound = self._guessed(starts, measured)
        # units of states and parameters, and the steps of the integration, from some points
        x, u = np.vstack(self.guess), np.vstack([record.u for record in self.records])
        self.columns = spread(np.hstack([x, u]))
        rows = np.unique(np.linspace(0, len(x) - 1, SETTINGS.most_rows).astype(int))
        self._points = x[rows], u[rows]
        laws, guards = self._laws_and_guards(self.start)
        modes = modes_at(guards, *self._points)
        at_points = np.hstack(self._points)
        self._typical = laws.features(at_points), laws.velocities(modes, *self._points)
        own, inputs = np.split(self.columns, [n_states])
        sizes = self.parameters.sizes(*self._typical)
        self.units = Units(sizes, own, inputs, deviations, bound)
        self.substeps = self._needed_substeps(self.start)
        self._cut(segment_length)

    # -- preparation -----------------------------------------------------------------------

    @property
    def start(self) -> Array:
        """The parameters of the given model; which of them are free may change."""
        return self.parameters.start

    def _channels(
        self, states: list[str], n_columns: int, observed: Observed | None
    ) -> NDArray[np.intp]:
        """Columns of the output that are measured."""
        if self.system.output is None:
            return observed_states(observed, states)
        if observed is not None:
            raise ValueError(
                "observed is given for a model with an output; leave it out, the output says what "
                "the columns of x measure."
            )
        named = self.parameters.at(self.start).named
        return np.arange(self.system.read(np.ones((1, n_columns)), named).shape[1])

    def _laws_and_guards(self, vector: Array) -> tuple[Laws, Guards]:
        """For some parameters, none of them free."""
        return self.system.known(self.columns, self.parameters.at(vector))

    def _guessed(self, starts: Array, measured: NDArray[np.intp]) -> tuple[list[Array], Array]:
        """States of each record, (n_samples, n_states), and the bound of one that has diverged.

        Where the initial states `starts` are NaN, `measured` states, those that the channels of
        the records are, start as measured and others at 0. Hidden states are carried by the given
        model, with the measured ones reset at every sample.
        """
        given, records, n_states = np.isfinite(starts), self.records, self.system.n_states
        largest = np.nanmax(np.abs(np.vstack([record.y for record in records])), axis=0)
        guess = []
        for record, start, known in zip(records, np.nan_to_num(starts), given, strict=True):
            states = np.zeros((len(record.t), n_states))
            states[:, measured] = record.filled[:, : len(measured)]
            states[0] = np.where(known, start, states[0])
            guess.append(states)
        first = np.abs([states[0] for states in guess]).max(axis=0)
        limit = np.maximum(first, max(1.0, float(largest.max())))
        limit[measured] = np.maximum(largest[: len(measured)], first[measured])
        bound = SETTINGS.diverged * np.where(limit > 0.0, limit, 1.0)
        self.columns = np.ones(n_states + records[0].u.shape[1])
        if len(measured) == n_states:
            return guess, bound
        laws, guards = self._laws_and_guards(self.start)
        grid = grid_of(self.system, records, guess, held=not self.linear)
        carried, seen = grid.guess.copy(), np.zeros(grid.guess.shape[:2], dtype=bool)
        for k, places in enumerate(grid.sampled):
            seen[places, k] = True
        for k, (u, after, steps) in enumerate(zip(grid.u, grid.after, grid.steps, strict=False), 1):
            x = carried[k - 1]
            with np.errstate(all="ignore"):
                x = np.nan_to_num(laws.step(modes_at(guards, x, u), x, u, after, steps))
            x[:, measured] = np.where(seen[k, :, None], carried[k][:, measured], x[:, measured])
            carried[k] = np.clip(x, -bound, bound)
        return [carried[places, k] for k, places in enumerate(grid.sampled)], bound

    def _needed_substeps(self, vector: Array) -> int:
        longest = max(float(np.quantile(np.diff(record.t), 0.99)) for record in self.records)
        return substeps_for(self._laws_and_guards(vector)[0], np.hstack(self._points), longest)

    def _cut(self, length: int | None) -> None:
        """Pieces of which the given model stays bounded on each."""
        n_steps = [len(record.t) - 1 for record in self.records]
        chosen = length or max(SETTINGS.shortest, -(-sum(n_steps) // SETTINGS.n_segments))
        self.length = min(chosen, max(n_steps))
        while True:
            apart = self._shooting(self.length)
            if apart.rolled(apart.join(self.start, apart.begins)).bounded.all():
                break
            if length is not None or self.length == 1:
                where = f"segments of {self.length} samples" if self.length > 1 else "one sample"
                raise ValueError(
                    f"the rollout of the start diverges within {where}; give a shorter "
                    "segment_length (None chooses one), or better coefficients to start from."
                )
            self.length = max(1, self.length // 2)
        self._join()

    def _join(self) -> None:
        """The problem of whole rollouts, or that of pieces that stay apart."""
        whole = max(len(record.t) for record in self.records)
        self.whole = self._shooting(whole if self.joined else self.length)

    def _shooting(self, length: int) -> Shooting:
        pieces = Pieces.of(self.records, self.guess, length)
        return Shooting(
            self.system, self.parameters, pieces, self.observed, self.units, self.substeps,
            self.linear,
        )  # fmt: skip

    # -- stages ----------------------------------------------------------------------------

    def refined(self, max_nfev: int) -> RefinementResult:
        """Fit the segments by themselves, then whole rollouts; keep what makes these better."""
        vector, starts, nfev = self.start, self.whole.begins, 0
        if self._starts_poorly():
            apart = self._shooting(self.length)
            answer = self._least_squares(apart, vector, apart.begins, max(1, max_nfev // 4))
            (vector, nodes), nfev = apart.split(answer.x), answer.nfev
            starts = nodes[apart.pieces.first == 0]
            vector, _ = self._settled(vector)
        for _ in range(SETTINGS.most_rounds):
            answer = self._least_squares(self.whole, vector, starts, max(1, max_nfev - nfev))
            vector, starts = self.whole.split(answer.x)
            nfev += answer.nfev
            vector, settled = self._settled(vector)
            if settled or nfev >= max_nfev:
                break
        status = Status.OPTIMAL if answer.status > 0 else Status.ITERATION_LIMIT
        return self._result(vector, starts, nfev, status)

    def initial_states(self, max_nfev: int) -> Array:
        """Initial states of whole rollouts of the given model, (n_records, n_states)."""
        answer = self._least_squares(self.whole, self.start, self.whole.begins, max_nfev)
        return self.whole.split(answer.x)[1]

    def _starts_poorly(self) -> bool:
        """True if whole rollouts of the given model are worse than the mean of the channels."""
        if not self.joined:
            return False
        found = self.whole.rolled(self.whole.join(self.start, self.whole.begins))
        with np.errstate(all="ignore"):
            error = np.sqrt(np.nanmean(np.square(found.read - self.whole.y), axis=0))
        usual = spread(np.vstack([record.y for record in self.records]))
        return not found.bounded.all() or bool((error > usual).any())

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
            self._join()
        return pivoted, settled

    def _least_squares(
        self, problem: Shooting, vector: Array, starts: Array, max_nfev: int
    ) -> OptimizeResult:
        start = problem.join(vector, starts)
        first = problem.residuals(start)
        self.f_scale = inner_scale(first) if self.loss != "linear" else 1.0

        def residuals(trial):
            self.integrated()
            try:
                return problem.residuals(trial)
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
            problem.jacobian,
            bounds=(low, high),
            loss=self.loss,
            f_scale=self.f_scale,
            x_scale="jac",
            **dict.fromkeys(("ftol", "xtol", "gtol"), SETTINGS.tolerance),
            max_nfev=max_nfev,
            tr_solver="exact" if small else "lsmr",
            tr_options={} if small else dict(atol=1e-10, btol=1e-10, maxiter=2 * len(start)),
        )

    # -- verdict and certainty -------------------------------------------------------------

    def _result(self, vector: Array, starts: Array, nfev: int, status: Status) -> RefinementResult:
        """Compare whole rollouts of the given model, of it from the new starts, and of the new."""
        whole, parameters, own = self.whole, self.parameters, self.whole.begins
        tried = [(self.start, own), (self.start, starts), (vector, starts)]
        runs = [whole.rolled(whole.join(*one)) for one in tried]
        costs = [self._cost(run) for run in runs]
        best = 2 if costs[2] < min(costs[:2]) else 0
        vector, starts = tried[best]
        covariance = self._covariance(vector, starts)
        errors = np.zeros(len(parameters.values))
        errors[parameters.free] = np.sqrt(np.diag(covariance))
        names = parameters.names
        return RefinementResult(
            model=parameters.apply(self.model, vector),
            names=names,
            values=vector,
            covariance=covariance,
            coef_standard_errors=parameters.split(errors)[0],
            initial_states=starts[whole.pieces.first == 0],
            cost_before=costs[0],
            cost_after=costs[best],
            rmse_before=self._rmse(runs[0]),
            rmse_after=self._rmse(runs[best]),
            nfev=nfev,
            segment_length=self.length,
            substeps=self.substeps,
            status=status,
            advice=_advice(names, covariance, costs[best] < costs[0], status),
        )

    def _cost(self, run: Rollout) -> float:
        if not run.bounded.all():
            return float("inf")
        z = np.square(self.whole.misfit(run.read) / self.f_scale)
        return float(0.5 * self.f_scale**2 * LOSSES[self.loss](z)[0].sum())

    def _rmse(self, run: Rollout) -> Array:
        """Errors of each record and channel."""
        with np.errstate(all="ignore"):
            error = np.square(run.read - self.whole.y)
        table = np.empty((len(self.records), len(self.observed)))
        record = self.whole.pieces.record
        for k in range(len(self.records)):
            own = np.nanmean(error[record[self.whole.piece] == k], axis=0)
            table[k] = np.sqrt(own) if run.bounded[record == k].all() else np.inf
        return table

    def _covariance(self, vector: Array, starts: Array) -> Array:
        """Covariance of the parameters; infinite where the data say nothing."""
        whole, unknowns = self.whole, self.whole.join(vector, starts)
        slopes, residuals = whole.information(unknowns), whole.residuals(unknowns)
        weight = LOSSES[self.loss](np.square(residuals / self.f_scale))[1]
        scaled = robust_covariance(
            slopes, residuals, weight, whole.segment, len(self.observed), len(unknowns)
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
