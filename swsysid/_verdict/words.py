"""What a verdict is said with: names of options, the table of errors, how long a model holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._rendering.printing import counted, text_table
from swsysid._results import Array
from swsysid._verdict.comparison import Comparison
from swsysid._verdict.terms import DEGREES, Terms


@dataclass(frozen=True)
class Words:
    """How a user asks for what is advised; "" for what cannot be asked for."""

    one_mode: str = "n_modes=1"
    auto: str = 'n_modes="auto"'
    again: str = "Fit again with"
    memory: str = "a HybridAutomatonRegressor"
    effects: str = "EffectSearchCV"
    beside: str = "EffectSearchCV"  # asks what modes that are there lack; {} is their number
    hold_out: str = ""
    smooth: str = ""
    inputs: str = "the inputs"
    degree: str = "n_modes=1, feature_library={}"
    degrees: Mapping[int, str] = field(default_factory=dict)
    waves: str = "n_modes=1 and a library with sines and cosines"
    waves_and_products: str = "n_modes=1 and a library with products, sines and cosines"

    def law(self, terms: Terms) -> str:
        """A law of one mode."""
        if terms.own is not None:
            return ""
        if terms.waves:
            return self.waves if terms.degree <= 1 else self.waves_and_products
        return self.degrees.get(terms.degree, self.degree.format(terms.degree))


PYTHON = Words()
AUTOMATON = Words(memory="", beside="")
COMMAND_LINE = Words(
    one_mode="--modes 1",
    auto="--modes auto",
    again="Run again with",
    memory="--automaton",
    effects="--diagnose",
    beside="--modes {} --diagnose",
    hold_out=", or hold out more of them (--test-fraction)",
    smooth=" (--window)",
    inputs="--inputs",
    degree="--modes 1 --library-degree {}",
    degrees={degree: f"--modes 1 --library {word}" for degree, word in DEGREES.items()},
    waves="--modes 1 --library trigonometric",
    waves_and_products="",
)


def change(comparison: Comparison) -> str:
    """The error of the modes beside that of the best law."""
    share = comparison.improvement
    if share < -1.0:
        return f"{1.0 - share:.3g} times as large"
    return f"{100 * abs(share):.1f} % {'lower' if share >= 0.0 else 'higher'}"


def held_out_text(comparison: Comparison, n_trained: int, whole: bool) -> str:
    """What the errors are of."""
    what = "whole trajectories" if whole else "the last stretch of each trajectory"
    n_rows = len(comparison.errors)
    if comparison.noise is None:
        return (
            f"held-out error: RMSE on {n_rows} samples, {what}, by models trained on the other "
            f"{n_trained}"
        )
    return (
        f"held-out error: RMSE of rollouts over stretches of {comparison.stretch} samples, on "
        f"{n_rows} samples, {what}, by laws of the other {n_trained}"
    )


def table(comparison: Comparison, modes: str, names: Sequence[str]) -> list[str]:
    """Errors of the columns, and what they do not test; `modes` "" for those of one law alone."""
    first, best = comparison.rivals[0], comparison.best
    beside = ("noise", comparison.noise)
    columns = [("spread", comparison.spread) if comparison.noise is None else beside]
    # the law of one mode with the same terms, and the best one if it is another
    shown = {rival.terms: rival for rival in (first, best)}
    columns += [(f"one mode, {one}", root_mean_square(law.errors)) for one, law in shown.items()]
    if modes:
        columns.append((f"{modes}, {first.terms}", root_mean_square(comparison.errors)))
    cells = [
        (title, ">10", [f"{value:.4g}" for value in values])
        for title, values in columns
        if values is not None
    ]
    lines = [f"    {line}" for line in text_table([("", "<1", list(names)), *cells], gap="  ")]
    if comparison.seen and modes:
        has, are = ("has", "is") if modes == counted(1, "mode") else ("have", "are")
        seen = f"The {modes} {has} seen these samples too, and {are} no better even so."
        lines.append(f"    {seen}")
    if comparison.untested:
        listed = ", ".join(map(str, comparison.untested))
        which, whose = ("Mode", "its") if len(comparison.untested) == 1 else ("Modes", "their")
        lines.append(
            f"    {which} {listed}: found in the held-out part only, so that no other samples test "
            f"{whose} law; {whose} samples are left out of these errors."
        )
    return lines


def distrust(rollouts: Sequence[FreeRollouts | None], time_unit: str = "") -> str:
    """For how long the model is to be trusted by itself; "" where it always is."""
    breaks = [one.first_break for one in rollouts if one is not None]
    follows = [one.follows for one in breaks if one is not None]
    if not follows:
        return ""
    if min(follows) <= 0.0:
        return (
            "By itself the model leaves the noise from the start, as free rollouts show: it "
            "predicts less well than it fits."
        )
    return (
        f"By itself the model leaves the noise {min(follows):.3g} {time_unit or 'units of time'} "
        "after a known state, as free rollouts show: from there on it predicts less well than it "
        "fits."
    )


def root_mean_square(errors: Array) -> Array:
    """Of the rows, those with a value."""
    return np.asarray(np.sqrt(np.nanmean(errors**2, axis=0)))
