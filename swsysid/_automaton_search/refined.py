"""The automaton of highest likelihood: laws, guards and resets refined together.

They begin with the ways of the recordings through its modes, their courses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.assembly import Assembled, assembled
from swsysid._automaton_search.cutting import by_samples
from swsysid._automaton_search.elsewhere import slopes_from
from swsysid._automaton_search.found import Told, place_of
from swsysid._automaton_search.guards import met, missed_by_all
from swsysid._automaton_search.instants import Settled
from swsysid._automaton_search.joint import Joint, JointEstimate, jointly
from swsysid._automaton_search.refinement import DIVERGED, AutomatonRefinement, FreeRollouts
from swsysid._automaton_search.settings import SETTINGS
from swsysid._automaton_search.switches import Switches
from swsysid._automaton_search.transition_guards import TransitionGuards
from swsysid._data.recordings import Record
from swsysid._journal import step
from swsysid._results import Array
from swsysid._stays.certainty import propagated
from swsysid._stays.given import Given
from swsysid._stays.identification import StayIdentification
from swsysid._stays.nodes import Nodes
from swsysid._stays.origin import Origin
from swsysid._stays.pieces import Pieces
from swsysid._stays.recordings import Recordings
from swsysid._stays.resets import Resets
from swsysid._stays.settings import StaySettings
from swsysid._stays.stays import Stays

_WORSE = 0.05  # part by which rollouts of the recordings may be worse by chance


@step
def refined(
    given: Given,
    stays: StayIdentification,
    pieces: Pieces,
    found: list[Settled],
    settings: StaySettings,
    origin: Origin,
) -> tuple[Told, AutomatonRefinement]:
    """The automaton refined, or as it was found where rollouts of the recordings became worse.

    Its standard errors are those of columns that are not counted from the `origin`.
    """
    parts = told_by_parts(given, stays, pieces, found)
    start, noise = joint_estimate(given, stays, pieces, found), stays.reached.noise
    joint = jointly(start, noise, settings)
    told = told_jointly(joint.after, parts, stays, pieces, found)
    told = told.on_samples([record.t for record in given.records])
    interval = stays.estimate.nodes.recordings.interval
    before, after = (assembled(one, stays) for one in (parts, told))
    free = FreeRollouts.of(after, joint.after)
    rolled_before = FreeRollouts.of(before, joint.before).misfit(noise)
    rolled_after = free.misfit(noise)
    likely = joint.value_after <= min(joint.value_before + settings.converged, DIVERGED)
    # those of states that walk lead away whatever the automaton
    walks = stays.estimate.nodes.recordings.walk is not None
    kept = likely and (walks or rolled_after <= (1.0 + _WORSE) * rolled_before)
    told = _judged_by_rollouts(told, free, joint, interval)
    after = assembled(told, stays)
    return (told if kept else parts), AutomatonRefinement(
        kept,
        joint.value_before,
        joint.value_after,
        rolled_before,
        rolled_after,
        *_errors(joint, after, told, found, origin),
    )


def _judged_by_rollouts(told: Told, free: FreeRollouts, joint: Joint, interval: float) -> Told:
    """The same with guards judged by free rollouts where these explain more of their switches.

    The instants that laws alone tell are off where laws are alike.
    """
    missed = free.missed([(one.source, one.target) for one in told.transitions])
    judged = []
    for number, one in enumerate(told.transitions):
        own = missed[joint.after.nodes.transitions == number]
        if one.guard is not None and len(own):
            rolled = replace(one.guard, misses=own, sure=0.0)
            if rolled.explained(interval) > one.guard.explained(interval):
                one = replace(one, guard=rolled)
        judged.append(one)
    return replace(told, transitions=judged)


def _errors(
    joint: Joint, after: Assembled, told: Told, found: list[Settled], origin: Origin
) -> tuple[Array, tuple[Array, ...], tuple[Array | None, ...], Array]:
    """Standard errors in the order of the automaton's modes and transitions, and the covariance.

    What is not refined, further conditions of a guard and one that steps tell, has errors of its
    own and no share in the covariance.
    """
    automaton, order = after.automaton, after.order
    laws, of_guards, of_resets = slopes_from(origin, joint, automaton.feature_map)
    parts, further = [laws[:, order]], [np.zeros(0)]
    for one in automaton.transitions:
        place = place_of(one, told.transitions, order)
        slopes, own = of_guards[place], found[place].guard
        assert slopes is not None and own is not None, "a transition of the automaton has a guard"
        also = np.concatenate([np.zeros(0), *(part.errors for part in own.also)])
        further.append(np.append(np.where(slopes.any(), 0.0, own.errors), also))
        parts.append(np.hstack([slopes, np.zeros((len(slopes), len(also)))]))
        if one.reset is not None:
            parts.append(of_resets[:, place])
    covariance = propagated(
        np.hstack([part.reshape(len(part), -1) for part in parts]), joint.covariance
    )
    ends = np.cumsum([part[0].size for part in parts])[:-1]
    coef, *others = np.split(np.sqrt(np.clip(np.diag(covariance), 0.0, np.inf)), ends)
    guards, resets = [], []
    for one, also in zip(automaton.transitions, further[1:], strict=True):
        guards.append(others.pop(0) + also)
        resets.append(None if one.reset is None else others.pop(0).reshape(parts[0].shape[2], -1))
    return coef.reshape(parts[0].shape[1:]), tuple(guards), tuple(resets), covariance


def joint_estimate(
    given: Given, stays: StayIdentification, pieces: Pieces, found: list[Settled]
) -> JointEstimate:
    """What was found part by part, as the start of the joint estimate."""
    laws = stays.estimate.laws
    nodes = _nodes_of_courses(given, stays, pieces, found)
    recordings, n_states = nodes.recordings, len(laws.spread)
    sources = np.array([one.transition.source for one in found], dtype=np.intp)
    inputs = nodes.u.std(axis=0)
    clocks = np.full(2, max(float(np.ptp(t)) for t in recordings.times))
    spread = np.concatenate([laws.spread, np.where(inputs > 0.0, inputs, 1.0), clocks])
    guards = TransitionGuards.of_transitions(
        [None if one.guard is None else one.guard.guard for one in found],
        sources,
        len(laws.coef),
        spread,
        np.array([_is_told_by_instants(one) for one in found], dtype=bool),
    )
    resets = Resets.of(
        [
            one.reset.reset if one.reset is not None and one.transition.jumps else None
            for one in found
        ],
        n_states,
    )
    states = recordings.in_a_row(recordings.guess)
    return JointEstimate(laws, nodes, states, guards, resets).pivoted()


def _nodes_of_courses(
    given: Given, stays: StayIdentification, pieces: Pieces, found: list[Settled]
) -> Nodes:
    """Nodes of the courses, steps as long as before, at most one switch between two of them."""
    recordings = stays.estimate.nodes.recordings
    switches = _all_switches(found, recordings.interval)
    begins = first_pieces(pieces, found, stays.reached.noise)
    courses, rows = _courses(stays, pieces, begins, switches)
    _, states = by_samples(given, stays, pieces)
    records, guess = [], []
    for k, own in rows:
        whole = given.records[k]
        records.append(whole.taken(own))
        guess.append(states[k][own])
    steps = recordings.per_sample, recordings.first_step
    return nodes_of(courses, records, guess, *steps, recordings.walk)


def _all_switches(
    found: list[Settled], interval: float
) -> tuple[Switches, NDArray[np.intp], NDArray[np.bool_]]:
    """The switches of all transitions, the number of each one's, and whether a guard tells it."""
    parts = zip(*(vars(one.switches).values() for one in found), strict=True)
    switches = Switches(*(np.concatenate(part) for part in parts))
    number = np.repeat(np.arange(len(found)), [len(one.switches) for one in found])
    return switches, number, np.concatenate([_told(one, interval) for one in found])


