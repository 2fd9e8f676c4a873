r"""Rows that a robust fit sets aside: one alone is an outlier, many together are a finding.

A regression that gives gross errors no weight says nothing of a law that acts rarely. Where such
rows were outliers, they would be scattered: of n rows, of which a share :math:`\rho` is set aside,
:math:`n \rho^2` pairs of neighbours are by chance, and their number is a Poisson variable. And the
errors of two neighbours would point apart as often as the same way. Where both are refuted, and
more than one trajectory has visited the place, another law acts there: a mode, a stop, a collision.
Where they fill an interval of time, or several, something happened then: a lid was opened, a load
switched on. Elsewhere a share q of the rows set aside has a successor that is set aside too, so
that one of m such rows begins n of them in a row with probability :math:`m q^{n-1}` at most.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from sklearn.neighbors import NearestNeighbors

from swsysid._data.records import Records
from swsysid._data.trajectories import label_text
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.contents import RowsPlace, RowsSetAside, TimeInterval
from swsysid._effect_search.folds import SearchData, memory_of
from swsysid._effect_search.settings import REPORT, SETTINGS
from swsysid._noise import robust_regression, robust_scale
from swsysid._results import Array
from swsysid._simulation.model import laws_of_mode

_FEWEST_IN_INTERVAL = 5  # rows of an event in time: fewer are an accident
_IN_INTERVALS = 0.9  # share of the rows that follow each other: then they are an event
_SAME_EVENT = 0.01  # probability below which errors elsewhere do not explain a stretch
_ELSEWHERE = 0.5  # share of the others where all are: with more it is no place of its own


Rows = NDArray[np.intp]
_NOWHERE = np.empty(0, dtype=np.intp)


@dataclass(frozen=True)
class Event:
    """Stretches of a trajectory that rows set aside fill, and the law that acts there."""

    trajectory: int
    intervals: tuple[tuple[float, float], ...]  # from the first time to the last of each, in order
    n_aside: int  # rows set aside in them
    coef: Array  # of the library, (n_states, n_features): the law of the usual mode and a change

    def in_words(self, fit: JointFit, records: Records, names: NDArray | None) -> TimeInterval:
        """As a report has it, the law by the names of the channels."""
        laws = fit.laws
        return {
            "trajectory": label_text(self.trajectory if names is None else names[self.trajectory]),
            "begin": self.intervals[0][0],
            "end": self.intervals[-1][1],
            "intervals": list(self.intervals),
            "n_rows": self.n_aside,
            "law": laws_of_mode(
                self.coef[None],
                0,
                laws.feature_map,
                REPORT.precision,
                "text",
                discrete_time=laws.discrete_time,
                states=records.equations,
                static=records.static,
                columns=laws.column_names(records.names),
            ),
        }


@dataclass(frozen=True)
class Whereabouts:
    """The channel that tells most of some rows apart from all others, and where they are in it."""

    channel: int
    interval: tuple[float, float]
    n_rows: int  # of them in the interval
    share: float  # of them that these are
    others: float  # share of all other rows there

    @property
    def separation(self) -> float:
        """By how much the share of the rows is larger there than that of the others."""
        return self.share - self.others

    @property
    def is_a_place(self) -> bool:
        """Whether the rows have a place of their own."""
        return self.separation >= 1.0 - _ELSEWHERE

    def in_words(self, records: Records) -> RowsPlace | None:
        """As a report has it, None if it is no place."""
        if not self.is_a_place:
            return None
        return {
            "channel": records.names[self.channel],
            "interval": self.interval,
            "n_rows": self.n_rows,
            "others": self.others,
        }


@dataclass(frozen=True)
class SetAside:
    """Rows with gross errors, and those of them that lie together."""

    rows: Rows  # of the record
    together: Rows  # those with a neighbour among them
    n_trajectories: int  # that these are in
    p_value: float  # of so many neighbours, and of errors so much alike, by chance
    where: Whereabouts | None  # None if there are none
    event: Event | None = None  # that they are, where they fill intervals of time

    def is_finding(self, significance: float) -> bool:
        """True if another law acts there; once in one trajectory may be an accident."""
        return self.p_value <= significance and self.n_trajectories > 1 and self.event is None

    def is_event(self, significance: float) -> bool:
        """True if another law acts for some time, or at some times, and never else."""
        return self.p_value <= significance and self.event is not None

    def in_words(
        self, fit: JointFit, records: Records, significance: float, names: NDArray | None
    ) -> RowsSetAside:
        """As a report has it, of a fit; `names` are those of the trajectories."""
        event = self.event if self.is_event(significance) else None
        return {
            "n_rows": len(self.rows),
            "n_together": len(self.together),
            "n_trajectories": self.n_trajectories,
            "p_value": self.p_value,
            "place": None if self.where is None else self.where.in_words(records),
            "is_finding": self.is_finding(significance),
            "time_interval": None if event is None else event.in_words(fit, records, names),
        }


def set_aside(fit: JointFit, data: SearchData, targets: Array, rows: Rows) -> SetAside:
    """Those of some rows of a record, with the `targets` of all of it, that no mode explains."""
    # Nothing is chosen by them, so that rows that were held out may count. Their mode is the one
    # that suits them best: next to a surface a row of the other mode is no outlier.
    counted = data.counted_states
    usual = fit.residuals(data.records, data.rows, data.targets)
    scale = np.maximum(robust_scale(usual), data.exact)
    errors = ((targets - fit.mode_velocities(data.records)) / scale)[:, rows][:, :, counted]
    best = np.argmin(np.sum(errors**2, axis=2), axis=0)
    errors = errors[best, np.arange(len(rows))]
    far = np.any(np.abs(errors) > SETTINGS.gross, axis=1)
    far &= ~data.may_stick(fit.terms, data.records, rows)  # no law of its motion acts there
    seen = data.records.take(rows)
    pairs = _neighbours(seen)
    both = pairs[far[pairs].all(axis=1)]
    together = np.unique(both)
    if not len(together):
        return SetAside(rows[far], _NOWHERE, 0, 1.0, None)
    alike = int(np.sum(np.sum(errors[both[:, 0]] * errors[both[:, 1]], axis=1) > 0.0))
    expected = len(pairs) * float(far.mean()) ** 2
    chance = max(
        float(stats.poisson.sf(len(both) - 1, expected)),
        float(stats.binom.sf(alike - 1, len(both), 0.5)),
    )
    where = _where(seen, together)
    # where rows have no order they were taken one by one
    count = len(together if seen.groups is None else np.unique(seen.groups[together]))
    event = _event(fit, data, targets, rows, together)
    if event is not None and event.n_aside < _IN_INTERVALS * len(together):
        # what lies at a place of its own in several trajectories belongs to the place
        event = event if count == 1 or not where.is_a_place else None
    return SetAside(rows[far], rows[together], count, chance, where, event)


def _event(
    fit: JointFit, data: SearchData, targets: Array, rows: Rows, together: Rows
) -> Event | None:
    """The stretches of a trajectory that rows set aside fill, None if they fill none."""
    records = data.records
    if not records.timed:
        return None
    assert records.t is not None
    aside = np.zeros(len(records), dtype=bool)
    aside[rows[together]] = True
    judged = np.isin(np.arange(len(records)), rows)
    # what neighbours remember of one error are no rows of their own
    left = fit.residuals(records, data.rows, data.targets)
    left = left[:, data.counted_states]
    fewest = _FEWEST_IN_INTERVAL * memory_of(records.take(data.rows), left)
    each = [rows[judged[rows]] for rows in records.trajectories]
    filled = [_stretches_filled(own, aside, fewest) for own in each]
    trajectory = max(
        range(len(each)), key=lambda one: sum(aside[part].sum() for part in filled[one])
    )
    found = filled[trajectory]
    while found and _chance_of(found, each, aside) > _SAME_EVENT:
        found = found[:-1]  # the shortest
    if not found:
        return None
    inside = np.concatenate(found)
    ends = sorted((float(records.t[part[0]]), float(records.t[part[-1]])) for part in found)
    n_aside, law = int(aside[inside].sum()), _law_inside(fit, data, targets, np.sort(inside))
    return Event(trajectory, tuple(ends), n_aside, law)


def _stretches_filled(rows: Rows, aside: NDArray[np.bool_], fewest: float) -> list[Rows]:
    """Stretches in which rows set aside outnumber the others, those with most of them first."""
    best = rows[_highest_sum(np.where(aside[rows], 1.0, -1.0))]
    if aside[best].sum() < fewest:
        return []
    start = int(np.searchsorted(rows, best[0]))
    sides = rows[:start], rows[start + len(best) :]
    others = [
        part for side in sides if len(side) for part in _stretches_filled(side, aside, fewest)
    ]
    return sorted([best, *others], key=lambda part: -int(aside[part].sum()))


def _chance_of(found: list[Rows], each: list[Rows], aside: NDArray[np.bool_]) -> float:
    """That the shortest of some stretches is one of those in which errors elsewhere follow."""
    inside = np.zeros(len(aside), dtype=bool)
    inside[np.concatenate(found)] = True
    elsewhere = [aside[rows] & ~inside[rows] for rows in each]
    count = sum(int(one.sum()) for one in elsewhere)
    followed = sum(int(np.sum(one[1:] & one[:-1])) for one in elsewhere)
    n_rows = sum(len(rows) for rows in each)
    q = (followed + (count + 1.0) / n_rows) / (count + 1.0)
    return (count + 1.0) * q ** (int(aside[found[-1]].sum()) - 1)


def _law_inside(fit: JointFit, data: SearchData, targets: Array, inside: Rows) -> Array:
    """The law of the usual mode with what the rows inside an interval change of it.

    Where they are few for the library a constant is changed, if the library has one.
    """
    velocities = fit.mode_velocities(data.records)[:, inside]
    left = targets[inside] - velocities
    usual = int(np.argmin(np.sum(np.abs(left), axis=(1, 2))))
    features, law = fit.features(data.records)[inside], fit.laws.coef[usual].copy()
    changing = np.ptp(features, axis=0) > 0.0
    many = len(inside) >= SETTINGS.rows_a_column * features.shape[1]
    used = fit.laws.support[usual] & (many | ~changing)
    for state in data.counted_states:
        if used[state].any():
            columns = features[:, used[state]]
            law[state, used[state]] += robust_regression(columns, left[usual][:, state])
    return law


def _neighbours(seen: Records) -> Rows:
    """Pairs of rows that follow each other, or of nearest states where no order is known."""
    if seen.ordered:
        pairs = [np.column_stack([rows[:-1], rows[1:]]) for rows in seen.trajectories]
        return np.concatenate(pairs)
    size = seen.X.std(axis=0)
    scaled = seen.X / np.where(size > 0.0, size, 1.0)
    nearest = NearestNeighbors(n_neighbors=2).fit(scaled).kneighbors(return_distance=False)[:, 0]
    return np.column_stack([np.arange(len(scaled)), nearest])


def _where(seen: Records, chosen: Rows) -> Whereabouts:
    """The interval of a channel that holds most of some rows and fewest of the others.

    The difference of the two shares is the largest there is (Kuiper 1960): a row at the edge of a
    window, or an outlier beside it, is left out.
    """
    own = np.zeros(len(seen), dtype=bool)
    own[chosen] = True
    n_others = max(len(seen) - len(chosen), 1)
    found = []
    for channel in range(seen.X.shape[1]):
        values, which = np.unique(seen.channel(channel), return_inverse=True)
        part = _highest_sum(np.bincount(which, np.where(own, 1.0 / len(chosen), -1.0 / n_others)))
        inside = (which >= part.start) & (which < part.stop)
        interval = (float(values[part.start]), float(values[part.stop - 1]))
        count, rest = (int(np.sum(inside & some)) for some in (own, ~own))
        found.append(Whereabouts(channel, interval, count, count / len(chosen), rest / n_others))
    return max(found, key=lambda one: one.separation)


def _highest_sum(steps: NDArray) -> slice:
    """The shortest stretch of some numbers whose sum is the highest."""
    lead = np.concatenate([[0.0], np.cumsum(steps)])
    gain = lead - np.minimum.accumulate(lead)
    stop = int(np.argmax(gain))
    return slice(stop - int(np.argmin(lead[stop::-1])), stop)
