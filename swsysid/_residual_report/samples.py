"""The residual of a fitted model and everything it is compared with, checked and in order."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.exceptions import NotFittedError

from swsysid._checks.arrays import column, labels, numbers, refuse_vanishing, table
from swsysid._pipelines import switching_step
from swsysid._results import Array
from swsysid._surfaces.surface import decisions_of, gives_values

__all__ = ["ResidualSamples", "collect", "rows_of_modes"]

_FEWEST_ROWS, _FEWEST_OF_A_MODE = 30, 60


@dataclass(frozen=True)
class ResidualSamples:
    """Rows sorted by trajectory, and by time within it; without trajectories by value.

    Attributes
    ----------
    X, residual, target : ndarray of shape (n_rows, ...)
    codes : ndarray of shape (n_rows,), int
        Trajectory of each row, contiguous; one for all where rows have no order.
    ordered : bool
        Rows of a trajectory follow each other in time.
    t : ndarray of shape (n_rows,) or None
    signals : ndarray of shape (n_rows, n_signals)
    modes : ndarray of shape (n_rows,) or None
    nearness : ndarray of shape (n_rows,) or None
        Distance from the switching surface, in the units of its function.
    why_no_nearness : str
        Empty if there is one.
    trajectories : list
        Their names, in the order of the codes.
    names, signal_names, equations : list of str
        Columns of X, of the signals, and states whose velocities are predicted.
    """

    X: Array
    residual: Array
    target: Array
    codes: NDArray[np.intp]
    ordered: bool
    t: Array | None
    signals: Array
    modes: NDArray | None
    nearness: Array | None
    why_no_nearness: str
    trajectories: list
    names: list[str]
    signal_names: list[str]
    equations: list[str]


def collect(model: Any, X, Xdot, t=None, groups=None, signals=None) -> ResidualSamples:
    """Check everything, predict, subtract, and sort the rows.

    Raises
    ------
    TypeError, ValueError
        If something is missing, of the wrong length or not finite; the message says what to do.
    """
    if isinstance(model, type) or not hasattr(model, "predict"):
        kind = model if isinstance(model, type) else type(model)
        raise TypeError(f"{kind.__name__} has no predict; give a fitted model.")
    columns = table("X", X)
    n_rows = len(columns)
    target = table("Xdot", Xdot, n_rows)
    channels = np.empty((n_rows, 0)) if signals is None else table("signals", signals, n_rows)
    for name, values in (("X", columns), ("Xdot", target), ("signals", channels)):
        refuse_vanishing(name, values)
    if n_rows < _FEWEST_ROWS:
        raise ValueError(f"X has {n_rows} rows; a residual report needs at least {_FEWEST_ROWS}.")
    trajectories, codes = _trajectories(groups, n_rows)
    times = None if t is None else _times(t, codes, n_rows)

    names = _names(model, X, columns.shape[1])
    frame = _in_fitted_form(model, X, columns)
    predicted = _predicted(model, frame, {"t": times, "groups": groups, "signals": channels})
    if predicted.shape != target.shape:
        raise ValueError(
            f"the model predicts an array of shape {predicted.shape}, but Xdot has shape "
            f"{target.shape}; give the velocities that it was fitted to."
        )
    if not np.isfinite(predicted).all():
        raise ValueError("the model predicts NaN or infinity on these rows; leave them out.")
    modes = np.asarray(model.predict_modes(frame)) if hasattr(model, "predict_modes") else None
    nearness, why_no_nearness = _nearness(model, X, columns)
    ordered = t is not None or groups is not None
    order = (
        np.argsort(codes, kind="stable")
        if ordered
        else np.lexsort(np.column_stack([columns, target, channels]).T[::-1])
    )
    return ResidualSamples(
        X=columns[order],
        residual=(target - predicted)[order],
        target=target[order],
        codes=codes[order],
        ordered=ordered,
        t=None if times is None else times[order],
        signals=channels[order],
        modes=None if modes is None else modes[order],
        nearness=None if nearness is None else nearness[order],
        why_no_nearness=why_no_nearness,
        trajectories=trajectories,
        names=names,
        signal_names=_column_names(signals, channels.shape[1], "signal"),
        equations=[names[i] if i < len(names) else f"output {i}" for i in range(target.shape[1])],
    )


def rows_of_modes(samples: ResidualSamples) -> list[tuple[object, NDArray[np.intp]]]:
    """Modes with rows enough to be examined, and their rows; none if there is one mode."""
    if samples.modes is None:
        return []
    labels = np.unique(samples.modes)
    if len(labels) < 2:
        return []
    rows = [(label.item(), np.flatnonzero(samples.modes == label)) for label in labels]
    return [(label, where) for label, where in rows if len(where) >= _FEWEST_OF_A_MODE]


def _trajectories(groups: ArrayLike | None, n_rows: int) -> tuple[list, NDArray[np.intp]]:
    """Names of the trajectories, and the number of each row's."""
    if groups is None:
        return [None], np.zeros(n_rows, dtype=np.intp)
    names, codes = np.unique(labels("groups", groups, n_rows), return_inverse=True)
    return names.tolist(), codes


