"""Free rollouts of what was identified: from the estimated starts, modes told by the surface.

They are as close as the noise of the recordings asks for, those of all courses side by side.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.recordings import Record
from swsysid._data.trajectories import label_text
from swsysid._free_rollouts.courses import SLIDES, Course, switches_of_stays
from swsysid._free_rollouts.judge import FreeRollouts, ModelRuns
from swsysid._free_rollouts.judge import judged as judged_rollouts
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._results import Array, Status, SwitchEvent, Trajectory
from swsysid._stays.guards import Guards
from swsysid._stays.identification import StayIdentification
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate
from swsysid._stays.origin import Origin
from swsysid._stays.recordings import Recordings, between
from swsysid._stays.rollouts import Rolled, nowhere, rolled_out
from swsysid._stays.samples import left_over, states_of
from swsysid._stays.settings import LIMITS


def judged(
    found: StayIdentification,
    origin: Origin,
    labels: Sequence[object],
    noise: Array,
    channels: Sequence[str],
    together: float,
    stretch: int | None,
) -> tuple[FreeRollouts, SampleNoise]:
    """What free rollouts leave, and the noise of the samples by which they are judged.

    `noise` are standard deviations of the channels; with `stretch` parts of so many samples
    are rolled out, each from its own start, and otherwise whole recordings.
    """
    names = [label_text(label) for label in labels]
    courses = list(courses_of(found.estimate, origin, names, len(noise), stretch))
    seen = noise_of_samples(found.estimate, origin, names, noise)
    over = f"stretches of {stretch} samples" if stretch else ""
    runs = FreeRuns.of(found, origin, courses, noise) or ModelRuns(found.model, "linear")
    judgement = judged_rollouts(runs, courses, seen, channels, together=together, over=over)
    return judgement, seen


def courses_of(
    estimate: Estimate,
    origin: Origin,
    labels: Sequence[str],
    n_channels: int,
    stretch: int | None,
) -> Iterator[Course]:
    """The recordings of an estimate, or parts of so many samples, each from its estimated start."""
    recordings, states = estimate.nodes.recordings, states_of(estimate)
    for k, first, last in recordings.stretches(stretch or int(recordings.lengths.max())):
        start = states[first, k]
        rows = slice(first, last + 1, recordings.per_sample)
        t, y = recordings.times[k][rows], recordings.y[rows, k, :n_channels].copy()
        if last < recordings.lengths[k] - 1:
            y[-1] = np.nan  # a sample where two parts meet counts in the second
        stays = estimate.nodes.stays[k].inside(t)
        modes = np.where(stays.modes < len(estimate.laws.coef), stays.modes, SLIDES)
        yield Course(
            labels[k],
            Record(t, origin.states(y), recordings.u[rows, k] + origin.offset[len(start) :]),
            origin.states(start),
            switches=switches_of_stays(modes.tolist(), stays.instants.tolist()),
        )


def noise_of_samples(
    estimate: Estimate, origin: Origin, labels: Sequence[str], noise: Array
) -> SampleNoise:
    """Of this size, or as what the fit leaves shows that it differs from sample to sample."""
    recordings = estimate.nodes.recordings
    left, states = left_over(estimate), origin.states(states_of(estimate))
    parts = [
        (left[places, k, : len(noise)], states[places, k, : len(noise)])
        for k, places in enumerate(recordings.sampled)
    ]
    return SampleNoise.seen(noise, [one for one, _ in parts], [one for _, one in parts], labels)


@dataclass
class FreeRuns:
    """The rollouts of an identification: those of all courses at the first question for one."""

    laws: Laws
    guards: Guards
    origin: Origin
    grid: Recordings  # how finely the fit was integrated
    courses: Sequence[Course]
    guess: Sequence[
        Array
    ] = ()  # states at the times of the grid, roughly, if these are the courses
    _done: dict[int, Trajectory] = field(default_factory=dict)

    @classmethod
    def of(
        cls, found: StayIdentification, origin: Origin, courses: Sequence[Course], noise: Array
    ) -> FreeRuns | None:
        """None without noise or, of several modes, a surface that is known by its coefficients."""
        estimate = found.estimate
        guards, noise = estimate.guards, noise[: len(estimate.laws.spread)]
        if len(estimate.laws.coef) == 1:
            guards = nowhere(np.ones_like(origin.offset))
        seen = (noise > LIMITS.unseen * estimate.laws.spread[: len(noise)]).all()
        if guards is None or not seen:
            return None
        recordings, states = estimate.nodes.recordings, states_of(estimate)
        whole = len(courses) == len(recordings)
        guess = [states[:n, k] for k, n in enumerate(recordings.lengths)] if whole else []
        return cls(estimate.laws.known(), guards, origin, recordings, courses, guess)

    def __call__(self, course: Course, start: Array, noise: Array) -> Trajectory:
        """The rollout of one course; the noise is that of the fit."""
        if start is not course.start:
            place = next(k for k, one in enumerate(self.courses) if one is course)
            return self._rolled_out([place], np.array([start]))[0]
        if not self._done:
            starts = np.array([one.start for one in self.courses])
            runs = self._rolled_out(range(len(starts)), starts)
            self._done = {id(one): run for one, run in zip(self.courses, runs, strict=True)}
        return self._done[id(course)]

    def _rolled_out(self, places: Sequence[int], starts: Array) -> list[Trajectory]:
        """The rollouts of some courses from starts, (n_courses, n_states)."""
        n_states, courses = starts.shape[1], [self.courses[place] for place in places]
        of_x, of_u = np.split(self.origin.offset, [n_states])
        records = [
            Record(one.record.t, one.record.filled - of_x[: one.record.y.shape[1]],
                   one.record.u - of_u)
            for one in courses
        ]  # fmt: skip
        zeros = [np.zeros((len(one.t), n_states)) for one in records]
        grid = replace(
            Recordings.of(records, zeros).divided(self.grid.per_sample),
            first_step=self.grid.first_step,
        )
        guess = [
            between(t, self.grid.times[place], self.guess[place])
            for t, place in zip(grid.times, places, strict=True)
            if len(self.guess)
        ]
        runs = rolled_out(self.laws, self.guards, grid, starts - of_x, guess)
        return [
            self._trajectory(one, run, grid.sampled[k], of_x)
            for k, (one, run) in enumerate(zip(courses, runs, strict=True))
        ]

    def _trajectory(
        self, course: Course, run: Rolled, places: NDArray[np.intp], offset: Array
    ) -> Trajectory:
        """The rollout at the samples, cut where it leaves all bounds."""
        t, states, modes = course.record.t, run.states[places], run.modes[places]
        with np.errstate(invalid="ignore"):
            far = ~(np.abs(states) <= LIMITS.diverged * self.laws.spread).all(axis=1)
        end = int(np.argmax(far)) if far.any() else len(t)
        status = Status.STATE_LIMIT if far.any() else Status.COMPLETED
        events = [
            SwitchEvent(one.time, states[0] + offset, one.before, one.after, one.kind)
            for one in run.events
            if end == len(t) or one.time < t[end]
        ]
        return Trajectory(t[:end], states[:end] + offset, modes[:end], tuple(events), status)
