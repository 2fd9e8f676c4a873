"""Samples at an end of the range of their sensor, told from a system that comes to rest there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid.differentiation._runs import runs_in
from swsysid.differentiation._settings import SETTINGS
from swsysid.differentiation._smoothing import Array
from swsysid.differentiation._white_noise import noise_in


def clipped_at(columns: Array, parts: list[NDArray[np.intp]], quantum: Array) -> NDArray[np.bool_]:
    """Which samples (n_samples, n_columns) are clipped; `parts` are rows that are no repeats."""
    clipped = np.zeros(columns.shape, dtype=bool)
    noise = noise_in([columns[rows] for rows in parts], quantum)
    for k, values in enumerate(columns.T):
        if len(np.unique(values)) <= SETTINGS.fewest_levels:
            continue  # a switch, whose ends are all that it has
        series = [values[rows] for rows in parts]
        # Noise repeats no value for long: where it does so at an end, this is that of the range.
        visible = max(SETTINGS.visible * np.ptp(values), SETTINGS.beyond_rounding * quantum[k])
        noisy = noise[k] > visible
        ends = [
            end
            for end in (values.min(), values.max())
            if (noisy and _repeats_only(series, end))
            or any(_passes(each, end, quantum[k], noise[k]) for each in series)
        ]
        if len(ends) == 1 and values.min() == -values.max():
            ends.append(-ends[0])  # a range is that of both signs
        clipped[:, k] = np.isin(values, ends)
    return clipped


def _repeats_only(series: list[Array], end: float) -> bool:
    """Whether values are repeated at this end for much longer than they are between the ends."""
    runs = [runs_in(values) for values in series]
    levels = np.concatenate([v[each.starts] for v, each in zip(series, runs, strict=True)])
    lengths = np.concatenate([each.lengths for each in runs])
    between = (levels > levels.min()) & (levels < levels.max())
    usual = int(lengths[between].max(initial=1))
    return bool(lengths[levels == end].max() >= SETTINGS.plateau * usual)


def _passes(values: Array, end: float, quantum: float, noise: float) -> bool:
    """Whether a trajectory would have gone on beyond an end at which it stays."""
    runs, depths = runs_in(values), np.abs(values - end)
    stays = np.flatnonzero((runs.lengths >= SETTINGS.plateau) & (depths[runs.starts] == 0.0))
    for start, length in zip(runs.starts[stays], runs.lengths[stays], strict=True):
        sides = depths[:start][::-1], depths[start + length :]
        # What was before the record or comes after it is not known.
        known = [side for side in sides if len(side) >= SETTINGS.approach]
        near = [_approach(side, quantum, noise) for side in known]
        if near and all(_is_fast(side, depths, length, quantum, noise) for side in near):
            return True
    return False


def _approach(depths: Array, quantum: float, noise: float) -> Array:
    """The samples beside a stay in which the movement is plain to see."""
    plain = depths > SETTINGS.plain * max(quantum, noise)
    reach = int(plain.argmax()) + 1 if plain.any() else len(depths)
    return depths[: max(reach, SETTINGS.approach)]


def _is_fast(near: Array, depths: Array, stay: int, quantum: float, noise: float) -> bool:
    """Whether a movement to an end is too fast to stop there, as this trajectory stops."""
    places = np.arange(1.0, len(near) + 1.0)
    inverse = np.linalg.pinv(places[:, None] ** np.arange(3))
    speed = float(inverse[1] @ near)
    # Up to so much is hidden by rounding, and by the step from one sample to the next.
    hidden = max(SETTINGS.hidden_quanta * quantum, float(near[0]))
    doubt = SETTINGS.sure * noise * float(np.linalg.norm(inverse[1]))
    if speed <= doubt or speed * stay <= hidden:
        return False
    deceleration = max(2.0 * float(inverse[2] @ near), _usual_bend(depths, len(near)))
    return speed**2 > 2.0 * deceleration * hidden


def _usual_bend(depths: Array, reach: int) -> float:
    """Acceleration, in samples, that a trajectory hardly exceeds away from the end."""
    away = depths > 0.0
    bend = np.abs(depths[2 * reach :] - 2.0 * depths[reach:-reach] + depths[: -2 * reach])
    bend = bend[away[2 * reach :] & away[reach:-reach] & away[: -2 * reach]]
    return float(np.quantile(bend, SETTINGS.hardly)) / reach**2 if len(bend) else np.inf
