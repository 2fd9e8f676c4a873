"""The page: what was found in words, panels along each recording, and the model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from importlib.resources import files
from importlib.util import find_spec
from types import MappingProxyType

import numpy as np

from swsysid._checks.parameters import shown
from swsysid._displays.automaton_graph import AutomatonGraphDisplay
from swsysid._displays.surface import SwitchingSurfaceDisplay
from swsysid._recording_page.charts import charts_json
from swsysid._recording_page.tracks import Told, Track, told_by, tracks_of
from swsysid._rendering.parts import figure, page, paragraph, section
from swsysid._stays.given import Given, read_given
from swsysid._trajectory_identifier import TrajectoryIdentifier

# The page stays below a megabyte: of each of so many recordings so many points, some eight columns
# of six bytes each, beside the 53 kB of the library.
_MOST_RECORDINGS = 8
_MOST_POINTS = 1500
_LONGEST = 5000  # samples of a recording that are rolled out, which takes two seconds (cart.csv)
_ASSETS = files("swsysid") / "_recording_page" / "assets"


def recording_page(
    model,
    x,
    t=None,
    groups=None,
    inputs=None,
    *,
    units=MappingProxyType({}),
    title="Identification",
    found="",
) -> str:
    """A page on what a model makes of recordings, with panels that answer to the mouse.

    Along each recording: the rollout over what was measured, the modes of both, what is left, and
    the value of each guard. Rollouts begin at estimated states and switch by the model's own
    guards. All is in the page, the library that draws it included; it needs no network.

    Parameters
    ----------
    model : TrajectoryIdentifier, HybridAutomatonRegressor or SwitchingSystemRegressor
        Fitted; the first two to these recordings.
    x, t, groups, inputs
        The recordings, as `TrajectoryIdentifier.fit` takes them. The first eight are drawn, of each
        the first 5,000 samples, and of these at most 1,500 points.
    units : mapping from names to units, default={}
        That of the times is named ``"time"``.
    title : str, default="Identification"
    found : str, default=""
        What was found, in words; the model's ``report_``, or its equations, if empty.

    Returns
    -------
    str
        HTML. Pictures of the plane of the states, and of an automaton as a graph, are left out if
        matplotlib is not installed.

    Raises
    ------
    TypeError
        If the model is of another kind.
    ValueError
        If it was not fitted to these recordings.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid import TrajectoryIdentifier, SwitchingSystemRegressor
    >>> from swsysid.report import recording_page
    >>> t = np.linspace(0, 5, 101)
    >>> x = np.exp(-t)[:, None] + 0.01 * np.random.default_rng(0).standard_normal((101, 1))
    >>> cooling = TrajectoryIdentifier(SwitchingSystemRegressor(1)).fit(x, t)
    >>> page = recording_page(cooling, x, t, units={"x0": "K", "time": "s"})
    >>> "measured minus rolled out: x0 [K]" in page, "http://" in page
    (True, False)
    """
    if not isinstance(title, str):
        raise TypeError(f"title={shown(title)} must be text.")
    given = read_given(x, t, groups, inputs)
    told = told_by(model, given)
    tracks = tracks_of(told, given, _MOST_RECORDINGS, _LONGEST)
    parts = [
        *_words(model, found),
        section("Along the recordings", _along(told, tracks, given, units)),
        *_pictures(model, told, given, units),
    ]
    head = f"<style>{_asset('uPlot.min.css')}{_asset('charts.css')}</style>"
    return page(title, parts, head)


def _words(model, found: str) -> Iterable[str]:
    """What was found, lines as they are."""
    told = found or str(vars(model).get("report_", "")) or "\n".join(model.equations())
    yield f'<pre class="found">{escape(told)}</pre>'


def _along(
    told: Told, tracks: list[Track], given: Given, units: Mapping[str, str]
) -> Iterable[str]:
    begins = "Each rollout begins at the estimated state of its first sample"
    if told.stretch:
        begins += f", and anew after every {told.stretch} samples"
    guards = "switches where its guards say so"
    yield paragraph(
        f"{begins}, and {guards}. Colours and numbers are modes. Move over a panel to read its "
        "values, drag to look closer, click twice to see all again.",
        "note",
    )
    if len(given.records) > len(tracks):
        yield paragraph(f"The first {len(tracks)} of {len(given.records)} recordings.", "note")
    if any(len(record.t) > _LONGEST for record in given.records[: len(tracks)]):
        yield paragraph(f"Of longer recordings the first {_LONGEST:,} samples.", "note")
    yield '<div id="charts"><noscript>The panels need JavaScript.</noscript></div>'
    data = charts_json(told, tracks, units, _MOST_POINTS)
    yield f'<script id="recordings" type="application/json">{data}</script>'
    yield from (f"<script>{_asset(one)}</script>" for one in ("uPlot.iife.min.js", "charts.js"))


def _pictures(model, told: Told, given: Given, units: Mapping[str, str]) -> Iterable[str]:
    """An automaton as a graph; of other models the plane of the columns that decide the mode."""
    if find_spec("matplotlib") is None:
        return
    if told.is_automaton:
        drawn = AutomatonGraphDisplay.from_estimator(model).figure_
        yield section("The automaton", [figure(drawn, "Modes with their laws, and transitions.")])
    elif len(told.names) > 1:
        estimator = model.estimator_ if isinstance(model, TrajectoryIdentifier) else model
        X = np.hstack([told.states, given.by_rows([record.u for record in given.records])])
        options = {"modes": told.modes, "features": "auto", "names": told.names, "units": units}
        drawn = SwitchingSurfaceDisplay.from_estimator(estimator, X, **options).figure_
        caption = "Samples by their mode, over the columns that decide it."
        yield section("Where it switches", [figure(drawn, caption)])


def _asset(name: str) -> str:
    return (_ASSETS / name).read_text(encoding="utf-8")
