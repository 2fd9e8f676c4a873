"""The words that all that is said of a search for effects shares, and those for gross errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from swsysid._displays.style import unit_of
from swsysid._effect_search.contents import EffectContents, RowsSetAside
from swsysid._effect_search.settings import REPORT
from swsysid._rendering.printing import between
from swsysid._results import Array
from swsysid.effects import FoundEffect, Rival
from swsysid.effects._base import NOWHERE

# the doubt about what explains less of an error than the effects together leave above the noise
NO_NAME = "more of the error is left than it explains: it may stand for what has no name here"
_SMALLEST_P_VALUE = 1e-16  # smaller ones are rounding
_NOISE_ALONE = 1.3  # times the noise floor, which is known to a tenth or two: no more
_LEAST = float(np.finfo(float).tiny)
_SMALLEST_ERROR = 1e-12  # of the declared model's: sums of some terms have no more digits

Units = Mapping[str, str] | None


def rate(name: str, discrete: bool = False, static: bool = False) -> str:
    """What a law gives: the velocity of a state, its next value, or a quantity that is no rate."""
    if static:
        return name
    return f"next {name}" if discrete else f"{name}'"


def named(kind: str, place: str) -> str:
    """Kind of an effect, and its place where that says more."""
    return kind.replace("_", " ") + ("" if place in NOWHERE else f" of {place}")


def title(kind: str, place: str, law: str, mode: int | None) -> str:
    """Kind, place, what the law gives and mode of an effect in a few words."""
    where = "" if mode is None else f", mode {mode}"
    return f"{named(kind, place)} in {law}{where}"


def effect_title(effect: FoundEffect | Rival, report: EffectContents) -> str:
    """`title` of an effect that was found, or of its rival; what is no name is called nearest."""
    law = law_of(report.targets[effect.target], report)
    told = title(effect.kind, effect.place, law, effect.mode)
    return told if isinstance(effect, Rival) or has_a_name(effect) else f"no name, nearest {told}"


def has_a_name(effect: FoundEffect) -> bool:
    """Whether it explains more than is left: p-values speak against nothing, not for a name."""
    return NO_NAME not in effect.doubts


def when(effect: FoundEffect) -> str:
    """From when to when it acts, "" of one that always does."""
    told = effect.placed.effect.when(effect.parameters)
    return f", {told}" if told else ""


def law_of(name: str, report: EffectContents) -> str:
    """What the equation of this name gives."""
    return rate(name, report.discrete, report.static)


def explained(report: EffectContents, state: int) -> str:
    """The share of what is no noise that the effects explain, and what remains of that."""
    noise = noise_floor(report, state)
    before, after = (report.errors[place]["held_out"][state] for place in (0, -1))
    if not before > noise:
        return ""
    share = (before**2 - max(after, noise) ** 2) / (before**2 - noise**2)
    told = f". Of the squared error above the noise {percent(share)} is explained"
    if after <= _NOISE_ALONE * noise:
        return f"{told}, and nothing but noise is left"
    is_free = noise <= REPORT.least_noise * before  # of noise: the record is all but exact
    return told if is_free else f"{told}, and {after / noise:.2g} times the noise is left"


def noise_floor(report: EffectContents, state: int) -> float:
    """Of what the errors are of, NaN where it is not known."""
    if report.of_rollouts:
        noise = None if report.data is None else report.data.noise
        return np.nan if noise is None else float(noise[state])
    left = report.residual_before
    floors = [] if left is None else [one.noise_floor for one in left.size if one.mode is None]
    floor = floors[state] if len(floors) == len(report.targets) else None
    return np.nan if floor is None else floor


def judged_unit(report: EffectContents, state: int, units: Units) -> str:
    """The unit of what errors are of, "" where it is not known."""
    name = report.targets[state]
    is_rate = not (report.of_rollouts or report.discrete or report.static)
    return unit_of(f"d/dt {name}" if is_rate else name, units) or ""


def judged(report: EffectContents, name: str) -> str:
    """What errors are of: a state that was rolled out, or what its law gives."""
    return name if report.of_rollouts else law_of(name, report)


def judged_with_unit(report: EffectContents, state: int, units: Units) -> str:
    """The same with its unit, where that is known."""
    name, unit = judged(report, report.targets[state]), judged_unit(report, state, units)
    return f"{name} [{unit}]" if unit else name


def nearest(report: EffectContents, units: Units) -> str:
    """What was tried in the place of a first effect that explains the lesser part, best first."""
    first, others = report.effects[0], len(report.effects) - 1
    errors = [np.array(one["held_out"]) for one in report.errors]
    state, _ = largest_fall(report, *errors[:2])
    unit = judged_unit(report, state, units)
    own = f"{named(first.kind, first.place)}{when(first)}"
    told = {own: " (in the model)"}
    tried = [(first.error_after, own)]
    tried += [(one.error, named(one.kind, one.place)) for one in first.rivals]
    near = [f"{name} {size:.4g}{told.get(name, '')}" for size, name in sorted(tried)]
    more = f"; with {others} more in the model {errors[-1][state]:.4g}" if others else ""
    return (
        f"{law_of(report.targets[first.target], report)} lacks something "
        f"({probability(first.p_value)}) that these data do not name. Nearest, by the held-out "
        f"error of {rate_of(report, state)}, which is {first.error_before:.4g}"
        f"{unit and f' {unit}'} without: {', '.join(near)}{more}"
        f"{explained(report, state)}."
    )


def none_is_sure(report: EffectContents) -> str:
    """What would come next if it were sure, and what would tell or speaks against it."""
    near = report.unsure
    if near is None:
        return ""
    # one that is sure of the searched part is not kept for what was held out
    why = (
        f"about {near['longer']:.2g} times as much of such a record would tell"
        if near["longer"] > 1.0
        else "what was held out speaks against it"
    )
    return (
        f"No effect is sure. Nearest is {near['effect']}, by which the squared error of stretches "
        f"that it was not fitted to falls by {percent(near['share'])} "
        f"({probability(near['p_value'])}); {why}"
    )


def rate_of(report: EffectContents, state: int) -> str:
    """What held-out errors are of: a free rollout, or what a law gives."""
    name = report.targets[state]
    return f"free rollouts of {name}" if report.of_rollouts else law_of(name, report)


def largest_fall(report: EffectContents, before: Array, after: Array) -> tuple[int, float]:
    """The state whose error falls by the largest share, and that share."""
    # an equation that is exact, such as q' = v, has no error that could be lowered
    exact = np.array([name in report.exact for name in report.judged])
    falls = np.where(exact, -np.inf, 1.0 - after / np.maximum(before, _LEAST))
    best = int(np.argmax(falls))
    return best, float(falls[best])


def sentence(text: str, names: Sequence[str]) -> str:
    """Text as a sentence; a channel's name that it begins with keeps its letters."""
    first = text if any(text.startswith(name) for name in names) else text[:1].upper() + text[1:]
    return f"{first}."


