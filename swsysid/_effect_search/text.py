"""What is said of a search for effects: the words that all share, and a report in plain text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from swsysid._effect_search.contents import EffectContents
from swsysid._effect_search.rollouts import Rollout, errors_of_all
from swsysid._effect_search.settings import REPORT, SETTINGS
from swsysid._noise import root_mean_square
from swsysid._rendering.columns import text_table
from swsysid._residual_report.report import ResidualReport
from swsysid.effects import (
    FoundEffect,
    Rival,
    StructureEffect,
    UnknownFunction,
    UnmeasuredDisturbance,
)
from swsysid.effects._base import NOWHERE

NOT_LOOKED_FOR = "Not looked for"
SPANNED = f"{NOT_LOOKED_FOR}, since the declared model can take their shape"
NOT_KEPT = "Significant but not kept, since what is untouched is not clearly better predicted"
_LEAST = float(np.finfo(float).tiny)
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
    """What came out, in a sentence; what is wrong, before it."""
    told = [*report.alarms, _outcome(report), *_risen(report), *_rollouts_no_better(report)]
    return " ".join(told)


def _outcome(report: EffectContents) -> str:
    if not report.n_held_out:
        return "Nothing was searched: the record is too short to hold any of it out."
    if not report.effects and report.time_interval is not None:
        return f"No effect that was looked for is missing at all times. {aside(report)}"
    if not report.effects and report.acts_rarely:
        return f"No effect that was looked for is missing, but a law acts rarely. {aside(report)}"
    if not report.effects and not report.alarms and _leaves_noise(report):
        return "No effect is missing as far as these data show."
    if not report.effects:
        return "No effect that was looked for is missing; what is left over is not all noise."
    before, after = (np.array(report.errors[place]["held_out"]) for place in (0, -1))
    # an equation that is exact, such as q' = v, has no error that could be lowered
    told = np.where([name in report.exact for name in report.targets], np.inf, before)
    target = int(np.argmin(np.where(np.isfinite(told), after / np.maximum(told, _LEAST), np.inf)))
    others = len(report.effects) - 1
    more = f" (and {others} more effect{'s' if others > 1 else ''})" if others else ""
    name = effect_title(report.effects[0], report)
    weak = ", weak evidence" if report.effects[0].doubts else ""
    name = f"{name[:1].upper()}{name[1:]}, {probability(report.effects[0].p_value)}{weak}{more}"
    if after[target] > (1.0 - REPORT.worth_telling) * before[target]:
        return f"{name}: {_lowers_nothing(report)}."
    return (
        f"{name}: with {'them' if others else 'it'} the held-out error of "
        f"{rate(report.targets[target], report.discrete)} "
        f"is {after[target]:.4g} instead of {before[target]:.4g}."
    )


def _lowers_nothing(report: EffectContents) -> str:
    """That no velocity is predicted better, and why, where that is to be expected."""
    subject = "they do" if len(report.effects) > 1 else "it does"
    reasons = dict.fromkeys(effect.placed.effect.lowers_nothing for effect in report.effects)
    told = f"{subject} not lower the held-out error of any velocity"
    return f"{told}, since {' and '.join(reasons)}" if all(reasons) else told


def at_rest(report: EffectContents) -> str:
    """A sentence on rows whose errors do not count, "" if there are none."""
    if not report.n_may_stick:
        return ""
    return f" At {report.n_may_stick} of them it may stick, and no error there counts."


def _leaves_noise(report: EffectContents) -> bool:
    """True if nothing but noise is left of the equations that are not exact."""
    left = report.residual_before
    return left is None or left.clean


def _risen(report: EffectContents) -> list[str]:
    """A sentence if the effects raise the held-out error of an equation."""
    if not report.effects:
        return []
    both = zip(report.targets, *(report.errors[end]["held_out"] for end in (0, -1)), strict=True)
    risen = [
        f"{rate(name, report.discrete)} ({after:.4g} instead of {before:.4g}"
        f"{_on_the_surface(report, state)})"
        for state, (name, before, after) in enumerate(both)
        if name not in report.exact and after > (1.0 + REPORT.worth_telling) * before
    ]
    return [f"The held-out error rises for {', '.join(risen)}."] if risen else []


def _on_the_surface(report: EffectContents, state: int) -> str:
    """What a rise is without the rows on a surface, which are in any mode by luck."""
    if report.data is None:
        return ""
    known = report.data.mode_known
    if known.all() or not known.any():
        return ""
    before, after = (
        root_mean_square(errors[known][:, [state]])[0] for errors in report.data.residuals
    )
    return (
        f"; without {np.sum(~known)} of {len(known)} rows, whose mode is not sure, "
        f"{after:.4g} instead of {before:.4g}"
    )


def _rollouts_no_better(report: EffectContents) -> list[str]:
    """A sentence if rollouts of the untouched rows do not come nearer with the effects."""
    rollouts = report.data.rollouts if report.effects and report.data is not None else ()
    if not rollouts:
        return []
    early = [one.name for one in rollouts if one.ended[1] and not one.ended[0]]
    if early:
        names = ", ".join(early)
        return [f"With them the rollout of {names} ends early, without them it does not."]
    before, after = errors_of_all(rollouts)
    if after <= (1.0 - REPORT.worth_telling) * before:
        return []
    return [
        f"Rollouts of the untouched rows do not become better: their error is {after:.3g} of the "
        f"spread of what was measured instead of {before:.3g}."
    ]


def moved(report: EffectContents) -> str:
    """What became of the modes, in a sentence."""
    if any(isinstance(effect.placed.effect, StructureEffect) for effect in report.effects):
        return "There is one more mode than declared."
    return f"{report.guard_moved:.1%} of the samples changed their mode."


def dropped(report: EffectContents) -> str:
    """What the rounds have added and the end has not kept, in a sentence; "" if nothing."""
    if not report.dropped:
        return ""
    forces = (isinstance(one.placed.effect, UnmeasuredDisturbance) for one in report.effects)
    force = " or a force that nobody measured" if any(forces) else ""
    which = "; ".join(report.dropped)
    return f"Dropped at the end, since chance{force} explains it as well: {which}."


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


def not_kept(report: EffectContents) -> list[str]:
    """Effects that lowered no held-out error, or raised that of rollouts, with their numbers."""
    return [
        f"{one['effect']}: {probability(one['p_value'])}; held-out error "
        + ", ".join(
            f"{rate(name, report.discrete)} {before:.4g} -> {after:.4g}"
            for name, before, after in zip(report.targets, one["before"], one["after"], strict=True)
        )
        + _of_rollouts(one["rollouts"])
        for one in report.tried
    ]


def _of_rollouts(errors: Sequence[float] | None) -> str:
    if errors is None:
        return ""
    before, after = errors
    told = f", of rollouts {before:.3g} -> {after:.3g} of the spread of what was measured"
    # An effect with which rollouts come nearer is refused only where one of them fails.
    return told if after > before else f"{told}, but with it the simulation of one ends early"


def aside(report: EffectContents) -> str:
    """How many rows are set aside and where they are, in a sentence; "" if there are none."""
    one = report.set_aside
    if one is None or not one["n_rows"]:
        return ""
    share = one["n_rows"] / (report.n_search + report.n_held_out)
    if one["n_rows"] == 1:
        return f"1 row ({share:.1%}) has a gross error and is set aside."
    told = f"{one['n_rows']} rows ({share:.1%}) have gross errors and are set aside"
    if not one["n_together"]:
        return f"{told}; no two of them follow each other."
    low, high = one["interval"]
    anywhere = one["others"] > SETTINGS.nowhere
    where = (
        f"{one['channel']} between {low:.4g} and {high:.4g} "
        f"(where {one['others']:.1%} of the others are)"
    )
    place = (
        f"{one['n_together']} of them lie together in {one['n_trajectories']} "
        f"{'trajectory' if one['n_trajectories'] == 1 else 'trajectories'}, "
        f"{'at no place of their own' if anywhere else where}"
    )
    event = one["time_interval"]
    if event is not None:
        beside = ", beside the effects" if report.effects else ""
        seen = "" if anywhere else f", with {where}: time and place cannot be told apart"
        times = [f"{begin:.4g} to {end:.4g}" for begin, end in event["intervals"]]
        once = len(times) == 1
        return (
            f"{told}; {event['n_rows']} of them follow each other from {joined(times)} in "
            f"trajectory {event['trajectory']}: another law acts for "
            f"{'that time' if once else 'these times'} ({probability(one['p_value'])}){beside}: "
            f"{'; '.join(event['law'])}. It is seen {'once' if once else f'{len(times)} times'}"
            f"{seen}."
        )
    if not one["is_finding"]:
        return f"{told}; {place}."
    # a place in which the usual law holds in more rows is not all that the other one needs
    others = one["others"] * (report.n_search + report.n_held_out - one["n_together"])
    when = "there" if others <= one["n_together"] else "at times" if anywhere else "there at times"
    return (
        f"{told}; {place}: another law acts {when}, one more mode, "
        f"a stop or a collision ({probability(one['p_value'])})."
    )


def joined(parts: Sequence[str]) -> str:
    """Parts in a row, with "and" before the last."""
    return " and ".join(filter(None, [", ".join(parts[:-1]), parts[-1]]))


def first_of(entries: Sequence[str], most: int) -> list[str]:
    """The first entries, and how many more there are."""
    rest = len(entries) - most
    return [*entries[:most], *([f"and {rest} more"] if rest > 0 else [])]


# -- the text -------------------------------------------------------------------------------------


def report_lines(report: EffectContents) -> Iterator[str]:
    """The whole report."""
    yield (
        f"Effect search: {report.n_search} rows searched, {report.n_held_out} held out "
        f"({report.held_out}).{at_rest(report)}"
    )
    yield summary(report)
    if report.errors:
        yield ""
        yield from _errors(report)
    for number, effect in enumerate(report.effects, start=1):
        yield ""
        yield from _effect(number, effect, report)
    if report.n_held_out:
        yield ""
    if report.effects:
        yield f"Modes: {moved(report)}"
    rare = report.acts_rarely or report.time_interval is not None
    if aside(report) and (report.effects or not rare):
        yield f"Set aside: {aside(report)}"
    if report.dropped:
        yield dropped(report)
    when = [" without the effects", " with the effects"] if report.effects else [""]
    for told, (_, leftover) in zip(when, leftovers(report), strict=False):
        for name, said in verdicts(leftover, report):
            yield f"Left over of {name}{told}: {said}"
    if report.effects:
        yield from _rollouts(report)
    for heading, entries in (
        (NOT_KEPT, not_kept(report)),
        (NOT_LOOKED_FOR, skipped(report)),
        (SPANNED, report.not_identifiable),
    ):
        if entries:
            yield f"{heading}:"
            yield from (f"  {entry}" for entry in first_of(entries, REPORT.names_in_text))


def _errors(report: EffectContents) -> list[str]:
    """Held-out errors of every equation, one line a model."""
    columns = [("held-out RMS error", "<1", [row["model"] for row in report.errors])]
    for state, name in enumerate(report.targets):
        exact = name in report.exact  # where rounding is left
        errors = ["exact" if exact else f"{row['held_out'][state]:.4g}" for row in report.errors]
        columns.append((rate(name, report.discrete), ">12", errors))
    return text_table(columns, gap="  ")


def _effect(number: int, effect: FoundEffect, report: EffectContents) -> Iterator[str]:
    yield f"{number}. {effect_title(effect, report)}: {effect.meaning}."
    yield (
        f"   held-out error before {effect.error_before:.4g}, after {effect.error_after:.4g}; "
        f"{probability(effect.p_value)}"
    )
    yield from (f"   weak evidence: {doubt}" for doubt in effect.doubts)
    for name, value in effect.parameters.items():
        sure = interval(effect, name)
        yield f"   {name} {value:.5g}" + (f"  (95 %: {sure})" if sure else "")
    yield from (f"   {equation}" for equation in effect.equations)
    for formula in effect.formulas[: REPORT.formulas]:
        verdict = "predicts as well" if formula.ties else "predicts worse"
        yield f"   formula: {formula.text}, {verdict}: {formula.error:.3g} of the error"
    for rival in effect.rivals:
        told = f"{effect_title(rival, report)}, error {rival.error:.4g}"
        if effect.kind == UnknownFunction.kind:
            yield f"   near effect with a name: {told} instead of {effect.error_after:.4g}"
        else:
            yield f"   rival, as good on these data: {told}; to tell them apart: {rival.advice}"


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
        yield from (f"  The rollout of the {model} ended: {why}" for model, why in ends(rollout))
    if report.data.why_no_rollouts:
        yield f"No rollouts: {report.data.why_no_rollouts}."
