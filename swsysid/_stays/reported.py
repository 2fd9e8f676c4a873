"""The report of an identification from recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._data.input_steps import Hold
from swsysid._rendering.printing import determined, sum_with_errors
from swsysid._stays.certainty import Certainty
from swsysid._stays.doubts import FitLeft, mode_doubts, surface_doubts
from swsysid._stays.free import judged
from swsysid._stays.identification import StayIdentification
from swsysid._stays.input_holds import hold_sentence
from swsysid._stays.origin import Origin
from swsysid._stays.recording_report import RecordingReport, advice_of
from swsysid._stays.search import Search
from swsysid._stays.settings import LIMITS
from swsysid._surfaces.surface import has_equations


def reported(
    search: Search,
    found: StayIdentification,
    sure: Certainty,
    modes: NDArray[np.intp],
    origin: Origin,
    holds: Sequence[Hold] = (),
) -> RecordingReport:
    """What was found, with how certain it is, and what free rollouts say of it.

    The estimate counts its columns from the `origin`, the model those of the user.
    """
    given, n_modes = search.given, len(found.estimate.laws.coef)
    n_channels, names = given.n_channels, found.model.switching_model.feature_map.names_in
    channels, together = tuple(names[:n_channels]), sure.samples_that_count_as_one
    least = LIMITS.exactly * found.estimate.laws.spread[:n_channels]
    near = np.maximum(search.base.noise[:n_channels], least)
    rollouts, noise = judged(found, origin, given.labels, near, channels, together, search.stretch)
    left = FitLeft.of(found, origin, noise, given)
    doubts = [
        *surface_doubts(found, origin, names),
        *mode_doubts(n_modes, search.estimator.n_modes, search.counts[-1]),
        *noise.sentences(channels),
        *left.sentences(),
        *_steps(found, holds, names[-given.n_inputs :]),
    ]
    has_surfaces = n_modes > 1 and has_equations(found.model.surface_)
    return RecordingReport(
        n_recordings=given.n_recordings,
        n_samples=given.n_samples,
        n_switches=len(found.estimate.nodes.instants),
        laws=tuple(_laws(found, sure, names)),
        surfaces=tuple(found.model.surface_equations()) if has_surfaces else (),
        shares=np.bincount(modes, minlength=n_modes) / len(modes),
        channels=channels,
        noise=found.left[:n_channels],
        noise_of_differences=search.base.noise[:n_channels],
        samples_that_count_as_one=together,
        excess=left.excess,
        rollouts=rollouts,
        doubts=tuple(doubts),
        advice=advice_of(left.excess, channels, together, rollouts),
    )


def _steps(found: StayIdentification, holds: Sequence[Hold], names: Sequence[str]) -> Iterator[str]:
    """What inputs do between two samples."""
    unknown = sum(map(len, found.estimate.nodes.recordings.unknown))
    for name, hold in zip(names, holds, strict=False):
        if hold is not Hold.LINE:
            yield hold_sentence(name, hold, unknown)


def _laws(found: StayIdentification, sure: Certainty, names: Sequence[str]) -> list[str]:
    """The laws with their standard errors."""
    system = found.model.switching_model
    features = list(system.feature_map.names_out)
    errors = determined(system.coef, sure.coef, system.feature_map.sizes)
    return [
        f"mode {mode}: {names[state]}' = "
        + sum_with_errors(system.coef[mode, state].tolist(), own.tolist(), features)
        for mode, of_states in enumerate(errors)
        for state, own in enumerate(of_states)
    ]