def probability(value: float) -> str:
    """A p-value, no smaller than means anything."""
    least = _SMALLEST_P_VALUE
    return f"p = {value:.1g}" if value >= least else f"p < {least:g}"


def error(value: float, before: float) -> str:
    """A root mean square error, no smaller than the rounding of what it was before."""
    least = _SMALLEST_ERROR * before
    return f"{value:.4g}" if value >= least else f"< {least:.1g}"


def briefly(said: str) -> str:
    """A sentence on what is left, with the first thing that it depends on.

    Examples
    --------
    >>> briefly("the residual is 2.0 times the noise floor; it depends on v (p<=0.01, 5% of it).")
    'the residual is 2.0 times the noise floor; it depends on v (p<=0.01, 5% of it).'
    >>> briefly("the residual is 3; it depends on x (a line) and on v (a step); its spread too.")
    'the residual is 3; it depends on x (a line), and more.'
    """
    clauses = said.rstrip(".").split("; ")
    told = "; ".join(clauses[:2])
    first, more, _ = told.partition(" and on ")
    return f"{first}, and more." if more or len(clauses) > 2 else f"{told}."


def percent(share: float) -> str:
    """A share, never rounded to nothing or to all of it.

    Examples
    --------
    >>> [percent(share) for share in (0.123, 0.99999, 1.0, 1e-4)]
    ['12 %', 'over 99 %', '100 %', 'under 1 %']
    """
    if 0.995 < share < 1.0:
        return "over 99 %"
    return "under 1 %" if 0.0 < share < 0.005 else f"{100.0 * share:.0f} %"


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


def aside(report: EffectContents) -> str:
    """How many rows are set aside and where they are, in a sentence; "" if there are none."""
    one = report.set_aside
    if one is None or not one["n_rows"]:
        return ""
    share = one["n_rows"] / (report.n_search + report.n_held_out)
    if one["n_rows"] == 1:
        return f"1 row ({share:.1%}) has a gross error and is set aside."
    gross = f"{one['n_rows']} rows ({share:.1%}) have gross errors and are set aside"
    if not one["n_together"]:
        return f"{gross}; no two of them follow each other."
    where = _where(one)
    place = (
        f"{one['n_together']} of them lie together in {one['n_trajectories']} "
        f"{'trajectory' if one['n_trajectories'] == 1 else 'trajectories'}, "
        f"{where or 'at no place of their own'}"
    )
    event = one["time_interval"]
    if event is not None:
        beside = ", beside the effects" if report.effects else ""
        seen = f", with {where}: time and place cannot be told apart" if where else ""
        times = [f"{begin:.4g} to {end:.4g}" for begin, end in event["intervals"]]
        once = len(times) == 1
        return (
            f"{gross}; {event['n_rows']} of them follow each other from {joined(times)} in "
            f"trajectory {event['trajectory']}: another law acts for "
            f"{'that time' if once else 'these times'} ({probability(one['p_value'])}){beside}: "
            f"{'; '.join(event['law'])}. It is seen {'once' if once else f'{len(times)} times'}"
            f"{seen}."
        )
    if not one["is_finding"]:
        return f"{gross}; {place}."
    # a place in which the usual law holds in more rows is not all that the other one needs
    others = report.n_search + report.n_held_out - one["n_together"]
    there = one["place"]
    few = there is not None and there["others"] * others <= there["n_rows"]
    when = "there" if few else "there at times" if where else "at times"
    return (
        f"{gross}; {place}: another law acts {when}, one more mode, "
        f"a stop or a collision ({probability(one['p_value'])})."
    )


def _where(rows: RowsSetAside) -> str:
    """The place of those that lie together, "" if it is everywhere."""
    place = rows["place"]
    if place is None:
        return ""
    low, high = place["interval"]
    most = "" if place["n_rows"] == rows["n_together"] else f"{place['n_rows']} with "
    return (
        f"{most}{place['channel']} between {low:.4g} and {high:.4g} "
        f"(where {place['others']:.1%} of the others are)"
    )
