"""Rows of recordings: the trajectory that they belong to, their times, angles that begin anew.

Encoders and arctangents give angles that begin anew after a turn.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import Array, column, labels, refuse_vanishing

TURNS = {2.0 * np.pi: "2 pi", 360.0: "360"}
# The largest step between two samples of an angle, in turns: from half a turn on nobody can tell
# in which direction it went.
_LARGEST_STEP = 0.4
# The step over the end of the range, in the largest of the others: one that is longer is a jump.
_LIKE_OTHERS = 2.0
_NOISE = 0.05  # of a turn, by which noise added to a wrapped angle exceeds its range


def spread(columns: Array) -> Array:
    """Standard deviation of each column; its size where it is constant, 1 where it is zero."""
    deviation = np.nanstd(columns, axis=0)
    size = np.nanmax(np.abs(columns), axis=0)
    return np.where(deviation > 0.0, deviation, np.where(size > 0.0, size, 1.0))


def passes(values: Array, low: float, high: float) -> int:
    """How often a series gets from below one level to above a higher one, or back.

    >>> passes(np.array([0.0, 1.0, 0.4, 1.0, 0.0]), 0.2, 0.8)
    2
    """
    side = (values > high).astype(int) - (values < low)
    return int(np.count_nonzero(np.diff(side[side != 0])))


def group_labels(groups: object, n_rows: int, name: str = "groups") -> NDArray:
    """The trajectory of each row, checked; None means one trajectory."""
    return np.zeros(n_rows, dtype=int) if groups is None else labels(name, groups, n_rows)


def trajectories(groups: NDArray) -> list[tuple[object, NDArray[np.intp]]]:
    """Label and row numbers of each trajectory, in order of appearance.

    >>> trajectories(np.array(["b", "a", "b"]))
    [('b', array([0, 2])), ('a', array([1]))]
    """
    names, first, codes = np.unique(groups, return_index=True, return_inverse=True)
    rows = np.split(np.argsort(codes, kind="stable"), np.cumsum(np.bincount(codes))[:-1])
    return [(names.tolist()[k], rows[k]) for k in np.argsort(first)]


def label_text(label: object) -> str:
    """What a trajectory is called: a column of whole numbers may have been read as decimals.

    >>> label_text(3.0), label_text("run 3")
    ('3', 'run 3')
    """
    return f"{label:.15g}" if isinstance(label, float) else str(label)


def places_along(groups: NDArray) -> Array:
    """How many rows of its trajectory come before each row.

    >>> places_along(np.array(["b", "a", "b"]))
    array([0., 0., 1.])
    """
    indices = np.empty(len(groups))
    for _, rows in trajectories(groups):
        indices[rows] = np.arange(len(rows))
    return indices


# of a usual step: how long after the left limit of an event its right one counts, and what is one
LATER, AT_ONCE = 1e-9, 2e-9
# of the rows that repeat a time, the share that is not too many; of a tick, what is no difference
COARSE, EVEN = 0.2, 0.01
# of them, how many tell a clock from an event; of a tick, by how much a fitted clock may be off
FEWEST_REPEATS, EVEN_CLOCK = 3, 0.1


def usual_step(steps: Array) -> float:
    """The median of steps of time, those from one limit of an event to the other left out.

    >>> usual_step(np.array([0.1, 1e-10, 0.1, 1e-10, 1e-10]))
    0.1
    """
    return float(np.median(steps[steps > AT_ONCE * steps.max()]))


def events_in(t: Array) -> NDArray[np.intp]:
    """Rows after which an event is: they and the next ones are its left and its right limit.

    >>> events_in(np.array([0.0, 1.0, 1.0, 2.0]))
    array([1])
    """
    steps = np.diff(t)
    lasting = steps[steps > 0.0]
    usual = np.median(lasting) if len(lasting) else 0.0
    return np.flatnonzero(steps <= max(AT_ONCE * usual, 1.5 * np.spacing(np.abs(t).max())))


def is_coarse(t: Array, x: Array) -> bool:
    """True if a clock is too slow for its rows: it ticks evenly, and all moves within a tick.

    Events fall between the ticks, or the states go on in them. `t` increases, save for repetitions;
    `x` are the columns, (n_rows, n_columns).
    """
    steps, moves = np.diff(t), np.abs(np.diff(x, axis=0))
    at_once = steps == 0.0
    if at_once.sum() <= COARSE * len(t) or at_once.all():
        return bool(at_once.all())
    if (at_once[1:] & at_once[:-1]).sum() > COARSE * len(t):
        return True
    ticks = steps[~at_once]
    even = np.abs(ticks / np.median(ticks) - 1.0) < EVEN
    within, between = (np.nanmedian(moves[some], axis=0) for some in (at_once, ~at_once))
    moving = between > 0.0
    return bool(even.mean() > 0.5 and (within > 0.5 * between)[moving].all())


def evened(t: Array, x: Array) -> Array:
    """Times of an even clock, where they are that to a tick that is longer than its steps.

    Frames every 0.0083 s are printed as 1.00, 1.01, 1.01 and 1.02 s. Two rows at one time are no
    event then: what moves does so between them as it always does, and the even clock is nowhere
    further than half a tick from the times. `x` are the columns, (n_rows, n_columns).

    >>> t = np.arange(0.0, 1.0, 0.0083)
    >>> bool(np.abs(evened(np.round(t, 2), np.sin(t)[:, None]) - t).max() < 0.001)
    True
    """
    x = np.where(np.isfinite(x), x, np.nan)
    steps, moves = np.diff(t), np.abs(np.diff(x, axis=0))
    at_once = steps == 0.0
    if at_once.sum() < FEWEST_REPEATS or (steps < 0.0).any() or is_coarse(t, x):
        return t
    told = [np.isfinite(moves[some]).any(axis=0) for some in (at_once, ~at_once)]
    moves = moves[:, told[0] & told[1]]
    within, between = (np.nanmedian(moves[some], axis=0) for some in (at_once, ~at_once))
    moving = between > 0.0
    is_usual = (0.5 * between < within) & (within < 2.0 * between)
    number = np.arange(len(t))
    even = np.asarray(np.polyval(np.polyfit(number, t, 1), number), dtype=float)
    is_even = np.abs(even - t).max() <= (0.5 + EVEN_CLOCK) * steps.max()
    return even if is_even and moving.any() and is_usual[moving].all() else t


def limits_apart(t: Array) -> Array:
    """Times of one trajectory that increase: the right limit of an event is a little later.

    So little that no state has changed, and what goes from one sample to the next jumps there.

    >>> later = limits_apart(np.array([0.0, 1.0, 1.0, 2.0])) - [0.0, 1.0, 1.0, 2.0]
    >>> later > 0.0, float(later.max()) < 1e-9
    (array([False, False,  True, False]), True)
    """
    steps = np.diff(t)
    at_once = np.append(False, steps <= 0.0)
    if not at_once.any() or (steps < 0.0).any():
        return t
    begins = np.flatnonzero(~at_once)
    number = np.arange(len(t)) - begins[np.cumsum(~at_once) - 1]
    after = np.append(t[begins[1:]], np.inf)[np.cumsum(~at_once) - 1] - t
    usual = np.median(steps[steps > 0.0]) if (steps > 0.0).any() else 1.0
    room = LATER * np.minimum(usual, after / (1 + number.max()))
    return np.asarray(t + number * np.maximum(room, np.spacing(np.abs(t))))


def between_limits(values: Array, t: Array) -> Array:
    """Values of one trajectory, those amid the first and the last row at one time as the last."""
    at_once = np.append(np.diff(t) == 0.0, False)
    if not (at_once[:-1] & at_once[1:]).any():
        return values
    last = np.flatnonzero(~at_once)[np.cumsum(np.append(0, ~at_once[:-1]))]
    amid = at_once & np.append(False, at_once[:-1])
    return np.asarray(np.where(amid[:, None], values[last], values))


def increasing_times(t: object, groups: NDArray) -> Array:
    """Times as numbers; refused where they do not increase along a trajectory."""
    t = column("t", t, len(groups))
    refuse_vanishing("t", t)
    if any((np.diff(t[rows]) <= 0).any() for _, rows in trajectories(groups)):
        raise ValueError(
            "t must increase along every trajectory; sort the rows of each trajectory by "
            "time, or give `groups` so that trajectories are told apart."
        )
    return t


def turn_of(runs: Sequence[Array]) -> float | None:
    """The turn after which an angle begins anew, 2 pi or 360; None for any other column.

    `runs` are its values along each recording, NaN where missing. An angle stays within one turn,
    jumps by nearly that, makes only small steps once whole turns are added, and goes over the end
    of its range as it goes just before or after, or by a single count: an input that rests at
    levels, and once steps by three quarters of a turn, is a voltage.

    Examples
    --------
    >>> theta = np.linspace(0.0, 30.0, 300)
    >>> turn_of([(theta + np.pi) % (2 * np.pi) - np.pi]), turn_of([np.degrees(theta) % 360])
    (6.283185307179586, 360.0)
    >>> turn_of([theta]), turn_of([np.where(theta % 2 < 1, 0.0, 6.2)])
    (None, None)
    >>> turn_of([np.repeat([2.9, 4.4, 3.2, 4.7, 0.0, 1.5, 2.9], 50)])
    """
    known = [run[np.isfinite(run)] for run in runs]
    values, steps = np.concatenate(known), np.concatenate([np.diff(run) for run in known])
    if not len(steps):
        return None
    middle, span = 0.5 * (values.min() + values.max()), np.ptp(values)
    for turn in TURNS:
        over = np.abs(steps) > 0.5 * turn
        rest = np.abs(steps - turn * np.rint(steps / turn))
        if not over.any() or over.all() or rest.max() > _LARGEST_STEP * turn:
            continue
        smooth = 0.0 < rest[over].max() <= _LIKE_OTHERS * rest[~over].max()
        counts = rest[(rest > 0.0) & (rest <= _NOISE * turn)]
        beside = np.concatenate([_beside(np.diff(run), turn) for run in known])
        beside = np.maximum(beside, counts.min() if counts.size else 0.0)
        goes_on = rest[over] <= _LIKE_OTHERS * beside[over]
        smooth &= bool(goes_on.mean() >= 0.5)  # rows may be lost beside some
        passes = bool((np.abs(values - middle) < 0.25 * turn).any())
        if smooth and span <= turn * (1.0 + (_NOISE if passes else 1e-9)):
            return turn
    return None


def _beside(steps: Array, turn: float) -> Array:
    """The larger of the steps before and after each, whole turns added."""
    sizes = np.abs(steps - turn * np.rint(steps / turn))
    around = np.pad(sizes, 1)
    return np.maximum(around[:-2], around[2:])


def how_to_unwrap(name: str, turn: float) -> str:
    """What is wrong with an angle that begins anew, and what to do in Python."""
    period = "" if turn != 360.0 else ", period=360"
    return (
        f"{name} begins anew after a turn of {TURNS[turn]}, which is no motion: give it unwrapped, "
        f"np.unwrap(values{period}) along each recording"
    )
