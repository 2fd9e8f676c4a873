"""What is said of a search for effects, wherever it is said."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._effect_search.contents import EffectContents
from swsysid._effect_search.report_settings import REPORT
from swsysid._effect_search.rollouts import Rollout
from swsysid._residual_report.report import ResidualReport
from swsysid.effects import FoundEffect, Rival, StructureEffect
from swsysid.effects._base import NOWHERE

__all__ = [
    "NOT_LOOKED_FOR",
    "SPANNED",
    "effect_title",
    "ends",
    "first_of",
    "interval",
    "leftovers",
    "moved",
    "named",
    "probability",
    "rate",
    "sentence",
    "skipped",
    "summary",
    "title",
    "verdicts",
]

NOT_LOOKED_FOR = "Not looked for"
SPANNED = f"{NOT_LOOKED_FOR}, since the declared model can take their shape"
_DECLARED, _WITH_EFFECTS = "declared model", "model with the effects"


def rate(name: str, discrete: bool = False) -> str:
    """What the law of a state gives: its velocity, or its next value."""
    return f"next {name}" if discrete else f"{name}'"


def named(kind: str, place: str) -> str:
    """Kind of an effect, and its place where that says more."""
    return kind.replace("_", " ") + ("" if place in NOWHERE else f" of {place}")


def title(kind: str, place: str, state: str, mode: int | None, discrete: bool = False) -> str:
    """Kind, place, equation and mode of an effect in a few words."""
    where = "" if mode is None else f", mode {mode}"
    return f"{named(kind, place)} in {rate(state, discrete)}{where}"


def effect_title(effect: FoundEffect | Rival, report: EffectContents) -> str:
    """`title` of an effect that was found, or of its rival."""
    state = report.targets[effect.target]
    return title(effect.kind, effect.place, state, effect.mode, report.discrete)


def sentence(text: str, names: Sequence[str]) -> str:
    """Text as a sentence; a channel's name that it begins with keeps its letters."""
    first = text if any(text.startswith(name) for name in names) else text[:1].upper() + text[1:]
    return f"{first}."


def probability(value: float) -> str:
    """A p-value, no smaller than means anything."""
    least = REPORT.smallest_p_value
    return f"p = {value:.1g}" if value >= least else f"p < {least:g}"


def interval(effect: FoundEffect, name: str) -> str:
    """95 % confidence interval of a parameter, "" if there is none."""
    low, high = effect.intervals.get(name, (np.nan, np.nan))
    return f"{low:.4g} to {high:.4g}" if np.isfinite(low) and np.isfinite(high) else ""


def summary(report: EffectContents) -> str:
    """What came out, in one sentence."""
    if not report.n_held_out:
        return "Nothing was searched: the record is too short to hold any of it out."
    if not report.effects:
        return "No effect is missing as far as these data show."
    errors = np.array([report.errors[place]["held_out"] for place in (0, -1)])
    target = int(np.argmin(errors[1] / np.where(errors[0] > 0, errors[0], np.inf)))
    before, after = errors[:, target]
    others = len(report.effects) - 1
    more = f" (and {others} more effect{'s' if others > 1 else ''})" if others else ""
    name = effect_title(report.effects[0], report)
    name = f"{name[:1].upper()}{name[1:]}{more}"
    if after > (1.0 - REPORT.worth_telling) * before:
        return f"{name}: it does not lower the held-out error of any velocity."
    return (
        f"{name}: with it the held-out error of {rate(report.targets[target], report.discrete)} "
        f"is {after:.4g} instead of {before:.4g}."
    )


def moved(report: EffectContents) -> str:
    """What became of the modes, in a sentence."""
    if any(isinstance(effect.placed.effect, StructureEffect) for effect in report.effects):
        return "There is one more mode than declared."
    return f"{report.guard_moved:.1%} of the samples changed their mode."


def leftovers(report: EffectContents) -> list[tuple[str, ResidualReport]]:
    """What the declared model leaves over, and what that with the effects."""
    models = [(_DECLARED, report.residual_before)]
    if report.effects:
        models.append((_WITH_EFFECTS, report.residual_after))
    return [(model, leftover) for model, leftover in models if leftover is not None]


def verdicts(leftover: ResidualReport, report: EffectContents) -> list[tuple[str, str]]:
    """Velocities, and the sentence on what is left of each."""
    return [(rate(name, report.discrete), said) for name, said in leftover.verdicts.items()]


def ends(rollout: Rollout) -> list[tuple[str, str]]:
    """Models whose simulation ended early, and why."""
    both = zip((_DECLARED, _WITH_EFFECTS), rollout.ended, strict=True)
    return [(model, why) for model, why in both if why]


def skipped(report: EffectContents) -> list[str]:
    """Kinds that were not looked for, and why."""
    return [f"{kind}: {why}" for kind, why in report.skipped.items()]


def first_of(entries: Sequence[str], most: int) -> list[str]:
    """The first entries, and how many more there are."""
    rest = len(entries) - most
    return [*entries[:most], *([f"and {rest} more"] if rest > 0 else [])]
