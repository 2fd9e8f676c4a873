"""A report of effects in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from swsysid.effects import FoundEffect, Rival
from swsysid.effects._base import NOWHERE

__all__ = [
    "SPANNED",
    "effect_title",
    "interval",
    "probability",
    "rate",
    "report_text",
    "sentence",
    "summary",
    "title",
]

_MOST_NAMED = 12
_SMALLEST = 1e-16
_WORTH_TELLING = 0.01  # share of an error
_LEFT_OUT = "and {} more"
SPANNED = "the declared model can take their shape"
_WHEN = {"before": " without the effects", "after": " with the effects"}


def rate(name: str, discrete: bool = False) -> str:
    """What the law of a state gives: its velocity, or its next value."""
    return f"next {name}" if discrete else f"{name}'"


def title(kind: str, place: str, state: str, mode: int | None, discrete: bool = False) -> str:
    """Kind, place, equation and mode of an effect in a few words."""
    where = "" if mode is None else f", mode {mode}"
    return f"{named(kind, place)} in {rate(state, discrete)}{where}"


def named(kind: str, place: str) -> str:
    """Kind of an effect, and its place where that says more."""
    return kind.replace("_", " ") + ("" if place in NOWHERE else f" of {place}")


def moved(report: Any) -> str:
    """What became of the modes, in a sentence."""
    if any(effect.placed.effect.n_more_modes for effect in report.effects):
        return "There is one more mode than declared."
    return f"{report.guard_moved:.1%} of the samples changed their mode."


def sentence(text: str, names: Sequence[str]) -> str:
    """Text as a sentence; a channel's name that it begins with keeps its letters."""
    first = text if any(text.startswith(name) for name in names) else text[:1].upper() + text[1:]
    return f"{first}."


def probability(value: float) -> str:
    """A p-value, no smaller than means anything."""
    return f"p = {value:.1g}" if value >= _SMALLEST else f"p < {_SMALLEST:g}"


def effect_title(effect: FoundEffect | Rival, report: Any) -> str:
    """`title` of an effect that was found, or of its rival."""
    state = report.targets[effect.target]
    return title(effect.kind, effect.place, state, effect.mode, report.discrete)


def interval(effect: FoundEffect, name: str) -> str:
    """95 % confidence interval of a parameter, "" if there is none."""
    low, high = effect.intervals.get(name, (np.nan, np.nan))
    return f"{low:.4g} to {high:.4g}" if np.isfinite(low) and np.isfinite(high) else ""


def summary(report: Any) -> str:
    """What came out, in one sentence."""
    if not report.n_held_out:
        return "Nothing was searched: the record is too short to hold any of it out."
    if not report.effects:
        return "No effect is missing as far as these data show."
    first = report.effects[0]
    errors = np.array([report.errors[place]["held_out"] for place in (0, -1)])
    target = int(np.argmin(errors[1] / np.where(errors[0] > 0, errors[0], np.inf)))
    before, after = errors[:, target]
    others = len(report.effects) - 1
    more = f" (and {others} more effect{'s' if others > 1 else ''})" if others else ""
    name = effect_title(first, report)
    name = f"{name[:1].upper()}{name[1:]}{more}"
    if after > (1.0 - _WORTH_TELLING) * before:
        return f"{name}: it does not lower the held-out error of any velocity."
    return (
        f"{name}: with it the held-out "
        f"error of {rate(report.targets[target], report.discrete)} is {after:.4g} instead of "
        f"{before:.4g}."
    )


def report_text(report: Any) -> str:
    """The whole report."""
    lines = [
        f"Effect search: {report.n_search} rows searched, {report.n_held_out} held out "
        f"({report.held_out}).",
        summary(report),
        *_errors(report),
    ]
    for number, effect in enumerate(report.effects, start=1):
        lines += ["", *_effect(number, effect, report)]
    lines += ["", *_consequences(report)] if report.n_held_out else []
    lines += _listed("Not looked for", [f"{k}: {why}" for k, why in report.skipped.items()])
    lines += _listed(f"Not looked for, since {SPANNED}", report.not_identifiable)
    return "\n".join(lines)


def _errors(report: Any) -> list[str]:
    """Held-out errors of every equation, one line a model."""
    if not report.errors:
        return []
    names = [rate(name, report.discrete) for name in report.targets]
    widths = [max(12, len(name)) for name in names]
    width = max(len(row["model"]) for row in report.errors)
    width = max(width, len("held-out RMS error"))
    head = "  ".join(f"{name:>{size}}" for name, size in zip(names, widths, strict=True))
    lines = ["", f"{'held-out RMS error':{width}}  {head}"]
    for row in report.errors:
        values = zip(row["held_out"], widths, strict=True)
        numbers = "  ".join(f"{value:{size}.4g}" for value, size in values)
        lines.append(f"{row['model']:{width}}  {numbers}")
    return lines


def _effect(number: int, effect: FoundEffect, report: Any) -> list[str]:
    lines = [
        f"{number}. {effect_title(effect, report)}: {effect.meaning}.",
        f"   held-out error before {effect.error_before:.4g}, after {effect.error_after:.4g}; "
        f"{probability(effect.p_value)}",
    ]
    for name, value in effect.parameters.items():
        sure = interval(effect, name)
        lines.append(f"   {name} {value:.5g}" + (f"  (95 %: {sure})" if sure else ""))
    for rival in effect.rivals:
        lines.append(
            f"   rival, as good on these data: {effect_title(rival, report)}, error "
            f"{rival.error:.4g}; to tell them apart: {rival.advice}"
        )
    return lines


def _consequences(report: Any) -> list[str]:
    """Modes, leftovers and rollouts."""
    lines = []
    if report.effects:
        lines.append(f"Modes: {moved(report)}")
    for when in ("before", "after") if report.effects else ("before",):
        leftover = getattr(report, f"residual_{when}")
        if leftover is not None:
            told = _WHEN[when] if report.effects else ""
            lines += [
                f"Left over of {rate(name, report.discrete)}{told}: {text}"
                for name, text in leftover.verdicts.items()
            ]
    return lines + (_rollouts(report) if report.effects else [])


def _rollouts(report: Any) -> list[str]:
    lines = []
    for rollout in report.rollouts:
        errors = ", ".join(
            f"{name} {before:.4g} -> {after:.4g}"
            for name, before, after in zip(
                report.targets, rollout["error_before"], rollout["error_after"], strict=True
            )
        )
        lines.append(
            f"Rollout of trajectory {rollout['trajectory']} over a time of "
            f"{rollout['compared']:.4g}: RMS error {errors}."
        )
        for model, when in (("declared model", "before"), ("model with effects", "after")):
            if rollout[f"ended_{when}"]:
                lines.append(f"  The rollout of the {model} ended: {rollout[f'ended_{when}']}")
    if report.data is not None and report.data.why_no_rollouts:
        lines.append(f"No rollouts: {report.data.why_no_rollouts}.")
    return lines


def _listed(title: str, entries: Sequence[str]) -> list[str]:
    """A heading and one line for each entry, the first dozen of them."""
    if not entries:
        return []
    shown = [f"  {entry}" for entry in entries[:_MOST_NAMED]]
    rest = len(entries) - _MOST_NAMED
    return [f"{title}:", *shown, *([f"  {_LEFT_OUT.format(rest)}"] if rest > 0 else [])]
