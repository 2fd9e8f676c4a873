"""The result of the main job in words: equations with units, surface, held-out error."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from swsysid._command.job import WORTH, JobResult
from swsysid._command.samples_text import preparation
from swsysid._printing import linear_combination

__all__ = ["render"]

PRECISION = 6  # decimals of coefficients


def render(result: JobResult) -> str:
    """The whole text, sections separated by empty lines."""
    sections = [_data(result), *_laws(result), _surface(result), _errors(result), _verdict(result)]
    return "\n\n".join(section for section in sections if section)


def rename(text: str, names: Sequence[str]) -> str:
    """Replace x0, x1, ... by the names of the columns.

    Examples
    --------
    >>> rename("2.0 x0 x1^2 - x10", ["q", "q'"])
    "2.0 q q'^2 - x10"
    """

    def name(match: re.Match) -> str:
        column = int(match.group(1))
        return names[column] if column < len(names) else match.group(0)

    return re.sub(r"\bx(\d+)\b", name, text)


def _data(result: JobResult) -> str:
    samples = result.samples
    columns = ", ".join(map(_with_unit, samples.names, samples.units))
    n_groups = len(np.unique(samples.groups))
    every = f", every {_ordinal(samples.decimate)} row" if samples.decimate > 1 else ""
    trajectories = "1 trajectory" if n_groups == 1 else f"{n_groups} trajectories"
    lines = [f"{len(samples.X):,} samples of {trajectories}{every}: {columns}"]
    lines += preparation(samples)
    if result.position_gain is not None:
        kept = "kept in" if _uses_positions(result) else "left out of"
        change = max(0.0, 100 * result.position_gain)
        lines.append(
            f"The position is {kept} the law: it lowers the error by {change:.1f} % "
            "(--position yes or no decides otherwise)."
        )
    return "\n".join(lines)


def _uses_positions(result: JobResult) -> bool:
    used = " ".join(map(str, result.model.feature_names_out_))
    return re.search(r"\bx0\b", used) is not None


def _laws(result: JobResult) -> list[str]:
    """One section for each mode, after the known equations."""
    model, samples = result.model, result.samples
    features = [rename(str(name), samples.names) for name in model.feature_names_out_]
    known = [
        f"known: the derivative of {position} is {rate}"
        for position, rate in zip(
            samples.names, samples.rate_names[: samples.n_known], strict=False
        )
    ]
    shares = np.bincount(model.modes_, minlength=model.n_modes_) / len(model.modes_)
    sections = ["\n".join(known)]
    for mode, share in enumerate(shares):
        lines = [f"mode {mode} ({100 * share:.0f} % of the samples)"]
        for state in range(samples.n_known, len(samples.rate_names)):
            row = model.coef_[mode, state]
            rate = _rate_name(samples, state)
            unit = f"   [{samples.rate_units[state]}]" if samples.rate_units[state] else ""
            lines.append(f"    {rate} = {_sum(row, features)}{unit}")
            lines += _balance(row, features, rate, samples)
        sections.append("\n".join(lines))
    return sections


def _rate_name(samples, state: int) -> str:
    return samples.rate_names[state]


def _balance(row, features, rate: str, samples) -> list[str]:
    """The law of an accelerated body as a balance of forces: inertia q'' = input - rest.

    It exists where one input drives a second-order system linearly; then the coefficients are
    mass and friction as a data sheet has them.
    """
    inputs = samples.names[2 * samples.n_known :]
    if not samples.n_known or len(inputs) != 1 or inputs[0] not in features:
        return []
    driven = features.index(inputs[0])
    if row[driven] == 0.0:
        return []
    scaled = -np.asarray(row) / row[driven]
    scaled[driven] = 0.0
    rest = _sum(scaled, features)
    unit = f"   [{samples.units[-1]}]" if samples.units[-1] else ""
    return [f"    or {1.0 / row[driven]:.{PRECISION}g} {rate} + ({rest}) = {inputs[0]}{unit}"]


def _sum(row, features) -> str:
    return linear_combination(row, features, precision=PRECISION)


def _surface(result: JobResult) -> str:
    model, samples = result.model, result.samples
    if model.n_modes_ == 1:
        return "No switching surface: one mode explains the data."
    surface = model.surface_
    equations = surface.equations(precision=PRECISION, input_features=samples.names)
    lines = ["switching surface", *(f"    {equation}" for equation in equations)]
    for mode, signs in zip(surface.classes_, surface.mode_book_, strict=True):
        sides = (f"f{k} {'>' if sign > 0 else '<'} 0" for k, sign in enumerate(signs) if sign)
        lines.append(f"    mode {mode} where {' and '.join(sides)}")
    return "\n".join(lines + _thresholds(surface, samples))


def _thresholds(surface, samples) -> list[str]:
    """The threshold on one column that comes closest to each surface."""
    lines = []
    for k, values in enumerate(surface.surface_values(samples.X).T):
        if (values > 0).all() or (values <= 0).all():
            lines.append(
                f"    f{k} has one sign on all samples: these columns do not tell the modes apart"
            )
            continue
        found = [best_threshold(column, values > 0) for column in samples.X.T]
        column = int(np.argmax([agreement for _, agreement in found]))
        threshold, agreement = found[column]
        place = f"{samples.names[column]} = {threshold:.2g} {samples.units[column]}".rstrip()
        lines.append(
            f"    f{k} = 0 puts {100 * agreement:.1f} % of the samples on the same side as {place}"
        )
    return lines


def best_threshold(values, positive) -> tuple[float, float]:
    """The threshold whose sides agree best with a labelling, and the fraction that agrees.

    Examples
    --------
    >>> best_threshold(np.array([1.0, 2.0, 3.0, 5.0]), np.array([True, True, False, False]))
    (2.5, 1.0)
    """
    order = np.argsort(values)
    ordered, labels = values[order], np.asarray(positive)[order]
    # with the first k samples below the threshold, those positive there plus those negative above
    # agree with "below is positive"; all others with the opposite orientation
    below = np.cumsum(labels)[:-1] + (~labels).sum() - np.cumsum(~labels)[:-1]
    share = np.maximum(below, len(labels) - below) / len(labels)
    k = int(np.argmax(share))
    return float(ordered[k : k + 2].mean()), float(share[k])


def _errors(result: JobResult) -> str:
    what = "whole trajectories" if result.whole_groups else "the last stretch of each trajectory"
    names = [
        _with_unit(name, unit)
        for name, unit in zip(result.samples.rate_names, result.samples.rate_units, strict=True)
    ][result.samples.n_known :]
    width = max(map(len, names))
    n_modes = result.model.n_modes_
    lines = [
        f"held-out error: RMSE on {result.n_test} samples, {what}, by models trained on the "
        f"other {result.n_train}",
        f"    {'':{width}}  {'spread':>10} {'one mode':>10} {f'{n_modes} modes':>10}",
    ]
    for name, *values in zip(names, result.spread, result.single, result.switching, strict=True):
        lines.append(f"    {name:{width}}  " + " ".join(f"{value:>10.4g}" for value in values))
    return "\n".join(lines)


def _verdict(result: JobResult) -> str:
    if result.model.n_modes_ == 1:
        return ""
    gain = (
        f"(error {100 * result.improvement:.1f} % lower, a gain of {result.gain:.1f} standard "
        "errors over contiguous blocks)."
    )
    if result.switches:
        text = f"Switching predicts the held-out samples clearly better than one mode {gain}"
    elif result.improvement > WORTH:
        text = (
            f"Switching predicts the held-out samples better than one mode, which may be chance "
            f"{gain} Record more trajectories, or hold out more of them (--test-fraction)."
        )
    else:
        text = (
            f"Switching does not predict the held-out samples clearly better than one mode {gain} "
            "Do not trust the modes: try another library, or keep one mode."
        )
    return f"{text}\nThe same answer came from {100 * result.stability:.0f} % of the starts."


def _with_unit(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _ordinal(number: int) -> str:
    suffix = {1: "st", 2: "nd", 3: "rd"}.get(number % 10 if number % 100 not in (11, 12, 13) else 0)
    return f"{number}{suffix or 'th'}"
