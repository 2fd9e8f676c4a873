"""The delivered model rolled out along recordings, and whether it leaves nothing but noise."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swsysid._free_rollouts.breaks import VARIANCE, Break, first_breaks, leave_more
from swsysid._free_rollouts.courses import (
    Course,
    Pairs,
    Switch,
    beside_jumps,
    seen_by_samples,
    switches_of_rollout,
)
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._rendering.printing import counted
from swsysid._results import Array, Trajectory

# Of the spread of a channel: what a rollout may be off by whatever the noise. The errors of a
# solver add up along a recording, unlike noise: 2e-4 in six impacts at a tolerance of 1e-5.
_SIZE = 1e-3
_ACCURACY = 1e-3  # part of the noise to which a rollout is integrated
_MOST_SWITCHES = 100  # beside one a sample, after which a model chatters

# The same of recordings that the model has not seen: there the standard errors of its laws, and
# of where a rollout starts, add to the noise.
_UNSEEN_VARIANCE = 4.0
# Samples that tell where a recording starts, where its error is not known.
_FIRST_SAMPLES = 20
# Part of the error of a start by which it is moved to see what hangs on it.
_MOVED = 0.1
# Steps of the integrator for a sample: the plants of `benchmarks/trajectories` take up to 5.
_MOST_STEPS = 50


class Simulates(Protocol):
    """A model that can be rolled out."""

    @property
    def simulate(self) -> Callable[..., Trajectory]:
        """As `HybridAutomaton.simulate`."""


@dataclass(frozen=True)
class FreeRollouts:
    """What free rollouts of a model leave of recordings, and what they make of the switches.

    Attributes
    ----------
    channels : tuple of str
    recordings : tuple of str
        What was rolled out, in order: recordings, or stretches of them.
    left : ndarray of shape (n_channels,)
        Root mean squares of what is left, in units of the noise. Infinite where a rollout ends
        early. Samples between the two instants of one switch, identified and rolled out, at most
        one sample apart, are on either side of it and do not count.
    left_of_each : ndarray of shape (n_recordings, n_channels)
    n_switches : int
        As identified; without stays that end within a sample.
    n_reproduced : int
        Of these, switches that the model's own guards make.
    farthest : float
        Largest distance of two of them, in samples; 0 where there are none.
    missing, extra : tuple of (str, Switch)
        Recordings and switches that the model does not make, or makes alone, each in order of time.
    breaks : tuple of Break
        Of each rollout that leaves the noise, where it does; the soonest after its start first.
    hangs_on_start : bool
        Whether a start that is off by two standard errors alone leads as far away at the first
        break: a chaotic motion, or a guard that is hit or missed by a hair. That is no proof
        against the model, unless its rollout ends early.
    leave_more : bool
        Whether all of them together leave more than noise.
    over : str
        What each rollout goes along, where that is not a whole recording.
    in_noise : bool
        Whether `left` is in units of the noise; else of a thousandth of the spread, where there is
        less noise than that.
    """

    channels: tuple[str, ...]
    recordings: tuple[str, ...]
    left: Array
    left_of_each: Array
    n_switches: int
    n_reproduced: int
    farthest: float
    missing: tuple[tuple[str, Switch], ...]
    extra: tuple[tuple[str, Switch], ...]
    breaks: tuple[Break, ...]
    hangs_on_start: bool = False
    leave_more: bool = False
    over: str = ""
    in_noise: bool = True

    @property
    def holds(self) -> bool:
        """Whether the rollouts leave nothing but noise."""
        return not self.breaks and not self.leave_more

    @property
    def tells_switches(self) -> bool:
        """Whether the model's own guards make all switches and no other."""
        return not self.missing and not self.extra

    @property
    def first_break(self) -> Break | None:
        """The soonest after the start of its rollout; None where all hold."""
        return self.breaks[0] if self.breaks else None

    @property
    def strays(self) -> str:
        """Which recordings are left, and what is wrong where most of them are; "" if none is."""
        if not self.breaks:
            return ""
        [(part, count)] = Counter(one.part for one in self.breaks).most_common(1)
        first = next(one for one in self.breaks if one.part == part)
        if len(self.recordings) == 1:
            return f"the recording where {self._wrong(first)} ({_at(first.time, '')})"
        n_left, n = len(self.breaks), len(self.recordings)
        left = f"all {n} recordings" if n_left == n else f"{n_left} of {n} recordings"
        return (
            f"{left}{f', {count} of them' if count < n_left else ''} where {self._wrong(first)} "
            f"(recording {first.recording} at {_at(first.time, '')})"
        )

    def _wrong(self, broken: Break) -> str:
        if broken.cause or broken.ended:
            there = "while it slides" if broken.follows > 0.0 else "at its start"
            there = there if broken.mode < 0 else f"in mode {broken.mode}"
            return broken.cause or f"{broken.ended} {there}"
        size, unit = broken.leaves, "times the noise"
        if not self.in_noise:
            size, unit = 100.0 * _SIZE * size, "% of the spread"
        return f"the law of mode {broken.mode} leaves {size:.2g} {unit} of {broken.channel}"

    def sentence(self, time_unit: str = "") -> str:
        """All of this in one line."""
        sizes = zip(self.channels, self.left, strict=True)
        scale = 1.0 if self.in_noise else 100.0 * _SIZE
        left = ", ".join(f"{name} {scale * size:.3g}" for name, size in sizes)
        left = f"leave: {left} {'of the noise' if self.in_noise else '% of the spread'}"
        if not np.isfinite(self.left).all():
            left = "end before what was recorded does"
        told = [f"Free rollouts{f' over {self.over}' if self.over else ''} {left}"]
        if self.n_switches or self.extra:
            told.append(self._switches(time_unit))
        broken = self.first_break
        if broken is not None:
            told.append(self._broken(broken, time_unit))
        return f"{'; '.join(told)}."

    def _switches(self, time_unit: str) -> str:
        within = counted(max(1, int(np.ceil(self.farthest))), "sample")
        if not self.missing:
            all_of = "the switch" if self.n_switches == 1 else f"all {self.n_switches} switches"
            told = f"{all_of} within {within}" if self.n_switches else "no switch was identified"
        else:
            told = f"{self.n_reproduced} of {counted(self.n_switches, 'switch')}"
            told += f" within {within}" if self.n_reproduced else ""
        if self.holds and not self.tells_switches:
            told += f", but {self._alone(time_unit)}"
        return told

    def _alone(self, time_unit: str) -> str:
        """The first switch that is made on one side only."""
        told = [(*one, "does not happen") for one in self.missing[:1]]
        told += [(*one, "happens in the model only") for one in self.extra[:1]]
        label, switch, what = min(told, key=lambda one: one[1].time)
        at = _at(switch.time, time_unit)
        return f"{switch.transition} at {at}{self._of(label)} {what}"

    def _broken(self, broken: Break, time_unit: str) -> str:
        named = self._named(broken.recording)
        if broken.follows <= 0.0:
            return f"they leave {named} from its start"
        told, why = f"they follow {named} to {_at(broken.time, time_unit)}", broken.cause
        if self.hangs_on_start:
            return (
                f"{told}, from there on they hang on how well the start is known, which is no "
                "proof against the laws"
            )
        if why or broken.ended:
            return f"{told}: there {broken.ended or why}"
        return f"{told} and leave it in mode {broken.mode}" if self.n_switches else told

    def _named(self, label: str) -> str:
        return "the recording" if len(set(self.recordings)) == 1 else f"recording {label}"

    def _of(self, label: str) -> str:
        return "" if len(set(self.recordings)) == 1 else f" of recording {label}"


