"""Free rollouts along trajectories of a file: those of the fit by derivatives, those held out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.samples import Samples
from swsysid._cli.settings import JUDGING, RECORDINGS
from swsysid._data.recordings import Record
from swsysid._data.trajectories import label_text, trajectories
from swsysid._free_rollouts.courses import Course, switches_of_samples
from swsysid._free_rollouts.judge import FreeRollouts, free_rollouts
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.given import FEWEST_SAMPLES, read_given
from swsysid.differentiation import estimate_noise
from swsysid.refinement._rollout_score import start_of


def free_of_samples(
    model: SwitchingSystemRegressor, samples: Samples, modes: NDArray[np.intp]
) -> FreeRollouts | None:
    """Of a model of derivatives along the trajectories, with the modes of the rows of samples.

    None where the times are not known.
    """
    if samples.t is None:
        return None
    recorded, n_states = samples.recorded, samples.Xdot.shape[1]
    if recorded is not None and samples.smoothing is not None:
        given = read_given(*recorded.named(samples.names, slice(None)))
        records, labels = given.records, given.labels
        noise = samples.smoothing.noise[: given.n_channels]
    else:
        rows = trajectories(samples.groups)
        X, t = samples.X, samples.t
        records = [Record(t[own], X[own, :n_states], X[own, n_states:]) for _, own in rows]
        labels = [label for label, _ in rows]
        noise = estimate_noise(X[:, :n_states], samples.groups)
    switches = [
        switches_of_samples(samples.t[own], modes[own])
        for own in (samples.groups == label for label in labels)
    ]
    return free_of_records(model, records, labels, noise, samples.names, switches)


def free_of_records(
    model: SwitchingSystemRegressor,
    records: Sequence[Record],
    labels: Sequence[object],
    noise: Array,
    names: Sequence[str],
    switches: Sequence | None = None,
) -> FreeRollouts | None:
    """Of the first few trajectories, each from the start that fits its first samples best.

    Without `switches` the model has not seen them.
    """
    long = [k for k, record in enumerate(records) if len(record.t) >= FEWEST_SAMPLES]
    courses = [
        Course(
            label_text(labels[k]),
            records[k],
            start_of(model, records[k], JUDGING.samples_of_start),
            switches=None if switches is None else switches[k],
        )
        for k in long[: RECORDINGS.most_trajectories]
    ]
    if not courses:
        return None
    spread = np.nanstd(np.vstack([course.record.y for course in courses]), axis=0)
    noise = np.maximum(noise, JUDGING.integrated * spread)
    known = SampleNoise.constant(noise, [course.label for course in courses])
    unseen = switches is None
    return free_rollouts(model, courses, known, names[: len(noise)], unseen=unseen)
