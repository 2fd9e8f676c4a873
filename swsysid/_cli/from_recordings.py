"""The model as the recordings themselves tell it, judged on recordings that it has not seen."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.guard_words import memory
from swsysid._cli.held_out import HeldOut
from swsysid._cli.input_holds import with_held_inputs
from swsysid._cli.options import JobOptions
from swsysid._cli.samples import Samples
from swsysid._cli.settings import JUDGING, RECORDINGS
from swsysid._cli.terms import Terms
from swsysid._cli.verdict import Comparison, Rival, Split, Verdict, relative_error
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array, SolverError
from swsysid._trajectory_identifier import TrajectoryIdentifier


@dataclass(frozen=True)
class FromRecordings:
    """Laws, modes and instants of highest likelihood, with their standard errors."""

    identifier: TrajectoryIdentifier
    terms: Terms
    modes: NDArray[np.intp]  # of the rows of the samples
    labels: list[object]  # of the trajectories
    split: Split  # of the rows of the recordings
    comparison: Comparison
    given_up: int | None  # modes that "auto" found before a smooth law proved as good
    excess: Array  # what rollouts leave, in units of the noise that neighbouring samples show
    # of held-out samples, by a model of the others; None where these are too few
    free_of_held_out: FreeRollouts | None
    samples: Samples  # with the limits of inputs that keep their value

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
    """What the recordings say; if nothing, why not."""
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
        samples = with_held_inputs(samples, terms, options)
        return _Identification(samples, terms, options).found(), ""
    except (_Unfit, ValueError, SolverError) as reason:
        return None, f"Identified from derivatives: {reason}"


class _Identification:
    """One identification: rivals of one mode, the model, and how both predict what is held out."""

    def __init__(self, samples: Samples, terms: Terms, options: JobOptions):
        self.samples, self.terms, self.options = samples, terms, options
        self.held_out = HeldOut(samples, options)
        self.fitted = dict(self.held_out.rivals(terms))
        # the model of the other recordings that stands for the answer on those held out
        self.plain = self.by_others = self.fitted[terms]
        self.rivals = tuple(
            Rival(each, self.held_out.left_by(one)) for each, one in self.fitted.items()
        )

    def found(self) -> FromRecordings:
        """The model of all recordings and the comparison, or an exception that says why not."""
        terms, n_modes, given_up = self.terms, self.options.modes, None
        if n_modes == 1:
            identifier = self._finished(terms, 1, self.plain)
            comparison = self._of_one_mode()
        else:
            identifier, comparison = self._of_several(n_modes)
        if n_modes == "auto" and comparison.verdict in (Verdict.SMOOTH, Verdict.ONE_MODE):
            stands = comparison.lacks_something and _leaves_noise(identifier)
            if identifier.n_modes_ > 1 and not stands and not self._remembers(identifier):
                given_up, terms = identifier.n_modes_, comparison.best.terms
                identifier = self._finished(terms, 1, None, sparsity="auto")
                self.by_others = self.fitted[terms]
        self._check(identifier, terms)
        return FromRecordings(
            identifier,
            terms,
            self._modes(identifier),
            self.held_out.recorded.labels,
            self.held_out.split,
            comparison,
            given_up,
            identifier.report_.excess,
            self.held_out.free(self.by_others),
            self.samples,
        )

    def _of_several(self, n_modes: int | str) -> tuple[TrajectoryIdentifier, Comparison]:
        """Several modes, judged by those of the training recordings alone.

        Where a law of one mode leaves nothing but noise, that takes no second fit: modes that have
        seen the held-out samples and are no better still settle it. One that leaves more is no
        law of the plant either: with "auto" one mode more is tried against it.
        """
        stretches = None
        if n_modes == "auto" or self._is_smooth():
            stretches = self.held_out.identified(self.terms, n_modes)
            n_found = stretches.n_modes_
            if n_found == 1:
                return self._finished(self.terms, 1, self.plain, stretches), self._of_one_mode()
            comparison = self._compared(stretches, stretches)
            if comparison.improvement <= JUDGING.worth:
                more = n_modes == "auto" and comparison.lacks_something and n_found < self._most
                if more:
                    identifier, better = self._trained(n_found + 1)
                    if identifier.n_modes_ > n_found and better.improvement > JUDGING.worth:
                        return identifier, better
                self.by_others = stretches
                return stretches, comparison
            n_modes = n_found
        return self._trained(int(n_modes), stretches)

    def _trained(
        self, n_modes: int, stretches: TrajectoryIdentifier | None = None
    ) -> tuple[TrajectoryIdentifier, Comparison]:
        """So many modes, judged by those of the training recordings alone."""
        held_out = self.held_out
        trained = held_out.trained(self.terms, n_modes)
        identifier = self._finished(self.terms, n_modes, trained, stretches)
        n_seen = int(self._is_seen(identifier).sum())
        if n_seen < identifier.n_modes_:
            trained = held_out.trained(self.terms, n_seen)
        comparison = self._compared(identifier, trained)
        if comparison.improvement <= JUDGING.worth and _leaves_noise(identifier):
            seen = self._compared(identifier, identifier)
            comparison = replace(comparison, explains=seen.improvement > JUDGING.worth)
            self.by_others = trained
        return identifier, comparison

    def _finished(
        self,
        terms: Terms,
        n_modes: int,
        trained: TrajectoryIdentifier | None,
        stretches: TrajectoryIdentifier | None = None,
        **options,
    ) -> TrajectoryIdentifier:
        """The model of all recordings: by rollouts over whole ones where laws lack nothing.

        Laws that lack something are bent by long rollouts, which take long too.
        """
        identified = self.held_out.identified
        if trained is None:
            trained = stretches = identified(terms, n_modes, **options)
        if _leaves_noise(trained):
            whole = identified(terms, n_modes, whole=True, **options)
            same = stretches is None or whole.n_modes_ == stretches.n_modes_
            if same and _leaves_noise(whole):
                return whole
        return identified(terms, n_modes, **options) if stretches is None else stretches

    # -- comparisons -----------------------------------------------------------------------

    @property
    def _most(self) -> int:
        return int(self.options.regressor("auto").max_modes)

    def _modes(self, identifier: TrajectoryIdentifier) -> NDArray[np.intp]:
        """Of the rows of the samples."""
        samples, recorded = self.samples, self.held_out.recorded
        assert samples.t is not None
        predicted = identifier.predict_modes(samples.frame)
        return recorded.at(samples.t, samples.groups, identifier.modes_, predicted)

    def _remembers(self, identifier: TrajectoryIdentifier) -> bool:
        """Whether one guard leads into each of two modes, which no surface tells."""
        if identifier.n_modes_ != 2 or identifier.report_.rollouts.tells_switches:
            return False
        return bool(memory(self._modes(identifier), self.samples))

    def _is_smooth(self) -> bool:
        """Whether a law of one mode leaves nothing but noise of what is held out."""
        noise = self.held_out.noise
        left = [relative_error(rival.errors, noise) for rival in self.rivals]
        return min(left) <= RECORDINGS.noise_alone

    def _is_seen(self, identifier: TrajectoryIdentifier) -> NDArray[np.bool_]:
        """Modes that the training recordings have."""
        modes, train = identifier.modes_, self.held_out.split.train
        shares = np.bincount(modes[train], minlength=identifier.n_modes_) / train.sum()
        return shares >= JUDGING.rare_mode

    def _compared(
        self, identifier: TrajectoryIdentifier, trained: TrajectoryIdentifier
    ) -> Comparison:
        """The modes of a model by rollouts of one that was trained without what is held out."""
        self.by_others = trained
        held_out, is_seen = self.held_out, self._is_seen(identifier)
        judged = held_out.stretches_in(is_seen[identifier.modes_[held_out.rows]])
        judged = judged if judged.any() else np.ones(len(judged), dtype=bool)
        return Comparison(
            errors=held_out.left_by(trained)[judged],
            rivals=tuple(Rival(rival.terms, rival.errors[judged]) for rival in self.rivals),
            spread=np.nanstd(held_out.measured[judged], axis=0),
            n_switches=sum(map(len, identifier.switch_times_)),
            constant=False,
            told_by_rates=None,
            untested=tuple(int(mode) for mode in np.flatnonzero(~is_seen)),
            noise=held_out.noise,
            blocks=held_out.blocks[judged],
            seen=trained is identifier,
        )

    def _of_one_mode(self) -> Comparison:
        held_out = self.held_out
        return Comparison(
            errors=self.rivals[0].errors,
            rivals=self.rivals,
            spread=np.nanstd(held_out.measured, axis=0),
            n_switches=0,
            constant=False,
            told_by_rates=None,
            untested=(),
            noise=held_out.noise,
            blocks=held_out.blocks,
        )

    # -- whether to believe it -------------------------------------------------------------

    def _check(self, identifier: TrajectoryIdentifier, terms: Terms) -> None:
        """Refuse what derivatives know better."""
        samples, excess = self.samples, identifier.report_.excess
        lacking = bool((excess > RECORDINGS.noise_alone).any())
        wanted = self.options.modes
        asked = identifier.n_modes_ if wanted == "auto" else int(wanted)
        predicted = identifier.predict_modes(samples.frame)
        is_constant = identifier.n_modes_ > 1 and bool((predicted == predicted[0]).all())
        shown = 1 if is_constant else identifier.n_modes_
        if shown < asked and (lacking or is_constant):
            raise _Unfit(f"the trajectories themselves show {shown} of {asked} modes.")
        if (excess > RECORDINGS.hopeless).any():
            worst = int(np.argmax(excess))
            raise _Unfit(
                f"over stretches of 30 samples rollouts leave {excess[worst]:.2g} times the noise "
                f"of {samples.names[worst]}; {self.options.missing}."
            )
        if not lacking:
            return
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


def _leaves_noise(identifier: TrajectoryIdentifier) -> bool:
    """Whether nothing but noise is left where the laws are told when to switch."""
    return bool((identifier.report_.excess <= RECORDINGS.noise_alone).all())


def _left(model: SwitchingSystemRegressor, samples: Samples) -> float:
    """What a model leaves of the derivatives that are not known."""
    errors = (samples.Xdot - model.predict(samples.frame))[:, samples.n_known :]
    return relative_error(errors, samples.Xdot[:, samples.n_known :].std(axis=0))
