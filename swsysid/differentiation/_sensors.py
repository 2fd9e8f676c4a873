"""What sensors do to a record: values on a grid, values at an end of the range, values held."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks.arrays import table
from swsysid._data.trajectories import group_labels, trajectories
from swsysid.differentiation._ranges import clipped_at
from swsysid.differentiation._runs import Runs, runs_in
from swsysid.differentiation._settings import SETTINGS
from swsysid.differentiation._smoothing import Array
from swsysid.differentiation._white_noise import sixth_differences


class Sensors(NamedTuple):
    """What the sensors did to a record.

    Attributes
    ----------
    quantum : ndarray of shape (n_columns,)
        Distance of neighbouring values of a quantised column, 0 for one that is not.
    clipped : ndarray of bool, shape (n_samples, n_columns)
        Samples at an end of the range of their sensor: the true value lies beyond.
    held : ndarray of bool, shape (n_samples,)
        Rows that only repeat the one before them, because the logger is faster than the sensors.
    """

    quantum: Array
    clipped: NDArray[np.bool_]
    held: NDArray[np.bool_]


def inspect_sensors(x: ArrayLike, groups: ArrayLike | None = None) -> Sensors:
    """Find the quantum of an encoder, clipped samples, and rows that are held.

    Parameters
    ----------
    x : array-like of shape (n_samples, n_columns) or (n_samples,)
        Measured trajectories, rows of one trajectory in order of time.
    groups : array-like of shape (n_samples,), default=None
        The trajectory each row belongs to; None means one trajectory.

    Returns
    -------
    Sensors

    Notes
    -----
    A column is quantised if all distances of its values are multiples of the smallest and its
    differences show it; exact ramps and parabolas lie on grids too, and have no noise. Samples
    count as clipped where a column stays at its largest or smallest value, and would have gone
    on by the samples before and after, or has noise that a sensor could not lose elsewhere.
    Something that comes to rest there arrives and leaves slowly, and does not count.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.differentiation import inspect_sensors
    >>> q = np.sin(np.linspace(0.0, 20.0, 2000))
    >>> sensors = inspect_sensors(np.column_stack([0.01 * np.round(q / 0.01), q.clip(-2.0, 0.9)]))
    >>> sensors.quantum.round(6).tolist()
    [0.01, 0.0]
    >>> sensors.clipped.sum(axis=0).tolist()
    [0, 277]
    """
    columns = table("x", x)
    parts = [rows for _, rows in trajectories(group_labels(groups, len(columns)))]
    quantum = np.array([_quantum([column[rows] for rows in parts]) for column in columns.T])
    held = _held(columns, parts, quantum)
    clipped = clipped_at(columns, [rows[~held[rows]] for rows in parts], quantum)
    return Sensors(quantum, clipped, held)


# --- values on a grid -------------------------------------------------------------------------


def _quantum(parts: list[Array]) -> float:
    """Distance of neighbouring values of one column, 0 if they lie on no grid."""
    # An encoder may be set to zero at the start of a trajectory, so grids may be shifted.
    gaps = np.concatenate([np.diff(np.unique(values)) for values in parts])
    rounding = SETTINGS.rounding * max(float(np.abs(values).max()) for values in parts)
    gaps = gaps[gaps > rounding]
    if len(gaps) < SETTINGS.fewest_levels:
        return 0.0
    least = float(gaps.min())
    steps = np.rint(gaps / least)
    quantum = float(gaps.sum() / steps.sum())
    if np.abs(gaps / quantum - steps).max() > SETTINGS.off_grid:
        return 0.0
    sizes = np.abs(np.concatenate([sixth_differences(values[:, None])[0] for values in parts]))
    return quantum if len(sizes) and np.median(sizes) > 0.5 * quantum else 0.0


# --- held rows --------------------------------------------------------------------------------


def _held(columns: Array, parts: list[NDArray[np.intp]], quantum: Array) -> NDArray[np.bool_]:
    """Rows that repeat the one before them although the record moves."""
    held = np.zeros(len(columns), dtype=bool)
    runs = [runs_in(columns[rows]) for rows in parts]
    hold = _hold(runs, bool((quantum > 0.0).any()))
    if hold > 1:
        for rows, each in zip(parts, runs, strict=True):
            # Of a long rest as many rows stay as there are of a movement.
            readings = np.maximum(np.rint(each.lengths / hold), 1.0)[each.numbers]
            place = each.places
            held[rows] = (place % hold != 0) | (place >= hold * readings)
    return held


def _hold(runs: list[Runs], quantised: bool) -> int:
    """Samples for which a logger repeats a reading, 1 if it does not."""
    # Runs at the ends may have been cut.
    lengths = np.concatenate([each.lengths[1:-1] for each in runs])
    if len(lengths) < SETTINGS.fewest_readings:
        return 1
    if quantised:
        # Slow motion repeats values of a grid too, but not in steps of one length.
        return int(np.gcd.reduce(lengths))
    single = np.mean(lengths == 1)
    return int(np.median(lengths)) if single <= SETTINGS.single_readings else 1
