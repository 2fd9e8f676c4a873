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
        for end in (values.min(), values.max()):
            found = noisy and _repeats_only(series, end)
            found = found or any(_passes(each, end, quantum[k], noise[k]) for each in series)
            if found:
                clipped[:, k] |= values == end
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
        long = [side for side in sides if len(side) >= SETTINGS.approach]
        if long and all(_is_fast(_approach(side, quantum, noise), quantum, noise) for side in long):
            return True
    return False


def _approach(depths: Array, quantum: float, noise: float) -> Array:
    """The samples beside a stay in which the movement is plain to see."""
    plain = depths > SETTINGS.plain * max(quantum, noise)
    reach = int(plain.argmax()) + 1 if plain.any() else len(depths)
    return depths[: max(reach, SETTINGS.approach)]


def _is_fast(depths: Array, quantum: float, noise: float) -> bool:
    """Whether a movement to an end is too fast to stop there with the deceleration that it has."""
    places = np.arange(1.0, len(depths) + 1.0)
    design = places[:, None] ** np.arange(3)
    inverse = np.linalg.pinv(design)
    _, speed, bend = inverse @ depths
    doubt = SETTINGS.sure * noise * float(np.linalg.norm(inverse[1]))
    # With the deceleration 2 * bend it stops after speed^2 / (4 * bend). Up to a quantum of this
    # is hidden by rounding, and up to a step of the movement between two samples.
    hidden = max(SETTINGS.hidden_quanta * quantum, float(depths[0]))
    return speed > doubt and speed**2 > 4.0 * bend * hidden
