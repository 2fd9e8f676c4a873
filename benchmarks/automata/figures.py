"""How far a found automaton is from the plant, on its recordings and on some nobody has seen.

Deviations and guards are relative to the range of each column in the held-out recordings, instants
are in samples. The last figures are those that the published tools report of themselves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.automata.found import Found, Guard, Rollout
from benchmarks.automata.plant import Array, Plant
from benchmarks.automata.recordings import Campaign
from benchmarks.automata.truth import Crossing
from swsysid.metrics._modes import best_matching, contingency

__all__ = ["FIGURES", "figures"]

FIGURES = (
    "modes", "share", "guard", "edges", "mean", "largest", "ended", "near", "spurious", "apart",
    "tool_modes", "tool_instants", "tool_mean", "tool_largest",
)  # fmt: skip
NEAR = 2.0  # samples
STEP = 1e-6  # of the range, where a guard is differentiated


def figures(plant: Plant, found: Found, seen: Campaign, unseen: Campaign) -> dict[str, float]:
    """All figures of one method on one campaign.

    ``modes`` is how many were found too many, ``share`` the share of the samples in their mode,
    ``edges`` the share of the held-out crossings whose transition was found and ``guard`` the
    largest distance of those to its guard; ``mean`` and ``largest`` are deviations of held-out
    rollouts up to their ends, ``ended`` the share of rollouts that ended early; ``near`` is the
    share of the true instants of the training set with one found within two samples, ``spurious``
    the share of those found that are further from a true one, ``apart`` the largest distance of
    held-out instants from the nearest in the rollout, or back.
    """
    order = matched(seen.modes, found.modes, plant.n_modes, found.n_modes)
    rollouts = [
        found.roll(replace(start, mode=int(order[start.mode])), run.t, given)
        for start, run, given in zip(unseen.starts, unseen.runs, unseen.given, strict=True)
    ]
    guards = distances_of_guards(plant, found, unseen, order)
    near, spurious = nearness(seen.instants, found.instants, plant.dt)
    deviations = [deviation(run.x, one.x) for run, one in zip(unseen.runs, rollouts, strict=True)]
    relative = np.concatenate(deviations) / span(unseen.states)
    n_crossings = sum(len(run.crossings) for run in unseen.runs)
    return {
        "modes": float(found.n_modes - plant.n_modes),
        "share": float(np.mean(order[seen.modes] == found.modes)),
        "guard": float(np.max(guards, initial=0.0)),
        "edges": len(guards) / n_crossings if n_crossings else 1.0,
        "mean": float(relative.mean()),
        "largest": float(relative.max()),
        "ended": float(np.mean([len(one.x) < len(run.t) for one, run in _pairs(unseen, rollouts)])),
        "near": near,
        "spurious": spurious,
        "apart": apart(unseen, rollouts, plant.dt),
        **of_tools(plant, found, unseen, rollouts),
    }


def _pairs(unseen: Campaign, rollouts: list[Rollout]):
    return zip(rollouts, unseen.runs, strict=True)


def matched(
    true: NDArray[np.intp], found: NDArray[np.intp], n_true: int, n_found: int
) -> NDArray[np.intp]:
    """The mode found for each true one; those without a partner get the one they mostly are."""
    joint = contingency(true, found, shape=(n_true, n_found))
    order = joint.argmax(axis=1)
    rows, columns = best_matching(joint)
    order[rows] = columns
    return order


def span(rows: Array) -> Array:
    """The range of each column, 1 where it does not change."""
    ranges = np.ptp(rows, axis=0)
    return np.where(ranges > 0.0, ranges, 1.0)


def deviation(true: Array, found: Array) -> Array:
    """Sizes of the differences as far as a rollout reaches."""
    return np.abs(found - true[: len(found)])


def distances_of_guards(
    plant: Plant, found: Found, unseen: Campaign, order: NDArray[np.intp]
) -> Array:
    """How far the state, inputs and clocks of each held-out crossing are from the guard found.

    The distance is |f| over the length of its gradient in ranges. A map tests its guards at whole
    steps, and a mode may be entered where its guard has been passed: a guard that does there what
    the true one does is at no distance.
    """
    crossings = [crossing for run in unseen.runs for crossing in run.crossings]
    if not crossings:
        return np.zeros(0)
    ranges = _ranges(plant, unseen)
    distances = []
    for crossing in crossings:
        edge = plant.edges[crossing.edge]
        guard = found.guard(int(order[edge.source]), int(order[edge.target]))
        if guard is not None:
            at_rows = plant.is_map or _on_entry(crossing)
            judge = _missed_by if at_rows else _distance
            distances.append(judge(guard, crossing, ranges))
    return np.array(distances)


def _on_entry(crossing: Crossing) -> bool:
    """Whether the guard had been passed where the mode was entered."""
    return crossing.columns[-2] == 0.0


def _ranges(plant: Plant, unseen: Campaign) -> Array:
    """Of the columns of laws, the longest dwell that ended in a crossing, and all times."""
    inputs = np.empty((1, 0)) if unseen.inputs is None else unseen.inputs
    dwells = [crossing.columns[-2] for run in unseen.runs for crossing in run.crossings]
    clocks = [max(dwells), np.ptp(unseen.t)]
    laws = [np.tile(span(rows), plant.lags + 1) for rows in (unseen.states, inputs)]
    return np.concatenate([*laws, clocks])


def _distance(guard: Guard, crossing: Crossing, ranges: Array) -> float:
    value, slope = _read(guard, crossing.columns, ranges)
    return abs(value) / slope if slope > 0.0 else np.inf


def _missed_by(guard: Guard, crossing: Crossing, ranges: Array) -> float:
    """How far below zero at a row at which it was taken, or above it one step of a map earlier."""
    value, slope = _read(guard, crossing.columns, ranges)
    wrong = max(0.0, -value)
    if crossing.before is not None:
        wrong = max(wrong, _read(guard, crossing.before, ranges)[0])
    return 0.0 if wrong == 0.0 else wrong / slope if slope > 0.0 else np.inf


def _read(guard: Guard, row: Array, ranges: Array) -> tuple[float, float]:
    """Value of a guard and length of its gradient in ranges."""
    steps = STEP * np.diag(ranges)
    values = guard(np.vstack([row, row + steps, row - steps]))
    up, down = values[1 : len(row) + 1], values[len(row) + 1 :]
    return float(values[0]), float(np.linalg.norm(up - down) / (2.0 * STEP))


def nearness(true: list[Array], found: list[Array], dt: float) -> tuple[float, float]:
    """Shares of the true instants that were found, and of those found that are not true."""
    late = np.concatenate([_nearest(one, own) for one, own in zip(true, found, strict=True)])
    early = np.concatenate([_nearest(own, one) for one, own in zip(true, found, strict=True)])
    near = float(np.mean(late <= NEAR * dt)) if len(late) else 1.0
    return near, float(np.mean(early > NEAR * dt)) if len(early) else 0.0


def _nearest(instants: Array, others: Array) -> Array:
    """Distance of each instant to the nearest of the others, infinite if there is none."""
    return np.abs(np.subtract.outer(instants, others)).min(axis=1, initial=np.inf)


def apart(unseen: Campaign, rollouts: list[Rollout], dt: float) -> float:
    """Largest distance of true and rolled out instants, both ways, in samples."""
    largest = 0.0
    for true, one in zip(unseen.instants, rollouts, strict=True):
        both = [*_nearest(true, one.instants), *_nearest(one.instants, true)]
        largest = max(largest, np.max(both, initial=0.0) / dt)
    return float(largest)


def of_tools(
    plant: Plant, found: Found, unseen: Campaign, rollouts: list[Rollout]
) -> dict[str, float]:
    """What DAINARX reports of itself (arXiv 2507.16426, section on experiments).

    Modes too many or too few; the largest distance of instants in time; the mean and the largest
    deviation of the rollouts, each state in units of the largest value it has in that recording.
    """
    relative = []
    for one, run in _pairs(unseen, rollouts):
        largest = np.abs(run.x).max(axis=0)
        relative.append(deviation(run.x, one.x) / np.where(largest > 0.0, largest, 1.0))
    every = np.concatenate(relative)
    return {
        "tool_modes": float(abs(found.n_modes - plant.n_modes)),
        "tool_instants": apart(unseen, rollouts, plant.dt) * plant.dt,
        "tool_mean": float(every.mean()),
        "tool_largest": float(every.max()),
    }
