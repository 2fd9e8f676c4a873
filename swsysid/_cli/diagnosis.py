"""From an identified model to the effects that it lacks: the search, its page, its model."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path

from sklearn.base import clone

from swsysid._cli.job import JobResult
from swsysid._tables.table import TableError
from swsysid.diagnosis import EffectSearchCV
from swsysid.effects import Effect, all_effects

__all__ = ["chosen_effects", "diagnose", "page_path"]

PAGE = "swsysid_diagnosis.html"


def diagnose(result: JobResult, effects: Sequence[Effect], verbose: bool = False) -> EffectSearchCV:
    """Search for what the identified model lacks.

    The search looks for modes itself: what it holds out must have no part in their number.
    """
    import pandas as pd

    samples, named = result.samples, result.options.measurement
    declared = clone(result.model).set_params(init="auto", n_modes=result.options.modes)
    search = EffectSearchCV(
        declared,
        effects=list(effects),
        n_jobs=result.options.n_jobs,
        random_state=result.options.random_state,
        verbose=int(verbose),
    )
    signals = pd.DataFrame(samples.signals, columns=list(samples.signal_names))
    return search.fit(
        samples.frame,
        samples.Xdot,
        t=samples.t,
        groups=samples.groups if named.groups else None,
        signals=signals if named.signals else None,
    )


def chosen_effects(kinds: Sequence[str]) -> list[Effect]:
    """Effects of the library by their kinds, in its order; all if none is named."""
    library = {effect.kind: effect for effect in all_effects()}
    for kind in kinds:
        if kind not in library:
            close = difflib.get_close_matches(kind, library, n=1)
            hint = f" Did you mean {close[0]!r}?" if close else ""
            raise TableError(
                f"--effects {kind!r} is no kind of effect.{hint} The kinds are: "
                f"{', '.join(library)}."
            )
    return [effect for kind, effect in library.items() if not kinds or kind in kinds]


def page_path(path: Path | None) -> Path:
    """Where the page goes, asked before the work is done."""
    chosen = Path(PAGE) if path is None else path
    if chosen.is_dir() or not chosen.parent.is_dir():
        raise TableError(f"--html {chosen} cannot be written; name a file in a folder that exists.")
    return chosen
