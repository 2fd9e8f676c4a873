r"""Rows of averages: what modes do where the noise of a sample is more than a step of the state.

By itself a row tells modes apart by what their laws make of one step. A sensor whose noise is as
large hides that however many rows there are: least squares and dynamic programming over rows see
noise in every one of them. Averages of s samples one after the other have noise that is
:math:`\sqrt s` times smaller, and go s times as far. Within a stay they obey a law as well, for
affine laws the s-th power of the mode's, and so the search for modes by rows goes through
unchanged; rows with a switch in them obey none. The modes are those of the samples in the middle of
such rows. Of the laws nothing is kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from swsysid._data.recordings import Record
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.found import without_momentary
from swsysid._discrete_stays.lagged import Labels, lagged_rows
from swsysid._discrete_stays.row_search import RowSearch
from swsysid._discrete_stays.rows import RowFit, alternate

# Averages of a recording below which modes of it are not told.
_FEWEST = 4


@dataclass(frozen=True)
class Averages:
    """Rows of averages of so many samples, and those of the samples in the middle of each."""

    data: DiscreteData
    nearest: Labels  # (n_rows,): of every row of the samples, -1 where its stretch has none

    @classmethod
    def of(cls, data: DiscreteData, size: int) -> Averages | None:
        """Those of some rows; None where stretches are too short."""
        rows, records, stretches = data.rows, [], []
        first = np.flatnonzero(rows.begins)
        for place, own in enumerate(np.split(np.arange(len(rows)), first[1:])):
            n_blocks = len(own) // size
            if n_blocks < rows.lags + _FEWEST:
                continue
            columns = rows.columns[own[: n_blocks * size]]
            means = columns.reshape(n_blocks, size, -1).mean(axis=1)
            n, n_lagged = rows.n_states, data.n_lagged
            n_inputs = (means.shape[1] - n_lagged) // (rows.lags + 1)
            x, u = means[:, :n], means[:, n_lagged : n_lagged + n_inputs]
            records.append(Record(np.arange(float(n_blocks)), x, u))
            stretches.append(place)
        if not records:
            return None
        averaged = lagged_rows(records, rows.lags)
        nearest = np.full(len(rows), -1, dtype=np.intp)
        for place, (stretch, record) in enumerate(zip(stretches, records, strict=True)):
            begin = first[stretch]
            end = first[stretch + 1] if stretch + 1 < len(first) else len(rows)
            of_stretch = np.flatnonzero(averaged.recording == place)
            middle = np.arange(end - begin) // (0.5 * size)  # halves of blocks
            block = ((middle.astype(int) - 1) // 2).clip(rows.lags, len(record.t) - 2)
            nearest[begin:end] = of_stretch[block - rows.lags]
        return cls(DiscreteData.of(averaged, data.feature_map), nearest)

    def fits(self, n_modes: int | None, max_modes: int) -> list[RowFit]:
        """One mode or several of these rows, led from a part to all of them."""
        rows = self.data.rows_of_part()
        part = self.data if len(rows) == len(self.data.rows) else self.data.take(rows)
        fits = RowSearch(part, max_modes).fits(n_modes)
        if part is self.data:
            return fits
        again = [alternate(self.data.problem, fit.coef) for fit in fits]
        return [without_momentary(self.data, fit) for fit in again]

    def of_samples(self, modes: Labels) -> Labels:
        """Of every row of the samples the mode of its row of averages, -1 where it has none."""
        return np.where(self.nearest >= 0, modes[self.nearest], -1)


def parted_by_averages(data: DiscreteData, modes: Labels, sizes: Sequence[int]) -> Iterator[Labels]:
    """Modes of rows (-1: of none), one of them in two by averages of its stays, in several ways.

    Ways whose averages one law explains as well are none. Where a row of averages has no mode, as
    with a switch in it, the one before goes on.
    """
    for mode in range(int(modes.max()) + 1):
        rows = np.flatnonzero(modes == mode)
        part = data.take(rows)
        for size in sizes:
            averages = Averages.of(part, size) if len(rows) else None
            if averages is None:
                break
            fits = averages.fits(2, 2)
            one = min(fit.cost for fit in fits if len(fit.coef) == 1)
            for fit in fits:
                if not fit.cost < one:
                    continue
                parts = averages.of_samples(fit.lawful)
                told = np.maximum.accumulate(np.where(parts >= 0, np.arange(len(parts)), 0))
                parted = modes.copy()
                parted[rows[parts[told] > 0]] = modes.max() + 1
                yield parted
