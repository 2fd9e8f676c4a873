"""The page of a search for effects: HTML with its pictures inside, nothing to load."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from swsysid._checks.parameters import shown
from swsysid._effect_search.text import (
    SPANNED,
    effect_title,
    interval,
    moved,
    probability,
    rate,
    sentence,
    summary,
)
from swsysid._rendering.markup import (
    code,
    figure,
    listing,
    page,
    paragraph,
    preformatted,
    section,
    table,
)

__all__ = ["effect_page"]

_MOST_ROWS = 40
_MOST_NAMED = 30
_SIZES = {"shape": (7.0, 4.4), "trajectory_errors": (9.0, 4.6)}

Units = Mapping[str, str] | None


def effect_page(report: Any, *, units: Units = None, title: str = "Effect search") -> str:
    """A page that says what a search for effects has found.

    Parameters
    ----------
    report : EffectReport
    units : mapping from names to units, default=None
        As in `EffectReportDisplay`.
    title : str, default="Effect search"

    Returns
    -------
    str
        HTML. Pictures are left out, with a note, if matplotlib is not installed.
    """
    if not hasattr(report, "n_held_out"):
        raise TypeError(f"report={shown(report)} is none; give report_ of an EffectSearchCV.")
    if not isinstance(title, str):
        raise TypeError(f"title={shown(title)} must be text.")
    drawing = report.data is not None and find_spec("matplotlib") is not None
    parts = [
        paragraph(summary(report), "verdict"),
        paragraph(
            f"{report.n_search} rows were searched; {report.n_held_out} rows ({report.held_out}) "
            "took no part in any choice, and all errors below are theirs unless said otherwise.",
            "note",
        ),
    ]
    if report.data is not None and not drawing:
        parts.append(paragraph('No pictures: pip install "swsysid[plot]".', "note"))
    parts += _before_after(report, units)
    parts += _effects(report, units, drawing)
    parts += _model(report)
    if report.n_held_out:
        parts += _residuals(report, units, drawing)
        parts += _trajectories(report, units, drawing)
        parts += _rollouts(report, units, drawing)
        parts += _search(report)
    return page(title, parts)


def _before_after(report: Any, units: Units) -> list[str]:
    if not report.errors:
        return []
    names = [_rate(report, state, units) for state in range(len(report.targets))]
    rows = [[row["model"], *row["held_out"]] for row in report.errors]
    body = [
        paragraph("Root mean square error of the prediction of each state equation."),
        table(["model", *names], rows, kind="ladder"),
    ]
    lower = _lower(report)
    if lower:
        told = ", ".join(f"{names[state]}: {share:.0%} lower" for state, share in lower)
        body.append(paragraph(f"Error with all effects: {told}.", "note"))
    return [section("Error before and after", body)]


def _lower(report: Any) -> list[tuple[int, float]]:
    """States whose error the effects lower by more than a hundredth, and by what share."""
    first, last = (np.array(report.errors[place]["held_out"]) for place in (0, -1))
    spread = report.data.measured.std(axis=0)
    known = first > 1e-9 * spread  # smaller ones are round-off
    shares = 1.0 - np.divide(last, first, out=np.ones_like(first), where=known)
    return [(int(state), float(shares[state])) for state in np.flatnonzero(shares > 0.01)]


def _effects(report: Any, units: Units, drawing: bool) -> list[str]:
    found = [
        _effect(report, number, effect, units, drawing)
        for number, effect in enumerate(report.effects)
    ]
    return [section("Effects", found)] if found else []


def _effect(report: Any, number: int, effect: Any, units: Units, drawing: bool) -> str:
    target = _rate(report, effect.target, units)
    parts = [
        paragraph(sentence(effect.meaning, report.data.records.names)),
        *([paragraph(f"Term: {effect.formula}")] if effect.placed.effect.terms else []),
        paragraph(
            f"Held-out error of {target}: {effect.error_before:.4g} before, "
            f"{effect.error_after:.4g} with it; {probability(effect.p_value)}, corrected for the "
            "number of candidates."
        ),
        _parameters(effect),
    ]
    if drawing:
        caption = (
            "What the effect contributes, with its 95 % band; dots: what the data ask of it "
            "(residual without the effect)."
        )
        parts.append(figure(_drawn("shape", report, units, place=number), caption))
    parts += _rivals(report, effect, target)
    return section(f"{number + 1}. {effect_title(effect, report)}", parts, level=3)


def _parameters(effect: Any) -> str:
    rows = [
        [name.replace("_", " "), value, interval(effect, name)]
        for name, value in effect.parameters.items()
    ]
    if not rows:
        return paragraph("It has no parameters of its own; the laws are those of the model below.")
    return table(["parameter", "value", "95 % interval"], rows)


def _model(report: Any) -> list[str]:
    """Laws and guards of the model that the search hands over."""
    if report.data is None:
        return []
    final = report.data.final
    body = [paragraph("Law of every mode:"), code("\n".join(final.equations()))]
    try:
        guards = final.surface_equations()
    except TypeError as error:  # a surface of the user's that has no text
        return [section("The model", [*body, paragraph(str(error))])]
    if not guards:
        return [section("The model", [*body, paragraph("It has one mode and never switches.")])]
    switching = [paragraph("Where it switches:"), code("\n".join(guards))]
    return [section("The model", body + switching)]


def _rivals(report: Any, effect: Any, target: str) -> list[str]:
    if not effect.rivals:
        return [paragraph("No other effect of the library explains these data as well.", "note")]
    rows = [
        [effect_title(rival, report), f"{rival.error:.4g}", rival.advice] for rival in effect.rivals
    ]
    head = ["rival", f"held-out error of {target}", "what would tell the two apart"]
    return [paragraph("As good on these data:"), table(head, rows, kind="words")]


def _residuals(report: Any, units: Units, drawing: bool) -> list[str]:
    from swsysid._residual_report.display import ResidualReportDisplay

    parts = []
    if drawing:
        state = _shown_state(report)
        drawn = _drawn("residuals", report, units, state=state)
        parts.append(figure(drawn, "Residual on the held-out rows, before and after."))
    for when in ("before", "after") if report.effects else ("before",):
        leftover = getattr(report, f"residual_{when}")
        if leftover is None:
            continue
        model = "declared model" if when == "before" else "model with the effects"
        verdicts = leftover.verdicts.items()
        body = [listing(f"{rate(name, report.discrete)}: {text}" for name, text in verdicts)]
        if drawing:
            name = leftover.equations[_shown_state(report)]
            display = ResidualReportDisplay.from_report(
                leftover, equation=name, n_channels=1, units=units
            )
            display.figure_.suptitle("")  # the verdict stands above the picture
            told = rate(name, report.discrete)
            caption = f"Residual of {told} of the {model}, against what tells most about it."
            body.append(figure(display.figure_, caption))
        body.append(preformatted("all tests", str(leftover)))
        parts.append(section(f"Left over by the {model}", body, level=3))
    return [section("Residual before and after", parts)]


def _trajectories(report: Any, units: Units, drawing: bool) -> list[str]:
    listed = report.by_trajectory
    if not listed:
        return []
    state = _shown_state(report)
    order = sorted(listed, key=lambda one: -one["before"][state])
    parts = []
    if drawing:
        drawn = _drawn("trajectory_errors", report, units, state=state)
        parts.append(figure(drawn, "Error on each held-out trajectory."))
    names = [_rate(report, number, units) for number in range(len(report.targets))]
    head = ["trajectory", "rows", *(f"{name} {when}" for name in names for when in _WHEN)]
    rows = [
        [
            one["trajectory"],
            one["n_samples"],
            *(one[when][number] for number in range(len(names)) for when in _WHEN),
        ]
        for one in order[:_MOST_ROWS]
    ]
    parts.append(table(head, rows))
    if len(order) > _MOST_ROWS:
        parts.append(paragraph(f"The worst {_MOST_ROWS} of {len(order)}.", "note"))
    return [section("Error by trajectory", parts)]


_WHEN = ("before", "after")


def _rollouts(report: Any, units: Units, drawing: bool) -> list[str]:
    if report.data is None or not report.effects:
        return []
    if not report.rollouts:
        return [
            section(
                "Rollouts before and after", [paragraph(f"None: {report.data.why_no_rollouts}.")]
            )
        ]
    head = [
        "trajectory",
        "compared over",
        *(f"{n} {when}" for n in report.targets for when in _WHEN),
    ]
    rows = [
        [
            one["trajectory"],
            one["compared"],
            *(
                value
                for pair in zip(one["error_before"], one["error_after"], strict=True)
                for value in pair
            ),
        ]
        for one in report.rollouts
    ]
    parts = [
        paragraph(
            "Simulated from the first held-out state by the declared model and by the one with "
            "the effects; root mean square error of each state over the time both have reached."
        ),
        table(head, rows),
    ]
    ended = [
        f"{one['trajectory']}, {model}: {one[f'ended_{when}']}"
        for one in report.rollouts
        for when, model in (("before", "declared model"), ("after", "with effects"))
        if one[f"ended_{when}"]
    ]
    parts += [paragraph("Ended early:"), listing(ended)] if ended else []
    if drawing:
        state = _shown_state(report)
        for number, one in enumerate(report.rollouts):
            drawn = _drawn("rollout", report, units, number=number, state=state)
            parts.append(
                figure(drawn, f"Trajectory {one['trajectory']}; a cross marks an early end.")
            )
    return [section("Rollouts before and after", parts)]


def _search(report: Any) -> list[str]:
    parts = []
    if report.history:
        head = ["round", "added", "p", "candidates", "effects after the round"]
        rows = [
            [
                number,
                one["added"],
                probability(one["p_value"]),
                one["n_candidates"],
                "; ".join(one["effects"]),
            ]
            for number, one in enumerate(report.history, start=1)
        ]
        parts.append(table(head, rows, kind="words"))
    if report.dropped:
        told = "; ".join(report.dropped)
        parts.append(
            paragraph(f"Dropped at the end, since chance explains it as well: {told}.", "note")
        )
    if report.effects:
        parts.append(paragraph(moved(report)))
    if report.skipped:
        parts.append(paragraph("Not looked for:"))
        parts.append(listing(f"{kind}: {why}" for kind, why in report.skipped.items()))
    if report.not_identifiable:
        parts.append(paragraph(f"Not looked for, since {SPANNED}:"))
        parts.append(paragraph(_some(report.not_identifiable), "note"))
    return [section("The search", parts)] if parts else []


def _some(names: Sequence[str]) -> str:
    rest = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {rest} more" if rest > 0 else "")


def _rate(report: Any, state: int, units: Units) -> str:
    name = report.targets[state]
    unit = (units or {}).get(name if report.discrete else f"d/dt {name}")
    label = rate(name, report.discrete)
    return f"{label} [{unit}]" if unit else label


def _shown_state(report: Any) -> int:
    if report.effects:
        return report.data.shapes[0].target
    return report.data.most_changed


def _drawn(panel: str, report: Any, units: Units, **what: Any) -> Any:
    """A figure with one panel."""
    from swsysid._displays.style import canvas
    from swsysid._effect_search import panels as panels

    draw: Callable[..., None] = getattr(panels, f"draw_{panel}")
    with canvas(panel_size=_SIZES.get(panel, (9.0, 3.8))) as (axes,):
        draw(axes, report.data, units=units, **what)
        return axes.figure
