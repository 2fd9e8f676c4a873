"""Free rollouts of an automaton along recordings, those that it was made from and others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import cycle

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton_search.found import FoundGuard, FoundTransition
from swsysid._data.recordings import Record
from swsysid._data.trajectories import label_text, spread
from swsysid._free_rollouts.courses import Course, Switch
from swsysid._free_rollouts.judge import FreeRollouts, free_rollouts
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._journal import step
from swsysid._results import Array, Trajectory
from swsysid._stays.given import Given
from swsysid._stays.pieces import without_limits
from swsysid._stays.settings import LIMITS
from swsysid._ties import first_least
from swsysid.refinement._rollout_score import determination, rough_states

_TURNS_OF_STARTS = 10


@step
def judged(
    automaton: HybridAutomaton,
    given: Given,
    modes: Sequence[NDArray[np.intp]],
    states: Sequence[Array],
    switches: Sequence[tuple[Switch, ...]],
    noise: Array,
) -> tuple[FreeRollouts, SampleNoise]:
    """What they leave of the recordings that an automaton was made from, and of which noise."""
    labels, given = [label_text(label) for label in given.labels], given.sensed
    measured = [own[:, : given.n_channels] for own in states]
    left = [record.y - own for record, own in zip(given.records, measured, strict=True)]
    seen = SampleNoise.seen(_least(noise, given), left, measured, labels)
    first = automaton.lags + 1
    courses = [
        Course(*told)
        for told in zip(
            labels,
            given.records,
            [own[:first] if automaton.lags else own[0] for own in states],
            [int(own[first - 1]) for own in modes],
            switches,
            strict=True,
        )
    ]
    return _rolled_out(automaton, courses, seen), seen


@step
def judged_on(automaton: HybridAutomaton, given: Given, noise: Array) -> FreeRollouts:
    """What they leave of others, from the mode and the state that fit the first samples best."""
    courses, given = [], given if automaton.discrete_time else without_limits(given)
    for label, record in zip(given.labels, given.records, strict=True):
        start, mode = start_of(automaton, record)
        courses.append(Course(label_text(label), record, start, mode))
    labels = [course.label for course in courses]
    return _rolled_out(automaton, courses, SampleNoise.constant(_least(noise, given), labels))


Guards = list[FoundGuard | None]


def by_rollouts(guards: Guards, judge: Callable[[Guards], FreeRollouts]) -> Guards:
    """Guards, or rivals in their place with which free rollouts follow the recordings better.

    That is with fewer wrong switches, or as many and half of what they leave. What tells the
    switches of a limit cycle as well need not tell those of a recording that begins elsewhere.
    Rivals stay those with which rollouts are no worse.
    """
    if not any(one is not None and one.rivals for one in guards):
        return guards

    def with_rivals(place: int) -> Iterator[tuple[Guards, FreeRollouts]]:
        guard = guards[place]
        for rival in guard.instead() if guard is not None else ():
            trial = [*guards[:place], rival, *guards[place + 1 :]]
            yield trial, judge(trial)

    best, at_rest = judge(guards), 0  # guards in a row that have stayed
    for place in cycle(range(len(guards))):
        if (best.holds and best.tells_switches) or at_rest == len(guards):
            break
        better = [one for one in with_rivals(place) if follows_better(one[1], best)]
        at_rest = 0 if better else at_rest + 1
        for trial, rolled in better:
            if follows_better(rolled, best):
                guards, best = trial, rolled
    told: Guards = []
    for place, guard in enumerate(guards):
        worse = [follows_better(best, rolled) for _, rolled in with_rivals(place)]
        told.append(None if guard is None else guard.without(worse))
    return told


def follows_better(one: FreeRollouts, other: FreeRollouts) -> bool:
    """Whether rollouts have fewer wrong switches, or as many and leave less than half."""
    wrong, before = (len(own.missing) + len(own.extra) for own in (one, other))
    left, left_before = (float(np.linalg.norm(own.left)) for own in (one, other))
    return wrong < before or (wrong == before and left < 0.5 * left_before)


def switches_by_recording(
    found: Sequence[FoundTransition], order: NDArray[np.intp], n_recordings: int
) -> list[tuple[Switch, ...]]:
    """When each recording switches and how, in the names of the answer and in order of time."""
    names = np.argsort(order)
    every: list[list[Switch]] = [[] for _ in range(n_recordings)]
    for one in found:
        pair = int(names[one.source]), int(names[one.target])
        for recording, time in zip(one.recording.tolist(), one.times.tolist(), strict=True):
            every[recording].append(Switch(time, *pair))
    return [tuple(sorted(own)) for own in every]


def _least(noise: Array, given: Given) -> Array:
    """Noise, no less than what counts as exact."""
    spread = np.nanstd(np.vstack([record.y for record in given.records]), axis=0)
    noise = noise[: len(spread)]
    return np.asarray(np.maximum(noise, LIMITS.exactly * np.where(spread > 0.0, spread, 1.0)))


def _rolled_out(
    automaton: HybridAutomaton, courses: Sequence[Course], noise: SampleNoise
) -> FreeRollouts:
    hold = "zero" if automaton.discrete_time else "linear"
    channels = automaton.state_names[: len(noise.channels)]
    return free_rollouts(automaton, courses, noise, channels, input_hold=hold)


def rollout_score(automaton: HybridAutomaton, given: Given) -> float:
    """Mean coefficient of determination of the states."""
    given = without_limits(given)
    return determination([left_by_rollout(automaton, record) for record in given.records], given)


def left_by_rollout(automaton: HybridAutomaton, record: Record) -> Array:
    """Measured minus rolled out, from the mode and the state that fit the first samples best."""
    return _left(automaton, record, *start_of(automaton, record))


def start_of(automaton: HybridAutomaton, record: Record) -> tuple[Array, int]:
    """The state and the mode from which a rollout fits the first samples of a recording best."""
    first = record.part(0, min(LIMITS.first_samples, len(record.t) - 1))
    tried = [_start(automaton, first, mode) for mode in range(automaton.n_modes)]
    mode = int(first_least([cost for _, cost in tried]))
    return tried[mode][0], mode


def _start(automaton: HybridAutomaton, first: Record, mode: int) -> tuple[Array, float]:
    """The state from which a rollout in a mode fits some samples best, and half its squares."""
    rough = rough_states(first, automaton.n_states)
    unit, guess = spread(rough), rough[: automaton.lags + 1]

    def misfit(start: Array) -> Array:
        left = _left(automaton, first, start, mode) / unit[: first.y.shape[1]]  # some are hidden
        left = np.nan_to_num(left, nan=LIMITS.diverged)
        return np.where(np.isfinite(first.y), left, 0.0).ravel()

    if automaton.lags:
        return guess, float(0.5 * np.square(misfit(guess)).sum())

    def start(moves: Array) -> Array:
        return np.asarray(guess[0] + (moves - 1.0) * unit)

    # from one, so that differences are taken over parts of a spread
    found = least_squares(
        lambda moves: misfit(start(moves)),
        np.ones(len(unit)),
        diff_step=LIMITS.difference,
        max_nfev=_TURNS_OF_STARTS,
    )
    return start(found.x), float(found.cost)


def _left(automaton: HybridAutomaton, record: Record, start: Array, mode: int) -> Array:
    """Measured minus rolled out; NaN throughout where the rollout does not reach the end."""
    inputs = record.u if record.u.size else None
    hold = "zero" if automaton.discrete_time else "linear"
    run = automaton.simulate(start, record.t, inputs, mode=mode, input_hold=hold)
    if len(run.t) < len(record.t):
        return np.full(record.y.shape, np.nan)
    left = record.y - run.x[:, : record.y.shape[1]]
    if not automaton.discrete_time:
        _on_either_side(left, automaton, record, run)
    return left


def _on_either_side(
    left: Array, automaton: HybridAutomaton, record: Record, run: Trajectory
) -> None:
    """The samples beside a jump leave what the nearer of its sides leaves of them.

    An instant that is off by less than a step is otherwise the whole of what a rollout leaves: a
    ball's speed has one sign or the other. What one side says at a sample of the other is a step
    of Heun from the sample beside it.
    """
    after = np.searchsorted(record.t, [one.time for one in run.events if one.kind == "jump"])
    after = after[(after > 0) & (after < len(record.t))]
    n_channels, unit = left.shape[1], spread(record.filled)
    heres, theres = np.append(after, after - 1), np.append(after - 1, after)
    for here, there in zip(heres, theres, strict=True):
        passed, x, mode = record.t[here] - record.t[there], run.x[there], int(run.modes[there])
        first = automaton.velocity(x, record.u[there], mode)
        second = automaton.velocity(x + passed * first, record.u[here], mode)
        other = record.y[here] - (x + 0.5 * passed * (first + second))[:n_channels]
        sizes = [np.nansum(np.square(one / unit)) for one in (left[here], other)]
        if sizes[1] < sizes[0]:
            left[here] = other
