"""From a table and the wishes of the command line to the printed and saved answer."""

from __future__ import annotations

import argparse
import sys
import warnings

from swsysid._cli.arguments import LIBRARIES, modes
from swsysid._cli.diagnosis import chosen_effects, diagnose, page_path
from swsysid._cli.job import JobOptions, run_job
from swsysid._cli.measurement import Measurement
from swsysid._cli.progress import is_watched, say
from swsysid._cli.saving import save
from swsysid._cli.text import render, with_effects
from swsysid._results import SolverError
from swsysid._tables.table import Table

__all__ = ["run"]


def run(table: Table, measurement: Measurement, arguments: argparse.Namespace) -> int:
    """Identify, print and save; the exit code is 1 for a failed solver."""
    search, page, effects = None, None, []
    watched = is_watched(arguments.verbose)
    if arguments.diagnose:
        effects, page = chosen_effects(arguments.effects), page_path(arguments.html)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", UserWarning)
            say("Smoothing, and identifying modes", watched)
            result = run_job(table, _options(arguments, measurement))
            if page is not None:
                say("Searching for what the model lacks", watched)
                search = diagnose(result, effects, verbose=watched)
    except SolverError as error:
        print(f"swsysid: {error}", file=sys.stderr)
        return 1
    text = render(result)
    notes = dict.fromkeys([*(str(warning.message) for warning in caught), *result.notes])
    told = [f"note: {note}" for note in notes]
    if search is not None:
        told += [str(search.report_), with_effects(search.best_estimator_)]
    text = "\n\n".join(part for part in [text, *told] if part)
    print(text)
    return save(result, text, arguments.output, search, page)


def _options(arguments: argparse.Namespace, measurement: Measurement) -> JobOptions:
    degree = arguments.library_degree
    return JobOptions(
        measurement=measurement,
        modes=modes(arguments.modes),
        library_degree=LIBRARIES[arguments.library or "affine"] if degree is None else degree,
        waves=arguments.library == "trigonometric",
        surface_degree=arguments.surface_degree,
        loss=arguments.loss,
        position=arguments.position,
        test_fraction=arguments.test_fraction,
        random_state=arguments.random_state,
        n_jobs=arguments.jobs,
        verbose=is_watched(arguments.verbose),
    )
