"""A search for effects in a sentence, and its report in plain text."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from swsysid._effect_search.contents import EffectContents, EffectData
from swsysid._effect_search.rollouts import Rollout, errors_of_all
from swsysid._effect_search.settings import REPORT
from swsysid._effect_search.words import (
    Units,
    aside,
    briefly,
    effect_title,
    error,
    explained,
    first_of,
    has_a_name,
    interval,
    joined,
    judged,
    judged_unit,
    judged_with_unit,
    largest_fall,
    law_of,
    nearest,
    none_is_sure,
    probability,
    rate_of,
    when,
)
from swsysid._noise import root_mean_square
from swsysid._rendering.printing import text_table
from swsysid._residual_report.report import ResidualReport
from swsysid._results import Array
from swsysid.effects import FoundEffect, StructureEffect, UnknownFunction, UnmeasuredDisturbance

_HIDDEN = 0.5  # share of a fall: where gross rows leave less of it, both are told
_NAMES_IN_TEXT = 12  # lines of a terminal
_FORMULAS = 3  # lines of a terminal

NOT_LOOKED_FOR = "Not looked for"
SPANNED = f"{NOT_LOOKED_FOR}, since the declared model can take their shape"
NOT_KEPT = "Significant, not kept: what is untouched is no better, or its size not told from none"
_DECLARED, _WITH_EFFECTS = "declared model", "model with the effects"


def summary(report: EffectContents, units: Units = None) -> str:
    """What came out, in a sentence; what is wrong, before it."""
    outcome = _outcome(report, units)
    return " ".join([*report.alarms, outcome, *_risen(report), *_rollouts_no_better(report)])


def _outcome(report: EffectContents, units: Units) -> str:
    if not report.n_held_out:
        _, _, enough = report.held_out.partition(": ")
        return f"Nothing was searched: the record is too short to hold any of it out. {enough}"
    if not report.effects:
        return _nothing_found(report)
    first = report.effects[0]
    if not has_a_name(first):
        return nearest(report, units)
    named = sum(map(has_a_name, report.effects)) - 1
    parts = [f"{named} more effect{'s' if named > 1 else ''}"] * (named > 0)
    parts += ["what these data do not name"] * (len(report.effects) > 1 + named)
    more = f" (and {joined(parts)})" if parts else ""
    weak = ", weak evidence" if first.doubts else ""
    name = f"{effect_title(first, report)}{when(first)}, {probability(first.p_value)}{weak}{more}"
    fall = _fall(report, "with them" if parts else "with it", units)
    return f"{name[:1].upper()}{name[1:]}: {fall}."


def _nothing_found(report: EffectContents) -> str:
    """What equations that are not exact leave, and free rollouts of recordings held out."""
    none = "No effect that was looked for is missing"
    if report.time_interval is not None:
        return f"{none} at all times. {aside(report)}"
    if report.acts_rarely:
        return f"{none}, but a law acts rarely. {aside(report)}"
    left, free = report.residual_before, None if report.data is None else report.data.free
    rollouts = free is None or free.holds
    velocities = rollouts if left is None else left.clean
    if report.alarms or not (velocities or (rollouts and report.of_rollouts)):
        return f"{none_is_sure(report) or none}; what is left over is not all noise."
    if velocities and rollouts:
        return "No effect is missing as far as these data show."
    both = ("free rollouts of the model", "velocities")
    more, only = both if velocities else reversed(both)
    told = f"{only} leave nothing but noise, but {more} leave more"
    return f"{none} and {told}: see what is said of them."


def _fall(report: EffectContents, with_them: str, units: Units) -> str:
    """By how much the effects lower an error, with gross rows and, where they hide it, without."""
    every = [np.array(report.errors[place]["held_out"]) for place in (0, -1)]
    has_others = report.data is not None and not report.of_rollouts
    usual = report.data.usual_errors if has_others and report.data is not None else every
    lead, unsure = f"{with_them} the held-out error of", " or whose mode is not sure"
    which = f"without the rows set aside{'' if _modes_are_sure(report) else unsure}"
    (target, fall), (other, usual_fall) = (largest_fall(report, *one) for one in (every, usual))
    if max(fall, usual_fall) < REPORT.worth_telling:
        return _lowers_nothing(report)
    if fall < REPORT.worth_telling:
        return (
            f"{lead} {rate_of(report, other)}, {which}, is {_instead(usual, other)}; that of all "
            "rows is no lower"
        )
    hidden = other == target and fall < _HIDDEN * usual_fall
    without = f", and {_instead(usual, target)} {which}" if hidden else ""
    instead = _instead(every, target, judged_unit(report, target, units))
    share = "" if hidden else explained(report, target)
    return f"{lead} {rate_of(report, target)} is {instead}{without}{share}"


def _instead(errors: Sequence[Array], state: int, unit: str = "") -> str:
    before, after = errors
    low, high = error(after[state], before[state]), f"{before[state]:.4g}"
    return f"{low} {unit} instead of {high} {unit}" if unit else f"{low} instead of {high}"


def _modes_are_sure(report: EffectContents) -> bool:
    return report.data is None or bool(report.data.mode_known.all())


def _lowers_nothing(report: EffectContents) -> str:
    """That no velocity is predicted better, and why, where that is to be expected."""
    subject = "they do" if len(report.effects) > 1 else "it does"
    reasons = dict.fromkeys(effect.placed.effect.lowers_nothing for effect in report.effects)
    of = "free rollouts, but that of what follows shortly" if report.of_rollouts else "any velocity"
    sentence = f"{subject} not lower the held-out error of {of}"
    return f"{sentence}, since {' and '.join(reasons)}" if all(reasons) else sentence


def at_rest(report: EffectContents) -> str:
    """A sentence on rows whose errors do not count, "" if there are none."""
    if not report.n_may_stick:
        return ""
    return f" At {report.n_may_stick} of them it may stick, and no error there counts."


def _risen(report: EffectContents) -> list[str]:
    """A sentence if the effects raise the held-out error of an equation."""
    if not report.effects:
        return []
    both = zip(report.judged, *(report.errors[end]["held_out"] for end in (0, -1)), strict=True)
    risen = [
        f"{judged(report, name)} ({after:.4g} instead of {before:.4g}"
        f"{_on_the_surface(report, state)})"
        for state, (name, before, after) in enumerate(both)
        if name not in report.exact and after > (1.0 + REPORT.worth_telling) * before
    ]
    return [f"The held-out error rises for {', '.join(risen)}."] if risen else []


def _on_the_surface(report: EffectContents, state: int) -> str:
    """What a rise is without the rows on a surface, which are in any mode by luck."""
    if report.data is None or report.of_rollouts:
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
    """A sentence if rollouts of the untouched rows do not come nearer with the effects.

    Where rollouts were judged, that was from their best starts, and with what went before them.
    """
    if not report.effects or report.data is None or report.of_rollouts:
        return []
    rollouts = report.data.rollouts
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
    """What became of the modes, in a sentence; "" where there is one all along."""
    if any(isinstance(effect.placed.effect, StructureEffect) for effect in report.effects):
        return "There is one more mode than declared."
    if report.lost_modes:
        return f"With the effects no row needs {report.lost_modes} of the declared modes."
    if report.data is not None and report.data.final.joint_fit_.n_modes == 1:
        return ""
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
    return [(law_of(name, report), said) for name, said in leftover.verdicts.items()]


def ends(rollout: Rollout) -> list[tuple[str, str]]:
    """Models whose simulation ended early, and why."""
    both = zip((_DECLARED, _WITH_EFFECTS), rollout.ended, strict=True)
    return [(model, why) for model, why in both if why]


def skipped(report: EffectContents) -> list[str]:
    """Kinds that were not looked for, by the reasons why."""
    reasons: dict[str, list[str]] = {}
    for kind, why in report.skipped.items():
        reasons.setdefault(why, []).append(kind)
    return [f"{', '.join(kinds)}: {why}" for why, kinds in reasons.items()]


def not_kept(report: EffectContents) -> list[str]:
    """Effects that lowered no held-out error, or raised that of rollouts, with their numbers."""
    return [
        f"{one['effect']}: {probability(one['p_value'])}; held-out error "
        + ", ".join(
            f"{judged(report, name)} {before:.4g} -> {after:.4g}"
            for name, before, after in zip(report.judged, one["before"], one["after"], strict=True)
        )
        + _of_rollouts(one["rollouts"])
        for one in report.tried
    ]


def _of_rollouts(errors: Sequence[float] | None) -> str:
    if errors is None:
        return ""
    before, after = errors
    fall = f", of rollouts {before:.3g} -> {after:.3g} of the spread of what was measured"
    # An effect with which rollouts come nearer is refused only where one of them fails.
    return fall if after > before else f"{fall}, but with it the simulation of one ends early"


# -- the text -------------------------------------------------------------------------------------


def report_lines(report: EffectContents, units: Units = None) -> Iterator[str]:
    """The whole report."""
    if report.n_held_out:
        yield (
            f"Effect search: {report.n_search} rows searched, {report.n_held_out} held out "
            f"({report.held_out}).{at_rest(report)}{_held(report)}"
        )
    yield summary(report, units)
    laws = _laws(report.data, bool(report.effects)) if report.data is not None else []
    yield from ["", *laws] if laws else []
    if report.errors:
        yield ""
        yield from _errors(report, units)
    for number, effect in enumerate(report.effects, start=1):
        yield ""
        yield from _effect(number, effect, report)
    if report.n_held_out:
        yield ""
    if report.effects and moved(report):
        yield f"Modes: {moved(report)}"
    rare = report.acts_rarely or report.time_interval is not None
    if aside(report) and (report.effects or not rare):
        yield f"Set aside: {aside(report)}"
    if report.dropped:
        yield dropped(report)
    yield from _left_over(report)
    if report.effects and not report.of_rollouts:
        yield from _rollouts(report)
    # the errors of effects in recordings are those of free rollouts already
    if not (report.effects and report.of_rollouts) and report.free_rollouts is not None:
        yield f"Held out: {report.free_rollouts[:1].lower()}{report.free_rollouts[1:]}"
    for heading, entries in (
        (NOT_KEPT, not_kept(report)),
        (NOT_LOOKED_FOR, skipped(report)),
        (SPANNED, report.not_identifiable),
    ):
        if entries:
            yield f"{heading}:"
            yield from (f"  {entry}" for entry in first_of(entries, _NAMES_IN_TEXT))


def _held(report: EffectContents) -> str:
    """What inputs that are on no lines do between rows, in sentences."""
    said = report.data.records.holds_in_words if report.data else ""
    return f" {said}" if said else ""


def _left_over(report: EffectContents) -> Iterator[str]:
    """What is left of each equation; without the effects of those alone that have some."""
    when = [" without the effects", " with the effects"] if report.effects else [""]
    acted_on = {law_of(report.targets[one.target], report) for one in report.effects}
    for whether, (model, leftover) in zip(when, leftovers(report), strict=False):
        for name, said in verdicts(leftover, report):
            if name in acted_on or model == _WITH_EFFECTS or not acted_on:
                yield f"Left over of {name}{whether}: {briefly(said)}"


def _laws(data: EffectData, has_effects: bool) -> list[str]:
    """Laws of one mode without the effects and with them, the law alone where there is none."""
    models = [("without:", data.models[0])] if has_effects else []
    models.append(("with:" if has_effects else "law:", data.final))
    return [
        f"{when:8} {law.removeprefix('mode 0: ')}"
        for when, model in models
        if model.joint_fit_.n_modes == 1
        for law in model.equations(REPORT.precision)
    ]


def _errors(report: EffectContents, units: Units) -> list[str]:
    """Held-out errors of every equation, one line a model."""
    what = "RMS error, free rollouts held out" if report.of_rollouts else "held-out RMS error"
    columns = [(what, "<1", [row["model"] for row in report.errors])]
    for state, name in enumerate(report.judged):
        exact = name in report.exact  # where rounding is left
        every = [row["held_out"][state] for row in report.errors]
        errors = ["exact" if exact else error(one, every[0]) for one in every]
        columns.append((judged_with_unit(report, state, units), ">12", errors))
    return text_table(columns, gap="  ")


def _effect(number: int, effect: FoundEffect, report: EffectContents) -> Iterator[str]:
    yield f"{number}. {effect_title(effect, report)}: {effect.meaning}."
    yield (
        f"   held-out error before {effect.error_before:.4g}, after "
        f"{error(effect.error_after, effect.error_before)}; {probability(effect.p_value)}"
    )
    yield from (f"   weak evidence: {doubt}" for doubt in effect.doubts)
    for name, value in effect.parameters.items():
        sure = interval(effect, name)
        yield f"   {name} {value:.5g}" + (f"  (95 %: {sure})" if sure else "")
    yield from (f"   {equation}" for equation in effect.equations)
    for formula in effect.formulas[:_FORMULAS]:
        verdict = "predicts as well" if formula.ties else "predicts worse"
        yield f"   formula: {formula.text}, {verdict}: {formula.error:.3g} of the error"
    advised: dict[str, list[str]] = {}
    for rival in effect.rivals:
        entry = f"{effect_title(rival, report)}, error {error(rival.error, effect.error_before)}"
        if effect.kind == UnknownFunction.kind:
            yield f"   near effect with a name: {entry} instead of {effect.error_after:.4g}"
        else:
            advised.setdefault(rival.advice, []).append(entry)
    for advice, entries in advised.items():
        which = "rival" if len(entries) == 1 else "rivals"
        listed = "; ".join(entries)
        yield f"   {which}, as good on these data: {listed}; to tell them apart: {advice}"
    if advised:
        yield f"   {WHICH_RECORDING}"


# Candidates are the user's: a report knows no recordings that could be made.
WHICH_RECORDING = (
    "which recording does so most: suggest_experiment(model.stated(), candidates, recordings, "
    "rivals=[rival.stated()]) of swsysid.refinement"
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
        yield from (f"  The rollout of the {model} ended: {why}" for model, why in ends(rollout))
    if report.data.why_no_rollouts:
        yield f"No rollouts: {report.data.why_no_rollouts}."
