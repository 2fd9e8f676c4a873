"""Columns of angles: whole turns that were taken off are added again, and said."""

from __future__ import annotations

import re

import numpy as np

from swsysid._cli.measurement import Measurement
from swsysid._cli.runs import Runs
from swsysid._data.trajectories import TURNS, trajectories, turn_of
from swsysid._results import Array
from swsysid._tables.table import Table

_DEGREES = re.compile(r"(deg|degrees?|°)(?![A-Za-z])")
_RADIANS = re.compile(r"rad|radians?")


def is_in_degrees(unit: str) -> bool:
    """Whether a unit is that of an angle in degrees, or of its rate.

    Examples
    --------
    >>> [is_in_degrees(unit) for unit in ("deg", "deg/s", "°", "degC", "rad")]
    [True, True, True, False, False]
    """
    return _DEGREES.match(unit) is not None


def is_angle(unit: str) -> bool:
    """Whether a unit is that of an angle."""
    return bool(_DEGREES.fullmatch(unit) or _RADIANS.fullmatch(unit))


def unwrapped(table: Table, what: Measurement, numbers: Array, runs: Runs) -> Table:
    """Unwrap the angles among the states and inputs of `numbers`, in place.

    The table has their units, and a sentence on each. A column whose unit is that of no angle is
    left alone.
    """
    rows = [runs.rows[members] for _, members in trajectories(runs.labels)]
    for k, name in enumerate((*what.states, *what.inputs)):
        turn, unit = turn_of([numbers[own, k] for own in rows]), table.unit(table.resolve(name))
        angle = {360.0: _DEGREES, 2.0 * np.pi: _RADIANS}.get(turn or 0.0)
        if turn is None or angle is None or (unit and not angle.fullmatch(unit)):
            continue
        for own in rows:
            known = own[np.isfinite(numbers[own, k])]
            numbers[known, k] = np.unwrap(numbers[known, k], period=turn)
        named = "degrees" if turn == 360.0 else "radians"
        told = (
            f"{name} begins anew after {TURNS[turn]}: it is an angle in {named}, and was unwrapped "
            f"(--units {table.title(name)}=1 keeps it as it is)."
        )
        values = table.columns[table.resolve(name)]
        table = table.replaced(name, values, unit or ("deg" if turn == 360.0 else "rad"), told)
    return table