def _times(t: ArrayLike, codes: NDArray[np.intp], n_rows: int) -> Array:
    times = column("t", t, n_rows)
    refuse_vanishing("t", times)
    order = np.argsort(codes, kind="stable")
    together = np.diff(codes[order]) == 0
    if (np.diff(times[order])[together] <= 0.0).any():
        raise ValueError(
            "t does not increase within every trajectory; sort the rows by time, and name the "
            "trajectories in groups if there is more than one."
        )
    return times


def _names(model: Any, X: Any, n_columns: int) -> list[str]:
    fitted = getattr(model, "feature_names_in_", None)
    if fitted is not None and len(fitted) == n_columns:
        return [str(name) for name in fitted]
    return _column_names(X, n_columns, "x")


def _column_names(table: Any, n_columns: int, stem: str) -> list[str]:
    columns = getattr(table, "columns", None)
    if columns is None and n_columns == 1 and getattr(table, "name", None) is not None:
        columns = [table.name]
    if columns is None:
        return [f"{stem}{i}" for i in range(n_columns)]
    return [str(name) for name in columns]


def _in_fitted_form(model: Any, X: Any, columns: Array) -> Any:
    """A data frame where the model was fitted on one, else an array."""
    names = getattr(model, "feature_names_in_", None)
    if names is None:
        return columns
    if hasattr(X, "columns"):
        return X
    import pandas as pd

    return pd.DataFrame(columns, columns=names)


def _predicted(model: Any, X: Any, extras: dict[str, Any]) -> Array:
    """Predictions as columns; the model is told what its signature asks for."""
    accepted = inspect.signature(model.predict).parameters
    options = {
        name: value for name, value in extras.items() if name in accepted and value is not None
    }
    if "signals" in options and not options["signals"].shape[1]:
        del options["signals"]
    try:
        predicted = numbers("the prediction of the model", model.predict(X, **options))
    except NotFittedError:
        raise NotFittedError("the model is not fitted yet; call fit with data first.") from None
    return predicted[:, None] if predicted.ndim == 1 else predicted


def _nearness(model: Any, X: Any, columns: Array) -> tuple[Array | None, str]:
    """How far each row is from the nearest place where the surface changes the mode.

    The surface is that of the regressor inside: of a search's best model, of a model with effects,
    of the last step of a pipeline. Without one the second answer says why.
    """
    for inside in ("best_estimator_", "estimator_"):
        model = getattr(model, inside, model)
    transform, regressor = switching_step(model)
    surface = getattr(regressor, "surface_", None)
    if surface is None:
        return None, "the model has no switching surface"
    seen = np.asarray(transform(_in_fitted_form(model, X, columns)), dtype=float)
    distance = _distance(surface, seen)
    if distance is None:
        return None, f"a {type(surface).__name__} does not say how far its surface is"
    return (distance, "") if distance.size else (None, "the model has one mode")


def _distance(surface: Any, X: Array) -> Array | None:
    """Distance of each row in the units of the surface, empty if there is no surface."""
    if gives_values(surface):
        values = np.abs(np.asarray(surface.surface_values(X), dtype=float).reshape(len(X), -1))
        if not values.shape[1]:
            return np.empty(0)
        typical = np.median(values, axis=0)
        return np.asarray((values / np.where(typical > 0.0, typical, 1.0)).min(axis=1))
    decided = decisions_of(surface, X)
    if decided is None:
        return None
    best = np.sort(decided, axis=1)
    lead = best[:, -1] - best[:, -2]
    return np.asarray(lead if decided.shape[1] > 2 else 0.5 * lead)
