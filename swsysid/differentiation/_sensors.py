"""What sensors do to a record: values on a grid, values at an end of the range, values held.

Samples at an end of the range of their sensor are told from a system that comes to rest there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swsysid._checks.arrays import table
from swsysid._data.trajectories import group_labels, trajectories
from swsysid.differentiation._noise import (
    BEYOND_ROUNDING,
    Runs,
    noise_in,
    runs_in,
    sixth_differences,
)
from swsysid.differentiation._smoothing import Array

SURE = 4.0  # standard deviations beyond which a speed is not noise

_ROUNDING = 1e-12  # share of the largest value: differences below it are rounding
_HIDDEN_QUANTA = 6.0  # quanta that may hide a smooth turn

# Fewer distances of neighbouring values are a signal of states, not of an encoder.
_FEWEST_LEVELS = 5
# Quanta by which the distances of values on a grid may be off, after single precision.
_OFF_GRID = 0.05
# Readings that show how long a logger holds them, and the share of them that it need not hold.
_FEWEST_READINGS = 20
_SINGLE_READINGS = 0.02
# Samples that a clipped stretch has at least, times those of any stay elsewhere; samples beside
# it that show how fast the movement to it is: at least so many, and until it has made so many
# quanta or deviations.
_PLATEAU = 3
_APPROACH = 7
_PLAIN = 10.0
# Noise below this share of the range may be what differences leave of a smooth signal.
_VISIBLE = 1e-4
# Share of a trajectory that accelerates less than it does where it stops.
_HARDLY = 0.95


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
    Something that comes to rest there arrives and leaves slowly, or stops as suddenly elsewhere,
    and does not count; nor does a rest with which a record begins, nor zero, where a wheel stands
    and a diode blocks.

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
    clipped = _clipped_at(columns, [rows[~held[rows]] for rows in parts], quantum)
    return Sensors(quantum, clipped, held)


# --- values on a grid -------------------------------------------------------------------------


def _quantum(parts: list[Array]) -> float:
    """Distance of neighbouring values of one column, 0 if they lie on no grid."""
    # An encoder may be set to zero at the start of a trajectory, so grids may be shifted.
    gaps = np.concatenate([np.diff(np.unique(values)) for values in parts])
    rounding = _ROUNDING * max(float(np.abs(values).max()) for values in parts)
    gaps = gaps[gaps > rounding]
    if len(gaps) < _FEWEST_LEVELS:
        return 0.0
    least = float(gaps.min())
    steps = np.rint(gaps / least)
    quantum = float(gaps.sum() / steps.sum())
    if np.abs(gaps / quantum - steps).max() > _OFF_GRID:
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
    if len(lengths) < _FEWEST_READINGS:
        return 1
    if quantised:
        # Slow motion repeats values of a grid too, but not in steps of one length.
        return int(np.gcd.reduce(lengths))
    single = np.mean(lengths == 1)
    return int(np.median(lengths)) if single <= _SINGLE_READINGS else 1


def _clipped_at(columns: Array, parts: list[NDArray[np.intp]], quantum: Array) -> NDArray[np.bool_]:
    """Which samples (n_samples, n_columns) are clipped; `parts` are rows that are no repeats."""
    clipped = np.zeros(columns.shape, dtype=bool)
    noise = noise_in([columns[rows] for rows in parts], quantum)
    for k, values in enumerate(columns.T):
        if len(np.unique(values)) <= _FEWEST_LEVELS:
            continue  # a switch, whose ends are all that it has
        series = [values[rows] for rows in parts]
        # A stay with which a record begins is a rest, unless another column moves meanwhile.
        least = _PLAIN * np.maximum(quantum, noise)
        rests = [not _moves_at_first(columns[rows], k, least) for rows in parts]
        # Noise repeats no value for long: where it does so at an end, this is that of the range.
        visible = max(_VISIBLE * np.ptp(values), BEYOND_ROUNDING * quantum[k])
        noisy = noise[k] > visible
        ends = [
            end
            for end in (values.min(), values.max())
            if end != 0.0  # where plants rest: a diode blocks, a tank is empty, a wheel stands
            and (
                (noisy and _repeats_only(series, end, rests))
                or _passes(series, end, quantum[k], noise[k], rests)
            )
        ]
        if len(ends) == 1 and values.min() == -values.max():
            ends.append(-ends[0])  # a range is that of both signs
        clipped[:, k] = np.isin(values, ends)
    return clipped


def _moves_at_first(record: Array, column: int, least: Array) -> bool:
    """Whether others move by more than `least` while a column has the value it begins with."""
    stay = record[: runs_in(record[:, column]).lengths[0]]
    return bool((np.delete(np.ptp(stay, axis=0) - least, column) > 0.0).any())


def _repeats_only(series: list[Array], end: float, rests: list[bool]) -> bool:
    """Whether values are repeated at this end for much longer than they are between the ends."""
    runs = [runs_in(values) for values in series]
    levels = np.concatenate([v[each.starts] for v, each in zip(series, runs, strict=True)])
    lengths = np.concatenate([each.lengths for each in runs])
    seen = np.concatenate([each.starts >= rest for each, rest in zip(runs, rests, strict=True)])
    between = (levels > levels.min()) & (levels < levels.max())
    usual = int(lengths[between].max(initial=1))
    return bool(lengths[seen & (levels == end)].max(initial=0) >= _PLATEAU * usual)


def _passes(
    series: list[Array], end: float, quantum: float, noise: float, rests: list[bool]
) -> bool:
    """Whether trajectories would have gone on beyond an end at which they stay.

    Not if they stop as suddenly elsewhere, as a servo at its target does; nor by how they depart
    from a rest with which a record begins: any plant rests until it is driven.
    """
    least, most = (float(bound) for bound in (min(map(np.min, series)), max(map(np.max, series))))
    passed = False
    for values, rest in zip(series, rests, strict=True):
        runs = runs_in(values)
        stays = np.flatnonzero((runs.lengths >= _PLATEAU) & (runs.starts >= rest))
        for start, length in zip(runs.starts[stays], runs.lengths[stays], strict=True):
            is_end = values[start] == end
            if not is_end and not least < values[start] < most:
                continue
            depths = np.abs(values - values[start])
            sides = [depths[:start][::-1], depths[start + length :]][: 2 if is_end else 1]
            # What was before the record or comes after it is not known.
            near = [_approach(side, quantum, noise) for side in sides if len(side) >= _APPROACH]
            if near and all(_is_fast(side, depths, length, quantum, noise) for side in near):
                if not is_end:
                    return False
                passed = True
    return passed


def _approach(depths: Array, quantum: float, noise: float) -> Array:
    """The samples beside a stay in which the movement is plain to see."""
    plain = depths > _PLAIN * max(quantum, noise)
    reach = int(plain.argmax()) + 1 if plain.any() else len(depths)
    return depths[: max(reach, _APPROACH)]


def _is_fast(near: Array, depths: Array, stay: int, quantum: float, noise: float) -> bool:
    """Whether a movement to an end is too fast to stop there, as this trajectory stops."""
    places = np.arange(1.0, len(near) + 1.0)
    inverse = np.linalg.pinv(places[:, None] ** np.arange(3))
    speed = float(inverse[1] @ near)
    # Up to so much is hidden by rounding, and by the step from one sample to the next.
    hidden = max(_HIDDEN_QUANTA * quantum, float(near[0]))
    doubt = SURE * noise * float(np.linalg.norm(inverse[1]))
    if speed <= doubt or speed * stay <= hidden:
        return False
    deceleration = max(2.0 * float(inverse[2] @ near), _usual_bend(depths, len(near)))
    return speed**2 > 2.0 * deceleration * hidden


def _usual_bend(depths: Array, reach: int) -> float:
    """Acceleration, in samples, that a trajectory hardly exceeds away from the end."""
    away = depths > 0.0
    bend = np.abs(depths[2 * reach :] - 2.0 * depths[reach:-reach] + depths[: -2 * reach])
    bend = bend[away[2 * reach :] & away[reach:-reach] & away[: -2 * reach]]
    return float(np.quantile(bend, _HARDLY)) / reach**2 if len(bend) else np.inf
