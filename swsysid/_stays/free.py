"""Free rollouts of what was identified: from the estimated starts, modes told by the surface."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from swsysid._data.recordings import Record
from swsysid._data.trajectories import label_text
from swsysid._free_rollouts.courses import SLIDES, Course, switches_of_stays
from swsysid._free_rollouts.judge import FreeRollouts, ModelRuns
from swsysid._free_rollouts.judge import judged as judged_rollouts
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._results import Array
from swsysid._stays.free_runs import FreeRuns
from swsysid._stays.identification import StayIdentification
from swsysid._stays.lifted import Estimate
from swsysid._stays.origin import Origin
from swsysid._stays.samples import left_over, states_of


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
