"""The one verdict of the main job in words: is there switching, how surely, and what to do."""

from __future__ import annotations

from swsysid._cli.guard_words import memory
from swsysid._cli.job import JobResult
from swsysid._cli.settings import JUDGING, RECORDINGS
from swsysid._cli.verdict import Comparison, Verdict


def n_compared(result: JobResult) -> int:
    """How many modes are compared with one: those that the training part has."""
    found = result.model.n_modes_ if result.given_up is None else result.given_up
    return found - len(result.comparison.untested)


def verdict_text(result: JobResult) -> str:
    """The one verdict, and how sure the search was."""
    comparison, model = result.comparison, result.model
    if result.given_up is not None:
        return _no_switching(
            result,
            f"{result.given_up} modes were found, but one mode with {result.terms} terms predicts "
            "the held-out samples as well, and is delivered (error of the "
            f"{n_compared(result)} modes: {_change(comparison)}).",
        )
    if model.n_modes_ > 1:
        if result.found is not None:
            return _of_modes(result)
        stability = (
            f"The same answer came from {100 * result.declared.stability_:.0f} % of the starts."
        )
        return f"{_of_modes(result)}\n{stability}"
    best = comparison.best
    if best is comparison.rivals[0]:
        return _no_switching(
            result, "the model has one mode, and no smooth law with more terms is better."
        )
    lower = 1.0 - 1.0 / (1.0 - comparison.improvement)  # the best law's error, than the model's
    return (
        f"No switching: the model has one mode. With {best.terms} terms its held-out error is "
        f"{100 * lower:.1f} % lower{_advice(best.terms.option)}."
    )


def _no_switching(result: JobResult, told: str) -> str:
    """What is `told` of one mode; where one was not asked for, it proves that by leaving noise."""
    if result.options.modes != "auto" or not result.comparison.lacks_something:
        return f"No switching: {told}"
    return (
        f"Whether it switches is not shown: {told} It leaves more than noise: try another library, "
        "or, if the modes may have memory or states jump, --automaton."
    )


def _of_modes(result: JobResult) -> str:
    comparison, best = result.comparison, result.comparison.best
    n_modes = n_compared(result)
    law = f"one mode with {best.terms} terms"
    judged = "rates" if comparison.noise is None else "states"
    sure = f"error {_change(comparison)}, {comparison.gain:.1f} standard errors over blocks"
    if comparison.improvement <= JUDGING.worth and (told := _memory(result)):
        return _of_memory(result, told)
    other = "" if result.options.modes == "auto" else "; or let the data say how many: --modes auto"
    unsure = comparison.verdict in (Verdict.SMOOTH, Verdict.ONE_MODE)
    if unsure and comparison.lacks_something and _stands(result):
        return _of_surface(result, law, other)
    return {
        Verdict.SWITCHES: (
            "Switching predicts the held-out samples clearly better than one mode: than the best "
            f"smooth law that was tried, {law} ({sure})."
        ),
        Verdict.CHANCE: (
            f"Switching predicts the held-out samples better than {law}, which may be chance "
            f"({sure}). Record more trajectories, or hold out more of them (--test-fraction)."
        ),
        Verdict.SMOOTH: (
            "Switching does not predict the held-out samples clearly better than one mode: "
            f"{law} does as well (error of the {n_modes} modes {_change(comparison)}). Do not "
            "trust the modes, which may only follow a curve piece by piece"
            f"{_smooth_advice(comparison)}{other}."
        ),
        Verdict.UNREPEATED: (
            f"Switching explains all that was recorded: told when to switch, {n_modes} modes leave "
            "nothing but noise, which no smooth law that was tried does. Laws of the other samples "
            f"alone do not repeat that on what is held out (error against {law} "
            f"{_change(comparison)}): they are too few for every coefficient. Record more."
        ),
        Verdict.ONE_MODE: (
            "Switching does not predict the held-out samples clearly better than one mode "
            f"(error {_change(comparison)}). Do not trust the modes: try another library, keep one "
            "mode (--modes 1), or, if the modes may have memory or states jump, try --automaton"
            f"{other}."
        ),
        Verdict.TOO_FEW: (
            "These data do not decide whether there is switching: the modes change "
            f"{comparison.n_switches} times and {len(comparison.errors)} samples are held out, "
            f"where at least {JUDGING.fewest_switches} and "
            f"{JUDGING.fewest_rows} are needed. Record more."
        ),
        Verdict.USELESS: (
            f"The held-out error of the {n_modes} modes is no smaller than the spread of the "
            f"{judged}: these laws predict no better than the mean. Smooth the data more "
            "(--window), add what drives the system to --inputs, or try another library."
        ),
        Verdict.HIDDEN: (
            "Switching does not predict the held-out samples clearly better than one mode, since "
            "the surface does not say which mode is active: the model uses the law of one mode "
            f"everywhere, and its error, against {law}, is {_change(comparison)}{other}."
        ),
    }[comparison.verdict]


def _memory(result: JobResult) -> str:
    """Where each of two modes begins, if their surface cannot tell it."""
    found = result.found
    if found is None or result.model.n_modes_ != 2:
        return ""
    rollouts = found.identifier.report_.rollouts
    return "" if rollouts.tells_switches else memory(result.modes, result.samples)


def _stands(result: JobResult) -> bool:
    """Whether the laws leave nothing but noise where they are told when to switch."""
    found = result.found
    return found is not None and bool((found.excess <= RECORDINGS.noise_alone).all())


def _of_memory(result: JobResult, told: str) -> str:
    """A guard that remembers, as far as laws that leave only noise say so; else a mode may lack."""
    error = f"(error {_change(result.comparison)})"
    if _stands(result):
        return (
            f"The guard remembers (hysteresis): {told}. No surface tells that, and so the laws, "
            f"which stand, predict the held-out samples no better than one mode {error}. Run again "
            "with --automaton, which finds such guards."
        )
    asked = result.options.modes == "auto"
    more = "" if asked else "with --modes auto, and if that finds no more modes "
    return (
        f"The guard may remember (hysteresis): {told}. But the laws leave more than noise even "
        "where they are told when to switch, and predict the held-out samples no better than one "
        f"mode {error}. Run again {more}with --automaton, which finds such guards."
    )


def _change(comparison: Comparison) -> str:
    share = comparison.improvement
    if share < -1.0:
        return f"{1.0 - share:.3g} times as large"
    return f"{100 * abs(share):.1f} % {'lower' if share >= 0.0 else 'higher'}"


def _of_surface(result: JobResult, law: str, other: str) -> str:
    """Laws that leave only noise where they are told when to switch, and a surface that is off."""
    return (
        f"Told when to switch, the {n_compared(result)} modes leave nothing but noise, which no "
        "smooth law that was tried does; but by themselves they predict the held-out samples no "
        f"better than {law} (error {_change(result.comparison)}): do not trust the switching "
        f"surface. Record more switches, from other states{other}."
    )


def _smooth_advice(comparison: Comparison) -> str:
    """To ask for the law of one mode, unless it lacks something as well."""
    if comparison.lacks_something:
        return ", nor that law, which leaves more than noise, too: try another library"
    return _advice(comparison.best.terms.option)


def _advice(option: str) -> str:
    return f"; ask for that law: --modes 1 {option}" if option else ""