# A course rolled out from a start, to a small part of the noise (n_samples, n_channels).
Runs = Callable[[Course, Array, Array], Trajectory]


def free_rollouts(
    model: Simulates,
    courses: Sequence[Course],
    noise: SampleNoise,
    channels: Sequence[str],
    *,
    together: float = 1.0,
    input_hold: str = "linear",
    over: str = "",
    unseen: bool = False,
) -> FreeRollouts:
    """Roll a model out along courses and judge what that leaves.

    `together` samples of the noise count as one. The model is given ``mode`` where a course has
    one. `noise` is that of the first columns of the states, one for each of the `channels`.
    `unseen` recordings have taken no part in the fit.
    """
    runs = ModelRuns(model, input_hold)
    return judged(runs, courses, noise, channels, together=together, over=over, unseen=unseen)


@np.errstate(over="ignore", invalid="ignore")  # a model that diverges is judged, no warning
def judged(
    runs: Runs,
    courses: Sequence[Course],
    noise: SampleNoise,
    channels: Sequence[str],
    *,
    together: float = 1.0,
    over: str = "",
    unseen: bool = False,
) -> FreeRollouts:
    """The same of rollouts that are made otherwise."""
    spread = np.nanstd(np.vstack([course.record.y for course in courses]), axis=0)
    least = _SIZE * spread
    noise = replace(noise, least=least)
    done = [_RolledOut.of(runs, course, noise) for course in courses]
    variance = _UNSEEN_VARIANCE if unseen else VARIANCE
    begins = first_breaks([one.left for one in done], together, variance)
    broken = [
        (one.broken(begin, channels), one, begin)
        for one, begin in zip(done, begins, strict=True)
        if (begin >= 0).any()
    ]
    broken.sort(key=lambda one: one[0].follows)
    each = np.array([_root_mean_square(one.left) for one in done])
    judged = [one for one in done if one.course.switches is not None]
    steps = [one.pairs.distances / one.course.step for one in judged]
    return FreeRollouts(
        channels=tuple(channels),
        recordings=tuple(one.course.label for one in done),
        left=_root_mean_square(np.vstack([one.left for one in done])),
        left_of_each=each,
        n_switches=sum(len(one.pairs.both) + len(one.pairs.missing) for one in judged),
        n_reproduced=sum(len(one.pairs.both) for one in judged),
        farthest=float(max((one.max(initial=0.0) for one in steps), default=0.0)),
        missing=_in_order((one.course.label, one.pairs.missing) for one in judged),
        extra=_in_order((one.course.label, one.pairs.extra) for one in judged),
        breaks=tuple(one for one, _, _ in broken),
        hangs_on_start=any(one.hangs_on_start(begin) for _, one, begin in broken[:1]),
        leave_more=leave_more([one.left for one in done], together, variance),
        over=over,
        in_noise=not all((one.noise <= least).all() for one in done),
    )


