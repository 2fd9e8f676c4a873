"""Guards that remember: each of two modes begins at a level of its own, which no surface tells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import median_abs_deviation

from swsysid._results import Array
from swsysid._verdict.settings import JUDGING


class Named(Protocol):
    """Rows of states and inputs, of which trajectory each is, and what the columns are called."""

    @property
    def X(self) -> Array:
        """States, then inputs, (n_rows, n_columns)."""

    @property
    def groups(self) -> NDArray:
        """Trajectory of each row."""

    @property
    def names(self) -> Sequence[str]:
        """Of the columns."""

    def unit(self, name: str) -> str:
        """The unit of a column, "" where unknown."""


@dataclass(frozen=True)
class NamedRows:
    """The same of arrays."""

    X: Array
    groups: NDArray
    names: Sequence[str]
    units: Mapping[str, str] = field(default_factory=dict)

    def unit(self, name: str) -> str:
        """The unit of a column, "" where unknown."""
        return self.units.get(name, "")


def memory(modes: NDArray[np.intp], rows: Named) -> str:
    """Where each of two modes begins, if one column says it: below one level, above another.

    "" if no column does, if the modes change too seldom to say, or if one level of some column is
    crossed both ways, which takes no memory: a stop is reached at a speed of one sign and left at
    one of the other.
    """
    order = np.argsort(rows.groups, kind="stable")
    modes, groups, X = modes[order], rows.groups[order], rows.X[order]
    last = np.flatnonzero((modes[1:] != modes[:-1]) & (groups[1:] == groups[:-1]))
    first = last + 1
    entered = [last[modes[first] == mode] for mode in (0, 1)]
    if min(map(len, entered)) < JUDGING.fewest_entries:
        return ""
    crossings = [0.5 * (X[own] + X[own + 1]) for own in entered]
    levels = [np.median(points, axis=0) for points in crossings]
    scatter = np.max([median_abs_deviation(points) for points in crossings], axis=0)
    gap = np.abs(levels[0] - levels[1])
    sharpness = np.where(gap > 0.0, scatter / np.where(gap > 0.0, gap, 1.0), np.inf)
    column = int(np.argmin(sharpness))
    spread = X.std(axis=0)
    both_ways = np.vstack(crossings).std(axis=0)[spread > 0.0] / spread[spread > 0.0]
    if sharpness[column] > JUDGING.sharp or both_ways.min() <= JUDGING.sharp:
        return ""
    low, high = sorted((0, 1), key=lambda mode: float(levels[mode][column]))
    name = rows.names[column]
    below, above = (
        f"{levels[mode][column]:.4g} {rows.unit(name)}".rstrip() for mode in (low, high)
    )
    return f"mode {low} begins below {name} = {below}, mode {high} above {name} = {above}"
