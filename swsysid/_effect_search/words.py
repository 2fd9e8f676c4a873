"""The words that all that is said of a search for effects shares."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._effect_search.contents import EffectContents
from swsysid._effect_search.settings import REPORT
from swsysid._rendering.errors import between
from swsysid.effects import FoundEffect, Rival
from swsysid.effects._base import NOWHERE


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


def error(value: float, before: float) -> str:
    """A root mean square error, no smaller than the rounding of what it was before."""
    least = REPORT.smallest_error * before
    return f"{value:.4g}" if value >= least else f"< {least:.1g}"


def interval(effect: FoundEffect, name: str) -> str:
    """95 % confidence interval of a parameter, "" if there is none."""
    low, high = effect.intervals.get(name, (np.nan, np.nan))
    if not (np.isfinite(low) and np.isfinite(high)):
        return ""
    ends = f"{low:.4g}", f"{high:.4g}"
    return between(low, high) if ends[0] == ends[1] else " to ".join(ends)


def joined(parts: Sequence[str]) -> str:
    """Parts in a row, with "and" before the last."""
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))


def first_of(entries: Sequence[str], most: int) -> list[str]:
    """The first entries, and how many more there are."""
    rest = len(entries) - most
    return [*entries[:most], *([f"and {rest} more"] if rest > 0 else [])]
