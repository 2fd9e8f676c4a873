r"""Rows that a robust fit sets aside: one alone is an outlier, many together are a finding.

A regression that gives gross errors no weight says nothing of a law that acts rarely. Where such
rows were outliers, they would be scattered: of n rows, of which a share :math:`\rho` is set aside,
:math:`n \rho^2` pairs of neighbours are by chance, and their number is a Poisson variable. And the
errors of two neighbours would point apart as often as the same way. Where both are refuted, and
more than one trajectory has visited the place, another law acts there: a mode, a stop, a collision.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from sklearn.neighbors import NearestNeighbors

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.folds import SearchData
from swsysid._noise import robust_scale
from swsysid._results import Array

Rows = NDArray[np.intp]
_NOWHERE = np.empty(0, dtype=np.intp)


@dataclass(frozen=True)
class SetAside:
    """Rows with gross errors, and those of them that lie together."""

    rows: Rows  # of the record
    together: Rows  # those with a neighbour among them
    n_trajectories: int  # that these are in
    p_value: float  # of so many neighbours, and of errors so much alike, by chance
    channel: str  # that tells most of these apart from the others
    interval: tuple[float, float]  # of the channel
    others: float  # share of all other rows in the interval

    def is_finding(self, significance: float) -> bool:
        """True if another law acts there; once in one trajectory may be an accident."""
        return self.p_value <= significance and self.n_trajectories > 1


def set_aside(fit: JointFit, data: SearchData, targets: Array, rows: Rows) -> SetAside:
    """Those of some rows of a record, with the `targets` of all of it, that no mode explains."""
    # Nothing is chosen by them, so that rows that were held out may count. Their mode is the one
    # that suits them best: next to a surface a row of the other mode is no outlier.
    counted = [state for state in range(targets.shape[1]) if state not in data.exact_states]
    usual = fit.residuals(data.records, data.rows, data.targets)
    scale = np.maximum(robust_scale(usual), data.exact)
    errors = ((targets - fit.mode_velocities(data.records)) / scale)[:, rows][:, :, counted]
    best = np.argmin(np.sum(errors**2, axis=2), axis=0)
    errors = errors[best, np.arange(len(rows))]
    far = np.any(np.abs(errors) > data.settings.gross, axis=1)
    seen, names = data.records.take(rows), data.records.names
    pairs = _neighbours(seen)
    both = pairs[far[pairs].all(axis=1)]
    together = np.unique(both)
    if not len(together):
        return SetAside(rows[far], _NOWHERE, 0, 1.0, "", (0.0, 0.0), 0.0)
    alike = int(np.sum(np.sum(errors[both[:, 0]] * errors[both[:, 1]], axis=1) > 0.0))
    expected = len(pairs) * float(far.mean()) ** 2
    chance = max(
        float(stats.poisson.sf(len(both) - 1, expected)),
        float(stats.binom.sf(alike - 1, len(both), 0.5)),
    )
    channel, interval, others = _where(seen, together)
    # where rows have no order they were taken one by one
    count = len(together if seen.groups is None else np.unique(seen.groups[together]))
    return SetAside(rows[far], rows[together], count, chance, names[channel], interval, others)


def _neighbours(seen: Records) -> Rows:
    """Pairs of rows that follow each other, or of nearest states where no order is known."""
    if seen.ordered:
        pairs = [np.column_stack([rows[:-1], rows[1:]]) for rows in seen.trajectories]
        return np.concatenate(pairs)
    size = seen.X.std(axis=0)
    scaled = seen.X / np.where(size > 0.0, size, 1.0)
    nearest = NearestNeighbors(n_neighbors=2).fit(scaled).kneighbors(return_distance=False)[:, 0]
    return np.column_stack([np.arange(len(scaled)), nearest])


def _where(seen: Records, chosen: Rows) -> tuple[int, tuple[float, float], float]:
    """The channel whose interval about some rows holds the fewest of the others."""
    rest = np.ones(len(seen), dtype=bool)
    rest[chosen] = False
    found: list[tuple[float, int, tuple[float, float]]] = []
    for channel in range(seen.X.shape[1]):
        values: Array = seen.channel(channel)
        low, high = float(values[chosen].min()), float(values[chosen].max())
        inside = (values[rest] >= low) & (values[rest] <= high)
        found.append((float(np.mean(inside)) if rest.any() else 0.0, channel, (low, high)))
    others, channel, interval = min(found)
    return channel, interval, others
