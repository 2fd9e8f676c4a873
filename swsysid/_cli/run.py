"""From a table and the wishes of the command line to the printed and saved answer."""

from __future__ import annotations

import argparse
import hashlib
import html
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path

from sklearn.base import clone

from swsysid._checkpoints import versions
from swsysid._cli.arguments import LIBRARIES, is_watched, modes, sentences
from swsysid._cli.automaton import own_warnings, run_automaton
from swsysid._cli.diagnosis import chosen_effects, diagnosed, searched
from swsysid._cli.further import Further
from swsysid._cli.job import JobOptions, JobResult, run_job
from swsysid._cli.measurement import Measurement
from swsysid._cli.output import prepare
from swsysid._cli.saving import page_title, save, save_diagnosis
from swsysid._cli.text import render, units_of_displays, with_effects
from swsysid._journal import handing_over, journal
from swsysid._rendering.progress import stage
from swsysid._results import SolverError
from swsysid._tables.several import recording_files
from swsysid._tables.table import Table, TableError
from swsysid.diagnosis import EffectSearchCV
from swsysid.effects import Effect

PAGE = "swsysid_diagnosis.html"
# Whatever these are, the answer is the same.
_WITHOUT_MEANING = {"files", "output", "html", "jobs", "verbose", "checkpoint"}


def run(table: Table, measurement: Measurement, arguments: argparse.Namespace) -> int:
    """Identify, print and save; the exit code is 1 for a failed solver."""
    try:
        checksum = _checksum(arguments.files)
        with _kept(arguments, checksum):
            return _run(table, measurement, arguments, checksum)
    except SolverError as error:
        print(f"swsysid: {error}", file=sys.stderr)
        return 1


def _run(
    table: Table, measurement: Measurement, arguments: argparse.Namespace, checksum: str
) -> int:
    prepare(arguments.output, table.source, checksum)
    watched = is_watched(arguments.verbose)
    options = _options(arguments, measurement)
    if arguments.automaton:
        with stage("Identifying an automaton", watched):
            return run_automaton(table, options, arguments.output, checksum)
    search, page, effects = None, None, []
    if arguments.diagnose:
        effects = chosen_effects(arguments.effects)
        page = _page_path(arguments.html or arguments.output / PAGE, table.source)
        is_left_open = arguments.modes is None and not options.has_measured_rates
        if is_left_open or options.modes == 1:
            found = diagnosed(table, options, effects, is_left_open, watched)
            return save_diagnosis(*found.saved, found.text, arguments.output, page, checksum)
    with own_warnings() as notes:
        with stage("Smoothing, and identifying modes", watched):
            result = run_job(table, options)
        if page is not None:
            with stage("Searching for what the model lacks", watched):
                search = _diagnose(result, effects)
    told = [f"note: {note}" for note in dict.fromkeys([*notes, *result.notes])]
    if search is not None:
        report = search.report_.to_text(units=units_of_displays(result.samples))
        told += [report, with_effects(search.best_estimator_)]
    text = "\n\n".join(part for part in [render(result), *told] if part)
    code = save(result, text, arguments.output, search, page, checksum)
    is_chosen = arguments.modes is not None or page is not None or options.quick
    if code or is_chosen or not options.is_recording:
        return code
    page = _page_path(arguments.output / PAGE, table.source)
    further = Further(table, options, arguments.output, page, checksum, watched)
    return further.asked(result, text)


@contextmanager
def _kept(arguments: argparse.Namespace, checksum: str) -> Iterator[None]:
    """Steps of the work go into a folder, if one is named; of other work it is refused."""
    if arguments.checkpoint is None:
        yield
        return
    told = {name: repr(value) for name, value in sorted(vars(arguments).items())
            if name not in _WITHOUT_MEANING}  # fmt: skip
    work = {"recording": checksum, **told, **versions()}
    with journal(arguments.checkpoint, work), handing_over(lambda found: None):
        yield


def _options(arguments: argparse.Namespace, measurement: Measurement) -> JobOptions:
    given, degree = vars(arguments), arguments.library_degree
    options = {each.name: given[each.name] for each in fields(JobOptions) if each.name in given}
    options |= {
        "known": sentences(arguments.known),
        "modes": modes(arguments.modes, arguments.automaton),
        "library_degree": LIBRARIES[arguments.library or "affine"] if degree is None else degree,
        "verbose": is_watched(arguments.verbose),
    }
    waves = arguments.library == "trigonometric"
    return JobOptions(measurement, waves=waves, n_jobs=arguments.jobs, **options)


def _diagnose(result: JobResult, effects: Sequence[Effect]) -> EffectSearchCV:
    """Search for what the identified model lacks.

    The search looks for modes itself: what it holds out must have no part in their number.
    """
    declared = clone(result.declared).set_params(init="auto", n_modes=result.options.modes)
    return searched(result.samples, declared, effects, result.options)


def _checksum(paths: Sequence[str]) -> str:
    """Which recordings these are; "" for the built-in example."""
    found = [
        inside
        for path in recording_files(paths)
        for inside in (sorted(path.iterdir()) if path.is_dir() else [path])
    ]
    if not found:
        return ""
    together = hashlib.sha256()
    for path in found:
        with path.open("rb") as read:
            content = hashlib.file_digest(read, "sha256")
        if len(found) == 1:
            return content.hexdigest()
        together.update(content.digest())
    return together.hexdigest()


def _page_path(chosen: Path, source: str) -> Path:
    """Where the page goes, asked before the work is done; says if another one is there."""
    if chosen.is_dir() or not os.access(chosen.parent, os.W_OK):
        raise TableError(f"--html {chosen} cannot be written; name a file in a folder that exists.")
    title = html.escape(page_title(source)).encode()
    if chosen.is_file() and title not in chosen.read_bytes():
        print(
            f"swsysid: {chosen} holds another page and will be replaced; --html names another "
            "file.",
            file=sys.stderr,
        )
    return chosen
