"""One refinement from its data to its result: preparation, stages, verdict, certainty."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks.arrays import truth_values
from swsysid._data.trajectories import spread
from swsysid._known.known import Known
from swsysid._noise import robust_scale
from swsysid._results import Array, Status
from swsysid._simulation.model import FittedModel, SwitchingModel, fitted_system
from swsysid._stays.certainty import errors_by, propagated
from swsysid._stays.output_error import OutputError, Rollouts
from swsysid._stays.rollouts import modes_at
from swsysid.refinement._known import Followers, RefinedFit, region_of
from swsysid.refinement._parameters import (
    Parametrization,
    ParametrizedPlant,
    System,
    fitted_and_free,
    grid_of,
    output_of,
)
from swsysid.refinement._result import RefinementResult, robust_covariance
from swsysid.refinement._stated import StatedModel
from swsysid.refinement._trajectories import (
    Observed,
    Recording,
    Segments,
    channel_noise,
    first_states,
    observed_states,
    read_trajectories,
    substeps_for,
)

_N_SEGMENTS = 32  # a segment is a thirty-second of the data, ...
_SHORTEST = 10  # ... but no fewer samples than decide about a state
_MOST_ROUNDS = 3  # in which steps or the scale of a surface may turn out to need another look
_DIVERGED = 1e3  # a state so many times larger than anything measured has diverged
_TOLERANCE = 1e-8  # of the least squares


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
        known: Known | None = None,
        left_out: frozenset[int] = frozenset(),
        frozen: bool = False,
        integrated: Callable[[], object] = int,
    ):
        fitted = fitted_system(model)
        self.model, self.loss, self.joined = model, loss, joined
        self.system = system = System(fitted, output_of(model))
        self.region = region_of(known, fitted, left_out)
        laws = Followers.of(self.region, fitted.coef, _free(model, fitted, free))
        self.parameters, self.of_segments = (
            Parametrization(system, laws, surface, frozen) for surface in (fit_surface, False)
        )
        if not frozen and not len(self.parameters):
            raise ValueError("no parameter is free; free a coefficient or name a parameter.")
        names, n_states = fitted.feature_map.names_in, system.n_states
        self.observed = self._channels(names[:n_states], len(names), observed)
        self.records = read_trajectories(trajectories, len(names) - n_states, len(self.observed))
        for one in (self.parameters, self.of_segments):
            one.bound({} if bounds is None else bounds)
        self.held = not linear
        self.noise = channel_noise(self.records, noise)
        starts = first_states(initial_states, names[:n_states], len(self.records))
        measured = self.observed if system.output is None else self.observed[:0]
        self.guess, self.bound = self._guessed(starts, measured)
        # what states and inputs count in, and the steps of the integration
        self.columns = np.hstack(
            [np.vstack(self.guess), np.vstack([record.u for record in self.records])]
        )
        self.spread = spread(self.columns)
        self.substeps = self._needed_substeps(self.start)
        self.integrated, self.nfev = integrated, 0
        self.length = self._bounded(segment_length)

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

    @property
    def plant(self) -> ParametrizedPlant:
        """The model with its parameters."""
        return ParametrizedPlant(self.system, self.parameters, self.spread, self.observed)

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
        bound = _DIVERGED * np.where(limit > 0.0, limit, 1.0)
        self.spread = np.ones(n_states + records[0].u.shape[1])
        if len(measured) == n_states:
            return guess, bound
        laws, guards, _ = self.plant.parts(self.start)
        grid = grid_of(self.system, records, guess, held=self.held)
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
        return substeps_for(self.plant.parts(vector).laws, self.columns, longest)

    def _bounded(self, given: int | None) -> int:
        """Length of segments on each of which the given model stays bounded."""
        n_steps = [len(record.t) - 1 for record in self.records]
        chosen = given or max(_SHORTEST, -(-sum(n_steps) // _N_SEGMENTS))
        length = min(chosen, max(n_steps))
        while not self._begun(length).bounded.all():
            if given is not None or length == 1:
                where = f"segments of {length} samples" if length > 1 else "one sample"
                raise ValueError(
                    f"the rollout of the start diverges within {where}; give a shorter "
                    "segment_length (None chooses one), or better coefficients to start from."
                )
            length = max(1, length // 2)
        return length

    def _begun(self, length: int) -> Rollouts:
        """Rollouts of the given model over segments of so many samples."""
        segments = Segments.of(self.records, self.guess, length)
        problem = OutputError(
            self.plant,
            grid_of(
                self.system, segments.parts, segments.guess, held=self.held, substeps=self.substeps
            ),
            segments.y, self.noise, self.bound, self.loss,
        )  # fmt: skip
        starts = np.array([one[0] for one in segments.guess])
        return problem.begun(self.start, np.clip(starts, -self.bound, self.bound))

    @property
    def _whole(self) -> int:
        """Samples of a segment of the problem that is solved."""
        longest = max(len(record.t) for record in self.records)
        return longest if self.joined else self.length

    # -- stages ----------------------------------------------------------------------------

    def refined(self, max_nfev: int) -> RefinementResult:
        """Fit the segments by themselves, then whole rollouts; keep what makes these better.

        By themselves they hold the surface: with starts of their own and wrong laws they drive it
        out of the data, to where it tells one mode alone.
        """
        # nodes at every time (`_stays.lifted`) in place of segments: a damper ends at 337, not 27
        whole = best = self._begun(self._whole)
        if self._starts_poorly(whole):
            joined, self.parameters = self.parameters, self.of_segments
            best = self._fitted(self._begun(self.length), max(1, max_nfev // 4))
            self.parameters = joined
            vector, _ = self._settled(self.of_segments.filled(best.vector)[joined.free])
            whole = self._begun(self._whole)
            first = Segments.of(self.records, self.guess, self.length).first == 0
            best = whole.problem.begun(vector, best.starts[first])
        for _ in range(_MOST_ROUNDS):
            best = self._fitted(best, max(1, max_nfev - self.nfev))
            vector, settled = self._settled(best.vector)
            if not settled:
                whole = self._begun(self._whole)
                best = whole.problem.begun(vector, best.starts)
            if settled or self.nfev >= max_nfev:
                break
        return self._result(whole, best)

    def initial_states(self, max_nfev: int) -> Array:
        """Initial states of whole rollouts of the given model, (n_records, n_states)."""
        return self._fitted(self._begun(self._whole), max_nfev).starts

    def told(self) -> tuple[Array, Array]:
        """Slopes and misfits of whole rollouts of the given model, their starts eliminated.

        In units of the noise, (n_residuals, n_parameters) and (n_residuals,).
        """
        whole = self._begun(self._whole)
        return whole.slopes_of_parameters, whole.without_starts(whole.misfit[:, None])[:, 0]

    def fit_beside(
        self, refined: FittedModel, touched: NDArray[np.bool_],
        again: Callable[[frozenset[int]], RefinedFit],
    ) -> RefinedFit:  # fmt: skip
        """The refined model with all coefficients free of which anything is known."""
        coef = self.parameters.at(self.found.vector).coef
        free = self.parameters.split(self.parameters.free | self.parameters.following)[0] | touched
        system, surface = System(fitted_system(refined), output_of(refined)), self.parameters.free
        fit_surface = bool(self.parameters.split(surface)[2].any())
        parameters = Parametrization(system, Followers.of(None, coef, free), fit_surface)
        plant = ParametrizedPlant(system, parameters, self.spread, self.observed)
        rollouts = replace(self.found.problem, plant=plant).begun(
            parameters.start, self.found.starts, self.found
        )
        root = np.sqrt(rollouts.weight)[:, None]
        both = np.column_stack([rollouts.slopes_of_parameters, self.found.misfit])
        both[:, -1:] = rollouts.without_starts(both[:, -1:])
        n_coef, n_unknowns = int(free.sum()), len(self.found.vector) + self.found.starts.size
        beside = np.linalg.qr(root * both[:, n_coef:-1])[0]
        own = root * np.delete(both, np.s_[n_coef:-1], axis=1)
        own -= beside @ (beside.T @ own)
        return RefinedFit(coef, free, own[:, :-1], own[:, -1], self._as_one, n_unknowns, again)

    @property
    def _as_one(self) -> float:
        """Residuals that count as one: how much larger variances are than those of white noise."""
        slopes, found = self.found.slopes_of_parameters, self.found
        covariance = self._covariance(found)
        told = np.isfinite(np.diag(covariance))
        slopes = np.sqrt(found.weight)[:, None] * slopes[:, told]
        squares = float((found.weight * np.square(found.misfit)).sum())
        freedom = max(1, len(found.misfit) - len(found.vector) - found.starts.size)
        ratio = np.einsum("ij,jk,ik->", slopes, covariance[np.ix_(told, told)], slopes)
        return max(1.0, float(ratio) * freedom / max(squares * told.sum(), 1e-300))

    def _starts_poorly(self, whole: Rollouts) -> bool:
        """True if whole rollouts of the given model are worse than the mean of the channels."""
        if not self.joined:
            return False
        with np.errstate(all="ignore"):
            error = np.sqrt(np.nanmean(np.square(whole.read - whole.problem.y), axis=0))
        usual = spread(np.vstack([record.y for record in self.records]))
        return not whole.bounded.all() or bool((error > usual).any())

    def _settled(self, vector: Array) -> tuple[Array, bool]:
        """The parameters, and whether they are still those of the problem that was solved.

        A model that became faster needs shorter steps, a surface that turned another scale; both
        need another round.
        """
        pivoted = self.parameters.pivoted(vector)
        needed = self._needed_substeps(pivoted)
        settled = needed <= self.substeps and np.array_equal(pivoted, vector)
        self.substeps = max(needed, self.substeps)
        return pivoted, settled

    def _fitted(self, start: Rollouts, max_nfev: int) -> Rollouts:
        """Where least squares lead; a robust loss bends at the scale of the first misfits."""
        if self.loss != "linear":
            scale = float(robust_scale(start.misfit)) or 1.0
            start = replace(start, problem=replace(start.problem, scale=scale))
        found, answer = start.problem.least(start, max_nfev, _TOLERANCE, self.integrated)
        self.nfev += answer.nfev
        self.status = Status.OPTIMAL if answer.status > 0 else Status.ITERATION_LIMIT
        return found

    # -- verdict and certainty -------------------------------------------------------------

    def _result(self, whole: Rollouts, found: Rollouts) -> RefinementResult:
        """Compare whole rollouts of the given model, of it from the new starts, and of the new."""
        problem, parameters = found.problem, self.parameters
        tried = [whole, problem.begun(self.start, found.starts, found), found]
        costs = [problem.value(one) for one in tried]
        best = 2 if costs[2] < min(costs[:2]) else 0
        self.found = tried[best]
        covariance = self._covariance(tried[best])
        errors = errors_by(parameters.by_vector.T, covariance)
        names = parameters.names
        segments = Segments.of(self.records, self.guess, self._whole)
        model = parameters.apply(self.model, tried[best].vector)
        vars(model)["covariance_"] = _of_all(parameters, covariance)
        return RefinementResult(
            model=model,
            names=names,
            values=tried[best].vector,
            covariance=covariance,
            coef_standard_errors=parameters.split(errors)[0],
            initial_states=tried[best].starts[segments.first == 0],
            cost_before=costs[0],
            cost_after=costs[best],
            rmse_before=self._rmse(whole, segments),
            rmse_after=self._rmse(tried[best], segments),
            nfev=self.nfev,
            segment_length=self.length,
            substeps=self.substeps,
            status=self.status,
            advice=_advice(names, covariance, costs[best] < costs[0], self.status),
        )

    def _rmse(self, rollouts: Rollouts, segments: Segments) -> Array:
        """Errors of each record and channel."""
        problem = rollouts.problem
        with np.errstate(all="ignore"):
            error = np.square(rollouts.read - problem.y)
        table = np.empty((len(self.records), len(self.observed)))
        for k in range(len(self.records)):
            own = np.nanmean(error[segments.record[problem.grid.groups] == k], axis=0)
            table[k] = np.sqrt(own) if rollouts.bounded[segments.record == k].all() else np.inf
        return table

    def _covariance(self, rollouts: Rollouts) -> Array:
        """Covariance of the parameters; infinite where the data say nothing."""
        n_unknowns = len(rollouts.vector) + rollouts.starts.size
        return robust_covariance(
            rollouts.slopes_of_parameters, rollouts.misfit, rollouts.weight,
            rollouts.problem.recording, len(self.observed), n_unknowns,
        )  # fmt: skip


def _of_all(parameters: Parametrization, covariance: Array) -> Array | None:
    """That of `SwitchingModel.parameters`, which has no parameters with names; None with these."""
    if parameters.named:
        return None
    return propagated(parameters.by_vector.T, covariance)


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
