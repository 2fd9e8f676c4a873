"""``--automaton``: guards that remember and states that jump, from the recordings alone."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._automaton_search.judged import judged_on, rollout_score
from swsysid._cli.options import JobOptions
from swsysid._cli.samples import Samples, measure
from swsysid._cli.saving import save_automaton
from swsysid._cli.terms import Terms
from swsysid._cli.text import described
from swsysid._cli.verdict import hold_out
from swsysid._stays.given import read_given
from swsysid._tables.table import Table, TableError


def run_automaton(table: Table, options: JobOptions, folder: Path, checksum: str) -> int:
    """Identify an automaton, judge one of the other recordings on what is held out, and save."""
    if options.measurement.derivatives:
        raise TableError("--automaton takes recorded states alone; leave out --derivatives.")
    with own_warnings() as notes:
        samples = measure(table, options.measurement)
    found, told = automaton_of(samples, options)
    beside = [f"note: {note}" for note in notes if note not in told]
    return save_automaton(
        found, samples, "\n\n".join([_recorded(samples), told, *beside]), folder, checksum
    )


def automaton_of(samples: Samples, options: JobOptions) -> tuple[HybridAutomatonRegressor, str]:
    """An automaton of recordings, and what is said of it."""
    with own_warnings() as notes:
        found, held_out = _identified(samples, options)
    # the advice of the report says what guards do not tell
    told = [f"note: {note}" for note in notes if note not in found.report_.advice]
    return found, "\n\n".join([str(found.report_), held_out, *told])


@contextmanager
def own_warnings() -> Iterator[list[str]]:
    """What our own warnings say; those of the arithmetic below are none of the user's."""
    told: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield told
    own = [str(one.message) for one in caught if issubclass(one.category, UserWarning)]
    told += dict.fromkeys(own)


def _identified(samples: Samples, options: JobOptions) -> tuple[HybridAutomatonRegressor, str]:
    """The automaton of all recordings; how one of the training rows rolls out the others."""
    recorded = samples.recorded
    assert recorded is not None, "derivatives are refused"
    split = hold_out(recorded.groups, options.test_fraction, options.random_state)
    n_columns = samples.X.shape[1]
    everything = tuple(range(n_columns))
    terms = Terms(everything, options.library_degree, options.waves, *samples.angles)
    model = HybridAutomatonRegressor(
        options.modes,
        order=options.measurement.order,
        feature_library=terms.library(n_columns),
        guard_degree=options.surface_degree,
        sparsity=options.sparsity,
        n_jobs=options.n_jobs,
        random_state=options.random_state,
        verbose=int(options.verbose),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the fit to all recordings says the same
        trained = model.fit(*recorded.named(samples.names, split.train))
        others = read_given(*recorded.named(samples.names, split.test))
        score = rollout_score(trained.automaton_, others)
        rollouts = judged_on(trained.automaton_, others, trained.noise_)
    what = "whole trajectories" if split.whole_groups else "the last stretch of each trajectory"
    well = f"R2 of {score:.4f}" if np.isfinite(score) else "no R2, since a rollout diverges,"
    held_out = (
        f"held-out rollouts: {well} on {split.test[recorded.holds_a_state].sum():,} samples, "
        f"{what}, by an automaton of the others\n{rollouts.sentence()}"
    )
    return model.fit(*recorded.named(samples.names, slice(None))), held_out


def _recorded(samples: Samples) -> str:
    recorded = samples.recorded
    assert recorded is not None
    first = described(samples, recorded.n_samples, len(recorded.labels))
    return "\n".join([first, *samples.remarks])