def _told(one: Settled, interval: float) -> NDArray[np.bool_]:
    """Switches that a guard explains: others are instants like any."""
    if one.guard is None:
        return np.zeros(len(one.switches), dtype=bool)
    # what is refined is the first condition
    first = True if one.guard.last is None else one.guard.last == 0
    return np.asarray(one.guard.explains(interval) & first & _is_told_by_instants(one))


def _is_told_by_instants(one: Settled) -> bool:
    """Whether its instants say where a guard is.

    Those of steps alone say between which values, and those at samples when it was asked.
    """
    return not (one.switches.in_steps.all() or one.asked_at_samples)


def first_pieces(pieces: Pieces, found: list[Settled], noise: Array) -> NDArray[np.intp]:
    """Pieces with which courses begin: those that no transition leads to from the one before."""
    follows = pieces.follows
    for one in found:
        switches, led = one.switches, np.full(len(one.switches), one.transition.is_one)
        if one.reset is not None:
            off = np.abs(one.reset.left) / (SETTINGS.end_of_stay * noise)
            led &= (off <= SETTINGS.beyond_noise).all(axis=1)
        follows[switches.piece[switches.jumped & ~led]] = False
    return np.flatnonzero(~follows)


def _courses(
    stays: StayIdentification,
    pieces: Pieces,
    begins: NDArray[np.intp],
    switching: tuple[Switches, NDArray[np.intp], NDArray[np.bool_]],
) -> tuple[list[Course], list[tuple[int, slice]]]:
    """Pieces that follow each other make a course; and recording and samples of each."""
    switches, number, told = switching
    first_modes = [one.modes[0] for one in stays.estimate.nodes.stays]
    times = stays.estimate.nodes.recordings.times
    # a jump is seen at the samples beside it, that of a speed which is not measured soon after
    late = stays.estimate.nodes.recordings.interval if pieces.given.n_positions else 0.0
    known = switches.known + late * np.array([-1.0, 1.0])
    between = np.where(switches.jumped[:, None], known, (-np.inf, np.inf))
    courses, rows = [], []
    for begin, end in zip(begins, np.append(begins[1:], len(pieces.first)), strict=True):
        k, first, last = pieces.recording[begin], times[begin][0], times[end - 1][-1]
        inside = (switches.times >= first) & (switches.times <= last)
        own = np.flatnonzero((switches.recording == k) & inside)
        own = own[np.argsort(switches.times[own], kind="stable")]
        # before the sample at which it is seen, and before the last one
        low, high = between[own].T
        high = np.maximum(low, np.nextafter(np.minimum(high, last), first))
        instants = np.clip(switches.times[own], low, high)
        modes = np.append(first_modes[begin], switches.target[own])
        courses.append(Course(modes, instants, number[own], told[own], between[own]))
        rows.append((int(k), slice(pieces.first[begin], pieces.last[end - 1] + 1)))
    return courses, rows


