"""Inputs that keep their value until the next row, where the recordings say so."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

from swsysid._cli.options import JobOptions
from swsysid._cli.recorded import Recorded
from swsysid._cli.samples import Samples
from swsysid._data.recordings import Hold
from swsysid._stays.given import read_given, without_clipped
from swsysid._stays.input_holds import hold_sentence, holds_of
from swsysid._stays.pieces import between_jumps
from swsysid._trajectory_identifier import TrajectoryIdentifier
from swsysid._verdict.terms import Terms


def with_held_inputs(samples: Samples, terms: Terms, options: JobOptions) -> Samples:
    """The recordings with the limits of such inputs, which all fits then see, and a sentence."""
    recorded, measurement = samples.recorded, options.measurement
    if recorded is None or not measurement.inputs:
        return samples
    names = samples.names[-len(measurement.inputs) :]
    if measurement.hold is not None:
        held = [name in measurement.hold for name in measurement.inputs]
        return replace(samples, recorded=recorded.holding(held))
    holds = _holds(samples, recorded, terms, options)
    remarks = [
        hold_sentence(name, hold)
        for name, hold in zip(names, holds, strict=True)
        if hold is Hold.ROW
    ]
    if not remarks:
        return samples
    recorded = recorded.holding([hold is Hold.ROW for hold in holds])
    return replace(samples, recorded=recorded, remarks=(*samples.remarks, *remarks))


def _holds(
    samples: Samples, recorded: Recorded, terms: Terms, options: JobOptions
) -> Sequence[Hold]:
    """What each input does between two rows."""
    library = terms.library(samples.X.shape[1])
    estimator = options.regressor(options.modes, verbose=0, feature_library=library)
    settings = TrajectoryIdentifier.settings.joined(False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the fit itself warns
        given = read_given(*recorded.named(samples.names, slice(None)))
        given = without_clipped(between_jumps(given).given)
        return holds_of(given, estimator, options.measurement.order, settings)
