"""What is rolled out: samples with an estimated start, and the switches that were identified."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._data.recordings import Record
from swsysid._rendering.printing import counted
from swsysid._results import Array, Trajectory

# Samples to which the begin of a break is known: noise may lead up to it.
_BEGIN = 3

_WHOLE = 0.999  # of a step: stays of that have a sample, whatever rounding leaves of instants

SLIDES = -1  # the mode of a state that slides along a surface


class Switch(NamedTuple):
    """A change of the mode, or a transition of a mode to itself where the state jumps."""

    time: float
    before: int
    after: int

    @property
    def transition(self) -> str:
        """The modes in words."""
        before, after = ("slide" if k == SLIDES else f"{k}" for k in (self.before, self.after))
        return f"mode {before} -> {after}"


@dataclass(frozen=True)
class Course:
    """A recording, or a stretch of one, with what was identified of it.

    `switches` are None where nothing says how it switches, as in recordings that are held out.
    """

    label: str
    record: Record
    start: Array  # (n_states,), or (lags + 1, n_states)
    mode: int | None = None  # at the start, for models whose guards do not tell it
    switches: tuple[Switch, ...] | None = None

    @property
    def step(self) -> float:
        """Usual time between two samples."""
        steps = np.diff(self.record.t)
        # the two limits of an event are no step
        return float(np.median(steps[steps > 1e-6 * steps.max()]))

    def begins(self, modes: NDArray[np.intp], time: float) -> str:
        """That a model does not begin in the mode it should, where no switch is before a time.

        `modes` are those in which it begins, none where it ends at once; "" where it is right.
        """
        first = next(iter(self.switches or ()), None)
        if first is None or first.time <= time or not modes.size or modes[0] == first.before:
            return ""
        return f"it begins in mode {modes[0]} and not in mode {first.before}"


def switches_of_samples(t: Array, modes: NDArray[np.intp]) -> tuple[Switch, ...]:
    """Switches between samples of known modes, each in the middle of its interval."""
    places = np.flatnonzero(np.diff(modes))
    return tuple(
        Switch(float(0.5 * (t[k] + t[k + 1])), int(modes[k]), int(modes[k + 1])) for k in places
    )


def switches_of_stays(modes: Sequence[int], instants: Sequence[float]) -> tuple[Switch, ...]:
    """Switches between stays of known modes."""
    pairs = zip(instants, modes[:-1], modes[1:], strict=True)
    return tuple(Switch(float(time), int(old), int(new)) for time, old, new in pairs)


def switches_of_rollout(run: Trajectory) -> tuple[Switch, ...]:
    """The events of a rollout."""
    found = []
    for event in run.events:
        before = SLIDES if event.kind == "leaving" else event.before
        after = SLIDES if event.kind == "sliding" else event.after
        found.append(Switch(event.time, before, after))
    return tuple(found)


def beside_jumps(run: Trajectory, t: Array) -> NDArray[np.intp]:
    """Samples before and after each jump of a rollout.

    Where a recording jumps by itself nobody has told: by one step more or less they are on either
    side of it.
    """
    after = np.searchsorted(t, [one.time for one in run.events if one.kind == "jump"])
    beside = np.concatenate([after - 1, after])
    return beside[(beside >= 0) & (beside < len(t))]


def seen_by_samples(switches: Sequence[Switch], step: float) -> tuple[Switch, ...]:
    """The switches without stays that end within a step: no sample need be in them.

    One of a whole step has a sample, as at a gate that is logged for a single row.
    """
    kept: list[Switch] = []
    for one in switches:
        last = kept[-1] if kept else None
        if last is None or last.before == last.after or one.time - last.time > _WHOLE * step:
            kept.append(one)
            continue
        kept.pop()
        if last.before != one.after:
            kept.append(Switch(last.time, last.before, one.after))
    return tuple(kept)


@dataclass(frozen=True)
class Pairs:
    """Switches as identified and as rolled out: which belong together, which are alone."""

    both: tuple[tuple[Switch, Switch], ...]  # identified, rolled out
    missing: tuple[Switch, ...]  # identified only
    extra: tuple[Switch, ...]  # rolled out only

    @classmethod
    def of(cls, identified: Sequence[Switch], rolled_out: Sequence[Switch]) -> Pairs:
        """Two of one transition are a pair where each is the nearest of the other."""
        both: list[tuple[int, int]] = []
        for transition in {one[1:] for one in identified} & {one[1:] for one in rolled_out}:
            first = [k for k, one in enumerate(identified) if one[1:] == transition]
            second = [k for k, one in enumerate(rolled_out) if one[1:] == transition]
            times = [identified[k].time for k in first], [rolled_out[k].time for k in second]
            nearest, back = _nearest(*times), _nearest(*times[::-1])
            both += [(first[k], second[n]) for k, n in enumerate(nearest) if back[n] == k]
        paired = [set(side) for side in zip(*both, strict=True)] or [set(), set()]
        return cls(
            tuple((identified[k], rolled_out[n]) for k, n in sorted(both)),
            tuple(one for k, one in enumerate(identified) if k not in paired[0]),
            tuple(one for k, one in enumerate(rolled_out) if k not in paired[1]),
        )

    def inside(self, t: Array, step: float) -> Pairs:
        """Without lone switches in the first and the last step: the other may be outside.

        The times are those at which something was measured; without any there is no inside.
        """
        first, last = (t[0] + step, t[-1] - step) if len(t) else (np.inf, -np.inf)
        alone = [
            tuple(one for one in side if first < one.time < last)
            for side in (self.missing, self.extra)
        ]
        return Pairs(self.both, *alone)

    @property
    def distances(self) -> Array:
        """Times between the two of every pair."""
        return np.array([abs(two.time - one.time) for one, two in self.both])

    def undecided(self, t: Array, step: float) -> NDArray[np.bool_]:
        """Samples between the two instants of one switch: they are on either side of it."""
        times = np.array([(one.time, two.time) for one, two in self.both]).reshape(-1, 2)
        first, last = np.sort(times[np.abs(np.diff(times)[:, 0]) <= step]).T
        begun = np.bincount(np.searchsorted(t, first), minlength=len(t) + 1)
        ended = np.bincount(np.searchsorted(t, last, side="right"), minlength=len(t) + 1)
        return (begun - ended).cumsum()[: len(t)] > 0

    def blamed(self, time: float, step: float) -> tuple[float, str, str]:
        """When the last switch up to a time goes wrong, which transition it is of, and how.

        The time itself and twice "" where nothing goes wrong. The time is known to a few steps.
        """
        told = [
            (min(one.time, two.time), one.transition, f"happens {_off(one, two, step)}")
            if abs(two.time - one.time) > step
            else (one.time, "", "")
            for one, two in self.both
        ]
        told += [(one.time, one.transition, "does not happen") for one in self.missing]
        told += [(one.time, one.transition, "happens in the model only") for one in self.extra]
        before = [one for one in told if one[0] <= time + _BEGIN * step]
        last = max(before, default=(time, "", ""))
        return last if last[1] else (time, "", "")


def _nearest(times: Sequence[float], among: Sequence[float]) -> NDArray[np.intp]:
    """Place of the nearest of some increasing times, the earlier one of two, for each."""
    ends = np.concatenate([[-np.inf], among, [np.inf]])
    after = np.searchsorted(among, times) + 1  # in ends
    earlier = np.subtract(times, ends[after - 1]) <= ends[after] - times
    return after - 1 - earlier


def _off(identified: Switch, rolled_out: Switch, step: float) -> str:
    off = (rolled_out.time - identified.time) / step
    return f"{counted(round(abs(off)), 'sample')} {'late' if off > 0 else 'early'}"
