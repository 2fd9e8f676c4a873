"""What a report of effects holds, and the rows behind it: predictions, shapes, rollouts."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._data.trajectories import label_text
from swsysid._effect_regressor import EffectRegressor
from swsysid._effect_search.contributions import Shape, effect_shape
from swsysid._effect_search.rollouts import Rollout, free_of, rolled_out
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._noise import exact_below, root_mean_square
from swsysid._rendering.parts import Parts, entries_of
from swsysid._residual_report.report import ResidualReport
from swsysid._results import Array
from swsysid.effects import FoundEffect

_POSSIBLE = 0.05  # probability of a mode that a row next to a surface may be in


def stretches(
    records: Records, rows: NDArray[np.intp], names: NDArray | None
) -> list[tuple[str, NDArray[np.intp]]]:
    """Names and rows of the contiguous parts of trajectories among `rows`, in order of time."""
    if not records.ordered:
        return []
    assert records.t is not None
    chosen = np.isin(np.arange(len(records)), rows)
    only, found = len(records.trajectories) == 1, []
    for number, trajectory in enumerate(records.trajectories):
        label = number if names is None else names[number]
        name = label_text(label)
        edges = np.flatnonzero(np.diff(chosen[trajectory])) + 1
        for part in np.split(trajectory, edges):
            if len(part) and chosen[part[0]]:
                start, end = records.t[part[[0, -1]]]
                when = f"{start:.4g} to {end:.4g}" if only else f"{name}, {start:.4g} to {end:.4g}"
                found.append((name if len(part) == len(trajectory) else when, part))
    return found


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
    samples : ndarray
        Samples in whose stretches these are, which are simulated.
    targets : ndarray of shape (n_samples, n_states)
        Measured velocities (next states in discrete time) of the whole record.
    models : tuple of two EffectRegressor
        The declared model and the one with the effects, neither fitted to `rows`.
    final : EffectRegressor
        The model with the effects that is handed to the user, whose shapes are drawn.
    covariances : tuple of ndarray
        Of the parameters of each effect of `final`; empty without a term.
    trajectory_names : ndarray or None
    aside : ndarray of int
        Rows of the record with gross errors.
    states : ndarray of shape (n_samples, n_states) or None
        As they were measured, where velocities were made of them.
    noise : ndarray of shape (n_states,) or None
        Of these.
    """

    records: Records
    rows: NDArray[np.intp]
    samples: NDArray[np.intp]
    targets: Array
    models: tuple[EffectRegressor, EffectRegressor]
    final: EffectRegressor
    covariances: tuple[Array, ...]
    trajectory_names: NDArray | None = None
    aside: NDArray[np.intp] = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    states: Array | None = None
    noise: Array | None = None

    @property
    def discrete(self) -> bool:
        """True if the targets are the next states."""
        return bool(self.final.joint_fit_.laws.discrete_time)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of what the laws give."""
        return self.records.equations

    @cached_property
    def measured(self) -> Array:
        """Velocities of `rows`, shape (n_rows, n_states)."""
        return self.targets[self.rows]

    @cached_property
    def predicted(self) -> tuple[Array, Array]:
        """Predictions of `rows` by each of the two models."""
        before, after = (
            model.joint_fit_.predict(self.records, rows=self.rows) for model in self.models
        )
        return before, after

    @cached_property
    def residuals(self) -> tuple[Array, Array]:
        """What each of the two models leaves over."""
        return self.measured - self.predicted[0], self.measured - self.predicted[1]

    @cached_property
    def errors(self) -> tuple[Array, Array]:
        """Root mean square error of each state, before and after."""
        before, after = map(root_mean_square, self.residuals)
        return before, after

    @cached_property
    def usual_errors(self) -> tuple[Array, Array]:
        """The same of rows of a sure mode without gross errors; of all if there are none."""
        usual = ~np.isin(self.rows, self.aside) & self.mode_known
        if not usual.any():
            return self.errors
        before, after = (root_mean_square(errors[usual]) for errors in self.residuals)
        return before, after

    @cached_property
    def mode_known(self) -> NDArray[np.bool_]:
        """Whether the model with the effects is sure of the mode, (n_rows,)."""
        probabilities = self.models[1].joint_fit_.mode_proba(self.records)[self.rows]
        return np.asarray(probabilities.max(axis=1) > 1.0 - _POSSIBLE)

    @cached_property
    def stretches(self) -> list[tuple[str, NDArray[np.intp]]]:
        """Names and positions among `rows` of the contiguous parts of trajectories."""
        position = np.full(len(self.records), -1)
        position[self.rows] = np.arange(len(self.rows))
        found = [(name, position[part]) for name, part in self._parts]
        return [(name, part[part >= 0]) for name, part in found if np.any(part >= 0)]

    @cached_property
    def _parts(self) -> list[tuple[str, NDArray[np.intp]]]:
        """Names and samples of the contiguous parts of trajectories."""
        return stretches(self.records, self.samples, self.trajectory_names)

    @cached_property
    def by_trajectory(self) -> tuple[TrajectoryError, ...]:
        """Errors of every stretch; empty if the order of the rows is not known."""
        found = []
        for name, part in self.stretches:
            before, after = (tuple(root_mean_square(one[part]).tolist()) for one in self.residuals)
            found.append(TrajectoryError(name, len(part), before, after))
        return tuple(found)

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """One for each effect, along the whole record."""
        declared, final = self.models[0].joint_fit_, self.final.joint_fit_
        return tuple(
            effect_shape(declared, final, place, covariance, self.records, self.targets)
            for place, covariance in enumerate(self.covariances)
        )

    @property
    def why_no_rollouts(self) -> str:
        """A sentence if there are none."""
        if self.records.static:
            return "the law gives no rate: there is nothing to roll out"
        if not self.stretches:
            return "the order of the rows is not known: give t or groups"
        if not (self.records.timed or self.discrete):
            return "the times of the rows are not known: give t"
        if self.records.X.shape[1] < self.records.n_states:
            return "the columns of X are not the states"
        return ""

    @cached_property
    def rollouts(self) -> tuple[Rollout, ...]:
        """The first few stretches, the first thousand samples of each, simulated by both models.

        Inputs and signals are linear between their samples.
        """
        if self.why_no_rollouts:
            return ()
        return rolled_out(self.models, self.records, self._parts, self.discrete)

    @cached_property
    def free(self) -> FreeRollouts | None:
        """What the rollouts with the effects leave of measured states, in units of their noise.

        None where velocities were given: nothing tells the noise of the states.
        """
        if self.states is None or self.noise is None or not self.rollouts:
            return None
        return free_of(
            self.models[1], self.records, self.states, self.noise, self.rollouts, self.discrete
        )

    @property
    def most_changed(self) -> int:
        """State whose error the effects lower most; without effects the one furthest off."""
        before, after = self.errors
        spread = np.std(self.measured, axis=0)
        # an equation that is exact, such as q' = v, changes by rounding only
        inexact = before > exact_below(self.measured)
        change = np.abs(before - after) / np.where(inexact, before, np.inf)
        size = before / np.where(spread > 0, spread, np.inf)
        return int(np.argmax(change if self.covariances else size))


class RungErrors(TypedDict):
    """Root mean square errors of each state by one of the models, declared or with effects."""

    model: str
    search: list[float]
    held_out: list[float]


class Round(TypedDict):
    """A round of the search: what it added, from how many candidates, and what there was then."""

    added: str
    p_value: float
    n_candidates: int
    effects: list[str]


class TriedEffect(TypedDict):
    """What chance does not explain, held-out rows do not show, and not all of them refute."""

    effect: str
    p_value: float
    before: list[float]
    after: list[float]
    rollouts: list[float] | None


class UnsureEffect(TypedDict):
    """What would come next, if chance may explain it or what was held out refutes it."""

    effect: str
    p_value: float
    share: float  # of the squared error of stretches that it was not fitted to
    longer: float  # times this record that would be sure of it; 1 of what is refuted


class TimeInterval(TypedDict):
    """The time or the times for which another law acts, and that law."""

    trajectory: str
    begin: float  # of the first
    end: float  # of the last
    intervals: list[tuple[float, float]]
    n_rows: int  # set aside in them
    law: list[str]


class RowsPlace(TypedDict):
    """Where most of some rows are and few others."""

    channel: str
    interval: tuple[float, float]
    n_rows: int
    others: float


class RowsSetAside(TypedDict):
    """Rows with gross errors, and whether they lie together."""

    n_rows: int
    n_together: int
    n_trajectories: int
    p_value: float
    place: RowsPlace | None
    is_finding: bool
    time_interval: TimeInterval | None


@dataclass(frozen=True, eq=False, repr=False)
class EffectContents(Parts):
    """Fields of an `EffectReport`, which are described there, and what follows from them."""

    targets: tuple[str, ...]
    held_out: str
    n_search: int
    n_held_out: int
    n_may_stick: int = 0
    n_candidates: int = 0
    errors: list[RungErrors] = field(default_factory=list)
    effects: tuple[FoundEffect, ...] = ()
    skipped: dict[str, str] = field(default_factory=dict)
    not_identifiable: tuple[str, ...] = ()
    residual_before: ResidualReport | None = None
    residual_after: ResidualReport | None = None
    guard_moved: float = 0.0
    lost_modes: int = 0
    history: tuple[Round, ...] = ()
    dropped: tuple[str, ...] = ()
    tried: tuple[TriedEffect, ...] = ()
    unsure: UnsureEffect | None = None
    exact: tuple[str, ...] = ()
    alarms: tuple[str, ...] = ()
    set_aside: RowsSetAside | None = None
    discrete: bool = False
    of_rollouts: bool = False
    static: bool = False
    data: EffectData | None = None

    @property
    def judged(self) -> tuple[str, ...]:
        """Names of those of the equations that `errors` are of: hidden states have none."""
        return self.targets[: len(self.errors[0]["held_out"])] if self.errors else self.targets

    @property
    def clean(self) -> bool:
        """True if no effect was found, and no law that acts rarely or for some time."""
        return not self.effects and not self.acts_rarely and self.time_interval is None

    @property
    def acts_rarely(self) -> bool:
        """True if rows that are set aside lie together, so that another law acts there."""
        return self.set_aside is not None and self.set_aside["is_finding"]

    @property
    def time_interval(self) -> TimeInterval | None:
        """When another law acts, if rows that are set aside fill stretches of time."""
        return None if self.set_aside is None else self.set_aside["time_interval"]

    @property
    def by_trajectory(self) -> list[dict[str, object]]:
        """Errors before and after on every held-out trajectory, or stretch of one."""
        return (
            [] if self.data is None else [entries_of(vars(one)) for one in self.data.by_trajectory]
        )

    @property
    def free_rollouts(self) -> str | None:
        """What free rollouts leave of recordings held out, in a line; None without recordings."""
        free = None if self.data is None else self.data.free
        return None if free is None else free.sentence()

    @property
    def rollouts(self) -> list[dict[str, object]]:
        """Errors of simulations from the first state of held-out trajectories, and their ends."""
        return [] if self.data is None else [one.to_dict() for one in self.data.rollouts]
