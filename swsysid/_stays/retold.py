r"""Single stays told otherwise, where no surface says in which mode they are.

A round tells all stays at once, by a filter whose laws are disturbed a little: it may enter a mode
briefly to make up for a law that is not right yet, and with such a stay the laws become right for
it. Here each brief stay is put in every other mode, that of a neighbour ends it, and what that does
to the likelihood is found with the laws as they are: states and instants around the stay are those
of the highest likelihood. All these trials are descended side by side.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from swsysid._results import Array
from swsysid._stays.descent import most_likely
from swsysid._stays.lifted import Estimate
from swsysid._stays.nodes import Nodes
from swsysid._stays.recordings import Piece
from swsysid._stays.samples import states_of
from swsysid._stays.settings import StaySettings
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
    """Half the squares of each trial where its states and instants suit it best."""
    recordings = estimate.nodes.recordings.with_guess(states_of(estimate))
    parted = recordings.parted([one.piece for one in trials])
    nodes = Nodes(parted, [one.stays for one in trials])
    first = Estimate(estimate.laws.known(), nodes, parted.in_a_row(parted.guess))
    reached = most_likely(first, noise, settings, near=True)
    return reached.objective.by_recording(reached.estimate)


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