@dataclass(frozen=True)
class ModelRuns:
    """The model, and how it is rolled out."""

    model: Simulates
    input_hold: str

    def __call__(self, course: Course, start: Array, noise: Array) -> Trajectory:
        """Rolled out from a start, to a small part of the noise, (n_samples, n_channels)."""
        record = course.record
        options: dict[str, object] = {} if course.mode is None else {"mode": course.mode}
        least, size = float(np.nanmin(noise)), float(np.abs(record.filled).max())
        options |= {
            "input_hold": self.input_hold,
            "rtol": float(np.clip(_ACCURACY * least / (size or 1.0), 1e-10, 1e-6)),
            "atol": _ACCURACY * least,
            # a wrong model may chatter at its guards for ever
            "max_switches": _MOST_SWITCHES + len(record.t),
            # and one whose terms cancel has a field of rounding, which no step is short enough for
            "max_steps": _MOST_STEPS * (_FIRST_SAMPLES + len(record.t)),
        }
        inputs = record.u if record.u.shape[1] else None
        return self.model.simulate(start, record.t, inputs, **options)


@dataclass(frozen=True)
class _RolledOut:
    """One course and its free rollout."""

    runs: Runs
    course: Course
    states: Array  # (n_samples, n_channels), NaN where the rollout has ended
    noise: Array  # of the samples, of the same shape
    left: Array  # in units of the noise; infinite where the rollout has ended
    modes: NDArray[np.intp]  # of the samples up to where it ends
    pairs: Pairs
    ended: str

    @classmethod
    def of(cls, runs: Runs, course: Course, noise: SampleNoise) -> _RolledOut:
        record = course.record
        run = runs(course, course.start, noise.at(record.filled, course.label))
        states = _states(run, record.y.shape)
        scale = noise.at(np.where(np.isfinite(states), states, record.filled), course.label)
        left = (record.y - states) / scale
        left[len(run.t) :] = np.where(np.isfinite(record.y[len(run.t) :]), np.inf, np.nan)
        sides = course.switches or (), switches_of_rollout(run)
        pairs = Pairs.of(*(seen_by_samples(side, course.step) for side in sides))
        pairs = pairs.inside(record.t[np.isfinite(record.y).any(axis=1)], course.step)
        left[pairs.undecided(record.t, course.step)] = np.nan
        if course.switches is None:
            left[beside_jumps(run, record.t)] = np.nan
        ended = "" if run.status.ok else f"the simulation ends ({run.status.value})"
        return cls(runs, course, states, scale, left, run.modes, pairs, ended)

    def broken(self, begins: NDArray[np.intp], channels: Sequence[str]) -> Break:
        """Where it leaves the noise, from the begins of each channel, -1 where it does not."""
        t = self.course.record.t
        first, channel = _soonest(begins)
        time, transition, what = float(t[first]), "", ""
        if self.course.switches is not None:
            time, transition, what = self.pairs.blamed(time, self.course.step)
        # a sample that counts: those before may be on either side of a switch
        seen = first + int(np.argmax(~np.isnan(self.left[first:, channel])))
        mode = int(self.modes[min(seen, len(self.modes) - 1)]) if self.modes.size else -1
        until = np.flatnonzero(self.modes[seen:] != mode)
        stay = self.left[seen : seen + int(until[0]) if until.size else None, channel]
        return Break(
            recording=self.course.label,
            channel=channels[channel],
            time=time,
            follows=time - float(t[0]),
            cause=f"{transition} {what}" if what else self.course.begins(self.modes[:1], time),
            ended=self.ended if np.isinf(self.left[first]).any() else "",
            mode=mode,
            transition=transition,
            leaves=float(_root_mean_square(stay)),
        )

    def hangs_on_start(self, begins: NDArray[np.intp]) -> bool:
        """Whether starts off by two standard errors lead as far from the noise, from there on.

        A rollout that ends early follows no motion that was recorded, however chaotic.
        """
        if self.ended:
            return False
        # an error of the start that grows is in the direction that grows, whichever was moved
        first, channel = _soonest(begins)
        n_first = min(_FIRST_SAMPLES, len(self.noise))
        away = np.zeros(len(self.states))
        for k, size in enumerate(self.noise[0] * 2.0 / np.sqrt(n_first)):
            moved = np.array(self.course.start, dtype=float)
            moved[..., k] += _MOVED * size
            other = _states(self.runs(self.course, moved, self.noise), self.states.shape)
            off = (other - self.states)[:, channel] / self.noise[:, channel] / _MOVED
            away += np.square(np.nan_to_num(off))
        seen = np.isfinite(self.left[:, channel])
        seen[:first] = False
        left = self.left[seen, channel]
        return bool(seen.any() and 4.0 * np.mean(away[seen]) >= np.mean(np.square(left)) - 1.0)


def _soonest(begins: NDArray[np.intp]) -> tuple[int, int]:
    """Sample and channel of the first break."""
    first = int(begins[begins >= 0].min())
    return first, int(np.flatnonzero(begins == first)[0])


def _states(run: Trajectory, shape: tuple[int, ...]) -> Array:
    """The measured columns of a rollout, NaN where it has ended."""
    states = np.full(shape, np.nan)
    states[: len(run.x)] = run.x[:, : shape[1]]
    return states


def _root_mean_square(left: Array) -> Array:
    """Of the samples that were measured."""
    count = np.maximum(1, (~np.isnan(left)).sum(axis=0))
    return np.asarray(np.sqrt(np.nansum(np.square(left), axis=0) / count))


def _in_order(
    found: Iterable[tuple[str, tuple[Switch, ...]]],
) -> tuple[tuple[str, Switch], ...]:
    every = [(label, switch) for label, switches in found for switch in switches]
    return tuple(sorted(every, key=lambda one: one[1].time))


def _at(time: float, unit: str) -> str:
    return f"t = {time:.4g}{f' {unit}' if unit else ''}"
