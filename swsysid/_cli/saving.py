"""What the command line leaves behind: the model, the text, the picture and the page."""

from __future__ import annotations

import json
import re
import sys
import warnings
from collections.abc import Callable
from contextlib import nullcontext
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from sklearn.base import BaseEstimator

from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._cli.job import JobResult
from swsysid._cli.output import AUTOMATON, EFFECTS, GRAPH, MODEL, PORTRAIT, REPORT, TEXT, results
from swsysid._cli.samples import Samples
from swsysid._cli.text import units_of_displays
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._saving.files import Recording, save_model
from swsysid._trajectory_identifier import TrajectoryIdentifier
from swsysid._whole_or_nothing import written_beside
from swsysid.diagnosis import EffectSearchCV
from swsysid.report import recording_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Fitted = TrajectoryIdentifier | HybridAutomatonRegressor | SwitchingSystemRegressor

_NO_PICTURE = ' (no picture: install matplotlib, pip install "swsysid[plot]").'
_MISSING = re.compile("Glyph .* missing from")  # a warning of matplotlib's


def save(
    result: JobResult,
    text: str,
    folder: Path,
    search: EffectSearchCV | None,
    page: Path | None,
    checksum: str,
) -> int:
    """Write model, text, picture and page, then print; the exit code is 2 if that cannot be.

    `checksum` is that of the file that the samples come from.
    """
    samples, recording = result.samples, _recording(result.samples, checksum)

    def write(draft: Path, beside: Path | None) -> str:
        drawn = _draw(result, draft / PORTRAIT)
        drawn += _write_report(*_fitted_to(result), samples, text, draft)
        if search is not None and beside is not None:
            drawn += _write_search(search, samples, recording, draft, beside)
        return drawn

    model = result.model if result.found is None else result.found.identifier
    return _save(model, recording, text, folder, page, write)


def save_diagnosis(
    search: EffectSearchCV,
    several: HybridAutomatonRegressor | None,
    samples: Samples,
    text: str,
    folder: Path,
    page: Path,
    checksum: str,
    before: str = "",
) -> int:
    """Write and print what a law lacks, or several; the exit code is 2 if it cannot be written.

    The text of what was printed `before` stays, and its model unless several laws take its place.
    """
    recording = _recording(samples, checksum)

    def write(draft: Path, beside: Path | None) -> str:
        assert beside is not None
        written = ""
        if several is not None:
            written = _write_automaton(several, draft)
            written += _write_report(several, _recorded(samples), samples, text, draft)
        return written + _write_search(search, samples, recording, draft, beside)

    declared = search.declared_estimator_.estimator_
    model = several or (None if before else declared)
    return _save(model, recording, text, folder, page, write, before)


def _fitted_to(result: JobResult) -> tuple[Fitted, tuple | None]:
    """What was fitted, and to what; None where these rows are no motion with times."""
    found, samples = result.found, result.samples
    if found is not None:
        return found.identifier, _recorded(samples)
    if samples.t is None or result.options.measurement.quantity:
        return result.model, None
    n_states = samples.Xdot.shape[1]
    frame = samples.frame
    inputs = frame.iloc[:, n_states:] if samples.X.shape[1] > n_states else None
    return result.model, (frame.iloc[:, :n_states], samples.t, samples.groups, inputs)


def _recorded(samples: Samples) -> tuple:
    assert samples.recorded is not None
    return samples.recorded.named(samples.names, slice(None))


def _write_report(
    model: Fitted, data: tuple | None, samples: Samples, text: str, draft: Path
) -> str:
    """The page of what the model makes of the recordings; says what there is."""
    if data is None:
        return ""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", _MISSING.pattern)
            units = {**samples.units, "time": samples.time_unit}
            told = recording_page(model, *data, units=units, title=samples.source, found=text)
    except ValueError as why:  # rows that derivatives were fitted to need be no recordings
        return f" (no {REPORT}: {why})"
    (draft / REPORT).write_text(told, encoding="utf-8")
    return f", {REPORT}"


def _write_search(
    search: EffectSearchCV, samples: Samples, recording: Recording, draft: Path, page: Path
) -> str:
    """The model with effects and the page; says what there is."""
    save_model(search.best_estimator_, draft / EFFECTS, recording=recording)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", _MISSING.pattern)
        units, title = units_of_displays(samples), page_title(samples.source)
        search.report_.to_html(page, units=units, title=title)
    return f", {EFFECTS}"


