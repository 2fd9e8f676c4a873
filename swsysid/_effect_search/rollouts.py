"""Rollouts of untouched stretches by two models, and which of the two comes nearer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from swsysid._data.recordings import Record
from swsysid._data.records import Records
from swsysid._effect_regressor import EffectRegressor
from swsysid._effect_search.settings import REPORT
from swsysid._free_rollouts.courses import Course, switches_of_samples
from swsysid._free_rollouts.judge import FreeRollouts, judged
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._journal import step
from swsysid._noise import root_mean_square
from swsysid._results import Array, Status, Trajectory

_MOST_ROLLOUTS = 4  # each has a picture of its own
_ROLLOUT_ACCURACY = 1e-5  # of the spreads of the states: no one measures more
MOST_SAMPLES = 1000  # of one rollout: seconds of work, and all that a picture resolves


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
    chatters : bool
        True if the simulation with the effects slides along a surface, and therefore ended: the
        end of what is simulated, and no fault of the laws.
    rows : ndarray of int
        The samples of the record.
    run : Trajectory or None
        The simulation with the effects.
    """

    name: str
    t: Array
    measured: Array
    before: Array
    after: Array
    ended: tuple[str, str]
    chatters: bool = False
    rows: NDArray[np.intp] = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    run: Trajectory | None = None

    @property
    def compared(self) -> float:
        """The time that both simulations have reached."""
        shared = min(len(self.before), len(self.after))
        return float(self.t[shared - 1] - self.t[0]) if shared else 0.0

    @property
    def errors(self) -> tuple[Array, Array]:
        """Root mean square error of each state over the times that both have reached."""
        shared = min(len(self.before), len(self.after))
        if not shared:
            unknown = np.full(self.measured.shape[1], np.nan)
            return unknown, unknown
        both = (one[:shared] - self.measured[:shared] for one in (self.before, self.after))
        before, after = map(root_mean_square, both)
        return before, after

    @property
    def relative_errors(self) -> tuple[float, float]:
        """Root mean squares of `errors`, each in the spread of its measured state."""
        spread = np.std(self.measured, axis=0)
        moving = spread > 0.0
        before, after = (
            float(np.sqrt(np.mean((one[moving] / spread[moving]) ** 2))) if moving.any() else np.nan
            for one in self.errors
        )
        return before, after

    def to_dict(self) -> dict[str, object]:
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


def rolled_out(
    models: tuple[EffectRegressor, EffectRegressor],
    records: Records,
    stretches: Sequence[tuple[str, NDArray[np.intp]]],
    discrete: bool,
) -> tuple[Rollout, ...]:
    """The first few stretches, the first thousand samples of each, simulated by both models."""
    done = []
    for name, rows in stretches[:_MOST_ROLLOUTS]:
        part = records.take(rows[:MOST_SAMPLES])
        if len(rows) > 1:
            t = np.asarray(part.t if part.timed else np.arange(len(part)), dtype=float)
            start = part.X[0, : part.n_states]
            both = [model.in_recording(_number(records, rows)) for model in models]
            before, after = (_rollout(model, part, t, discrete, start) for model in both)
            measured, ended = part.X[:, : part.n_states], (_why(before), _why(after))
            slides = after.status is Status.SWITCH_LIMIT
            own = rows[:MOST_SAMPLES]
            done.append(Rollout(name, t, measured, before.x, after.x, ended, slides, own, after))
    return tuple(done)


def free_of(
    model: EffectRegressor,
    records: Records,
    measured: Array,
    noise: Array,
    rollouts: Sequence[Rollout],
    discrete: bool,
) -> FreeRollouts:
    """What the rollouts of a model leave of states as they were measured, with this noise.

    They begin at the states as they are known best, those of the `records`.
    """
    parts, runs_by_name, courses = {}, {one.name: one for one in rollouts}, []
    for one in rollouts:
        part = parts[one.name] = records.take(one.rows)
        record = Record(one.t, measured[one.rows], np.empty((len(one.t), 0)))
        modes = part.decoded_modes
        switches = None
        if modes is not None and (modes >= 0).all() and model.joint_fit_.n_modes > 1:
            switches = switches_of_samples(one.t, modes)
        courses.append(Course(one.name, record, part.X[0, : part.n_states], switches=switches))

    def runs(course: Course, start: Array, noise: Array) -> Trajectory:
        one = runs_by_name[course.label]
        if one.run is not None and np.array_equal(start, course.start):
            return one.run
        own = model.in_recording(_number(records, one.rows))
        return _rollout(own, parts[course.label], one.t, discrete, start)

    spread = np.std(np.vstack([one.measured for one in rollouts]), axis=0)[: len(noise)]
    known = np.maximum(noise, REPORT.least_noise * spread)
    each = SampleNoise.constant(known, [course.label for course in courses])
    return judged(runs, courses, each, records.names[: len(noise)], unseen=True)


def errors_of_all(rollouts: Sequence[Rollout]) -> tuple[float, float]:
    """Root mean squares before and after, in the spreads of what was measured."""
    squares = np.square([one.relative_errors for one in rollouts])
    before, after = np.sqrt(np.mean(squares, axis=0)).tolist()
    return before, after


def are_worse(
    rollouts: Sequence[Rollout],
    *,
    gained: float = 1.0,
    in_doubt: bool = False,
    luck: float = REPORT.clearly_worse,
) -> bool:
    """True if each is worse with the effects, and all together clearly; or one fails.

    Clearly is by a larger share than `luck`, and by a larger factor than errors of velocities have
    fallen by, which is what was `gained`. Effects that are in doubt already have gained nothing,
    and need not make each rollout worse.
    """
    if not rollouts:
        return False
    if any(one.ended[1] and not one.ended[0] and not one.chatters for one in rollouts):
        return True
    each = [one.relative_errors for one in rollouts]
    if not in_doubt and not all(after > before for before, after in each):
        return False
    before, after = errors_of_all(rollouts)
    clearly = 1.0 + luck
    return after > (clearly if in_doubt else max(clearly, gained)) * before


def _number(records: Records, rows: NDArray[np.intp]) -> int:
    """Of the recording that some rows are of."""
    return 0 if records.groups is None else int(records.groups[rows[0]])


@step
def _rollout(
    model: EffectRegressor, part: Records, t: Array, discrete: bool, start: Array
) -> Trajectory:
    """A simulation along a measured part of a trajectory."""
    spread = np.std(part.X[:, : part.n_states], axis=0)
    simulated: Trajectory = model.simulate(
        start,
        t,
        part.X[:, part.n_states :] if part.n_inputs else None,
        signals=part.signals if part.signals.shape[1] else None,
        input_hold="zero" if discrete or set(part.inputs) <= part.held else "linear",
        mode=model.joint_fit_.first_mode(part),
        rtol=_ROLLOUT_ACCURACY,
        atol=_ROLLOUT_ACCURACY * float(spread[spread > 0.0].min(initial=1.0)),
    )
    return simulated


def _why(trajectory: Trajectory) -> str:
    """Why a simulation ended early; "" if it did not."""
    if trajectory.status.ok:
        return ""
    end = f"at {trajectory.t[-1]:.4g}" if len(trajectory.t) else "at the start"
    return f"{trajectory.status.value} {end}: {trajectory.status.advice}"
