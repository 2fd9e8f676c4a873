"""The model as the recordings themselves tell it, judged on recordings that it has not seen."""

from __future__ import annotations

import warnings
from contextlib import nullcontext
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.options import JobOptions
from swsysid._cli.samples import Samples
from swsysid._cli.settings import RECORDINGS
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._journal import handing_over
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import SolverError
from swsysid._stays.given import read_given
from swsysid._stays.input_holds import holds_of
from swsysid._stays.settings import StaySettings
from swsysid._trajectory_identifier import TrajectoryIdentifier
from swsysid._verdict.comparison import Split, Verdict, hold_out, relative_error
from swsysid._verdict.held_out import HeldOutTrajectories
from swsysid._verdict.judge import Judge, Judged
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.terms import Terms
from swsysid._verdict.verdict import SwitchingVerdict
from swsysid._verdict.words import COMMAND_LINE


@dataclass(frozen=True)
class FromRecordings:
    """Laws, modes and instants of highest likelihood, with their standard errors."""

    identifier: TrajectoryIdentifier
    terms: Terms
    modes: NDArray[np.intp]  # of the rows of the samples
    labels: list[object]  # of the trajectories
    split: Split  # of the rows of the recordings
    verdict: SwitchingVerdict

    @property
    def free(self) -> FreeRollouts:
        """Of the recordings, or of stretches of them."""
        return self.identifier.report_.rollouts

    @property
    def model(self) -> SwitchingSystemRegressor:
        """The identified model."""
        return self.identifier.estimator_

    @property
    def whole(self) -> bool:
        """Rollouts over whole trajectories; else over stretches."""
        return bool(self.identifier.refine)


class _Unfit(Exception):
    """Why the recordings themselves give no model."""


