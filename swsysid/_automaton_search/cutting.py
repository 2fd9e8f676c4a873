"""The search for laws and stays, which cuts recordings where the laws at hand say that they jump.

Before any law is known only large jumps are seen. With the laws of an answer smaller ones are, and
recordings that are cut there are told anew; that pays for the states in which the pieces begin.
Answers with more modes begin with the recordings as they were: where modes are missing, what looks
like a jump may be one of these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.hidden_jumps import hidden_jumps
from swsysid._automaton_search.places import better_places
from swsysid._automaton_search.settings import SETTINGS
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._stays.count import CountCandidate, criterion, fewest_modes
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.pieces import Pieces, cut_at
from swsysid._stays.search import Search
from swsysid._stays.settings import StaySettings


@dataclass(frozen=True)
class Pieced:
    """Recordings cut where they jump, and the search on the pieces."""

    jumps: list[NDArray[np.intp]]  # of each recording the samples after which it jumps
    pieces: Pieces
    search: Search


@dataclass(frozen=True)
class Cut(Pieced):
    """The same with an answer."""

    stays: StayIdentification

    @property
    def excess(self) -> float:
        """The most that the laws leave of a state, in units of its noise."""
        return float(self.search.excess(self.stays).max())

    @property
    def cost(self) -> float:
        """The information criterion, by which answers are compared."""
        return criterion(len(self.stays.estimate.laws.coef), self.stays).criterion


class Cutting:
    """One search; `told` is called now and then, to show that it goes on."""

    def __init__(
        self,
        estimator: SwitchingSystemRegressor,
        given: Given,
        settings: StaySettings,
        told: Callable[[], object],
    ):
        self.estimator, self.given, self.settings, self.told = estimator, given, settings, told
        self.first: Pieced  # cut where everybody sees that it jumps
        self.fewer: StayIdentification | None = None  # the last answer on that
        self.answers: list[Cut] = []
        self.candidates: list[CountCandidate] = []

    def identified(self, jumps: list[NDArray[np.intp]]) -> Cut:
        """The most likely laws and modes, from jumps that are known to further ones."""
        self.first = self._at(jumps)
        with Search.quietly():
            if self.estimator.n_modes != "auto":
                return self._of(self._with_modes(self.estimator.n_modes))
            counts = self.first.search.counts
            found, self.candidates = fewest_modes(self._with_modes, self._merged, counts)
            return self._of(found)

    def again(self, cut: Cut, jumps: list[NDArray[np.intp]]) -> Cut:
        """The answer on other pieces, from the laws at hand, cut where these say that it jumps."""
        with Search.quietly():
            told = self._told_anew(self._at(jumps), cut.stays)
            for _ in range(SETTINGS.most_rounds):
                places = better_places(self.given, told.stays, told.pieces, told.jumps)
                if all(map(np.array_equal, places, told.jumps)):
                    break
                told = self._told_anew(self._at(places), told.stays)
            return told

    def _with_modes(self, n_modes: object, _: object = None) -> StayIdentification:
        """With so many modes, from the answer with fewer on the recordings as they were."""
        self.fewer = self.first.search.with_modes(n_modes, self.fewer)
        return self._jumping(self.first, self.fewer).stays

    def _merged(self, more: StayIdentification) -> StayIdentification | None:
        cut = self._of(more)
        fewer = cut.search.with_one_fewer(more)
        return None if fewer is None else self._jumping(cut, fewer).stays

    def _jumping(self, at: Pieced, found: StayIdentification) -> Cut:
        """The answer with further jumps, as long as they are worth it."""
        cut = first = Cut(at.jumps, at.pieces, at.search, found)
        for _ in range(SETTINGS.most_rounds):
            further = self._further(cut)
            if further is None:
                break
            cut = further
            if cut.excess > SETTINGS.most_excess:  # more is missing than jumps
                break
        if cut is not first and cut.excess <= SETTINGS.most_excess:
            cut = self._told_anew(cut, cut.stays)
        self.answers.append(cut)
        return cut

    def _further(self, now: Cut) -> Cut | None:
        """With the jumps that its own laws see, if that is better."""
        usual = now.search.usual_excess(now.stays)
        if usual > SETTINGS.most_usual_excess:  # laws say nothing yet
            return None
        more = hidden_jumps(now.stays, now.pieces, len(now.jumps), self.settings)
        jumps = [np.union1d(*both).astype(np.intp) for both in zip(now.jumps, more, strict=True)]
        if all(map(np.array_equal, jumps, now.jumps)):
            return None
        told = self._told_anew(self._at(jumps), now.stays, roughly=True)
        self.told()
        return told if told.cost < now.cost else None

    def _told_anew(self, at: Pieced, before: StayIdentification, *, roughly: bool = False) -> Cut:
        """Stays told anew, from the laws at hand; roughly by the first rounds."""
        search = at.search
        alternation = search.alternation(
            before.model, before.estimate.laws.free, search.base.recordings
        )
        begun = alternation.begin()
        stays = begun if roughly else alternation.finish(self.told)
        return Cut(at.jumps, at.pieces, search, stays)

    def _at(self, jumps: list[NDArray[np.intp]]) -> Pieced:
        pieces = cut_at(self.given, jumps)
        search = Search(
            self.estimator, pieces.given, 1, None, self.settings, self.told, surfaces=False
        )
        return Pieced(jumps, pieces, search)

    def _of(self, found: StayIdentification) -> Cut:
        return next(one for one in self.answers if one.stays is found)
