"""Levels of an input that noise is added to: a gate or a relay on an analog channel.

What acts on the plant is the gate, and not the noise of the voltmeter. Values are put into classes
that leave least squares, one class more at a time, and are levels where neighbouring classes are so
far apart that noise hardly puts a value of one into the other.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._data.recordings import KEEPS, how_often
from swsysid._results import Array

# Levels that are tried at most, and how far apart they are, in standard deviations of the values
# around them: of normal ones 1 in 16,000 is then nearer to the next level. Those of a sine wave in
# two classes are 4.1 apart, of a ramp in any number of classes 3.5, of normal noise 2.7.
_MOST, _APART = 8, 8.0


def levels_of(values: Array) -> Array | None:
    """The levels around which values scatter, ascending; None if there are no two of them.

    Examples
    --------
    >>> noise = 0.05 * np.random.default_rng(0).standard_normal(300)
    >>> levels_of(np.repeat([5.0, 1.0, 2.5], 100) + noise).round(1).tolist()
    [1.0, 2.5, 5.0]
    >>> levels_of(noise), levels_of(np.sin(np.arange(300.0)))
    (None, None)
    """
    ordered = np.sort(values)
    ordered = ordered - (middle := float(ordered.mean()))
    sums = [np.append(0.0, np.cumsum(ordered**power)) for power in (1, 2)]
    edges, found = [0, len(ordered)], None
    for _ in range(1, min(_MOST, len(ordered) - 1)):
        gain, edge = max(_split(sums, *pair) for pair in zip(edges[:-1], edges[1:], strict=True))
        if gain <= 0.0:
            break
        edges = sorted([*edges, edge])
        count = np.diff(edges)
        means = np.diff(sums[0][edges]) / count
        left = max(0.0, sums[1][-1] - float((count * means**2).sum()))
        if np.diff(means).min() > _APART * np.sqrt(left / len(ordered)):
            found = means + middle
    return found


def _split(sums: Sequence[Array], first: int, last: int) -> tuple[float, int]:
    """By how much two classes in the place of one lower the squares, and where the second begins.

    `sums` are those of the first values in order, and of their squares.
    """
    if last - first < 2:
        return 0.0, first
    edges = np.arange(first + 1, last)
    total, before = sums[0][last] - sums[0][first], sums[0][edges] - sums[0][first]
    gains = before**2 / (edges - first) + (total - before) ** 2 / (last - edges)
    best = int(gains.argmax())
    return float(gains[best] - total**2 / (last - first)), int(edges[best])


def at_levels(records: Sequence[tuple[Array, Array]]) -> tuple[list[Array], list[int]]:
    """Inputs of recordings, those in levels but for noise without it, and which are in levels.

    `records` are times and inputs of each. Of inputs that are steps without noise, and seldom,
    every value is one that was sent.

    Examples
    --------
    >>> t, noise = np.arange(6.0), np.array([0.1, -0.1, 0.0, -0.1, 0.0, 0.1])
    >>> inputs, channels = at_levels([(t, np.column_stack([[0, 0, 0, 5, 5, 5] + noise, t]))])
    >>> inputs[0].tolist(), channels
    ([[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [5.0, 3.0], [5.0, 4.0], [5.0, 5.0]], [0])
    """
    inputs, channels = [u for _, u in records], []
    for channel in np.flatnonzero(how_often(records) > KEEPS).tolist():
        levels = levels_of(np.concatenate([u[:, channel] for u in inputs]))
        if levels is not None:
            inputs = [_with_nearest(u, channel, levels) for u in inputs]
            channels.append(channel)
    return inputs, channels


def _with_nearest(u: Array, channel: int, levels: Array) -> Array:
    other = u.copy()
    other[:, channel] = levels[np.searchsorted(0.5 * (levels[1:] + levels[:-1]), u[:, channel])]
    return other
