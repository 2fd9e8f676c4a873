"""``--automaton``: guards that remember and states that jump, from the recordings alone."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._automaton_search.held_out import HeldOutAutomata
from swsysid._automaton_search.judged import judged_on, rollout_score
from swsysid._cli.options import JobOptions
from swsysid._cli.samples import Samples, measure
from swsysid._cli.saving import save_automaton
from swsysid._cli.text import described
from swsysid._journal import handing_over
from swsysid._results import SolverError
from swsysid._stays.given import Given, read_given
from swsysid._tables.table import Table, TableError
from swsysid._trajectory_identifier import TrajectoryIdentifier
from swsysid._verdict.comparison import Verdict, hold_out
from swsysid._verdict.held_out import HeldOutTrajectories
from swsysid._verdict.judge import Judge
from swsysid._verdict.terms import Terms
from swsysid._verdict.verdict import SwitchingVerdict
from swsysid._verdict.words import COMMAND_LINE


def run_automaton(
    table: Table, options: JobOptions, folder: Path, checksum: str, before: str = ""
) -> int:
    """Identify an automaton, judge one of the other recordings on what is held out, and save.

    The text of what was said `before` stays.
    """
    if options.measurement.derivatives:
        raise TableError("--automaton takes recorded states alone; leave out --derivatives.")
    with own_warnings() as notes:
        samples = measure(table, options.measurement)
    answer = automaton_of(samples, options)
    assert answer is not None  # it is asked for
    told = answer.text(samples)
    beside = [f"note: {note}" for note in notes if note not in told]
    data = [] if before else [_recorded(samples)]
    text = "\n\n".join([*data, told, *beside])
    return save_automaton(answer.found, samples, text, folder, checksum, before)


@dataclass(frozen=True)
class Answer:
    """An automaton of recordings, and what is said of it."""

    found: HybridAutomatonRegressor
    held_out: str
    verdict: SwitchingVerdict | None  # none where no smooth law can be fitted beside it
    notes: Sequence[str]

    @property
    def report(self) -> str:
        """What was found, and how it rolls out what is held out."""
        return f"{self.found.report_}\n\n{self.held_out}"

    @property
    def predicts_no_better(self) -> bool:
        """Whether one law tells what is held out as well: the modes are pieces of a curve."""
        smooth = Verdict.ONE_MODE, Verdict.SMOOTH
        return self.verdict is not None and self.verdict.kind in smooth

    def text(self, samples: Samples) -> str:
        """All that is said, the verdict on its modes included."""
        verdict = self.verdict
        judged = [] if verdict is None else [verdict.table(samples.units), verdict.sentence]
        return "\n\n".join([self.report, *judged, *self.notes])


def automaton_of(
    samples: Samples,
    options: JobOptions,
    is_worth: Callable[[HybridAutomatonRegressor], bool] = lambda found: True,
) -> Answer | None:
    """An automaton of recordings; None if it is not worth judging."""
    identification = _Identification(samples, options)
    with own_warnings() as notes:
        found = identification.fitted(slice(None), options.modes)
    identification.holds = found.input_holds_
    if not is_worth(found):
        return None
    trained = identification.trained()
    # the advice of the report says what guards do not tell
    told = [f"note: {note}" for note in notes if note not in found.report_.advice]
    verdict = None
    with suppress(ValueError, SolverError):  # no smooth law can be fitted to what is left
        verdict = identification.verdict(found, trained)
    return Answer(found, identification.held_out(trained), verdict, told)


@contextmanager
def own_warnings() -> Iterator[list[str]]:
    """What our own warnings say; those of the arithmetic below are none of the user's."""
    told: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        yield told
    own = [str(one.message) for one in caught if issubclass(one.category, UserWarning)]
    told += dict.fromkeys(own)


class _Identification:
    """An automaton of all recordings, and one of the training rows, which rolls out the others."""

    def __init__(self, samples: Samples, options: JobOptions):
        recorded = samples.recorded
        assert recorded is not None, "derivatives are refused"
        self.recorded, self.samples, self.options = recorded, samples, options
        self.split = hold_out(recorded.groups, options.test_fraction, options.random_state)
        everything = tuple(range(samples.X.shape[1]))
        self.terms = Terms(everything, options.library_degree, options.waves, *samples.angles)
        self.holds = options.measurement.input_hold

    def trained(self) -> HybridAutomatonRegressor:
        """Of the training rows; the fit to all says the same."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self.fitted(self.split.train, self.options.modes)

    def fitted(self, rows: NDArray[np.bool_] | slice, n_modes: int | str, **options: object):
        """The automaton of some rows."""
        wishes = self.options
        model = HybridAutomatonRegressor(
            n_modes,
            known=list(wishes.known) or None,
            order=wishes.measurement.order,
            feature_library=self.terms.library(self.samples.X.shape[1]),
            guard_degree=wishes.surface_degree,
            sparsity=wishes.sparsity,
            input_hold=self.holds,
            n_jobs=wishes.n_jobs,
            random_state=wishes.random_state,
            verbose=int(wishes.verbose),
        )
        with handing_over(None) if isinstance(rows, slice) else nullcontext():
            return model.set_params(**options).fit(*self._data(rows))

    def held_out(self, trained: HybridAutomatonRegressor) -> str:
        """How an automaton of the training rows rolls out the others."""
        split, others = self.split, self._given(self.split.test)
        score = rollout_score(trained.automaton_, others)
        rollouts = judged_on(trained.automaton_, others, trained.noise_)
        what = "whole trajectories" if split.whole_groups else "the last stretch of each trajectory"
        well = f"R2 of {score:.4f}" if np.isfinite(score) else "no R2, since a rollout diverges,"
        n_samples = split.test[self.recorded.holds_a_state].sum()
        return (
            f"held-out rollouts: {well} on {n_samples:,} samples, {what}, by an automaton of the "
            f"others\n{rollouts.sentence()}"
        )

    def verdict(
        self, found: HybridAutomatonRegressor, trained: HybridAutomatonRegressor
    ) -> SwitchingVerdict:
        """Whether the modes that were found are to be believed."""
        order, given = self.options.measurement.order, self._given(slice(None))

        def again(rows, n_modes: int | str, whole: bool, **options: object):
            same = n_modes == trained.n_modes_
            return trained if same else self.fitted(rows, n_modes, **options)

        def law(rows, n_modes: int | str, whole: bool, **options: object):
            asked = self.options.regressor(n_modes).set_params(verbose=0, **options)
            identifier = TrajectoryIdentifier(
                asked, order=order, refine=whole, input_hold=self.holds
            )
            return identifier.fit(*self._data(rows))

        laws = HeldOutTrajectories(given, self.split, law, order, through_jumps=True)
        held_out = HeldOutAutomata(given, self.split, again, found, laws)
        judge, asked = Judge(held_out, self.terms), self.options.modes
        words = replace(COMMAND_LINE, memory="", beside="")
        return judge.verdict(found, judge.judged(found, asked), asked, words=words)

    def _given(self, rows: NDArray[np.bool_] | slice) -> Given:
        return read_given(*self._data(rows)).held(self.holds)

    def _data(self, rows: NDArray[np.bool_] | slice) -> tuple:
        return self.recorded.named(self.samples.names, rows)


def _recorded(samples: Samples) -> str:
    recorded = samples.recorded
    assert recorded is not None
    first = described(samples, recorded.n_samples, len(recorded.labels))
    return "\n".join([first, *samples.remarks])