def told_by_parts(
    given: Given, stays: StayIdentification, pieces: Pieces, found: list[Settled]
) -> Told:
    """The automaton as it was found part by part."""
    modes, states = by_samples(given, stays, pieces)
    transitions = [one.transition for one in found]
    told = Told(stays.estimate.laws.coef, transitions, modes, states, stays.left)
    return told.on_samples([record.t for record in given.records])


def told_jointly(
    estimate: JointEstimate,
    parts: Told,
    stays: StayIdentification,
    pieces: Pieces,
    found: list[Settled],
) -> Told:
    """The same with laws, guards, resets, instants and states of the joint estimate."""
    nodes = estimate.nodes
    # the first piece of each course
    begins = first_pieces(pieces, found, stays.reached.noise)
    modes, states = [own.copy() for own in parts.modes], [own.copy() for own in parts.states]
    for begin, first, sampled in zip(begins, nodes.first, nodes.recordings.sampled, strict=True):
        own = pieces.first[begin] + np.arange(len(sampled))
        modes[pieces.recording[begin]][own] = nodes.modes[first + sampled]
        states[pieces.recording[begin]][own] = estimate.states[first + sampled]
    switched = nodes.recording[nodes.begins[nodes.at]]
    recording, transitions = pieces.recording[begins[switched]], []
    for number, one in enumerate(found):
        own, guard, reset = nodes.transitions == number, one.guard, one.reset
        if not own.any():  # courses begin behind its switches
            transitions.append(one.transition)
            continue
        if guard is not None:
            own_guard = estimate.guards.guard(number)
            assert own_guard is not None, "each of them has unknowns"
            # judged at the switches that the laws alone tell
            columns, rates = one.switches.before(stays.estimate.laws)
            guard = replace(guard, guard=own_guard)
            guard = replace(guard, misses=missed_by_all(guard, columns, rates)[0])
            guard = met(guard, columns, rates)
        if reset is not None and one.transition.jumps:
            own_reset = estimate.resets.reset(number)
            assert own_reset is not None, "what jumps has unknowns"
            reset = replace(reset, reset=own_reset)
        times = nodes.instants[own]
        transitions.append(
            replace(one.transition, recording=recording[own], times=times, guard=guard, reset=reset)
        )
    return Told(estimate.laws.coef, transitions, modes, states, estimate.left)


