"""The recordings of `by_default` from the command line: a file and one command each.

The file has the columns that the README of a set declares, and the command names them and no more.
"""

from __future__ import annotations

import re
from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time

import numpy as np
import pandas as pd

from benchmarks.measured.by_default import CASES, verdict_of
from benchmarks.measured.rows import ByDefault
from swsysid import load_model
from swsysid.__main__ import main

LIBRARIES = {"pendulum": ["--library", "trigonometric"]}
_ERRORS = re.compile(r" is (?:< )?(\S+)(?: \S+)? instead of ([-+.e\d]*\d)")


def rows() -> list[ByDefault]:
    """One row a set."""
    return [commanded(name) for name in CASES]


def commanded(name: str) -> ByDefault:
    """The row of one set."""
    lacks, right, hand, data = CASES[name]
    X, options, *_ = data()
    with TemporaryDirectory() as folder:
        place = Path(folder)
        words = [*_roles(X, options, place), *LIBRARIES.get(name, []), "--diagnose"]
        said, started = StringIO(), process_time()
        with redirect_stdout(said):
            main([*words, "--output", f"{folder}/out", "--html", f"{folder}/page.html"])
        seconds, text = process_time() - started, said.getvalue()
        effects = load_model(place / "out" / "model_with_effects.json").effects_
        names = [*X.columns, *(options["inputs"].columns if "inputs" in options else ())]
        names += [*options["signals"].columns] if "signals" in options else []
    found = ", ".join(f"{one.effect.kind} of {one.label(names)}" for one in effects)
    verdict = verdict_of([one.effect.kind for one in effects], right)
    if "Several laws follow each other" in text:
        found, verdict = "several laws", "wrong"
    errors = _ERRORS.search(text)
    after, before = (float(errors[1]), float(errors[2])) if errors else (np.nan, np.nan)
    command, found = " ".join(words[1:]), found or "nothing"
    return ByDefault(name, lacks, command, found, verdict, before, after, hand, seconds)


def _roles(X: pd.DataFrame, options: dict, folder: Path) -> list[str]:
    """The file, and the words that say which column is what."""
    table, words = X.assign(t_s=options["t"]), ["--states", *X.columns, "--time", "t_s"]
    for role in ("inputs", "signals"):
        if role in options:
            more = pd.DataFrame(options[role]).reset_index(drop=True)
            table = pd.concat([table.reset_index(drop=True), more], axis=1)
            words += [f"--{role}", *more.columns]
    if "y" in options:
        table = table.assign(quantity=options["y"])
        words += ["--quantity", "quantity"]
    if "groups" in options:
        table = table.assign(run=options["groups"])
        words += ["--groups", "run"]
    table.to_csv(folder / "recording.csv", index=False)
    return [str(folder / "recording.csv"), *words]