def save_automaton(
    found: HybridAutomatonRegressor,
    samples: Samples,
    text: str,
    folder: Path,
    checksum: str,
    before: str = "",
) -> int:
    """Write and print what was found; the exit code is 2 if it cannot be written.

    The text of what was printed `before` stays.
    """

    def write(draft: Path, _: Path | None) -> str:
        report = _write_report(found, _recorded(samples), samples, text, draft)
        return _write_automaton(found, draft) + report

    return _save(found, _recording(samples, checksum), text, folder, None, write, before)


def _write_automaton(found: HybridAutomatonRegressor, draft: Path) -> str:
    """The automaton and its graph; says what there is."""
    told = json.dumps(found.to_dict(), indent=1)
    (draft / AUTOMATON).write_text(told + "\n", encoding="utf-8")
    return f", {AUTOMATON}{_drawn(found, draft / GRAPH)}"


def _picture(figure: Figure, path: Path) -> str:
    """Draw a figure to a file; says what came of it."""
    import matplotlib.pyplot as plt

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        figure.savefig(path, dpi=150)
    plt.close(figure)
    boxes = any(_MISSING.match(str(warning.message)) for warning in caught)
    return f", {path.name}" + " (with boxes for letters that its font lacks)" * boxes


def page_title(source: str) -> str:
    """The title of the page of a search in a recording."""
    return f"Effect search: {source}"


def _save(
    model: BaseEstimator | None,
    recording: Recording,
    text: str,
    folder: Path,
    page: Path | None,
    write: Callable[[Path, Path | None], str],
    before: str = "",
) -> int:
    """Write the model, the text, and what `write` adds to a folder and a page, or nothing.

    The text is printed when all is written: a reader such as head that ends early loses no results.
    What was written with a text that was printed `before` stays.
    """
    written, told = nullcontext() if page is None else written_beside(page), TEXT
    try:
        with results(folder, adds=bool(before)) as draft, written as beside:
            if model is not None:
                save_model(model, draft / MODEL, recording=recording)
                told = f"{MODEL}, {TEXT}"
            whole = "\n\n".join(filter(None, [before, text]))
            (draft / TEXT).write_text(whole + "\n", encoding="utf-8")
            more = write(draft, beside)
    except OSError as error:
        print(text)
        where = folder if page is None or str(error.filename) != str(page) else page
        print(f"swsysid: {where} cannot be written: {error.strerror}.", file=sys.stderr)
        return 2
    print(f"{text}\n\nSaved in {folder}: {told}{more}")
    if page is not None:
        print(f"Page with pictures: {page.resolve()}")
    return 0


def _recording(samples: Samples, checksum: str) -> Recording:
    return Recording(
        source=samples.source,
        names=list(samples.names),
        units={**samples.units, "time": samples.time_unit},
        smoothing=_smoothing_of(samples),
        checksum=checksum,
    )


def _smoothing_of(samples: Samples) -> dict[str, str | int | float | list[float]]:
    """How the velocities were made; empty where they were measured."""
    used = samples.smoothing
    if used is None:
        return {}
    limits = {"window": used.window, "cutoff": used.cutoff}
    return {
        "method": str(used.method),
        **{name: float(value) for name, value in limits.items() if value is not None},
        "noise": [float(size) for size in used.noise],
        "every": samples.decimate,
    }


def _draw(result: JobResult, path: Path) -> str:
    """Draw the modes and the surface over the first two columns; says what came of it."""
    samples = result.samples
    if samples.X.shape[1] < 2:
        return " (no picture: it needs two columns)."
    if find_spec("matplotlib") is None:
        return _NO_PICTURE
    from swsysid.plotting import SwitchingSurfaceDisplay

    told = {"features": "auto", "names": samples.names, "units": samples.units}
    X = samples.with_recorded_inputs
    display = SwitchingSurfaceDisplay.from_estimator(result.model, X, modes=result.modes, **told)
    return _picture(display.figure_, path)


def _drawn(found: HybridAutomatonRegressor, path: Path) -> str:
    """Draw modes and transitions; says what came of it."""
    if find_spec("matplotlib") is None:
        return _NO_PICTURE
    from swsysid.plotting import AutomatonGraphDisplay

    display = AutomatonGraphDisplay.from_estimator(found)
    return _picture(display.figure_, path)
