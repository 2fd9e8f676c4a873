"""Rearrangements of a residual that keep its correlation in time, and p-values from them.

To ask whether a residual depends on a channel one compares with residuals that cannot: the same
ones, in another order. Rows that follow each other in time may be alike, and so they move in
blocks longer than their correlation; a white residual moves row by row, however slow the channel.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._noise import robust_scale
from swsysid._residual_report.settings import SETTINGS
from swsysid._results import Array


def robust_clip(values: Array) -> Array:
    """`values` about their median, cut off at a few robust standard deviations, then centred."""
    centred = values - np.median(values)
    spread = robust_scale(centred)
    if spread == 0.0:  # more than half of them are equal
        spread = np.abs(centred).mean()
    clipped = np.clip(centred, -SETTINGS.clip * spread, SETTINGS.clip * spread)
    return clipped - clipped.mean()


def correlation_length(values: Array, codes: NDArray[np.intp]) -> float:
    r"""Rows that count as one: :math:`1 + 2\sum_k \rho_k` up to the first lag that is noise.

    `codes` name the trajectory of each row; a trajectory is a contiguous stretch of rows.
    """
    centred = values - values.mean()
    variance = float(np.square(centred).mean())
    total, noise = 0.0, 2.0 / np.sqrt(len(values))
    for lag in range(1, min(SETTINGS.longest_lag, len(values) // 4) + 1):
        together = codes[lag:] == codes[:-lag]
        if variance == 0.0 or not together.any():
            break
        rho = (centred[lag:] * centred[:-lag])[together].mean() / variance
        if rho < noise:
            break
        total += float(rho)
    return 1.0 + 2.0 * total


def block_length(values: Array, codes: NDArray[np.intp]) -> int:
    """Rows that must stay together: a few correlation lengths of the values and of their size."""
    length = max(correlation_length(one, codes) for one in (values, np.abs(values)))
    if length == 1.0:
        return 1
    longest = len(values) // SETTINGS.fewest_blocks
    return int(max(1, min(np.ceil(SETTINGS.lengths_a_block * length), longest)))


def rearrangements(n_rows: int, block: int, n_permutations: int, rng) -> NDArray[np.int32]:
    """Orders of the rows, (1 + n_permutations, n_rows); the first one is the order as it is.

    The rows are closed to a ring that is cut at a random place into blocks, which are shuffled.
    """
    orders = np.empty((1 + n_permutations, n_rows), dtype=np.int32)
    rows = orders[0] = np.arange(n_rows)
    n_pieces = max(2, n_rows // block)
    lengths = n_rows // n_pieces + (np.arange(n_pieces) < n_rows % n_pieces)
    starts = np.cumsum(lengths) - lengths
    for order in orders[1:]:
        if block == 1:
            order[:] = rng.permutation(n_rows)
            continue
        cut, pieces = rng.randint(n_rows), rng.permutation(n_pieces)
        begins = np.cumsum(lengths[pieces]) - lengths[pieces]  # where each piece comes to lie
        order[:] = np.repeat(starts[pieces] - begins, lengths[pieces]) + rows - cut
        order %= n_rows
    return orders


def max_statistic(statistics: Array) -> Array:
    """P-values of many tests at once, corrected for their number (Westfall and Young, 1993).

    Column 0 of `statistics` (n_tests, 1 + n_permutations) is the data, the others are the
    rearrangements. Every test is put on its own scale first; its p-value is the share of the
    columns whose *largest* entry reaches its own. So no p-value needs a multiplication by the
    number of tests, which few rearrangements could never survive.
    """
    if not len(statistics):
        return np.zeros(0)
    deviation = statistics.std(axis=1, keepdims=True)
    deviation[deviation == 0.0] = 1.0
    scores = (statistics - statistics.mean(axis=1, keepdims=True)) / deviation
    largest = np.sort(scores[:, 1:].max(axis=0))
    reached = len(largest) - np.searchsorted(largest, scores[:, 0], side="left")
    return (1.0 + reached) / (1.0 + len(largest))


def holm(p_values: list[float]) -> Array:
    """P-values corrected for their number by Holm's step-down procedure.

    Written out, because statsmodels' ``multipletests`` collects garbage at each call, which takes
    longer than the whole report of a small record.
    """
    order = np.argsort(p_values)
    corrected = np.empty(len(p_values))
    steps = np.arange(len(p_values), 0, -1) * np.asarray(p_values)[order]
    corrected[order] = np.minimum(1.0, np.maximum.accumulate(steps))
    return corrected
