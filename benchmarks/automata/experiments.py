"""Where recordings start, and what their inputs do."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.automata.plant import Array, Start

__all__ = ["Box", "drawn", "ramps"]

Box = tuple[int, Sequence[tuple[float, float]]]


def drawn(
    *boxes: Box, times: Sequence[tuple[float, float]] | None = None, lags: int = 0
) -> Callable[[np.random.Generator, int], Start]:
    """Starts from some boxes, each a mode and the range of every state; recordings take turns.

    ``times`` has the range of the first time for each box; with lags the rows are drawn one by one.
    """

    def start(rng: np.random.Generator, number: int) -> Start:
        turn = number % len(boxes)
        mode, ranges = boxes[turn]
        low, high = np.transpose(ranges)
        shape = low.shape if lags == 0 else (lags + 1, len(low))
        time = 0.0 if times is None else rng.uniform(*times[turn])
        return Start(rng.uniform(low, high, shape), mode, time)

    return start


def ramps(*ranges: tuple[float, float]) -> Callable[[np.random.Generator, Array], Array]:
    """Inputs that are drawn uniformly at every knot, each from its range."""
    low, high = np.transpose(ranges)
    return lambda rng, t: rng.uniform(low, high, (len(t), len(ranges)))