@dataclass(frozen=True)
class Course(Stays):
    """Stays with the transitions between them, none of which is ever given up."""

    numbers: NDArray[np.intp]  # (n_stays - 1,): of the transitions
    guarded: NDArray[np.bool_]  # (n_stays - 1,): whether the guard tells the instant
    window: Array  # (n_stays - 1, 2): times between which each instant certainly is

    @property
    def transitions(self) -> NDArray[np.intp]:
        """Number of the transition at each instant."""
        return self.numbers

    @property
    def told_by(self) -> NDArray[np.intp]:
        """Number of the transition whose guard tells each instant, -1 for none."""
        return np.where(self.guarded, self.numbers, -1)

    @property
    def bounds(self) -> Array:
        """Times between which each instant must stay, (n_stays - 1, 2)."""
        return self.window

    def names(self, t: Array) -> NDArray[np.intp]:
        """What tells a stay from its neighbours, at any times: its number."""
        return np.searchsorted(self.instants, t)

    def moved(self, instants: Array, t: Array) -> Course:
        """The same with other instants, at most one between two of the times.

        Those that would come to others stay in the interval in which they are.
        """
        first, last = self.window.T
        instants = np.clip(instants, first, np.maximum(first, np.nextafter(last, first)))
        instants = np.clip(instants, t[0], np.nextafter(t[-1], t[0]))
        own = np.minimum(np.searchsorted(t, self.instants, side="right"), len(t) - 1) - 1
        held = np.clip(instants, t[own], np.nextafter(t[own + 1], t[0]))
        while True:
            cells = np.searchsorted(t, instants, side="right") - 1
            meets = np.diff(cells) <= 0
            meets = (np.append(meets, False) | np.append(False, meets)) & (instants != held)
            if not meets.any():
                return replace(self, instants=instants)
            instants = np.where(meets, held, instants)


def nodes_of(
    courses: Sequence[Course],
    records: Sequence[Record],
    guess: Sequence[Array],
    per_sample: int,
    first_step: float,
    walk: Array | None = None,
) -> Nodes:
    """Nodes of courses: at their samples, in steps between, and between two switches of a step.

    Of each interval so many parts are nodes, and of these such a part is integrated at once; states
    may walk beside the laws.
    """
    between = []
    for course, record in zip(courses, records, strict=True):
        cells = np.searchsorted(record.t, course.instants, side="right")
        together = np.flatnonzero(np.diff(cells) == 0)
        between.append(0.5 * (course.instants[together] + course.instants[together + 1]))
    recordings = Recordings.of(records, guess, between).divided(per_sample)
    return Nodes(replace(recordings, first_step=first_step, walk=walk), courses)
