"""Rollouts of a declared model and of one with effects, beside the measured trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_regressor import EffectRegressor
from swsysid._effect_search.report_settings import REPORT
from swsysid._results import Array, Trajectory

__all__ = ["Rollout", "compare_rollouts", "stretches"]

Models = tuple[EffectRegressor, EffectRegressor]


@dataclass(frozen=True, eq=False)
class Rollout:
    """One measured trajectory and two simulations from its first state.

    Attributes
    ----------
    name : str
        Of the trajectory.
    t : ndarray of shape (n_times,)
    measured : ndarray of shape (n_times, n_states)
    before, after : ndarray of shape (n_reached, n_states)
        Of the declared model and of the one with the effects; shorter if it ended early.
    ended : tuple of str
        Why each of the two ended early; "" if it did not.
    """

    name: str
    t: Array
    measured: Array
    before: Array
    after: Array
    ended: tuple[str, str]

    @property
    def compared(self) -> float:
        """The time that both simulations have reached."""
        shared = min(len(self.before), len(self.after))
        return float(self.t[shared - 1] - self.t[0]) if shared else 0.0

    @property
    def errors(self) -> tuple[Array, Array]:
        """Root mean square error of each state over the times that both have reached."""
        shared = min(len(self.before), len(self.after))
        before, after = (
            np.sqrt(np.mean((one[:shared] - self.measured[:shared]) ** 2, axis=0))
            if shared
            else np.full(self.measured.shape[1], np.nan)
            for one in (self.before, self.after)
        )
        return before, after

    def to_dict(self) -> dict[str, Any]:
        """Name, duration and errors."""
        before, after = self.errors
        return {
            "trajectory": self.name,
            "duration": float(self.t[-1] - self.t[0]),
            "compared": self.compared,
            "error_before": before.tolist(),
            "error_after": after.tolist(),
            "ended_before": self.ended[0],
            "ended_after": self.ended[1],
        }


def stretches(
    records: Records, rows: NDArray[np.intp], names: NDArray | None
) -> list[tuple[str, NDArray[np.intp]]]:
    """Names and rows of the contiguous parts of trajectories among `rows`, in order of time."""
    if not records.ordered:
        return []
    assert records.t is not None
    chosen = np.zeros(len(records), dtype=bool)
    chosen[rows] = True
    found = []
    for number, trajectory in enumerate(records.trajectories):
        edges = np.flatnonzero(np.diff(chosen[trajectory].astype(int))) + 1
        parts = [part for part in np.split(trajectory, edges) if len(part) and chosen[part[0]]]
        only = len(records.trajectories) == 1
        name = _name(number if names is None else names[number])
        for part in parts:
            whole = len(part) == len(trajectory)
            start, end = records.t[part[[0, -1]]]
            told = f"{start:.4g} to {end:.4g}"
            found.append((name if whole else told if only else f"{name}, {told}", part))
    return found


def _name(label: Any) -> str:
    """A label of a trajectory; a column of whole numbers may have been read as decimals."""
    return f"{label:.15g}" if isinstance(label, float) else str(label)


def compare_rollouts(
    models: Models,
    records: Records,
    parts: Sequence[tuple[str, NDArray[np.intp]]],
) -> tuple[tuple[Rollout, ...], str]:
    """Rollouts of two models along some stretches, and why there are none.

    Of many stretches the first few are simulated, of a long one the first thousand samples.
    Inputs and signals are linear between their samples.
    """
    discrete = models[0].joint_fit_.switching.discrete_time
    if not parts:
        return (), "the order of the rows is not known: give t or groups"
    if not (records.timed or discrete):
        return (), "the times of the rows are not known: give t"
    if records.X.shape[1] < records.n_states:
        return (), "the columns of X are not the states"
    done = tuple(
        _rollout(models, records, name, rows[: REPORT.most_samples], discrete)
        for name, rows in parts[: REPORT.most_rollouts]
        if len(rows) > 1
    )
    return done, ""


def _rollout(
    models: Models,
    records: Records,
    name: str,
    rows: NDArray[np.intp],
    discrete: bool,
) -> Rollout:
    assert records.t is not None
    t, X = records.t[rows], records.X[rows]
    if discrete and not records.timed:
        t = np.arange(len(rows), dtype=float)
    measured, inputs = X[:, : records.n_states], X[:, records.n_states :]
    signals = records.signals[rows] if records.signals.shape[1] else None
    before, after = (
        model.simulate(
            measured[0],
            t,
            inputs if records.n_inputs else None,
            signals=signals,
            input_hold="zero" if discrete else "linear",
        )
        for model in models
    )
    return Rollout(name, t, measured, before.x, after.x, (_why(before), _why(after)))


def _why(trajectory: Trajectory) -> str:
    """Why a simulation ended early; "" if it did not."""
    if trajectory.status.ok:
        return ""
    end = f"at {trajectory.t[-1]:.4g}" if len(trajectory.t) else "at the start"
    return f"{trajectory.status.value} {end}: {trajectory.status.advice}"
