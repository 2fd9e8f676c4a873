"""The judge: modes beside smooth laws of one mode, on recordings that none of them has seen.

An estimator that is `JudgedOnRecordings` asks it of what it has fitted.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from swsysid._checks.estimators import FittedLater, check_fitted
from swsysid._data.recordings import Hold
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._stays.given import FEWEST_SAMPLES, Given
from swsysid._verdict.comparison import Comparison, Rival, Split, hold_out, relative_error
from swsysid._verdict.held_out import Fit, HeldOut
from swsysid._verdict.same import is_same
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.terms import Terms
from swsysid._verdict.verdict import SwitchingVerdict
from swsysid._verdict.words import PYTHON, Words
from swsysid._whole_or_nothing import failing_in_words


@dataclass(frozen=True)
class Judged:
    """A comparison, and free rollouts of the model of the others that is the answer in it."""

    comparison: Comparison
    free: Callable[[], FreeRollouts | None]  # of that model, over what is held out


class Judge(Generic[Fit]):
    """Smooth laws of the training recordings; any fit to all recordings is judged beside them."""

    def __init__(self, held_out: HeldOut[Fit], terms: Terms):
        self.held_out, self.terms = held_out, terms
        self.laws = dict(held_out.laws.rivals(terms))
        self.rivals = self._rivals()
        # over short stretches a smooth law may leave nothing but noise, and so may modes
        while self.is_smooth() and held_out.lengthened():
            self.rivals = self._rivals()

    def judged(self, fit: Fit, asked: int | str) -> Judged:
        """How the modes of a fit predict what is held out, if laws of the others have them.

        Where a law of one mode leaves nothing but noise, or the number of modes was left open,
        that takes no second fit: modes that have seen the held-out samples and are no better
        still settle it.
        """
        if self.held_out.is_one_law(fit):
            return self.of_one_mode()
        if asked == "auto" or self.is_smooth():
            seen = self.compared(fit, fit)
            if seen.comparison.improvement <= JUDGING.worth:
                return seen
        return self.by_training(fit)

    def of_one_mode(self) -> Judged:
        """A model of one mode is its own rival, beside those of more terms."""
        held_out, cut = self.held_out, self.held_out.cut
        comparison = Comparison(
            errors=self.rivals[0].errors,
            rivals=self.rivals,
            spread=np.nanstd(cut.measured, axis=0),
            n_switches=0,
            constant=False,
            told_by_rates=None,
            untested=(),
            noise=held_out.noise,
            blocks=cut.blocks,
            stretch=cut.length,
        )
        return self.of_law(self._with_law(comparison), self.terms)

    def of_law(self, comparison: Comparison, terms: Terms) -> Judged:
        """A smooth law is the answer."""
        return Judged(comparison, partial(self.held_out.laws.free, self.laws[terms]))

    def by_training(self, fit: Fit, trained: Fit | None = None) -> Judged:
        """By modes of the training recordings alone: as many as they have of those of a fit."""
        n_seen = int(self._is_seen(fit).sum())
        if trained is None or n_seen < fit.n_modes_:
            trained = self.held_out.trained(self.terms, n_seen)
        found = self.compared(fit, trained)
        if found.comparison.improvement <= JUDGING.worth and self.held_out.leaves_noise(fit):
            seen = self.compared(fit, fit).comparison
            told = replace(found.comparison, explains=seen.improvement > JUDGING.worth)
            found = replace(found, comparison=told)
        return found

    def compared(self, fit: Fit, trained: Fit) -> Judged:
        """The modes of a fit by rollouts of one that was trained without what is held out."""
        held_out, cut, is_seen = self.held_out, self.held_out.cut, self._is_seen(fit)
        judged = cut.whole(is_seen[fit.modes_[cut.rows]])
        judged = judged if judged.any() else np.ones(len(judged), dtype=bool)
        comparison = Comparison(
            errors=held_out.left_by(trained, cut)[judged],
            rivals=tuple(
                replace(rival, errors=rival.errors[judged], same=self._is_same(fit, rival))
                for rival in self.rivals
            ),
            spread=np.nanstd(cut.measured[judged], axis=0),
            n_switches=sum(map(len, fit.switch_times_)),
            constant=False,
            told_by_rates=held_out.told(fit),
            untested=tuple(int(mode) for mode in np.flatnonzero(~is_seen)),
            noise=held_out.noise,
            blocks=cut.blocks[judged],
            stretch=cut.length,
            seen=trained is fit,
        )
        return Judged(self._with_law(comparison), partial(held_out.free, trained))

    def _is_same(self, fit: Fit, rival: Rival) -> bool:
        """Whether the modes of a fit and a law of one mode are one model of what is held out."""
        columns = self.held_out.cut.columns
        if columns.shape[1] != self.held_out.n_columns:  # laws of samples before have more
            return False
        return is_same(rival.terms, self.terms, columns, fit.modes_[self.held_out.cut.rows])

    def is_smooth(self) -> bool:
        """Whether a law of one mode leaves nothing but noise of what is held out."""
        noise = self.held_out.noise
        left = [relative_error(rival.errors, noise) for rival in self.rivals]
        return min(left) <= JUDGING.noise_alone

    def verdict(
        self,
        fit: Fit,
        judged: Judged,
        asked: int | str,
        *,
        terms: Terms | None = None,
        given_up: int | None = None,
        words: Words = PYTHON,
    ) -> SwitchingVerdict:
        """All that is said of a fit; of `given_up` modes where it is the smooth law instead."""
        held_out = self.held_out
        return SwitchingVerdict(
            comparison=judged.comparison,
            n_modes=fit.n_modes_,
            switches=not held_out.is_one_law(fit),
            asked=asked,
            channels=held_out.channels(fit),
            terms=str(terms or self.terms),
            n_trained=held_out.n_trained,
            whole_recordings=held_out.split.whole_groups,
            stands=held_out.leaves_noise(fit),
            memory=held_out.memory(fit),
            free=held_out.rollouts(fit),
            free_of_held_out=judged.free(),
            given_up=given_up,
            words=words,
        )

    def _rivals(self) -> tuple[Rival, ...]:
        laws, cut = self.held_out.laws, self.held_out.cut
        return tuple(Rival(each, laws.left_by(one, cut)) for each, one in self.laws.items())

    def _with_law(self, comparison: Comparison) -> Comparison:
        """With what the best law leaves of the samples it was made from, if no more than noise."""
        if not comparison.noise_alone:
            return comparison
        held_out, law = self.held_out, self.laws[comparison.best.terms]
        seen = replace(held_out.made_from, length=held_out.cut.length)
        left = relative_error(held_out.laws.left_by(law, seen), held_out.noise)
        return replace(comparison, law_stands=left <= JUDGING.noise_alone)

    def _is_seen(self, fit: Fit) -> NDArray[np.bool_]:
        """Modes that the training recordings have."""
        modes, train = fit.modes_, self.held_out.split.train
        shares = np.bincount(modes[train], minlength=fit.n_modes_) / train.sum()
        return np.asarray(shares >= JUDGING.rare_mode)


class Asked(NamedTuple):
    """What a fit was asked for, and what it leaves of recordings held out."""

    held_out: HeldOut
    library: int | BaseEstimator | None
    n_modes: int | str
    words: Words = PYTHON


class JudgedOnRecordings(FittedLater):
    """An estimator of recordings, which it keeps for the verdict on its modes.

    Its `fit` calls `_keep`, and `_asked` fits again without what is held out.
    """

    _recordings: Given | None
    _verdict: SwitchingVerdict | None

    @property
    def verdict_(self) -> SwitchingVerdict:
        """Whether the modes are to be believed, judged on recordings that were held out.

        The recordings of `fit` are kept for it: of five or more, three tenths are held out whole,
        of fewer the last three tenths of each. Modes, and smooth laws of one mode, are identified
        without them and rolled out over them, which takes up to five fits more. That is done when
        it is first asked for; the answer is kept, and saved with the model.

        Raises
        ------
        AttributeError
            If nothing is fitted, or the model comes from a file, which holds no recordings.
        ValueError
            If the recordings are too short to hold some samples out.
        """
        check_fitted(self)
        known = vars(self).get("_verdict")
        if known is None:
            known = self._verdict = self._judged()
        return known

    @property
    def _holds(self) -> tuple[str, ...]:
        """What inputs do between samples; of models that were saved before it was told, nothing."""
        return vars(self).get("input_holds_", ())

    def _stepped(self, given: Given) -> Given:
        """With the limits of inputs that keep their value until the next row."""
        return given.held(self._holds) if given.n_inputs == len(self._holds) else given

    def _with_hold(self, options: dict[str, object]) -> dict[str, object]:
        """Options of `simulate`: held are inputs all of which were, others are on lines."""
        alike = next((one for one in (Hold.ROW, Hold.NEXT) if {*self._holds} == {one}), Hold.LINE)
        return {"input_hold": str(alike)} | options

    def _keep(self, given: Given | None) -> None:
        """The recordings of a fit, nothing of which is known yet."""
        self._recordings = given
        self._verdict = None

    @failing_in_words
    def _judged(self) -> SwitchingVerdict:
        given = vars(self).get("_recordings")
        if given is None:
            raise AttributeError(
                "verdict_ needs the recordings, which neither the file of a model holds nor a fit "
                "of many that are read when they are asked for; fit them, or some, again."
            )
        split = hold_out(given.places, JUDGING.fraction, 0)
        n_left = np.bincount(given.places[split.train])
        least = n_left[n_left > 0].min()
        if least < FEWEST_SAMPLES:
            raise ValueError(
                f"The recordings are too short for a verdict: with {JUDGING.fraction:.0%} held "
                f"out, one keeps {least} samples, and {FEWEST_SAMPLES} are the least; give longer "
                "ones, or five or more of them, of which whole ones are held out."
            )
        asked = self._asked(given, split)
        held_out, n_modes = asked.held_out, asked.n_modes
        judge = Judge(held_out, Terms.of(asked.library, held_out.n_columns))
        return judge.verdict(self, judge.judged(self, n_modes), n_modes, words=asked.words)

    @abstractmethod
    def _asked(self, given: Given, split: Split) -> Asked:
        """The same fit again, of recordings some of whose rows are held out."""
