"""What a model makes of recordings: rollouts, modes and guards along each of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.equations import transition_equation
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import Guard
from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._checks.estimators import check_fitted, column_names, in_fitted_form
from swsysid._data.recordings import Record
from swsysid._data.trajectories import label_text
from swsysid._free_rollouts.courses import Course
from swsysid._free_rollouts.judge import ModelRuns, Simulates
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.given import Given
from swsysid._stays.settings import SETTINGS
from swsysid._surfaces.surface import gives_values
from swsysid._trajectory_identifier import TrajectoryIdentifier
from swsysid.differentiation import estimate_noise

ENDED = -1  # the mode of a rollout that has ended


@dataclass(frozen=True)
class Track:
    """One recording and its rollout, at the times of the samples."""

    label: str
    t: Array
    measured: Array  # (n_samples, n_channels), NaN where missing
    inputs: Array
    modes: NDArray[np.intp]  # as identified
    rolled: Array  # of the shape of `measured`, NaN where the rollout has ended
    rolled_modes: NDArray[np.intp]
    guards: Array  # (n_samples, n_guards), NaN where another mode is active


@dataclass(frozen=True)
class Told:
    """What a fitted model tells of its recordings."""

    model: Simulates
    names: list[str]  # of states, then of inputs
    n_modes: int
    states: Array  # without noise, of the rows of the data
    modes: NDArray[np.intp]
    noise: Array  # of the channels
    guards: list[str]  # where each switches, as an equation
    values: Callable[[Array, Array, Array, NDArray[np.intp]], Array]  # of guards along a recording
    holds: tuple[str, ...] = ()
    stretch: int | None = None  # samples after which a rollout begins anew
    lags: int = 0
    is_automaton: bool = False


def told_by(model: object, given: Given) -> Told:
    """What is drawn of a model; anything else, or another's recordings, is refused."""
    if isinstance(model, SwitchingSystemRegressor):
        return _of_regressor(model, given)
    if not isinstance(model, TrajectoryIdentifier | HybridAutomatonRegressor):
        raise TypeError(
            f"model is a {type(model).__name__}; give a fitted TrajectoryIdentifier, "
            "HybridAutomatonRegressor or SwitchingSystemRegressor."
        )
    check_fitted(model)
    if len(model.modes_) != given.n_samples:
        raise ValueError(
            f"the model was fitted to {len(model.modes_)} samples and x has {given.n_samples}; "
            "give the recordings of the fit."
        )
    if isinstance(model, TrajectoryIdentifier):
        return _of_identifier(model)
    return _of_automaton(model)


def tracks_of(told: Told, given: Given, most: int, longest: int) -> list[Track]:
    """Of the first `most` recordings the first `longest` samples.

    Rollouts begin at estimated states, and switch by the model's own guards.
    """
    stepped = given.held(told.holds)
    return [
        _track(told, given, stepped, place, longest)
        for place in range(min(most, len(given.records)))
    ]


def _track(told: Told, given: Given, stepped: Given, place: int, longest: int) -> Track:
    rows, record = given.rows[place][:longest], given.records[place].taken(slice(longest))
    states, modes, n_channels = told.states[rows], told.modes[rows], record.y.shape[1]
    # rows at which inputs step are rolled through, and not drawn
    drawn = np.flatnonzero(stepped.rows[place] >= 0)[: len(rows)]
    whole = stepped.records[place].taken(slice(int(drawn[-1]) + 1))
    rolled = np.full(record.y.shape, np.nan)
    rolled_modes = np.full(len(rows), ENDED)
    label, length = label_text(given.labels[place]), told.stretch or len(rows)
    for first in range(0, len(rows) - 1, length):
        last = min(first + length, len(rows) - 1)
        part = whole.taken(slice(int(drawn[first]), int(drawn[last]) + 1))
        start = states[first : first + told.lags + 1]
        run = _rolled_out(told, label, part, start, int(modes[first]))
        here = drawn[first : last + 1] - int(drawn[first])
        here = here[here < len(run.t)]
        reached = slice(first, first + len(here))
        rolled[reached] = run.x[here, :n_channels]
        rolled_modes[reached] = run.modes[here]
    return Track(
        label=label,
        t=record.t,
        measured=record.y,
        inputs=record.u,
        modes=modes,
        rolled=rolled,
        rolled_modes=rolled_modes,
        guards=told.values(states, record.u, record.t, modes),
    )


