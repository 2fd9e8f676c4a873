"""What a residual may depend on: columns, cut into bins of equally many rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from swsysid._results import Array

__all__ = [
    "Channel",
    "best_step",
    "between_shares",
    "broken_line",
    "lagged",
    "make_channel",
    "make_pair",
    "without",
]

_FEWEST, _MOST, _ROWS_A_BIN = 4, 10, 20
# Rows per line of the broken line that takes a found dependence away, and its most pieces.
_ROWS_A_LINE, _MOST_LINES = 40, 25
_MOST_SIDES = 5  # a pair of columns is cut into at most so many cells each way


@dataclass(frozen=True)
class Channel:
    """One column that a residual may depend on.

    Attributes
    ----------
    name : str
    values : ndarray of shape (n_rows,)
        NaN where it is not known, as before the first row of a trajectory.
    kind : str
        ``"state"``, ``"input"``, ``"time"``, ``"signal"``, ``"mode"``, ``"pair"``, ``"lag"``,
        ``"residual lag"`` or ``"surface"``.
    bins : ndarray of shape (n_rows,), int
        Bin of each row, -1 where the value is not known.
    parts : tuple of two Channel or None
        The columns of a pair.
    """

    name: str
    values: Array
    kind: str
    bins: NDArray[np.intp]
    parts: tuple[Channel, Channel] | None = None

    @property
    def n_bins(self) -> int:
        """Number of bins; below two the channel is constant and says nothing."""
        return int(self.bins.max()) + 1

    def on(self, rows: NDArray[np.intp]) -> Channel:
        """The same channel on some rows, cut into bins anew."""
        return make_channel(self.name, self.values[rows], self.kind)


def make_channel(name: str, values: Array, kind: str, quantiles: Array | None = None) -> Channel:
    """Cut a column into bins at its quantiles; equal values share a bin."""
    known = np.isfinite(values)
    some = np.sort(values[known])
    distinct = np.unique(some)
    if kind == "mode" or len(distinct) <= _FEWEST:
        edges = distinct[1:]
    else:
        if quantiles is None:
            n_bins = int(np.clip(len(some) // _ROWS_A_BIN, _FEWEST, _MOST))
            quantiles = np.arange(1, n_bins) / n_bins
        edges = np.unique(np.quantile(some, quantiles, method="closest_observation"))
    bins = np.where(known, np.searchsorted(edges, values, side="right"), -1)
    # An edge at the smallest value leaves the bin below it empty.
    inside, bins[known] = np.unique(bins[known], return_inverse=True)
    return Channel(name, values, kind, bins)


def make_pair(first: Channel, second: Channel) -> Channel:
    """Two columns together, cut into cells: what depends on both may depend on neither alone."""
    n_rows = len(first.values)
    n_sides = int(np.clip(np.sqrt(n_rows / _ROWS_A_LINE), 2, _MOST_SIDES))
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
        design = np.column_stack([np.ones(known.sum()), values[known]])
        fit = design @ np.linalg.lstsq(design, past[known], rcond=None)[0]
        size = np.abs(past[known] - past[known].mean()).max()
        past[known] -= fit
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
    places = [(np.flatnonzero(channel.bins >= 0), channel.bins) for channel in channels]
    rows = np.concatenate(
        [bins[known] + start for (known, bins), start in zip(places, offsets[:-1], strict=True)]
    )
    columns = np.concatenate([known for known, _ in places])
    n_rows = values.shape[1]
    member = csr_matrix(
        (np.ones(len(rows), dtype=values.dtype), (rows, columns)), shape=(offsets[-1], n_rows)
    )
    counts = np.bincount(rows, minlength=offsets[-1])[:, None]
    sums = member @ np.ascontiguousarray(values.T)
    known = np.add.reduceat(counts, offsets[:-1], axis=0)
    between = np.add.reduceat(np.square(sums) / counts, offsets[:-1], axis=0)
    between -= np.square(np.add.reduceat(sums, offsets[:-1], axis=0)) / known
    variance = values[0].var()
    return between / (known * (variance if variance > 0.0 else 1.0))


def broken_line(channel: Channel, values: Array) -> Array:
    """Columns whose span holds a line in each of the channel's finer bins, zero where unknown.

    Lines follow slopes, and as they need not meet they follow steps too: the best step of
    `values` is an edge of the bins.
    """
    if channel.parts is not None:
        return _planes(channel, *channel.parts)
    known = np.flatnonzero(channel.bins >= 0)
    coordinate = channel.values[known]
    n_bins = int(np.clip(len(known) // _ROWS_A_LINE, 1, _MOST_LINES))
    order = np.argsort(coordinate, kind="stable")
    response = values[known][order] - values[known].mean()
    step = best_step(coordinate[order], response)[1]
    edges = np.unique([*np.quantile(coordinate, np.arange(1, n_bins) / n_bins), step])
    bins = np.searchsorted(edges, coordinate, side="right")
    columns = np.zeros((len(channel.values), 2 * (len(edges) + 1)))
    for number in np.unique(bins):
        rows, place = known[bins == number], coordinate[bins == number]
        columns[rows, 2 * number] = 1.0
        columns[rows, 2 * number + 1] = (place - place.mean()) / max(np.ptp(coordinate), 1e-300)
    return columns


def _planes(channel: Channel, first: Channel, second: Channel) -> Array:
    """Columns whose span holds a plane in each cell of a pair."""
    both = np.column_stack([first.values, second.values])
    plane = np.column_stack([np.ones(len(both)), (both - both.mean(axis=0)) / both.std(axis=0)])
    cells = channel.bins[:, None] == np.arange(channel.n_bins)
    return (cells[:, :, None] * plane[:, None, :]).reshape(len(both), -1)


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
