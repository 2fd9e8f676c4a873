"""Panels along a recording, as JSON for the script of the page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._displays.style import mode_colour, thinned
from swsysid._recording_page.tracks import Told, Track
from swsysid._results import Array

_DIGITS = 5  # of a number that is drawn


def charts_json(
    told: Told, tracks: Sequence[Track], units: Mapping[str, str], most_points: int
) -> str:
    """What `assets/charts.js` draws: panels with their curves, and the columns of each recording.

    Of a recording with more than `most_points` samples every second, third, ... is drawn.
    """
    n_channels = tracks[0].measured.shape[1]
    n_inputs = tracks[0].inputs.shape[1]
    page = {
        "colours": [mode_colour(mode) for mode in range(told.n_modes)],
        "time": _titled("time", {"time": units.get("time", "")}),
        "panels": list(_panels(told, n_channels, n_inputs, units)),
        "recordings": [_recording(one, most_points) for one in tracks],
    }
    # no text of a user's file ends the script that it stands in
    return json.dumps(page, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _panels(
    told: Told, n_channels: int, n_inputs: int, units: Mapping[str, str]
) -> Iterator[dict[str, object]]:
    """Every panel: its heading, its kind, and which columns it draws under which names."""
    channels = told.names[:n_channels]
    inputs = told.names[len(told.names) - n_inputs :]
    for place, name in enumerate(channels):
        curves = {f"y{place}": "measured", f"r{place}": "rolled out"}
        yield {"kind": "state", "title": _titled(name, units), "curves": curves}
    for place, name in enumerate(inputs):
        held = "input held" if told.holds and told.holds[place] == "zero" else "input"
        yield {"kind": held, "title": _titled(name, units), "curves": {f"u{place}": name}}
    for place, (name, noise) in enumerate(zip(channels, told.noise, strict=False)):
        yield {
            "kind": "residual",
            "title": f"measured minus rolled out: {_titled(name, units)}",
            "curves": {f"e{place}": "left over"},
            "noise": _rounded(np.array([noise]))[0],
        }
    for place, equation in enumerate(told.guards):
        yield {"kind": "guard", "title": equation, "curves": {f"g{place}": "guard"}}


def _recording(track: Track, most_points: int) -> dict[str, object]:
    shown = thinned(len(track.t), most_points)
    columns = {"t": track.t}
    columns |= {f"y{k}": values for k, values in enumerate(track.measured.T)}
    columns |= {f"r{k}": values for k, values in enumerate(track.rolled.T)}
    columns |= {f"u{k}": values for k, values in enumerate(track.inputs.T)}
    columns |= {f"g{k}": values for k, values in enumerate(track.guards.T)}
    every = shown.step
    return {
        "label": track.label,
        "every": every,
        "columns": {name: _rounded(values[shown]) for name, values in columns.items()},
        "modes": _stays(track.t, track.modes),
        "rolled": _stays(track.t, track.rolled_modes),
    }


def _stays(t: Array, modes: NDArray[np.intp]) -> list[list[float]]:
    """Begin, end and mode of each stay; one changes over in the middle of its interval."""
    places = np.flatnonzero(np.diff(modes)) + 1
    edges = np.r_[t[0], (t[places - 1] + t[places]) / 2.0, t[-1]]
    first = np.r_[0, places]
    return [
        [*_rounded(edges[k : k + 2], 8), int(modes[place])]  # type: ignore[list-item]
        for k, place in enumerate(first)
    ]


def _rounded(values: Array, digits: int = _DIGITS) -> list[float | None]:
    """Numbers of so many digits, None for what is not finite."""
    return [float(f"{one:.{digits}g}") if np.isfinite(one) else None for one in values]


def _titled(name: str, units: Mapping[str, str]) -> str:
    return f"{name} [{units[name]}]" if units.get(name) else name
