r"""Single stays told otherwise, and visits beyond a surface that noise hides.

*Where no surface says in which mode they are*, a round tells all stays at once, by a filter whose
laws are disturbed a little: it may enter a mode briefly to make up for a law that is not right yet,
and with such a stay the laws become right for it. Here each brief stay is put in every other mode,
that of a neighbour ends it, and what that does to the likelihood is found with the laws as they
are: states and instants around the stay are those of the highest likelihood. All these trials are
descended side by side.

*At a surface*, where a recording turns back within its noise, stays and surface agree with each
other whether it was beyond or not: the surface moves by as much. Both can only be tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from swsysid._results import Array
from swsysid._stays.descent import most_likely
from swsysid._stays.laws import slopes_of
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.nodes import Nodes, Rows
from swsysid._stays.recordings import Piece
from swsysid._stays.samples import states_of
from swsysid._stays.settings import StaySettings
from swsysid._stays.sliding import SlidingLaws, pairs_of, slides_there
from swsysid._stays.stays import Stays


@dataclass(frozen=True)
class _Trial:
    """A stay of a recording in another mode, or as it is, and the piece around it."""

    piece: Piece
    stay: int
    mode: int
    stays: Stays  # of the piece

    @property
    def place(self) -> tuple[int, int]:
        """Recording and stay."""
        return self.piece.recording, self.stay


def retold(
    estimate: Estimate, noise: Array, settings: StaySettings, prices: Array
) -> Estimate | None:
    """The stays with those in another mode that are likelier there; None if there are none.

    `prices` (n_modes, n_modes) of a switch from one mode to another are in nats.
    """
    trials = _trials(estimate, settings)
    if not trials:
        return None
    values = _values(estimate, trials, noise, settings)
    values += [prices[one.stays.modes[:-1], one.stays.modes[1:]].sum() for one in trials]
    as_it_is = {one.place: value for one, value in zip(trials, values, strict=True)
                if one.mode == _mode(estimate, one)}  # fmt: skip
    gains = np.array([
        as_it_is[one.place] - value for one, value in zip(trials, values, strict=True)
    ])  # fmt: skip
    chosen = _apart(trials, gains, settings.nearly_converged)
    if not chosen:
        return None
    stays = list(estimate.nodes.stays)
    # the last stays of a recording first: the numbers of those before stay as they are
    for one in sorted(chosen, key=lambda one: one.place, reverse=True):
        stays[one.piece.recording] = stays[one.piece.recording].told(one.stay, one.mode)
    return replace(estimate, nodes=estimate.nodes.with_stays(stays))


def _mode(estimate: Estimate, one: _Trial) -> int:
    return int(estimate.nodes.stays[one.piece.recording].modes[one.stay])


def _trials(estimate: Estimate, settings: StaySettings) -> list[_Trial]:
    """Every brief stay in every mode."""
    recordings = estimate.nodes.recordings
    longest = settings.brief * recordings.per_sample
    around = settings.around_brief * recordings.per_sample
    trials = []
    for k, (own, t) in enumerate(zip(estimate.nodes.stays, recordings.times, strict=True)):
        edges = np.searchsorted(t, np.concatenate([[t[0]], own.instants, [t[-1]]])).tolist()
        for stay, (first, last) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
            if last - first > longest or len(own.modes) == 1:
                continue
            begin, end = max(0, first - around), min(len(t) - 1, last + around)
            piece = Piece(k, begin, end, first, last)
            within = t[begin : end + 1]
            for mode in estimate.laws.modes:
                told = own.told(stay, mode).inside(within)
                trials.append(_Trial(piece, stay, mode, told))
    return trials


def _values(
    estimate: Estimate, trials: Sequence[_Trial], noise: Array, settings: StaySettings
) -> Array:
    """Half the squares of each trial where its states and instants suit it best.

    Loose ties bound them from below: where these already leave far more than the stay as it is,
    nothing else is asked.
    """
    recordings = estimate.nodes.recordings.with_guess(states_of(estimate))
    parted = recordings.parted([one.piece for one in trials])
    nodes = Nodes(parted, [one.stays for one in trials])
    first = Estimate(estimate.laws.known(), nodes, parted.in_a_row(parted.guess))
    *loose, last = settings.ties[-2:]
    if not loose:
        return _reached(first, noise, settings, last)[1]
    roughly = replace(settings, converged=settings.roughly_converged)
    rough, values = _reached(first, noise, roughly, *loose)
    begun = Objective(noise, last[0]).by_recording(first)
    as_it_is = {one.place: value for one, value in zip(trials, begun, strict=True)
                if one.mode == _mode(estimate, one)}  # fmt: skip
    most = [as_it_is[one.place] + settings.hopeless for one in trials]
    kept = np.flatnonzero(values <= most)
    values[kept] = _reached(_some(rough, kept), noise, settings, last)[1]
    return values


def _reached(
    first: Estimate, noise: Array, settings: StaySettings, tie: tuple[float, int]
) -> tuple[Estimate, Array]:
    """The estimate of highest likelihood, and what each recording adds to its value.

    A step is taken or not for all recordings at once, by the sum of what they leave: where one is
    hopeless it may raise what another left. Of each the better of its start and its end is kept.
    """
    reached = most_likely(first, noise, replace(settings, ties=(tie,)))
    begun, ended = (reached.objective.by_recording(one) for one in (first, reached.estimate))
    better = ended <= begun
    if better.all():
        return reached.estimate, ended
    guess = np.where(better[:, None], states_of(reached.estimate), states_of(first))
    recordings = first.nodes.recordings.with_guess(guess)
    both = zip(first.nodes.stays, reached.estimate.nodes.stays, better, strict=True)
    stays = [end if is_better else begin for begin, end, is_better in both]
    kept = replace(first, nodes=Nodes(recordings, stays), states=recordings.in_a_row(guess))
    return kept, np.where(better, ended, begun)


def _some(estimate: Estimate, kept: Rows) -> Estimate:
    """The same of some recordings."""
    recordings = estimate.nodes.recordings.with_guess(states_of(estimate))
    ends = recordings.lengths - 1
    own = recordings.parted([Piece(k, 0, ends[k], 0, ends[k]) for k in kept.tolist()])
    nodes = Nodes(own, [estimate.nodes.stays[k] for k in kept.tolist()])
    return replace(estimate, nodes=nodes, states=own.in_a_row(own.guess))


def _apart(trials: Sequence[_Trial], gains: Array, least: float) -> list[_Trial]:
    """The trials that gain most, none within the piece of another."""
    chosen: list[_Trial] = []
    for number in np.argsort(-gains, kind="stable").tolist():
        if gains[number] <= least:
            break
        one = trials[number]
        if not any(_overlap(one.piece, other.piece) for other in chosen):
            chosen.append(one)
    return chosen


def _overlap(one: Piece, other: Piece) -> bool:
    same = one.recording == other.recording
    return same and one.begin < other.end and other.begin < one.end


class Visit(NamedTuple):
    """A stay that a recording has, or may have, amid another mode."""

    distance: float  # of its turn from the surface, in deviations of the noise; less is likelier
    recording: int
    mode: int
    begin: float  # minus infinity where the recording begins
    end: float


class Turns:
    """Where recordings are near the surfaces of an estimate."""

    def __init__(self, estimate: Estimate, noise: Array, beyond_slide: float):
        assert estimate.guards is not None
        self.estimate, self.pairs = estimate, pairs_of(len(estimate.laws.coef))
        recordings = estimate.nodes.recordings.with_guess(states_of(estimate))
        columns = np.concatenate([recordings.guess, recordings.u], axis=2)
        self.distances = self._of_pairs(columns.reshape(-1, columns.shape[2]), noise)
        self.distances = self.distances.reshape(*columns.shape[:2], -1)
        laws = SlidingLaws.of(estimate.laws, estimate.guards)
        self.slides = slides_there(laws, recordings, noise, beyond_slide)

    def missed(self, near: float) -> list[Visit]:
        """Visits that recordings may have made where they turn back, the likeliest first.

        Where both laws point at the surface they may have slid along it.
        """
        found = [
            visit
            for recording, stays in enumerate(self.estimate.nodes.stays)
            for pair, (first, second) in enumerate(self.pairs.tolist())
            for modes in ((first, second), (second, first))
            for visit in self._turns(recording, stays, pair, modes, near)
        ]
        return sorted(found)

    def made(self, near: float) -> list[Visit]:
        """Visits that go no further beyond a surface, the least far first."""
        found = []
        numbers = {frozenset(pair): k for k, pair in enumerate(self.pairs.tolist())}
        for recording, stays in enumerate(self.estimate.nodes.stays):
            t = self.estimate.nodes.recordings.times[recording]
            edges = np.concatenate([[-np.inf], stays.instants, [np.inf]])
            for k, mode in enumerate(stays.modes.tolist()):
                around = stays.modes[max(0, k - 1) : k + 2].tolist()
                pair = numbers.get(frozenset(around))
                inside = np.flatnonzero((t > edges[k]) & (t <= edges[k + 1]))
                if pair is not None and inside.size:
                    depth = float(np.abs(self.distances[inside, recording, pair]).max())
                    found.append(Visit(depth, recording, mode, edges[k], edges[k + 1]))
        return sorted(visit for visit in found if visit.distance < near)

    def _turns(
        self,
        recording: int,
        stays: Stays,
        pair: int,
        modes: tuple[int, int],
        near: float,
    ) -> list[Visit]:
        """Visits of the second mode where a stay in the first one turns back."""
        mode, other = modes
        sign = 1.0 if mode < other else -1.0
        t = self.estimate.nodes.recordings.times[recording]
        here = stays.at(t) == mode
        own = np.where(here, sign * self.distances[: len(t), recording, pair], np.inf)
        before, after = np.append(np.inf, own[:-1]), np.append(own[1:], np.inf)
        turns = (own < near) & (own <= before) & (own < after)
        # next to another mode it is no turn but a crossing
        turns[1:] &= here[:-1]
        turns[:-1] &= here[1:]
        middles = np.concatenate([[-np.inf], 0.5 * (t[1:] + t[:-1]), [np.inf]])
        visits = []
        for place in np.flatnonzero(turns).tolist():
            close = np.flatnonzero(own >= own[place] + 1.0)
            first = int(close[close < place].max(initial=-1)) + 1
            last = int(close[close > place].min(initial=len(t)))
            slid = self.slides[max(0, place - 1) : place + 1, recording, pair].any()
            new = len(self.estimate.laws.coef) + pair if slid else other
            visits.append(Visit(float(own[place]), recording, new, middles[first], middles[last]))
        return visits

    def _of_pairs(self, columns: Array, noise: Array) -> Array:
        """Distances on the side of the first mode of each pair, (n_rows, n_pairs)."""
        guards, n_states = self.estimate.guards, len(noise)
        assert guards is not None
        basis, slopes = slopes_of(guards.features, columns, guards.spread[:n_states])
        gradients = np.einsum("lf,kfc->klc", guards.coef, slopes)
        blurs = np.sqrt(np.square(gradients * noise).sum(axis=2))
        values = basis @ guards.coef.T
        values = np.divide(values, blurs, out=np.full(values.shape, np.inf), where=blurs > 0.0)
        first, second = guards.mode_book[self.pairs].transpose(1, 0, 2)
        apart = first * second < 0
        surfaces = apart.argmax(axis=1)
        signs = first[np.arange(len(surfaces)), surfaces]
        return np.where(apart.sum(axis=1) == 1, values[:, surfaces] * signs, np.inf)


def with_visits(estimate: Estimate, visits: Sequence[Visit]) -> Estimate:
    """The same with visits that were missed."""
    stays = list(estimate.nodes.stays)
    for visit in visits:
        stays[visit.recording] = _with(stays[visit.recording], visit)
    return _with_stays(estimate, stays)


def without_visits(estimate: Estimate, visits: Sequence[Visit]) -> Estimate:
    """The same without visits that were made."""
    stays = list(estimate.nodes.stays)
    for visit in visits:
        stays[visit.recording] = _without(stays[visit.recording], visit)
    return _with_stays(estimate, stays)


def _with(stays: Stays, visit: Visit) -> Stays:
    """Stays with one more amid one of them."""
    place = int(np.searchsorted(stays.instants, visit.begin))
    modes = np.insert(stays.modes, place + 1, [visit.mode, stays.modes[place]])
    instants = np.insert(stays.instants, place, [visit.begin, visit.end])
    # a visit at the begin or the end of a recording has no stay on its other side
    kept = (np.append(instants, np.inf) > -np.inf) & (np.append(-np.inf, instants) < np.inf)
    return Stays(modes[kept], instants[np.isfinite(instants)])


def _without(stays: Stays, visit: Visit) -> Stays:
    """Stays without one of them, those around it joined; the only one stays."""
    begins = np.append(-np.inf, stays.instants)
    kept = begins != visit.begin
    if not kept.any():
        return stays
    modes = stays.modes[kept]
    new = np.append(True, np.diff(modes) != 0)
    return Stays(modes[new], begins[kept][new][1:])


def _with_stays(estimate: Estimate, stays: list[Stays]) -> Estimate:
    times = estimate.nodes.recordings.times
    within = [one.within(t) for one, t in zip(stays, times, strict=True)]
    return replace(estimate, nodes=estimate.nodes.with_stays(within))
