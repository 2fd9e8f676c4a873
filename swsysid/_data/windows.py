r"""Local polynomials along recordings that do not reach across a switch or an event.

Each sample has a window, the neighbours up to half a window before and after it that are in the
same stay, on the same side of what happens between two rows of one time. The polynomial of least
squares through them gives value and slope at the sample; both are linear in the samples, and so are
rows of sparse matrices. With w the weights of a slope and I the integral of a column c by
trapezia,

.. math:: \sum_k w_k I_k = \sum_j \tfrac{h_j}{2} (c_j + c_{j+1}) \sum_{k > j} w_k,

since the weights of a slope sum to zero: the mean of c that the slope shows is a row of a matrix
too.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from swsysid._data.trajectories import events_in
from swsysid._results import Array

Rows = NDArray[np.intp]

_ROWS_AT_A_TIME = 20_000  # whose windows are solved together, which bounds the memory


@dataclass(frozen=True)
class Windows:
    """Windows around every sample, cut at the ends of the stays and at events."""

    t: Array  # (n_samples,)
    stays: list[Rows]  # rows of each stay in order of time, of all of them every row
    half: int  # samples to either side
    degree: int = 2  # of the polynomials

    @property
    def length(self) -> int:
        """Samples of a whole window."""
        return 2 * self.half + 1

    def whole(self, stride: int = 1) -> Rows:
        """Rows whose window is whole, every so many of each stay."""
        inner = [run[self.half : len(run) - self.half] for run in self._runs]
        some = [rows[(len(rows) - 1) % stride // 2 :: stride] for rows in inner if len(rows)]
        return np.sort(np.concatenate([np.empty(0, dtype=np.intp), *some]))

    @property
    def values(self) -> csr_matrix:
        """What takes a column to its smoothed values."""
        return self._matrices[0]

    @property
    def slopes(self) -> csr_matrix:
        """What takes a column to its slopes."""
        return self._matrices[1]

    @property
    def means(self) -> csr_matrix:
        """What takes a column to the slopes of its integral."""
        return self._matrices[2]

    @cached_property
    def _runs(self) -> list[Rows]:
        """Rows of each stay between its events, of which they are the limits."""
        order = np.concatenate(self.stays)
        starts = np.cumsum([len(stay) for stay in self.stays])[:-1]
        return np.split(order, np.union1d(starts, events_in(self.t[order]) + 1))

    # -- weights -----------------------------------------------------------------------------------

    @cached_property
    def _matrices(self) -> tuple[csr_matrix, csr_matrix, csr_matrix]:
        indices, parts = [], []
        for rows in self._alike():
            times = self.t[rows.around]
            parts.append([one.ravel() for one in _weights(times, rows.place, self.degree)])
            indices.append((np.repeat(rows.rows, times.shape[1]), rows.around.ravel()))
        row, column = (np.concatenate(one) for one in zip(*indices, strict=True))
        shape = len(self.t), len(self.t)
        values, slopes, means = (
            csr_matrix((np.concatenate(one), (row, column)), shape=shape)
            for one in zip(*parts, strict=True)
        )
        return values, slopes, means

    def _alike(self) -> Iterator[_Alike]:
        """Samples whose windows reach equally far back and ahead."""
        order = np.concatenate(self._runs)
        lengths = np.array([len(run) for run in self._runs])
        before = np.concatenate([np.arange(length) for length in lengths])
        after = np.repeat(lengths, lengths) - 1 - before
        left, right = np.minimum(before, self.half), np.minimum(after, self.half)
        shape = left * (self.half + 1) + right
        for number in np.unique(shape):
            every = np.flatnonzero(shape == number)
            for some in np.array_split(every, -(-len(every) // _ROWS_AT_A_TIME)):
                back, ahead = int(left[some[0]]), int(right[some[0]])
                around = order[some[:, None] + np.arange(-back, ahead + 1)]
                yield _Alike(order[some], around, back)


@dataclass(frozen=True)
class _Alike:
    rows: Rows
    around: Rows  # (n_rows, n_around): the samples of their windows
    place: int  # of the sample itself in its window


def stays_of(modes: NDArray, trajectories: list[Rows]) -> list[Rows]:
    """Rows of each stretch of a trajectory that has one mode."""
    return [
        stay
        for rows in trajectories
        for stay in np.split(rows, np.flatnonzero(modes[rows][1:] != modes[rows][:-1]) + 1)
    ]


def _weights(times: Array, place: int, degree: int) -> tuple[Array, Array, Array]:
    """Weights of the samples of windows in value, slope and mean, each (n_rows, n_around)."""
    n_around = times.shape[1]
    if n_around == 1:
        return np.ones_like(times), np.zeros_like(times), np.ones_like(times)
    offsets = times - times[:, place, None]
    scale = np.ptp(offsets, axis=1)[:, None]
    powers = (offsets / scale)[..., None] ** np.arange(min(degree, n_around - 1) + 1)
    turned = powers.swapaxes(1, 2)
    solved = np.linalg.solve(turned @ powers, turned)
    values, slopes = solved[:, 0], solved[:, 1] / scale
    later = np.cumsum(slopes[:, :0:-1], axis=1)[:, ::-1]
    halves = 0.5 * np.diff(times, axis=1) * later
    means = np.zeros_like(times)
    means[:, :-1] += halves
    means[:, 1:] += halves
    return values, slopes, means
