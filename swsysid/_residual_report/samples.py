r"""The residual of a fitted model and everything it is compared with, checked and in order.

A smoother makes the velocity of a row of a window of measurements. Neighbours share most of them
and so their noise, and a row next to a switch is a mixture of two laws: correlation in time, a
dependence on what came before, and larger residuals near the surface are then the smoother's own.
It also bends what is curved over a window: with M the mean that a slope shows, :math:`M - 1` of a
velocity, and for laws that are linear nearly, of the states and inputs.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.exceptions import NotFittedError

from swsysid._automaton.model import HybridAutomaton
from swsysid._checks.arrays import labels, names_of, numbers, refuse_vanishing, table
from swsysid._checks.estimators import column_names, in_fitted_form
from swsysid._data.records import Records, make_records
from swsysid._data.windows import Windows, stays_of
from swsysid._pipelines import switching_step
from swsysid._residual_report.channels import without
from swsysid._results import Array
from swsysid._simulation.model import FittedModel
from swsysid._surfaces.surface import gives_values, has_decisions

FEWEST_ROWS = 30  # of a report: three bins of ten rows

_DEGREE = 4  # of the polynomials of a smoother, as `differentiate` has them

_FEWEST_ROWS_OF_A_MODE = 60  # of a mode examined by itself, as its tests share the level


class Predictor(Protocol):
    """A fitted model, whose `predict` may also take `t`, `groups` and `signals` by name."""

    @property
    def predict(self) -> Callable[..., ArrayLike]: ...


@dataclass(frozen=True)
class ResidualSamples:
    """Rows sorted by trajectory, and by time within it; without trajectories by value."""

    records: Records
    target: Array  # (n_rows, n_equations)
    residual: Array
    modes: NDArray | None  # (n_rows,)
    nearness: Array | None  # (n_rows,): distance from the surface, in the units of its function
    why_no_nearness: str  # empty if there is one
    trajectories: list  # their names, by the codes of the rows
    n_shared: int = 0  # rows left out, as they share measurements with others

    @classmethod
    def of(
        cls,
        model: object,
        records: Records,
        target: Array,
        predicted: Array,
        modes: NDArray | None,
        trajectories: list,
        X: object = None,
    ) -> ResidualSamples:
        """Subtract what was predicted, ask the model for its surface, and sort the rows.

        `trajectories` are names by the numbers in `records.groups`; `X` is the data frame of the
        user, where there is one.
        """
        nearness, why_not = _nearness(model, records.X if X is None else X)
        if records.groups is None:
            order = np.lexsort(np.column_stack([records.X, target, records.signals]).T[::-1])
        else:
            numbers, codes = np.unique(records.groups, return_inverse=True)
            records = replace(records, groups=codes)
            trajectories = [trajectories[number] for number in numbers]
            order = np.argsort(codes, kind="stable")
        return cls(
            records=records.take(order),
            target=target[order],
            residual=(target - predicted)[order],
            modes=None if modes is None else modes[order],
            nearness=None if nearness is None else nearness[order],
            why_no_nearness=why_not,
            trajectories=trajectories,
        )

    def decimated(self, window: int) -> ResidualSamples:
        """Only rows that share no measurement, where each is made of `window` of them."""
        if not self.records.ordered:
            raise ValueError(
                f"window={window} is that of a smoother along trajectories; give t or groups too."
            )
        smoothed = Smoothed.of(self.records, self.modes, window)
        rows = smoothed.decimated
        if len(rows) < FEWEST_ROWS:
            raise ValueError(
                f"only {len(rows)} of {len(self.residual)} rows share no measurement with another "
                f"and lie in one mode; a residual report needs {FEWEST_ROWS}: record "
                "more, or smooth over a shorter window."
            )
        predicted = self.target - self.residual
        modes = np.zeros(len(predicted)) if self.modes is None else self.modes
        residual = smoothed.straightened(self.residual, self.records.X, predicted, modes)
        return replace(
            self,
            records=self.records.take(rows),
            target=self.target[rows],
            residual=residual[rows],
            modes=None if self.modes is None else self.modes[rows],
            nearness=None if self.nearness is None else self.nearness[rows],
            n_shared=len(self.residual) - len(rows),
        )

    @property
    def codes(self) -> NDArray[np.intp]:
        """Trajectory of each row, contiguous; one for all where rows have no order."""
        groups = self.records.groups
        return np.zeros(len(self.records), dtype=np.intp) if groups is None else groups

    @property
    def equations(self) -> list[str]:
        """States whose velocities are predicted, or the quantity that a static law gives."""
        names = self.records.equations[: self.records.X.shape[1]]
        n_equations = self.target.shape[1]
        return [names[i] if i < len(names) else f"output {i}" for i in range(n_equations)]

    def parts(self) -> list[tuple[object, NDArray[np.intp]]]:
        """All rows as mode None, then those of each of several modes that has enough."""
        parts: list[tuple[object, NDArray[np.intp]]] = [(None, np.arange(len(self.records)))]
        if self.modes is None or (self.modes == self.modes[0]).all():
            return parts
        for mode in np.unique(self.modes):
            rows = np.flatnonzero(self.modes == mode)
            if len(rows) >= _FEWEST_ROWS_OF_A_MODE:
                parts.append((mode.item(), rows))
        return parts


def collect(
    model: Predictor,
    X: ArrayLike,
    Xdot: ArrayLike,
    t: ArrayLike | None,
    groups: ArrayLike | None,
    signals: ArrayLike | None,
    window: int = 1,
) -> ResidualSamples:
    """Check everything, predict, subtract, sort the rows, and keep those that share nothing."""
    if isinstance(model, type) or not hasattr(model, "predict"):
        kind = model if isinstance(model, type) else type(model)
        raise TypeError(f"{kind.__name__} has no predict; give a fitted model.")
    columns = table("X", X)
    n_rows, n_columns = columns.shape
    target = table("Xdot", Xdot, n_rows)
    channels = None if signals is None else table("signals", signals, n_rows)
    for name, values in (("X", columns), ("Xdot", target), ("signals", channels)):
        if values is not None:
            refuse_vanishing(name, values)
    if n_rows < FEWEST_ROWS:
        raise ValueError(f"X has {n_rows} rows; a residual report needs at least {FEWEST_ROWS}.")
    records = make_records(
        columns,
        target.shape[1],
        t=t,
        groups=groups,
        signals=channels,
        names=column_names(model, X, n_columns),
        signal_names=None if channels is None else names_of(signals, channels.shape[1], "signal"),
    )
    frame = in_fitted_form(model, X)
    t = records.t if records.timed else None
    predicted = _predicted(model, frame, t=t, groups=groups, signals=channels)
    if predicted.shape != target.shape:
        raise ValueError(
            f"the model predicts an array of shape {predicted.shape}, but Xdot has shape "
            f"{target.shape}; give the velocities that it was fitted to."
        )
    if not np.isfinite(predicted).all():
        raise ValueError("the model predicts NaN or infinity on these rows; leave them out.")
    modes = None
    if hasattr(model, "predict_modes"):
        modes = np.asarray(
            _accepted(model.predict_modes, frame, t=t, groups=groups, signals=channels)
        )
    named = [None] if groups is None else np.unique(labels("groups", groups)).tolist()
    samples = ResidualSamples.of(model, records, target, predicted, modes, named, X)
    return samples if window == 1 else samples.decimated(window)


def _predicted(model: Predictor, X: ArrayLike, **extras: ArrayLike | None) -> Array:
    """Predictions as columns."""
    try:
        predicted = numbers("the prediction of the model", _accepted(model.predict, X, **extras))
    except NotFittedError:
        raise NotFittedError("the model is not fitted yet; call fit with data first.") from None
    return predicted[:, None] if predicted.ndim == 1 else predicted


def _accepted(method: Callable, X: ArrayLike, **extras: ArrayLike | None) -> ArrayLike:
    """What a method of the model answers; it is told what its signature asks for."""
    accepted = inspect.signature(method).parameters
    known = {
        name: value for name, value in extras.items() if name in accepted and value is not None
    }
    answer: ArrayLike = method(X, **known)
    return answer


def _nearness(model: object, X: object) -> tuple[Array | None, str]:
    """How far each row is from the nearest place where the surface changes the mode.

    The surface is that of the regressor inside: of a search's best model, of a model with effects,
    of the last step of a pipeline. Without one the second answer says why.
    """
    for inside in ("best_estimator_", "estimator_"):
        model = getattr(model, inside, model)
    if isinstance(model, HybridAutomaton):
        return None, "the guards of an automaton remember, so that no place alone changes the mode"
    transform, regressor = switching_step(model)
    surface = getattr(regressor, "surface_", None)
    if surface is None and isinstance(regressor, FittedModel):  # a model that is stated
        surface = regressor.switching_model.surface
    if surface is None:
        return None, "the model has no switching surface"
    seen = np.asarray(transform(in_fitted_form(model, X)), dtype=float)
    if gives_values(surface):
        values = np.abs(np.asarray(surface.surface_values(seen), dtype=float))
        values = values.reshape(len(seen), -1)
        if not values.shape[1]:
            return None, "the model has one mode"
        typical = np.median(values, axis=0)
        return (values / np.where(typical > 0.0, typical, 1.0)).min(axis=1), ""
    if not has_decisions(surface):
        return None, f"a {type(surface).__name__} does not say how far its surface is"
    values = np.asarray(surface.decision_function(seen), dtype=float)
    if values.ndim == 1:
        return np.abs(values), ""
    best = np.sort(values, axis=1)
    return best[:, -1] - best[:, -2], ""


@dataclass(frozen=True)
class Smoothed:
    """Windows of a smoother within the modes that a model says."""

    windows: Windows

    @classmethod
    def of(cls, records: Records, modes: NDArray | None, window: int) -> Smoothed:
        """Those of a record in order of time."""
        assert records.t is not None
        modes = np.zeros(len(records)) if modes is None else modes
        stays = stays_of(modes, records.trajectories)
        return cls(Windows(records.t, stays, window // 2, _DEGREE))

    @property
    def decimated(self) -> NDArray[np.intp]:
        """Rows a window apart whose windows lie in one mode."""
        return self.windows.whole(self.windows.length)

    def straightened(self, residual: Array, X: Array, predicted: Array, modes: NDArray) -> Array:
        """The residual without what windows bend of states, inputs and velocities.

        A fitted model has taken of that what is linear in them, mode by mode.
        """
        rows = self.windows.whole()
        columns = np.hstack([X, predicted])
        bent = (self.windows.means @ columns - columns)[rows]
        own = np.column_stack([np.ones(len(rows)), columns[rows]])
        for mode in np.unique(modes[rows]):
            here = modes[rows] == mode
            bent[here] = without(own[here], bent[here])
        answer = residual.copy()
        answer[rows] = without(bent, residual[rows])
        return answer
