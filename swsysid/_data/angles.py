"""Angles that begin anew after a turn, as encoders and arctangents give them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TURNS = {2.0 * np.pi: "2 pi", 360.0: "360"}
# The largest step between two samples of an angle, in turns: from half a turn on nobody can tell
# in which direction it went.
_LARGEST_STEP = 0.4
# The step over the end of the range, in the largest of the others: one that is longer is a jump.
_LIKE_OTHERS = 2.0
_NOISE = 0.05  # of a turn, by which noise added to a wrapped angle exceeds its range


def turn_of(runs: Sequence[Array]) -> float | None:
    """The turn after which an angle begins anew, 2 pi or 360; None for any other column.

    `runs` are its values along each recording, NaN where missing. An angle stays within one turn,
    jumps by nearly that, and makes only small steps once whole turns are added.

    Examples
    --------
    >>> theta = np.linspace(0.0, 30.0, 300)
    >>> turn_of([(theta + np.pi) % (2 * np.pi) - np.pi]), turn_of([np.degrees(theta) % 360])
    (6.283185307179586, 360.0)
    >>> turn_of([theta]), turn_of([np.where(theta % 2 < 1, 0.0, 6.2)])
    (None, None)
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
        passes = bool((np.abs(values - middle) < 0.25 * turn).any())
        if smooth and span <= turn * (1.0 + (_NOISE if passes else 1e-9)):
            return turn
    return None


def how_to_unwrap(name: str, turn: float) -> str:
    """What is wrong with an angle that begins anew, and what to do in Python."""
    period = "" if turn != 360.0 else ", period=360"
    return (
        f"{name} begins anew after a turn of {TURNS[turn]}, which is no motion: give it unwrapped, "
        f"np.unwrap(values{period}) along each recording"
    )
