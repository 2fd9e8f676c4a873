"""Whether an answer is equal to the one that was frozen, worse or better.

Estimates are equal within two combined standard errors. Where they are not, the estimates *moved*,
and what they are far from the truth decides; where no truth is known, having moved is worse. What
is counted (modes, switches, transitions, effects) is judged in any case. All figures are such that
less is better.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

__all__ = ["Comparison", "Verdict", "compared", "verdict"]

ERRORS = 2.0  # combined standard errors within which estimates are equal
# Relative to the largest of a block of estimates: what solvers and rounding may change. Recordings
# without noise have standard errors of a millionth.
ROUNDING = 1e-5


@dataclass(frozen=True)
class Tolerance:
    """By how much a figure may change and be equal: absolute, and relative to the larger one."""

    absolute: float
    relative: float = 0.0
    is_counted: bool = True

    def change(self, before: float | None, now: float | None) -> int:
        """1 where it got worse, -1 where it got better; None is infinite."""
        before, now = (np.inf if one is None else one for one in (before, now))
        if before == now:
            return 0
        if np.isinf(before) or np.isinf(now):
            return 1 if now > before else -1
        allowed = max(self.absolute, self.relative * max(before, now))
        return int(np.sign(now - before)) if abs(now - before) > allowed else 0


FIGURES = {
    "modes": Tolerance(0.0),  # too many or too few
    "effects": Tolerance(0.0),  # found besides what was planted
    "no transition": Tolerance(0.02),  # share of the held-out crossings
    "ended": Tolerance(0.0),  # share of the rollouts that ended early
    "missed": Tolerance(0.02),  # share of the true switches
    "spurious": Tolerance(0.02),  # share of those found
    # the following move with the estimates
    "unbalanced": Tolerance(0.005, 0.25, False),  # share of the samples in another mode
    "late": Tolerance(0.05, 0.25, False),  # samples
    "field": Tolerance(0.001, 0.25, False),  # relative to the spread of the velocities
    "mean": Tolerance(0.001, 0.25, False),  # of the deviations of rollouts, in ranges
    "guard": Tolerance(0.001, 0.25, False),  # distance in ranges
    "coefficients": Tolerance(0.001, 0.25, False),  # the largest difference from a true one
    "error": Tolerance(0.0, 0.02, False),  # on rows or in runs that were not fitted
}


@dataclass(frozen=True)
class Verdict:
    """What became of one record.

    Attributes
    ----------
    cell : list
    word : {"equal", "worse", "better", "other data", "new"}
        Of a record made of other data, and of one that was not frozen, nothing can be said.
    moved : bool
        Whether the estimates changed by more than their standard errors, or the effects found.
    changes : list of str
        What got worse or better, with both values.
    time : float
        CPU time over the one frozen, both in units of the yardstick.
    """

    cell: list
    word: str
    moved: bool = False
    changes: list[str] = field(default_factory=list)
    time: float = np.nan


@dataclass(frozen=True)
class Comparison:
    """What became of the records of a kind.

    Attributes
    ----------
    verdicts : list of Verdict
    right, alarms : tuple of int
        Numbers of records that are right, and of those with nothing missing in which something was
        found: frozen, and now.
    seconds, units : tuple of float
        CPU seconds of all records, frozen and now, and the same in units of the yardstick.
    may_lose : int
        By how many the records that got worse may outnumber those that got better.
    """

    verdicts: list[Verdict]
    right: tuple[int, int]
    alarms: tuple[int, int]
    seconds: tuple[float, float]
    units: tuple[float, float]
    may_lose: int = 1

    def count(self, word: str) -> int:
        """How many records became this."""
        return sum(one.word == word for one in self.verdicts)

    @property
    def is_worse(self) -> bool:
        """Whether more got worse than may, or null alarms are more, or the data are others."""
        lost = max(self.count("worse") - self.count("better"), self.right[0] - self.right[1])
        more_alarms = self.alarms[1] > self.alarms[0]
        return lost > self.may_lose or more_alarms or self.count("other data") > 0


def compared(frozen: dict[str, dict], now: dict[str, dict], may_lose: int = 1) -> Comparison:
    """The records of a kind, by their cells, beside those frozen."""
    verdicts = [
        verdict(frozen[key], one) if key in frozen else Verdict(one["cell"], "new")
        for key, one in now.items()
    ]
    both = [(frozen[key], one) for key, one in now.items() if key in frozen]

    def sums(of: Callable[[dict], float]) -> tuple:
        return tuple(sum(of(pair[side]) for pair in both) for side in (0, 1))

    return Comparison(
        verdicts,
        right=sums(lambda one: bool(one["right"])),
        alarms=sums(lambda one: one.get("alarm", False)),
        seconds=sums(lambda one: one["seconds"]),
        units=sums(units),
        may_lose=may_lose,
    )


def verdict(before: dict, now: dict) -> Verdict:
    """What became of a record."""
    cell, time = now["cell"], units(now) / units(before)
    if not np.allclose(before["data"], now["data"], rtol=1e-4):
        told = [f"data {before['data']} -> {now['data']}"]
        return Verdict(cell, "other data", changes=told, time=time)
    if "refused" in before or "refused" in now:
        changes = _refusals(before, now)
        return Verdict(cell, _word(changes), bool(changes), [t for _, t in changes], time)
    moved = list(_moved(before, now))
    # of estimates without standard errors the figures alone tell whether they moved
    is_moved = bool(moved) or not any("error" in one for one in now.get("estimates", {}).values())
    changes = list(_changes(before, now, is_moved))
    has_measure = any(not _tolerance(name).is_counted for name in now["figures"])
    if moved and not has_measure and not changes:
        changes = [(1, told) for told in moved]
    told = [told for _, told in changes]
    return Verdict(cell, _word(changes), bool(moved), told + moved if changes else [], time)


def units(one: dict) -> float:
    """CPU time of a record in units of the yardstick that was measured beside it."""
    return max(one["seconds"], 0.01) / one["unit"]


def _word(changes: list[tuple[int, str]]) -> str:
    signs = {sign for sign, _ in changes}
    return "worse" if 1 in signs else "better" if -1 in signs else "equal"


def _refusals(before: dict, now: dict) -> list[tuple[int, str]]:
    ends = [one.get("refused", "an answer") for one in (before, now)]
    if "refused" in before and "refused" in now:
        return []
    return [(1 if "refused" in now else -1, f"{ends[0]} -> {ends[1]}")]


def _tolerance(name: str) -> Tolerance:
    """Of a figure; behind a comma its name says of what it is."""
    return FIGURES[name.split(",")[0]]


def _changes(before: dict, now: dict, is_moved: bool):
    """Of everything that got worse or better the sign, and both values."""
    if bool(before["right"]) != bool(now["right"]):
        yield 1 if before["right"] else -1, f"right {before['right']} -> {now['right']}"
    for name, value in now["figures"].items():
        known, tolerance = before["figures"].get(name), _tolerance(name)
        if tolerance.is_counted or is_moved:
            sign = tolerance.change(known, value)
            if sign:
                yield sign, f"{name} {known} -> {value}"


def _moved(before: dict, now: dict):
    """Estimates that are not equal, and what else was found."""
    if before.get("found") != now.get("found"):
        yield f"found {before.get('found')} -> {now.get('found')}"
    elif _order(before) != _order(now):
        yield f"p-values {before['p_values']} -> {now['p_values']}"
    blocks = before.get("estimates", {}), now.get("estimates", {})
    others = sorted(set(blocks[0]) ^ set(blocks[1]))
    if others:
        yield f"only one has {'; '.join(others)}"
    for name in blocks[0].keys() & blocks[1].keys():
        distance = _distance(blocks[0][name], blocks[1][name])
        if distance > ERRORS:
            yield f"{name} by {distance:.2g} standard errors"


def _order(one: dict) -> list[int]:
    """Which of the p-values is the smallest, and so on."""
    return np.argsort(one.get("p_values", []), kind="stable").tolist()


def _distance(before: dict, now: dict) -> float:
    """The largest difference of two blocks in combined standard errors; what is rounding is none.

    Blocks without standard errors are judged by the figures that follow from them.
    """
    if "error" not in before or "error" not in now:
        return 0.0
    values, errors = (
        [np.array(one[name], dtype=float) for one in (before, now)] for name in ("value", "error")
    )
    if values[0].shape != values[1].shape:
        return np.inf
    difference = np.abs(values[0] - values[1])
    difference -= ROUNDING * np.nanmax(np.abs(values[0]), initial=0.0)
    combined = np.hypot(*errors)
    known = np.isfinite(combined) & (difference > 0.0)  # of the others the data tell nothing
    return float(np.max(difference[known] / np.maximum(combined[known], 1e-300), initial=0.0))