def identify_recordings(
    samples: Samples, terms: Terms, options: JobOptions
) -> tuple[FromRecordings | None, str]:
    """What the recordings say, and why that, or nothing, is less than was asked for."""
    recorded = samples.recorded
    if recorded is None or samples.t is None or options.quick:
        return None, ""
    is_plain = isinstance(terms.library(samples.X.shape[1]), int | None)
    most = RECORDINGS.most_samples if is_plain else RECORDINGS.most_of_pipelines
    try:
        if len(recorded.t) > most:
            fewer = -(-len(recorded.t) // most)
            raise _Unfit(
                f"rollouts of more than {most:,} samples of these terms take long (--decimate "
                f"{fewer} makes them fewer)."
            )
        found, why = _Identification(samples, terms, options).found()
    except (_Unfit, ValueError, SolverError) as reason:
        found, why = None, str(reason)
    return found, f"Identified from derivatives: {why}" if why else ""


class _Identification:
    """One identification: rivals of one mode, the model, and how both predict what is held out."""

    def __init__(self, samples: Samples, terms: Terms, options: JobOptions):
        assert samples.recorded is not None
        self.samples, self.terms, self.options = samples, terms, options
        self.recorded = recorded = samples.recorded
        split = hold_out(recorded.groups, options.test_fraction, options.random_state)
        given = read_given(*recorded.named(samples.names, slice(None)))
        order, units = options.measurement.order, samples.units
        library = terms.library(samples.X.shape[1])
        model = options.regressor(options.modes, verbose=0, feature_library=library)
        # nodes that are tied loosely, as in fits over stretches, make up for an input that steps
        self.holds = holds_of(given, model, order, options.measurement.input_hold, StaySettings())
        given = given.held(self.holds)
        self.held_out = HeldOutTrajectories(given, split, self._fitted, order, units)
        self.judge = Judge(self.held_out, terms)

    def found(self) -> tuple[FromRecordings, str]:
        """The model of all recordings and the verdict, or an exception that says why not.

        Also what derivatives may know better of it; "" where that is nothing.
        """
        terms, n_modes, given_up, judge = self.terms, self.options.modes, None, self.judge
        if n_modes == 1:
            identifier = self._finished(terms, 1, judge.laws[terms])
            judged = judge.of_one_mode()
        else:
            identifier, judged = self._of_several(n_modes)
        comparison = judged.comparison
        if n_modes == "auto" and comparison.verdict in (Verdict.SMOOTH, Verdict.ONE_MODE):
            stands = comparison.lacks_something and self.held_out.leaves_noise(identifier)
            if identifier.n_modes_ > 1 and not stands and not self.held_out.memory(identifier):
                given_up, terms = identifier.n_modes_, comparison.best.terms
                identifier = self._finished(terms, 1, None, sparsity="auto")
                judged = judge.of_law(comparison, terms)
        doubt = self._checked(identifier, terms)
        verdict = judge.verdict(
            identifier, judged, n_modes, terms=terms, given_up=given_up, words=COMMAND_LINE
        )
        found = FromRecordings(
            identifier,
            terms,
            self._modes(identifier),
            self.recorded.labels,
            self.held_out.split,
            verdict,
        )
        return found, doubt

    def _of_several(self, n_modes: int | str) -> tuple[TrajectoryIdentifier, Judged]:
        """Several modes, judged by those of the training recordings alone.

        Where a law of one mode leaves nothing but noise, that takes no second fit: modes that have
        seen the held-out samples and are no better still settle it. One that leaves more is no
        law of the plant either: with "auto" one mode more is tried against it.
        """
        stretches, judge = None, self.judge
        if n_modes == "auto" or judge.is_smooth():
            stretches = self.identified(self.terms, n_modes, False)
            n_found = stretches.n_modes_
            if n_found == 1:
                plain = judge.laws[self.terms]
                return self._finished(self.terms, 1, plain, stretches), judge.of_one_mode()
            seen = judge.compared(stretches, stretches)
            if seen.comparison.improvement <= JUDGING.worth:
                more = n_modes == "auto" and seen.comparison.lacks_something
                if more and n_found < int(self.options.regressor("auto").max_modes):
                    identifier, better = self._trained(n_found + 1)
                    worth = better.comparison.improvement > JUDGING.worth
                    if identifier.n_modes_ > n_found and worth:
                        return identifier, better
                return stretches, seen
            n_modes = n_found
        return self._trained(int(n_modes), stretches)

    def _trained(
        self, n_modes: int, stretches: TrajectoryIdentifier | None = None
    ) -> tuple[TrajectoryIdentifier, Judged]:
        """So many modes, judged by those of the training recordings alone."""
        trained = self.held_out.trained(self.terms, n_modes)
        identifier = self._finished(self.terms, n_modes, trained, stretches)
        return identifier, self.judge.by_training(identifier, trained)

    def _finished(
        self,
        terms: Terms,
        n_modes: int,
        trained: TrajectoryIdentifier | None,
        stretches: TrajectoryIdentifier | None = None,
        **options: str,
    ) -> TrajectoryIdentifier:
        """The model of all recordings: by rollouts over whole ones where laws lack nothing.

        Laws that lack something are bent by long rollouts, which take long too.
        """
        if trained is None:
            trained = stretches = self.identified(terms, n_modes, False, **options)
        if self.held_out.leaves_noise(trained):
            whole = self.identified(terms, n_modes, True, **options)
            same = stretches is None or whole.n_modes_ == stretches.n_modes_
            if same and self.held_out.leaves_noise(whole):
                return whole
        return self.identified(terms, n_modes, False, **options) if stretches is None else stretches

    # -- fits ------------------------------------------------------------------------------

    def identified(
        self, terms: Terms, n_modes: int | str, whole: bool, **options: object
    ) -> TrajectoryIdentifier:
        """Laws, modes and surface of highest likelihood of all recordings.

        By rollouts over stretches, or with `whole` over whole ones; `options` are the regressor's.
        """
        library = terms.library(self.samples.X.shape[1])
        options |= {"feature_library": library}
        with warnings.catch_warnings():
            # smoothing told of clipped samples already
            warnings.filterwarnings("ignore", message="samples stand at an end of the range")
            return self._fitted(slice(None), n_modes, whole, **options)

    def _fitted(
        self, rows: NDArray[np.bool_] | slice, n_modes: int | str, whole: bool, **options: object
    ) -> TrajectoryIdentifier:
        options = {"known": list(self.options.known) or None} | options
        identifier = TrajectoryIdentifier(
            self.options.regressor(n_modes).set_params(verbose=0, **options),
            order=self.options.measurement.order,
            refine=whole,
            input_hold=self.holds,
            n_jobs=self.options.n_jobs,
            verbose=int(self.options.verbose and not isinstance(rows, np.ndarray)),
        )
        with handing_over(None) if isinstance(rows, slice) else nullcontext():
            return identifier.fit(*self.recorded.named(self.samples.names, rows))

    def _modes(self, identifier: TrajectoryIdentifier) -> NDArray[np.intp]:
        """Of the rows of the samples."""
        samples = self.samples
        assert samples.t is not None
        predicted = identifier.predict_modes(samples.frame)
        return self.recorded.at(samples.t, samples.groups, identifier.modes_, predicted)

    # -- whether to believe it -------------------------------------------------------------

    def _checked(self, identifier: TrajectoryIdentifier, terms: Terms) -> str:
        """Refuse what derivatives know better; one law that lacks something they may know."""
        samples, excess = self.samples, identifier.report_.excess
        lacking = bool((excess > JUDGING.noise_alone).any())
        wanted = self.options.modes
        asked = identifier.n_modes_ if wanted == "auto" else int(wanted)
        predicted = identifier.predict_modes(samples.frame)
        is_constant = identifier.n_modes_ > 1 and bool((predicted == predicted[0]).all())
        shown = 1 if is_constant else identifier.n_modes_
        fewer = f"the trajectories themselves show {shown} of {asked} modes."
        if is_constant or (1 < shown < asked and lacking):
            raise _Unfit(fewer)
        if (excess > RECORDINGS.hopeless).any():
            worst = int(np.argmax(excess))
            raise _Unfit(
                f"over stretches of 30 samples rollouts leave {excess[worst]:.2g} times the noise "
                f"of {samples.names[worst]}; {self.options.missing}."
            )
        if not lacking:
            return ""
        library = terms.library(samples.X.shape[1])
        derived = self.options.regressor(identifier.n_modes_, feature_library=library)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            derived.fit(samples.frame, samples.Xdot, groups=samples.groups)
        if _left(identifier.estimator_, samples) > RECORDINGS.worse * _left(derived, samples):
            raise _Unfit(
                "the laws that follow the trajectories best miss their derivatives, and so lack "
                "something."
            )
        return fewer if shown < asked else ""


def _left(model: SwitchingSystemRegressor, samples: Samples) -> float:
    """What a model leaves of the derivatives that are not known."""
    errors = (samples.Xdot - model.predict(samples.frame))[:, samples.n_known :]
    return relative_error(errors, samples.Xdot[:, samples.n_known :].std(axis=0))
