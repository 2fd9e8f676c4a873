"""A report of effects in plain text."""

from __future__ import annotations

from collections.abc import Iterator

from swsysid._effect_search import wording
from swsysid._effect_search.contents import EffectContents
from swsysid._effect_search.report_settings import REPORT
from swsysid._rendering.columns import text_table
from swsysid.effects import FoundEffect

__all__ = ["report_text"]


def report_text(report: EffectContents) -> str:
    """The whole report."""
    return "\n".join(_lines(report))


def _lines(report: EffectContents) -> Iterator[str]:
    yield (
        f"Effect search: {report.n_search} rows searched, {report.n_held_out} held out "
        f"({report.held_out})."
    )
    yield wording.summary(report)
    if report.errors:
        yield ""
        yield from _errors(report)
    for number, effect in enumerate(report.effects, start=1):
        yield ""
        yield from _effect(number, effect, report)
    if report.n_held_out:
        yield ""
    if report.effects:
        yield f"Modes: {wording.moved(report)}"
    when = [" without the effects", " with the effects"] if report.effects else [""]
    for told, (_, leftover) in zip(when, wording.leftovers(report), strict=False):
        for name, said in wording.verdicts(leftover, report):
            yield f"Left over of {name}{told}: {said}"
    if report.effects:
        yield from _rollouts(report)
    for heading, entries in (
        (wording.NOT_LOOKED_FOR, wording.skipped(report)),
        (wording.SPANNED, report.not_identifiable),
    ):
        if entries:
            yield f"{heading}:"
            yield from (f"  {entry}" for entry in wording.first_of(entries, REPORT.names_in_text))


def _errors(report: EffectContents) -> list[str]:
    """Held-out errors of every equation, one line a model."""
    columns = [("held-out RMS error", "<1", [row["model"] for row in report.errors])]
    for state, name in enumerate(report.targets):
        errors = [f"{row['held_out'][state]:.4g}" for row in report.errors]
        columns.append((wording.rate(name, report.discrete), ">12", errors))
    return text_table(columns, gap="  ")


def _effect(number: int, effect: FoundEffect, report: EffectContents) -> Iterator[str]:
    yield f"{number}. {wording.effect_title(effect, report)}: {effect.meaning}."
    yield (
        f"   held-out error before {effect.error_before:.4g}, after {effect.error_after:.4g}; "
        f"{wording.probability(effect.p_value)}"
    )
    for name, value in effect.parameters.items():
        sure = wording.interval(effect, name)
        yield f"   {name} {value:.5g}" + (f"  (95 %: {sure})" if sure else "")
    for rival in effect.rivals:
        yield (
            f"   rival, as good on these data: {wording.effect_title(rival, report)}, error "
            f"{rival.error:.4g}; to tell them apart: {rival.advice}"
        )


def _rollouts(report: EffectContents) -> Iterator[str]:
    if report.data is None:
        return
    for rollout in report.data.rollouts:
        errors = ", ".join(
            f"{name} {before:.4g} -> {after:.4g}"
            for name, before, after in zip(report.targets, *rollout.errors, strict=True)
        )
        yield (
            f"Rollout of trajectory {rollout.name} over a time of {rollout.compared:.4g}: "
            f"RMS error {errors}."
        )
        yield from (
            f"  The rollout of the {model} ended: {why}" for model, why in wording.ends(rollout)
        )
    if report.data.why_no_rollouts:
        yield f"No rollouts: {report.data.why_no_rollouts}."
