"""The page of a search for effects: HTML with its pictures inside, nothing to load."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from importlib.util import find_spec

import numpy as np

from swsysid._checks.parameters import shown
from swsysid._effect_search import text, words
from swsysid._effect_search.contents import EffectContents, EffectData
from swsysid._effect_search.display import Panels
from swsysid._effect_search.settings import REPORT
from swsysid._effect_search.words import Units, aside
from swsysid._rendering.parts import (
    code,
    figure,
    listing,
    page,
    paragraph,
    preformatted,
    section,
    table,
)
from swsysid._rendering.series import canvas
from swsysid._residual_report.display import ResidualReportDisplay
from swsysid.effects import FoundEffect, UnknownFunction

_NAMES_ON_PAGE = 30  # words of a paragraph
_MOST_ROWS = 40  # of a table of trajectories


def effect_page(
    report: EffectContents, *, units: Units = None, title: str = "Effect search"
) -> str:
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
    if not isinstance(report, EffectContents):
        raise TypeError(f"report={shown(report)} is none; give report_ of an EffectSearchCV.")
    if not isinstance(title, str):
        raise TypeError(f"title={shown(title)} must be text.")
    rows = (
        f"{report.n_search} rows were searched; {report.n_held_out} rows ({report.held_out}) "
        "took no part in any choice, and all errors below are theirs unless said otherwise."
        f"{text.at_rest(report)}"
    )
    parts = [paragraph(text.summary(report, units), "verdict"), paragraph(rows, "note")]
    if report.data is not None:
        view = _View(report, report.data, units, find_spec("matplotlib") is not None)
        if not view.drawing:
            parts.append(paragraph('No pictures: pip install "swsysid[plot]".', "note"))
        bodies = [(heading, list(body(view))) for heading, body in _SECTIONS]
        parts += [section(heading, body) for heading, body in bodies if body]
    return page(title, parts)


@dataclass(frozen=True)
class _View:
    """A report, its data, and how they are shown."""

    report: EffectContents
    data: EffectData
    units: Units
    drawing: bool

    @property
    def state(self) -> int:
        """The state that pictures show."""
        return self.data.shapes[0].target if self.report.effects else self.data.most_changed

    def judged(self, state: int) -> str:
        """What errors are of, with its unit."""
        return words.judged_with_unit(self.report, state, self.units)

    @property
    def rates(self) -> list[str]:
        """What the laws of all states give, with units."""
        laws, states = replace(self.report, of_rollouts=False), range(len(self.report.targets))
        return [words.judged_with_unit(laws, state, self.units) for state in states]

    def picture(
        self, draw: Callable[..., None], *what: int, caption: str, size=(9.0, 3.8)
    ) -> list[str]:
        """A figure with one panel, a method of `Panels`; nothing where nothing can be drawn."""
        if not self.drawing:
            return []
        with canvas(panel_size=size) as (axes,):
            draw(Panels(self.data, self.units), axes, *what)
        return [figure(axes.figure, caption)]


# -- sections: each yields what stands under its heading, nothing if it has nothing to say -------


def _errors(view: _View) -> Iterable[str]:
    report = view.report
    of = "free rollouts" if report.of_rollouts else "the prediction of each state equation"
    yield paragraph(f"Root mean square error of {of}.")
    rows: list[list[object]] = []
    for row in report.errors:
        each = zip(row["held_out"], report.errors[0]["held_out"], report.judged, strict=True)
        errors = (
            "exact" if name in report.exact else words.error(own, before)
            for own, before, name in each
        )
        rows.append([row["model"], *errors])
    judged = [view.judged(state) for state in range(len(report.judged))]
    yield table(["model", *judged], rows, kind="ladder")
    first, last = (np.array(report.errors[place]["held_out"]) for place in (0, -1))
    known = np.array([name not in report.exact for name in report.judged])
    shares = 1.0 - np.divide(last, first, out=np.ones_like(first), where=known)
    lower = [
        f"{judged[state]}: {shares[state]:.0%} lower"
        for state in np.flatnonzero(shares > REPORT.worth_telling).tolist()
    ]
    if lower:
        yield paragraph(f"Error with all effects: {', '.join(lower)}.", "note")


def _effects(view: _View) -> Iterable[str]:
    for number, effect in enumerate(view.report.effects):
        heading = f"{number + 1}. {words.effect_title(effect, view.report)}"
        yield section(heading, _effect(view, number, effect), level=3)


def _effect(view: _View, number: int, effect: FoundEffect) -> Iterable[str]:
    target = view.judged(effect.target)
    if view.report.of_rollouts:  # of the state that comes closest to what was measured
        ends = (np.array(one["held_out"]) for one in view.report.errors[number : number + 2])
        target = view.judged(words.largest_fall(view.report, *ends)[0])
    yield paragraph(words.sentence(effect.meaning, view.data.records.names))
    if effect.placed.effect.terms:
        yield paragraph(f"Term: {effect.formula}")
    yield paragraph(
        f"Held-out error of {target}: {effect.error_before:.4g} before, "
        f"{words.error(effect.error_after, effect.error_before)} with it; "
        f"{words.probability(effect.p_value)}, corrected for the number of candidates."
    )
    for doubt in effect.doubts:
        yield paragraph(f"Weak evidence: {doubt}.", "note")
    if effect.parameters:
        rows: list[list[object]] = [
            [name.replace("_", " "), value, words.interval(effect, name)]
            for name, value in effect.parameters.items()
        ]
        yield table(["parameter", "value", "95 % interval"], rows)
    elif not effect.equations:
        yield paragraph("It has no parameters of its own; the laws are those of the model below.")
    if effect.equations:
        yield paragraph("Its laws, and where it is left:")
        yield code("\n".join(effect.equations))
    caption = (
        "What the effect contributes, with its 95 % band; dots: what the data ask of it "
        "(residual without the effect)."
    )
    yield from view.picture(Panels.shape, number, caption=caption, size=(7.0, 4.4))
    if effect.channel is not None:
        name = view.data.records.names[effect.channel]
        caption = f"Residual on the held-out rows against {name}, before and after on one scale."
        yield from view.picture(Panels.against, effect.target, effect.channel, caption=caption)
    if not effect.rivals:
        yield paragraph("No other effect of the library explains these data as well.", "note")
        return
    unknown = effect.kind == UnknownFunction.kind
    yield paragraph("The nearest with a name:" if unknown else "As good on these data:")
    head = [
        "effect" if unknown else "rival",
        f"held-out error of {target}",
        "what would tell the two apart",
    ]
    rows = [
        [
            words.effect_title(rival, view.report),
            words.error(rival.error, effect.error_before),
            rival.advice,
        ]
        for rival in effect.rivals
    ]
    yield table(head, rows, kind="words")


def _model(view: _View) -> Iterable[str]:
    """Laws and guards of the model that the search hands over."""
    final = view.data.final
    if view.report.effects:
        yield paragraph("Law of every mode as declared:")
        yield code("\n".join(view.data.models[0].equations()))
    yield paragraph(f"Law of every mode{' with the effects' if view.report.effects else ''}:")
    yield code("\n".join(final.equations()))
    try:
        guards = final.surface_equations()
    except TypeError as error:  # a surface of the user's that has no text
        yield paragraph(str(error))
        return
    if guards:
        yield paragraph("Where it switches:")
        yield code("\n".join(guards))
    else:
        yield paragraph("It has one mode and never switches.")


def _residuals(view: _View) -> Iterable[str]:
    caption = "Residual on the held-out rows, before and after."
    yield from view.picture(Panels.residuals, view.state, caption=caption)
    for model, leftover in text.leftovers(view.report):
        body = [listing(f"{name}: {said}" for name, said in text.verdicts(leftover, view.report))]
        name = leftover.equations[view.state]
        if view.drawing and leftover.against_channels(name):
            display = ResidualReportDisplay.from_report(
                leftover, equation=name, n_channels=1, units=view.units
            )
            display.figure_.suptitle("")  # the verdict stands above the picture
            whose = f"Residual of {words.law_of(name, view.report)} of the {model}"
            caption = f"{whose}, against what tells most about it."
            body.append(figure(display.figure_, caption))
        body.append(preformatted("all tests", str(leftover)))
        yield section(f"Left over by the {model}", body, level=3)


def _trajectories(view: _View) -> Iterable[str]:
    listed = sorted(view.data.by_trajectory, key=lambda one: -one.before[view.state])
    if not listed:
        return
    caption, size = "Error on each held-out trajectory.", (9.0, 4.6)
    yield from view.picture(Panels.trajectory_errors, view.state, caption=caption, size=size)
    yield table(
        ["trajectory", "rows", *_before_and_after(view.rates)],
        [
            [one.trajectory, one.n_samples, *np.ravel([one.before, one.after], "F").tolist()]
            for one in listed[:_MOST_ROWS]
        ],
    )
    if len(listed) > _MOST_ROWS:
        yield paragraph(f"The worst {_MOST_ROWS} of {len(listed)}.", "note")


def _rollouts(view: _View) -> Iterable[str]:
    rollouts = view.data.rollouts
    if view.report.free_rollouts is not None:
        yield paragraph(view.report.free_rollouts)
    if not view.report.effects:
        return
    if not rollouts:
        yield paragraph(f"None: {view.data.why_no_rollouts}.")
        return
    yield paragraph(
        "Simulated from the first held-out state by the declared model and by the one with "
        "the effects; root mean square error of each state over the time both have reached."
    )
    yield table(
        ["trajectory", "compared over", *_before_and_after(view.report.targets)],
        [[one.name, one.compared, *np.ravel(one.errors, "F").tolist()] for one in rollouts],
    )
    ended = [f"{one.name}, {model}: {why}" for one in rollouts for model, why in text.ends(one)]
    if ended:
        yield paragraph("Ended early:")
        yield listing(ended)
    for number, one in enumerate(rollouts):
        caption = f"Trajectory {one.name}; a cross marks an early end."
        yield from view.picture(Panels.rollout, number, view.state, caption=caption)


def _search(view: _View) -> Iterable[str]:
    report = view.report
    if report.history:
        head = ["round", "added", "p", "candidates", "effects after the round"]
        rows = [
            [number, one["added"], words.probability(one["p_value"]), one["n_candidates"]]
            + ["; ".join(one["effects"])]
            for number, one in enumerate(report.history, start=1)
        ]
        yield table(head, rows, kind="words")
    if report.dropped:
        yield paragraph(text.dropped(report), "note")
    if report.effects and text.moved(report):
        yield paragraph(text.moved(report))
    if aside(report):
        yield paragraph(aside(report))
    if report.tried:
        yield paragraph(f"{text.NOT_KEPT}:")
        yield listing(text.not_kept(report))
    if report.skipped:
        yield paragraph(f"{text.NOT_LOOKED_FOR}:")
        yield listing(text.skipped(report))
    if report.not_identifiable:
        yield paragraph(f"{text.SPANNED}:")
        yield paragraph(", ".join(words.first_of(report.not_identifiable, _NAMES_ON_PAGE)), "note")


_SECTIONS: tuple[tuple[str, Callable[[_View], Iterable[str]]], ...] = (
    ("Error before and after", _errors),
    ("Effects", _effects),
    ("The model", _model),
    ("Residual before and after", _residuals),
    ("Error by trajectory", _trajectories),
    ("Rollouts before and after", _rollouts),
    ("The search", _search),
)


def _before_and_after(names: Iterable[str]) -> list[str]:
    return [f"{name} {when}" for name in names for when in ("before", "after")]