@np.errstate(over="ignore", invalid="ignore")  # a model that diverges is drawn as far as it goes
def _rolled_out(told: Told, label: str, part: Record, start: Array, mode: int):
    start = start if told.lags else start.ravel()
    course = Course(label, part, start, mode if told.is_automaton else None)
    runs = ModelRuns(told.model, "zero" if told.lags else "linear")
    # a thousandth of the spread is not seen, where there is less noise than that
    least = np.maximum(told.noise, 1e-3 * part.filled.std(axis=0))
    return runs(course, start, np.broadcast_to(least, part.y.shape))


# -- of each kind of model -------------------------------------------------------------------------


def _of_regressor(model: SwitchingSystemRegressor, given: Given) -> Told:
    check_fitted(model)
    states = given.by_rows([record.filled for record in given.records])
    inputs = given.by_rows([record.u for record in given.records])
    names = given.names or column_names(model, None, model.n_features_in_, None)
    guards, values = _of_surface(model)
    return Told(
        model=model,
        names=names,
        n_modes=model.n_modes_,
        states=states,
        modes=np.asarray(model.predict_modes(in_fitted_form(model, np.hstack([states, inputs])))),
        noise=estimate_noise(states, given.places),
        guards=guards,
        values=values,
    )


def _of_identifier(model: TrajectoryIdentifier) -> Told:
    guards, values = _of_surface(model.estimator_)
    return Told(
        model=model,
        names=list(model.estimator_.switching_model.feature_map.names_in),
        n_modes=model.n_modes_,
        states=model.states_,
        modes=model.modes_,
        noise=model.noise_,
        guards=guards,
        values=values,
        holds=model.input_holds_,
        stretch=None if model.refine else SETTINGS.segment,
    )


def _of_automaton(model: HybridAutomatonRegressor) -> Told:
    automaton = model.automaton_
    guards, values = _of_transitions(automaton)
    return Told(
        model=model,
        names=[*automaton.state_names, *automaton.input_names],
        n_modes=model.n_modes_,
        states=model.states_,
        modes=model.modes_,
        noise=model.noise_,
        guards=guards,
        values=values,
        holds=model.input_holds_,
        lags=automaton.lags,
        is_automaton=True,
    )


def _of_surface(model: SwitchingSystemRegressor) -> tuple[list[str], Callable[..., Array]]:
    """Surfaces between modes, where they are known as functions."""
    surface = model.surface_
    if model.n_modes_ == 1 or not gives_values(surface):
        return [], lambda states, inputs, t, modes: np.empty((len(t), 0))

    def values(states: Array, inputs: Array, t: Array, modes: NDArray[np.intp]) -> Array:
        X = in_fitted_form(surface, np.hstack([states, inputs]))
        return np.asarray(surface.surface_values(X)).reshape(len(t), -1)

    return model.surface_equations(precision=3), values


def _of_transitions(automaton: HybridAutomaton) -> tuple[list[str], Callable[..., Array]]:
    """Guards, each in the mode that it leads out of."""
    columns, lags = automaton.guard_columns, automaton.lags
    states = automaton.feature_map.names_in[: automaton.n_lagged]

    def values(x: Array, u: Array, t: Array, modes: NDArray[np.intp]) -> Array:
        time = np.arange(len(t), dtype=float) if automaton.discrete_time else t - t[0]
        entered = np.maximum.accumulate(np.where(np.r_[True, np.diff(modes) != 0], time, 0.0))
        rows = [_earlier(channels, lag) for channels in (x, u) for lag in range(lags + 1)]
        known = np.column_stack([*rows, time - entered, time])
        each = [
            np.where(modes == one.source, _as_written(one.guard, known), np.nan)
            for one in automaton.transitions
        ]
        return np.reshape(each, (len(each), len(t))).T

    return [
        transition_equation(one, columns, states, 3, "text") for one in automaton.transitions
    ], values


def _as_written(guard: Guard, columns: Array) -> Array:
    """A guard as its equation has it: a monomial beside a constant has no factor."""
    conditions = []
    for one in guard.conditions:
        varying = one.coef[one.powers.any(axis=1) & (one.coef != 0.0)]
        scale = abs(varying[0]) if len(varying) == 1 else 1.0
        conditions.append(one.values(columns) / scale)
    return np.asarray(np.min(conditions, axis=0))


def _earlier(channels: Array, lag: int) -> Array:
    """Channels of some rows before; NaN before the first."""
    moved = np.full(channels.shape, np.nan)
    moved[lag:] = channels[: len(channels) - lag]
    return moved
