"""The search for laws and stays, which cuts recordings where the laws at hand say that they jump.

Before any law is known only large jumps are seen. With the laws of an answer smaller ones are, and
recordings that are cut there are told anew; that pays for the states in which the pieces begin.
Answers with more modes begin with the recordings as they were: where modes are missing, what looks
like a jump may be one of these.

*That it jumps*: the most likely modes are sought once more with every mode there twice, entered
with the state going on, or by a jump, after which nothing is known of the state but its spread.
What the samples after it say of the state then pays for a jump, or does not.

*Where it does*: from some samples before a cut the old law is followed over it, from some after it
the new one is followed back. Where the samples leave the one for the other, the recording jumps.

*What it does there*: stays are taken apart from each other, each with states of its own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.settings import SETTINGS
from swsysid._data.recordings import Record
from swsysid._journal import step
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.assign import disturbances
from swsysid._stays.count import CountCandidate, criterion, fewest_modes
from swsysid._stays.decoding import decode
from swsysid._stays.descent import most_likely
from swsysid._stays.filtering import FlowFilter
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification, leaves_noise
from swsysid._stays.intervals import flow
from swsysid._stays.knowledge import NOTHING, Knowledge
from swsysid._stays.laws import Laws
from swsysid._stays.lifted import Estimate
from swsysid._stays.nodes import Nodes
from swsysid._stays.pieces import Pieces, cut_at
from swsysid._stays.recordings import Recordings, pieces_of
from swsysid._stays.samples import modes_of, states_of
from swsysid._stays.search import Search
from swsysid._stays.settings import StaySettings
from swsysid._stays.stays import Stays
from swsysid._stays.walk import Walk
from swsysid._stays.walking import beside_walk
from swsysid._ties import least_of

# What most recordings may leave, in units of the noise, where laws are believed; how many samples a
# cut moves at most; squares of one that is lost.
_MOST_USUAL_EXCESS = 2.0
_FARTHEST_PLACE, _LOST = 10, 1e4
_FEWEST = 3  # samples of a piece: two for a position and its speed, one that speaks for them


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


def search_of(
    estimator: SwitchingSystemRegressor,
    pieces: Pieces,
    settings: StaySettings,
    told: Callable[[], object],
    knowledge: Knowledge,
) -> Search:
    """What is sought in pieces, without a surface: guards come after the stays."""
    return Search(
        estimator, pieces.given.sensed, pieces.given.order, None, settings, told,
        surfaces=False, knowledge=knowledge,
    )  # fmt: skip


class Cutting:
    """One search; `told` is called now and then, to show that it goes on."""

    def __init__(
        self,
        estimator: SwitchingSystemRegressor,
        given: Given,
        settings: StaySettings,
        told: Callable[[], object],
        knowledge: Knowledge = NOTHING,
    ):
        self.estimator, self.given, self.settings, self.told = estimator, given, settings, told
        self.knowledge = knowledge
        self.first: Pieced  # cut where everybody sees that it jumps
        self.fewer: StayIdentification | None = None  # the last answer on that
        self.walk: Walk | None = None  # of the states beside the laws
        self.still: list[Cut] = []  # asked in vain whether states walk
        self.answers: list[Cut] = []
        self.candidates: list[CountCandidate] = []

    def identified(self, jumps: list[NDArray[np.intp]]) -> Cut:
        """The most likely laws and modes, from jumps that are known to further ones."""
        self.first = self._at(jumps)
        with Search.quietly():
            if self.estimator.n_modes != "auto":
                return self._walking(self._of(self._with_modes(self.estimator.n_modes)))
            counts = self.first.search.counts
            found, self.candidates = fewest_modes(
                self._with_modes, self._merged, counts, self._explains
            )
            return self._walking(self._of(found))

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
        cut = self._jumping(self.first, self.fewer)
        # two are always asked for: further ones would make up for what walks
        return (self._walking(cut) if n_modes == 2 else cut).stays

    def _merged(self, more: StayIdentification) -> StayIdentification | None:
        cut = self._of(more)
        fewer = cut.search.with_one_fewer(more)
        return None if fewer is None else self._jumping(cut, fewer).stays

    def _walking(self, cut: Cut) -> Cut:
        """The answer beside a random walk of the states, where that is all that laws leave.

        It is told from recordings as they were, what walks looks like jumps, too; where fewer
        modes do as well beside it, they are the answer.
        """

        def again(walk: Array, now: StayIdentification) -> StayIdentification:
            self.first.search.walk = walk
            return self._told_anew(self.first, now, roughly=True).stays

        if self.walk is not None or any(cut is one for one in self.still):
            return cut
        if (told := beside_walk(cut.stays, self.first.search, again)) is None:
            self.first.search.walk = None
            self.still.append(cut)
            return cut
        stays, self.walk = told
        n_modes = len(stays.estimate.laws.coef)
        fewer = [one for one in self.answers if len(one.stays.estimate.laws.coef) < n_modes]
        tried = stays, *(one.stays for one in fewer)
        every = [self._told_anew(self.first, one).stays for one in tried]
        best = least_of(every, lambda one: criterion(len(one.estimate.laws.coef), one).criterion)
        return self._jumping(self.first, best)

    def _explains(self, found: StayIdentification) -> bool:
        """Whether no mode could explain more; states that are no rollout yet say nothing of it."""
        reached, noise = found.reached, self.first.search.base.noise
        if found.estimate.nodes.recordings.walk is not None:  # which explains all that laws leave
            return True
        return reached.is_joined and leaves_noise(reached, noise)

    def _jumping(self, at: Pieced, found: StayIdentification) -> Cut:
        """The answer with further jumps, as long as they are worth it."""
        cut = first = Cut(at.jumps, at.pieces, at.search, found)
        most = SETTINGS.excess(self.given.n_samples)
        for _ in range(SETTINGS.most_rounds):
            further = self._further(cut)
            if further is None:
                break
            cut = further
            if cut.excess > most:  # more is missing than jumps
                break
        if cut is not first and cut.excess <= most:
            cut = self._told_anew(cut, cut.stays)
        self.answers.append(cut)
        return cut

    def _further(self, now: Cut) -> Cut | None:
        """With the jumps that its own laws see, if that is better."""
        usual = now.search.usual_excess(now.stays)
        if usual > _MOST_USUAL_EXCESS or not now.stays.reached.is_joined:  # laws say nothing yet
            return None
        more = hidden_jumps(now.stays, now.pieces, len(now.jumps), self.settings)
        jumps = [np.union1d(*both).astype(np.intp) for both in zip(now.jumps, more, strict=True)]
        if all(map(np.array_equal, jumps, now.jumps)):
            return None
        told = self._told_anew(self._at(jumps), now.stays, roughly=True)
        self.told()
        if not told.stays.reached.is_joined:
            told = self._told_anew(told, now.stays)
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
        pieces = cut_at(self.given, jumps, _FEWEST)
        search = search_of(self.estimator, pieces, self.settings, self.told, self.knowledge)
        search.walk = None if self.walk is None else self.walk.walk
        return Pieced(jumps, pieces, search)

    def _of(self, found: StayIdentification) -> Cut:
        return next(one for one in self.answers if one.stays is found)


def hidden_jumps(
    found: StayIdentification, pieces: Pieces, n_recordings: int, settings: StaySettings
) -> list[NDArray[np.intp]]:
    """Of each recording the samples after which it jumps amid the pieces."""
    estimate = found.estimate
    laws, n_modes = estimate.laws, len(estimate.laws.coef)
    recordings = estimate.nodes.recordings.with_guess(states_of(estimate))
    twice = replace(laws, coef=np.tile(laws.coef, (2, 1, 1)), free=np.tile(laws.free, (2, 1, 1)))
    least = disturbances(laws, recordings, settings)[-1]
    parted, places = recordings.cut(settings.piece, settings.overlap)
    # the second ones are entered by a jump: the state is known by its spread alone
    wide = np.outer(np.square(laws.spread), np.arange(2 * n_modes) >= n_modes)
    spans = pieces_of(recordings.spans, places)
    filter_ = replace(FlowFilter.of(twice, parted, found.left, least, spans), entering=wide)
    price = float(np.log(recordings.lengths.sum()))
    told = decode(filter_, parted, price=price, n_kept=settings.n_kept).modes
    jumps: list[list[int]] = [[] for _ in range(n_recordings)]
    for number, piece in enumerate(places):
        own = told[piece.first - piece.begin : piece.last - piece.begin, number]
        jumped = np.flatnonzero((np.diff(own) != 0) & (own[1:] >= n_modes)) + 1 + piece.first
        sampled = recordings.sampled[piece.recording]
        after = np.searchsorted(sampled, jumped, side="right") - 1
        first = pieces.first[piece.recording]
        jumps[int(pieces.recording[piece.recording])].extend((first + after).tolist())
    return [_apart(np.unique(np.array(own, dtype=np.intp))) for own in jumps]


def _apart(jumps: NDArray[np.intp]) -> NDArray[np.intp]:
    """Jumps with samples enough between them.

    A sample between two is that of one jump. What is longer, and too short to be told, is no jump
    but a mode of its own.
    """
    kept = jumps[np.diff(jumps, prepend=-np.inf) > 1]
    after, before = np.diff(kept, append=np.inf), np.diff(kept, prepend=-np.inf)
    return kept[np.minimum(before, after) >= _FEWEST]


def better_places(
    given: Given, found: StayIdentification, pieces: Pieces, jumps: list[NDArray[np.intp]]
) -> list[NDArray[np.intp]]:
    """Of each recording the samples after which it jumps, where a cut fits best."""
    laws, noise = found.estimate.laws, found.left
    modes, states = by_samples(given, found, pieces)
    places = []
    for record, own, x, cuts in zip(given.records, modes, states, jumps, strict=True):
        edges = np.concatenate([[-1], cuts, [len(own) - 1]])
        moved = [
            _better_place(laws, noise, record, own, x, *edges[k : k + 3])
            for k in range(len(cuts))
        ]  # fmt: skip
        places.append(np.unique(np.array(moved, dtype=np.intp)))
    return places


def _better_place(
    laws: Laws,
    noise: Array,
    record: Record,
    modes: NDArray[np.intp],
    states: Array,
    before: int,
    cut: int,
    after: int,
) -> int:
    """The sample of one recording after which it jumps; its neighbours stay where they are."""
    first = _reach(modes, cut, max(before + 1, cut - _FARTHEST_PLACE), -1)
    last = _reach(modes, cut + 1, min(after, cut + 1 + _FARTHEST_PLACE), 1)
    samples = np.arange(first, last + 1)
    if min(modes[cut], modes[cut + 1]) < 0 or len(samples) < SETTINGS.fewest_of_a_stay:
        return cut
    old = _followed(laws, int(modes[cut]), record, states[first], samples)
    new = _followed(laws, int(modes[cut + 1]), record, states[last], samples[::-1])[::-1]
    old, new = (_squares(record.y[samples], path, noise) for path in (old, new))
    costs = np.cumsum(old)[:-1] + np.cumsum(new[::-1])[::-1][1:]
    best = int(costs.argmin())
    return first + best if costs[best] < costs[cut - first] - 1.0 else cut


def _squares(y: Array, path: Array, noise: Array) -> Array:
    """Of each sample the squares by which a path misses it; none of what was not measured."""
    missed = np.where(np.isfinite(path), np.square((y - path) / noise), _LOST)
    return np.asarray(np.where(np.isfinite(y), missed, 0.0).sum(axis=1).clip(max=_LOST))


def _reach(modes: NDArray[np.intp], start: int, end: int, step: int) -> int:
    """The last sample on the way that is in the mode of the first one."""
    way = np.arange(start, end + step, step)
    other = np.flatnonzero(modes[way] != modes[start])
    return int(way[-1] if not len(other) else way[other[0] - 1])


def _followed(
    laws: Laws, mode: int, record: Record, start: Array, samples: NDArray[np.intp]
) -> Array:
    """States at samples one after the other, by one law, forwards or back in time."""
    x, path, which = start[None], [start], np.array([mode])
    for here, there in zip(samples[:-1].tolist(), samples[1:].tolist(), strict=True):
        duration = record.t[[there]] - record.t[here]
        x = flow(laws, which, x, record.u[[here]], record.u[[there]], duration)
        path.append(x[0])
    return np.array(path)


@step
def apart(
    given: Given, found: StayIdentification, pieces: Pieces, settings: StaySettings
) -> tuple[StayIdentification, Pieces]:
    """The same stays, each a piece of its own that starts where its own samples say."""
    modes, states = by_samples(given, found, pieces)
    cuts = [
        np.union1d(np.flatnonzero(np.diff(own)), pieces.last[pieces.recording == k])
        for k, own in enumerate(modes)
    ]
    alone = cut_at(
        given,
        [own[own < len(own_modes) - 1] for own, own_modes in zip(cuts, modes, strict=True)],
        _FEWEST,
    )
    first = np.array(
        [modes[k][place] for k, place in zip(alone.recording, alone.first, strict=True)]
    )
    alone, first = alone.take(first >= 0), first[first >= 0]
    rough = [
        states[k][a : b + 1]
        for k, a, b in zip(alone.recording, alone.first, alone.last, strict=True)
    ]
    recordings = Recordings.of(alone.given.records, rough)
    parts = found.estimate.nodes.recordings.per_sample
    before = found.estimate.nodes.recordings
    recordings = replace(recordings.divided(parts), first_step=before.first_step, walk=before.walk)
    stays = [Stays(np.array([mode]), np.zeros(0)) for mode in first]
    nodes = recordings.in_a_row(recordings.guess)
    estimate = Estimate(found.estimate.laws, Nodes(recordings, stays), nodes)
    reached = most_likely(estimate, found.reached.noise, settings.roughly(), near=True)
    return replace(found, reached=reached), alone


def by_samples(
    given: Given, found: StayIdentification, pieces: Pieces
) -> tuple[list[NDArray[np.intp]], list[Array]]:
    """Modes and states at the samples of each recording.

    Where no piece tells, the mode is -1 and the state as it was measured.
    """
    recordings = found.estimate.nodes.recordings
    parts = np.cumsum([len(places) for places in recordings.sampled])[:-1]
    of_pieces = np.split(modes_of(found.estimate), parts)
    states_of_pieces = np.split(recordings.joined(states_of(found.estimate)), parts)
    lengths = [len(record.t) for record in given.records]
    modes = [np.full(n, -1, dtype=np.intp) for n in lengths]
    states = [record.filled.copy() for record in given.records]
    for k, first, last, mode, state in zip(
        pieces.recording, pieces.first, pieces.last, of_pieces, states_of_pieces, strict=True
    ):
        modes[k][first : last + 1], states[k][first : last + 1] = mode, state
    return modes, states
