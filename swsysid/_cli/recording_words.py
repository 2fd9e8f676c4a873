"""What recordings tell beside the laws, in words: standard errors, instants, what is left over."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._cli.from_recordings import FromRecordings
from swsysid._cli.options import JobOptions
from swsysid._cli.samples import Samples
from swsysid._cli.settings import RECORDINGS
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._rendering.printing import counted, determined
from swsysid._stays.doubts import mode_doubts
from swsysid._verdict.settings import JUDGING


def standard_errors(
    found: FromRecordings, mode: int, state: int, features: Sequence[str]
) -> list[str]:
    """A line with the standard error of every coefficient of a law that was estimated."""
    model, every = found.model.switching_model, found.identifier.coef_errors_
    errors = determined(model.coef, every, model.feature_map.sizes)[mode, state]
    terms = [
        (f"{error:.1g}" if np.isfinite(error) else "not determined")
        + (f" {name}" if name != "1" else "")
        for error, name in zip(errors, features, strict=True)
        if error > 0.0
    ]
    return [f"      standard errors {', '.join(terms)}"] if terms else []


def recording_text(found: FromRecordings, samples: Samples, options: JobOptions) -> str:
    """What the rollouts leave, what that says, and when the trajectories switch."""
    time_unit, n_modes = samples.time_unit, found.identifier.n_modes_
    # a model of fewer modes was identified anew, and knows nothing of those asked for
    fewer = mode_doubts(n_modes, options.modes, 0)
    doubts = dict.fromkeys([*fewer, *found.identifier.report_.doubts])
    lines = [_left_over(found, samples, options), found.free.sentence(time_unit)]
    known = [f"Known: {one}." for one in found.identifier.known_]
    held_out = free_of_held_out(found.verdict.free_of_held_out, time_unit)
    return "\n".join([*lines, *known, *held_out, *doubts, *_instants(found, samples)])


def free_of_held_out(free: FreeRollouts | None, time_unit: str) -> list[str]:
    """A line on free rollouts of what a model has not seen."""
    if free is None:
        return []
    said = free.sentence(time_unit)
    return [f"Held out, by laws of the others: {said[:1].lower()}{said[1:]}"]


def _left_over(found: FromRecordings, samples: Samples, options: JobOptions) -> str:
    span = "whole trajectories" if found.whole else "stretches of 30 samples"
    begin = f"Identified from the trajectories as they were measured. Over {span} rollouts leave "
    report = found.identifier.report_
    if (report.excess <= JUDGING.noise_alone).all():
        noise = ", ".join(
            f"{name} {size:.2g} {samples.unit(name)}".rstrip()
            for name, size in zip(report.channels, report.noise, strict=True)
        )
        freely = "noise where switches are told" if found.free.n_switches else "little but noise"
        alone = "nothing but noise" if found.free.holds else freely
        return f"{begin}{alone}: {noise}."
    worst = int(np.argmax(report.excess))
    return (
        f"{begin}{report.excess[worst]:.2g} times the noise of {samples.names[worst]}: "
        f"{options.missing}."
    )


def _instants(found: FromRecordings, samples: Samples) -> list[str]:
    """The switch instants of the first trajectories."""
    times, errors = found.identifier.switch_times_, found.identifier.switch_time_errors_
    together = np.concatenate(errors)
    if not len(together):
        return []
    unit = f" {samples.time_unit}" if samples.time_unit else ""
    lines = [
        f"{counted(len(together), 'switch instant')}, with a median standard error of "
        f"{np.median(together):.2g}{unit}:"
    ]
    most = RECORDINGS.most_trajectories
    for label, instants in list(zip(found.labels, times, strict=True))[:most]:
        shown = ", ".join(f"{instant:.5g}" for instant in instants[: RECORDINGS.most_instants])
        rest = len(instants) - RECORDINGS.most_instants
        more = f" and {rest} more" if rest > 0 else ""
        lines.append(f"    trajectory {_word(label)}: {shown or 'none'}{more}")
    if len(times) > most:
        lines.append(f"    (and those of {len(times) - most} more)")
    return lines


def _word(label: object) -> str:
    """The name of a trajectory; numbers of a text file are read as floats."""
    return f"{label:g}" if isinstance(label, float) else str(label)
