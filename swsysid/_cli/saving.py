"""What the command line leaves behind: the model, the text, the picture and the page."""

from __future__ import annotations

import sys
from pathlib import Path

from swsysid._cli.job import JobResult
from swsysid._cli.samples import Samples
from swsysid._saving.files import Recording, save_model
from swsysid.diagnosis import EffectSearchCV


def save(
    result: JobResult, text: str, folder: Path, search: EffectSearchCV | None, page: Path | None
) -> int:
    """Write model, text, picture and page; the exit code is 2 if they cannot be written."""
    samples, where = result.samples, folder
    recording = Recording(
        source=samples.source,
        names=list(samples.names),
        units={**samples.units, "time": samples.time_unit},
        smoothing=_smoothing_of(samples),
    )
    try:
        save_model(result.model, folder / "model.json", recording=recording)
        (folder / "identification.txt").write_text(text + "\n", encoding="utf-8")
        drawn = _draw(result, folder / "phase_portrait.png")
        if search is not None and page is not None:
            effects = folder / "model_with_effects.json"
            save_model(search.best_estimator_, effects, recording=recording)
            drawn += f", {effects.name}"
            where = page
            title = f"Effect search: {samples.source}"
            search.report_.to_html(page, units=_units_of_displays(samples), title=title)
    except OSError as error:
        print(f"swsysid: {where} cannot be written: {error.strerror}.", file=sys.stderr)
        return 2
    print(f"\nSaved in {folder}: model.json, identification.txt{drawn}")
    if page is not None:
        print(f"Page with pictures: {page.resolve()}")
    return 0


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


def _units_of_displays(samples: Samples) -> dict[str, str]:
    """Units by the names that displays use for rates and times."""
    rates = zip(samples.names, samples.rate_names, strict=False)
    named = {f"d/dt {name}": samples.unit(rate) for name, rate in rates}
    named["time"] = samples.time_unit
    return {**samples.units, **{name: unit for name, unit in named.items() if unit}}


def _draw(result: JobResult, path: Path) -> str:
    """Draw the modes and the surface over the first two columns; says what came of it."""
    samples = result.samples
    if samples.X.shape[1] < 2:
        return " (no picture: it needs two columns)."
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        return ' (no picture: install matplotlib, pip install "swsysid[plot]").'
    from swsysid.plotting import SwitchingSurfaceDisplay

    told = {"names": samples.names, "units": samples.units}
    display = SwitchingSurfaceDisplay.from_estimator(
        result.model, samples.X, modes=result.modes, **told
    )
    display.figure_.savefig(path, dpi=150)
    plt.close(display.figure_)
    return f", {path.name}"
