"""Two ways out of one mode whose guards rise at the same places, and what tells them apart."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import combinations

import numpy as np

from swsysid._automaton_search.found import FoundTransition
from swsysid._results import Array


def shared_exits(
    found: Sequence[FoundTransition],
    rises: Callable[[FoundTransition, FoundTransition], float],
    rows: Callable[[FoundTransition], Array],
    names: Sequence[int],
    columns: Sequence[str],
) -> Iterator[str]:
    """One sentence for each pair; `names` are those of the modes in the answer.

    ``rises(one, other)`` is the part of the switches of the other at which the guard of the one
    rises as well, and ``rows(one)`` are columns at its switches. A column tells two transitions
    apart where it is below a threshold at all switches of the one and above it at all others.
    """
    told = [one for one in found if one.guard is not None and one.source != one.target]
    for one, other in combinations(told, 2):
        if one.source != other.source or max(rises(one, other), rises(other, one)) <= 0.5:
            continue
        first, second = sorted((one, other), key=lambda way: names[way.target])
        source, ways = names[one.source], (names[first.target], names[second.target])
        which = "nothing that was recorded tells which; record what does and give it as an input."
        apart = _telling(rows(first), rows(second), columns)
        if apart is not None:
            name, low, level = apart
            which = (
                f"{name} tells which (mode {ways[0 if low else 1]} below {level:.3g}), but a guard "
                "here is one condition: give a column that is both, or raise guard_degree."
            )
        yield (
            f"Mode {source} is left for mode {ways[0]} and for mode {ways[1]} where the same guard "
            f"rises, and the model always goes one way: {which}"
        )


def _telling(first: Array, second: Array, columns: Sequence[str]) -> tuple[str, bool, float] | None:
    """The column that tells two sets of rows apart best, whether the first is below, and where."""
    best: tuple[float, str, bool, float] | None = None
    for name, own, other in zip(columns, first.T, second.T, strict=True):
        spread = np.std(np.append(own, other))
        if not spread > 0.0:  # NaN: a clock that is not known
            continue
        for low, below, above in ((True, own, other), (False, other, own)):
            gap = float((above.min() - below.max()) / spread)
            if gap > 0.0 and (best is None or gap > best[0]):
                best = gap, name, low, 0.5 * float(above.min() + below.max())
    return None if best is None else best[1:]
