"""Rows behind a report of effects: predictions before and after, shapes, rollouts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_regressor import EffectRegressor
from swsysid._effect_search.rollouts import Rollout, compare_rollouts, stretches
from swsysid._effect_search.shapes import Shape, effect_shape
from swsysid._results import Array

__all__ = ["EffectData", "TrajectoryError"]


@dataclass(frozen=True)
class TrajectoryError:
    """Root mean square errors of the velocities on one trajectory, one for each state."""

    trajectory: str
    n_samples: int
    before: tuple[float, ...]
    after: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class EffectData:
    """What pictures of a search for effects need.

    Attributes
    ----------
    records : Records
        The whole record.
    rows : ndarray
        Rows on which the models are compared: those held out, or new ones.
    targets : ndarray of shape (n_samples, n_states)
        Measured velocities (next states in discrete time) of the whole record.
    models : tuple of two EffectRegressor
        The declared model and the one with the effects, neither fitted to `rows`.
    final : EffectRegressor
        The model with the effects that is handed to the user, whose shapes are drawn.
    covariances : tuple of ndarray
        Of the parameters of each effect of `final`; empty without a term.
    trajectory_names : ndarray or None
    """

    records: Records
    rows: NDArray[np.intp]
    targets: Array
    models: tuple[EffectRegressor, EffectRegressor]
    final: EffectRegressor
    covariances: tuple[Array, ...]
    trajectory_names: NDArray | None = None

    @property
    def discrete(self) -> bool:
        """True if the targets are the next states."""
        return bool(self.final.joint_fit_.switching.discrete_time)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states."""
        listed = self.records.names[: self.records.n_states]
        return tuple(listed[: self.measured.shape[1]])

    @cached_property
    def measured(self) -> Array:
        """Velocities of `rows`, shape (n_rows, n_states)."""
        return self.targets[self.rows]

    @cached_property
    def predicted(self) -> tuple[Array, Array]:
        """Predictions of `rows` by each of the two models."""
        before, after = (model.joint_fit_.predict(self.records)[self.rows] for model in self.models)
        return before, after

    @cached_property
    def residuals(self) -> tuple[Array, Array]:
        """What each of the two models leaves over."""
        before, after = (self.measured - one for one in self.predicted)
        return before, after

    @cached_property
    def errors(self) -> tuple[Array, Array]:
        """Root mean square error of each state, before and after."""
        before, after = (np.sqrt(np.mean(one**2, axis=0)) for one in self.residuals)
        return before, after

    @cached_property
    def stretches(self) -> list[tuple[str, NDArray[np.intp]]]:
        """Names and positions among `rows` of the contiguous parts of trajectories."""
        position = np.full(len(self.records), -1)
        position[self.rows] = np.arange(len(self.rows))
        found = stretches(self.records, self.rows, self.trajectory_names)
        return [(name, position[part]) for name, part in found]

    @cached_property
    def by_trajectory(self) -> tuple[TrajectoryError, ...]:
        """Errors of every stretch; empty if the order of the rows is not known."""
        return tuple(
            TrajectoryError(name, len(part), *(_size(one[part]) for one in self.residuals))
            for name, part in self.stretches
        )

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """One for each effect, along the whole record."""
        declared, final = self.models[0].joint_fit_, self.final.joint_fit_
        return tuple(
            effect_shape(declared, final, place, covariance, self.records, self.targets)
            for place, covariance in enumerate(self.covariances)
        )

    @property
    def rollouts(self) -> tuple[Rollout, ...]:
        """The first few stretches simulated by both models."""
        return self._rollouts[0]

    @property
    def why_no_rollouts(self) -> str:
        """A sentence if there are none."""
        return self._rollouts[1]

    @cached_property
    def _rollouts(self) -> tuple[tuple[Rollout, ...], str]:
        parts = [(name, self.rows[part]) for name, part in self.stretches]
        return compare_rollouts(self.models, self.records, parts)

    @property
    def most_changed(self) -> int:
        """State whose error the effects lower most; without effects the one furthest off."""
        before, after = self.errors
        spread = np.std(self.measured, axis=0)
        change = np.abs(before - after) / np.where(before > 0, before, np.inf)
        size = before / np.where(spread > 0, spread, np.inf)
        return int(np.argmax(change if self.covariances else size))


def _size(residual: Array) -> tuple[float, ...]:
    return tuple(np.sqrt(np.mean(residual**2, axis=0)).tolist())
