"""What a residual may depend on: columns, cut into bins of equally many rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from swsysid._results import Array

ROUNDING = 1e-12  # of a column: below it its changes are rounding

_FEWEST_BINS = 4
_MOST_BINS = 10  # of a channel: more are less powerful against smooth dependences
_ROWS_A_BIN = 20
_MOST_SIDES = 5  # a pair of columns is cut into at most so many cells each way
_ROWS_A_LINE = 40  # of what is taken away: a line in each finer bin has two coefficients
_MOST_LINES = 25


@dataclass(frozen=True)
class Channel:
    """One column that a residual may depend on, or a pair of them."""

    name: str
    values: Array  # (n_rows,), NaN where it is not known, as before the start of a trajectory
    kind: str  # as in `Finding`
    bins: NDArray[np.intp]  # of the rows, -1 where the value is not known
    parts: tuple[Channel, Channel] | None = None  # of a pair

    @property
    def n_bins(self) -> int:
        """Number of bins; below two the channel is constant and says nothing."""
        return int(self.bins.max()) + 1

    def on(self, rows: NDArray[np.intp]) -> Channel:
        """The same channel on some rows, cut into bins anew."""
        return make_channel(self.name, self.values[rows], self.kind)

    def columns(self, values: Array) -> Array:
        """Columns whose span holds a line in each of finer bins, zero where nothing is known.

        Lines follow slopes, and as they need not meet they follow steps too: the best step of
        `values` is an edge of the bins. For a pair there is a plane in each cell.
        """
        if self.parts is not None:
            both = np.column_stack([part.values for part in self.parts])
            scaled = (both - both.mean(axis=0)) / both.std(axis=0)
            plane = np.column_stack([np.ones(len(both)), scaled])
            cells = self.bins[:, None] == np.arange(self.n_bins)
            return (cells[:, :, None] * plane[:, None, :]).reshape(len(both), -1)
        known = np.flatnonzero(self.bins >= 0)
        coordinate = self.values[known]
        n_bins = int(np.clip(len(known) // _ROWS_A_LINE, 1, _MOST_LINES))
        order = np.argsort(coordinate, kind="stable")
        response = values[known][order] - values[known].mean()
        step = best_step(coordinate[order], response)[1]
        edges = np.unique([*np.quantile(coordinate, np.arange(1, n_bins) / n_bins), step])
        bins = np.searchsorted(edges, coordinate, side="right")
        columns = np.zeros((len(self.values), 2 * (len(edges) + 1)))
        for number in np.unique(bins):
            rows, place = known[bins == number], coordinate[bins == number]
            columns[rows, 2 * number] = 1.0
            columns[rows, 2 * number + 1] = (place - place.mean()) / max(np.ptp(coordinate), 1e-300)
        return columns


def make_channel(name: str, values: Array, kind: str, quantiles: Array | None = None) -> Channel:
    """Cut a column into bins at its quantiles; values equal up to rounding share a bin."""
    known = np.isfinite(values)
    values = _equal_up_to_rounding(values)
    some = np.sort(values[known])
    distinct = np.unique(some)
    if kind == "mode" or len(distinct) <= _FEWEST_BINS:
        edges = distinct[1:]
    else:
        if quantiles is None:
            n_bins = len(some) // _ROWS_A_BIN
            n_bins = int(np.clip(n_bins, _FEWEST_BINS, _MOST_BINS))
            quantiles = np.arange(1, n_bins) / n_bins
        edges = np.unique(np.quantile(some, quantiles, method="closest_observation"))
    bins = np.where(known, np.searchsorted(edges, values, side="right"), -1)
    # An edge at the smallest value leaves the bin below it empty.
    bins[known] = np.unique(bins[known], return_inverse=True)[1]
    return Channel(name, values, kind, bins)


def _equal_up_to_rounding(values: Array) -> Array:
    """The values, each replaced by the smallest one of those that differ from it by rounding.

    A filter leaves a column that rests at 1e-17 of one sign or the other; bins cut there would
    differ from one processor to the next. NaN comes last and stays.
    """
    order = np.argsort(values, kind="stable")
    ascending = values[order]
    size = np.abs(values[np.isfinite(values)]).max(initial=0.0)
    begins = np.diff(ascending, prepend=-np.inf) > ROUNDING * size
    begins |= ~np.isfinite(ascending)
    equal = np.empty_like(values)
    equal[order] = ascending[np.maximum.accumulate(np.where(begins, np.arange(len(values)), 0))]
    return equal


def make_pair(first: Channel, second: Channel) -> Channel:
    """Two columns together, cut into cells: what depends on both may depend on neither alone."""
    n_sides = np.sqrt(len(first.values) / _ROWS_A_LINE)
    n_sides = int(np.clip(n_sides, 2, _MOST_SIDES))
    quantiles = np.arange(1, n_sides) / n_sides
    sides = [make_channel("", one.values, "", quantiles).bins for one in (first, second)]
    cells = np.unique(sides[0] * (n_sides + 1) + sides[1], return_inverse=True)[1]
    name = f"{first.name} and {second.name} together"
    return Channel(name, first.values, "pair", cells, (first, second))


def lagged(values: Array, codes: NDArray[np.intp], lag: int, beyond: bool = True) -> Array:
    """The values `lag` rows before within the trajectory, NaN before its start.

    With `beyond`, only what they add to the values now: the remainder of their regression on
    them. A slow column is nearly its own past, and would be named twice.
    """
    past = np.full(len(values), np.nan)
    together = codes[lag:] == codes[:-lag]
    past[lag:][together] = values[:-lag][together]
    known = np.isfinite(past)
    if beyond and known.sum() > 2:
        size = np.abs(past[known] - past[known].mean()).max()
        past[known] = without(np.column_stack([np.ones(known.sum()), values[known]]), past[known])
        if np.abs(past[known]).max() <= 1e-9 * size:  # rounding errors only
            past[known] = 0.0
    return past


def between_shares(channels: list[Channel], values: Array) -> Array:
    r"""Share of the variance of each row of `values` that lies between the bins of each channel.

    With :math:`S_b` the sum over the :math:`n_b` rows of bin b it is
    :math:`(\sum_b S_b^2 / n_b - (\sum_b S_b)^2 / \sum_b n_b) / (\sigma^2 \sum_b n_b)`. The sums of
    all channels and all rows of `values` (n_orders, n_rows) are one sparse product.
    """
    offsets = np.cumsum([0] + [channel.n_bins for channel in channels])
    indices = [np.flatnonzero(channel.bins >= 0) for channel in channels]
    starts = zip(channels, indices, offsets[:-1], strict=True)
    rows = np.concatenate([channel.bins[known] + start for channel, known, start in starts])
    member = csr_matrix(
        (np.ones(len(rows), dtype=values.dtype), (rows, np.concatenate(indices))),
        shape=(offsets[-1], values.shape[1]),
    )
    counts = np.bincount(rows, minlength=offsets[-1])[:, None]
    sums = member @ np.ascontiguousarray(values.T)
    known = np.add.reduceat(counts, offsets[:-1], axis=0)
    between = np.add.reduceat(np.square(sums) / counts, offsets[:-1], axis=0)
    between -= np.square(np.add.reduceat(sums, offsets[:-1], axis=0)) / known
    variance = values[0].var()
    return between / (known * (variance if variance > 0.0 else 1.0))


def best_step(x: Array, y: Array, z: Array | None = None) -> tuple[float, float]:
    r"""Sum of squares that the best step adds, and its place; beside a line in `z` if given.

    A step h has the part of its square :math:`h^\top h - (h^\top 1)^2/n - (h^\top z)^2/n`
    that a constant and a line do not have.
    """
    n_rows = len(x)
    right = np.arange(n_rows - 1, 0, -1)
    own = right * (1.0 - right / n_rows)
    if z is not None:
        own = own - np.square(np.cumsum(z)[:-1]) / n_rows
    gain = np.square(np.cumsum(y)[:-1]) / np.maximum(own, 1e-9 * n_rows)
    fewest = max(3, n_rows // 50)
    gain[(right < fewest) | (right > n_rows - fewest) | (np.diff(x) == 0.0)] = 0.0
    best = int(gain.argmax())
    return float(gain[best]), float(0.5 * (x[best] + x[best + 1]))


def without(columns: Array, values: Array) -> Array:
    """What is left of `values` after least squares on some columns."""
    return values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]
