"""From lagged rows to modes and laws: starts, numbers of modes, and noise in stages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.modes import reassigned
from swsysid._discrete_stays.rows import (
    RowFit,
    RowProblem,
    alternate,
    as_fit,
    assigned,
    law_of,
    row_costs,
    scale_of,
    switching_of,
)
from swsysid._discrete_stays.starts import LawPool, best_thresholds
from swsysid._discrete_stays.states import StateFit, with_own_ratio, with_states
from swsysid._journal import step
from swsysid._results import Array

# Residuals below this come from arithmetic, and laws of highest likelihood in all states would only
# add to it.
_EXACT = 1e-11
_THRESHOLDS = 3  # columns whose thresholds are a start
# Share of the stays of a mode that are as short as a jump, and how many times as much as the best
# law the one of all rows that straddle a jump leaves.
_MOMENTARY, _ROUGH = 0.95, 3.0
# The disturbance of the states as a share of the noise, smaller and smaller, since wrong modes
# disturb them too, in two stages.
_STAGES = (1.0, 1.0, 1.0, 0.3, 0.1), (0.03, 0.01, 0.01, 0.01, 0.01, 0.01)
# Nats a row by which a number of modes is so much worse than the best one that it is not judged any
# more, before each stage; and by which modes are so much worse that the best ones are taken again.
_HOPELESS, _WORSE = (0.5, 0.1), 0.03
_PATIENCE = 2  # numbers of modes that are tried after the best one


@dataclass(frozen=True)
class DiscreteCandidate:
    """One number of modes, and what the recordings say of it: the least criterion is chosen."""

    n_modes: int
    criterion: float  # nats: negative log likelihood, switches and coefficients paid for


@dataclass(frozen=True)
class Found:
    """Modes and laws; with states where the measurements have noise."""

    fit: RowFit
    states: StateFit | None
    history: tuple[float, ...]

    @property
    def cost(self) -> float:
        """Nats that are minimised."""
        return self.fit.cost if self.states is None else self.states.cost

    @property
    def coef(self) -> Array:
        """Laws in the units of the data."""
        return self.fit.coef if self.states is None else self.states.coef

    def samples(self, data: DiscreteData) -> Array:
        """States at x[k + 1], x[k], ... of every row, (n_rows, lags + 2, n_states)."""
        if self.states is not None:
            return self.states.states[self.states.back]
        every = np.hstack([data.problem.targets, data.columns[:, : data.n_lagged]])
        return every.reshape(len(every), -1, data.rows.n_states)

    def lagged_states(self, data: DiscreteData) -> Array:
        """States among the columns of the rows."""
        return self.samples(data)[:, 1:].reshape(len(data.rows), -1)


@dataclass(frozen=True)
class Searched:
    """Rows, what was found in them, and the numbers of modes that were compared."""

    data: DiscreteData
    found: Found
    candidates: tuple[DiscreteCandidate, ...]


class StaySearch:
    """Compares numbers of modes on a part of the rows, then goes on with all of them."""

    def __init__(self, data: DiscreteData, max_modes: int):
        self.data, self.part, self.max_modes = data, data.part(), max_modes
        self.pool = LawPool(self.part.problem)
        few = best_thresholds(self.part)[:_THRESHOLDS]
        told = [thresholds.fit(self.part) for thresholds in few]
        self.told = [fit for fit in told if _lasting(self.part, fit).all()]

    def best(self, n_modes: int | None) -> Searched:
        """The best identification, with so many modes or as many as the data ask for."""
        by_rows = self._by_rows(n_modes)
        if n_modes is not None:
            most = max(len(fit.coef) for fit in by_rows if len(fit.coef) <= n_modes)
            by_rows = [fit for fit in by_rows if len(fit.coef) == most]
        found = [Found(fit, None, fit.history) for fit in by_rows]
        if not any(_is_exact(fit) for fit in by_rows):
            for turn, ties in enumerate(_STAGES):
                hopeful = self._hopeful(found, _HOPELESS[turn])
                again = [with_noise(self.part, one, ties) for one in hopeful]
                found = _best_of_each(lasting_only(self.part, one) for one in again)
            found = [with_both_noises(self.part, one) for one in found]
        found = _best_of_each(found)
        chosen = min(found, key=lambda one: one.cost)
        candidates = [DiscreteCandidate(len(one.coef), one.cost) for one in found]
        most = self.max_modes if n_modes is None else n_modes
        return Searched(self.data, self._on_all_rows(chosen, most), tuple(candidates))

    def _hopeful(self, found: list[Found], nats: float) -> list[Found]:
        """Candidates not worse than one of fewer modes, nor by so many nats a row than any."""
        most = min(one.cost for one in found) + nats * len(self.part.rows)
        return [
            one
            for one in found
            if one.cost <= most
            and all(one.cost <= other.cost for other in found if len(other.coef) < len(one.coef))
        ]

    def _by_rows(self, n_modes: int | None) -> list[RowFit]:
        """The best fit by rows of every number of modes, until two more modes say no more.

        With two modes also those that thresholds tell.
        """
        best: dict[int, RowFit] = {}
        last: RowFit | None = None
        in_vain = 0
        most = self.max_modes if n_modes is None else n_modes + _PATIENCE
        for count in range(1, most + 1):
            last = self._alternated(count, last)
            lasting = without_momentary(self.part, last)
            n_lasting = len(lasting.coef)
            before = min((fit.cost for fit in best.values()), default=np.inf)
            if n_lasting not in best or lasting.cost < best[n_lasting].cost:
                best[n_lasting] = lasting
            if n_modes is not None and n_lasting >= n_modes:
                break
            in_vain = 0 if lasting.cost < before else in_vain + 1
            if n_modes is None and in_vain > _PATIENCE:
                break
        allowed = self.max_modes if n_modes is None else n_modes
        return [*best.values(), *(fit for fit in self.told if len(fit.coef) <= allowed)]

    @step
    def _alternated(self, count: int, last: RowFit | None) -> RowFit:
        """The best of the starts with so many modes."""
        starts = [self.pool.best(count)]
        if last is not None:
            starts.append(self.pool.beside(last.coef))
            if last.unexplained.any():  # they may be a rare mode
                rest = law_of(self.part.problem, last.unexplained)
                starts.append(np.concatenate([last.coef, rest[None]]))
        fits = [alternate(self.part.problem, coef) for coef in starts]
        return min(fits, key=lambda fit: fit.cost)

    def _on_all_rows(self, found: Found, most: int) -> Found:
        """The same with all rows; modes that the part has not visited come in, up to so many."""
        if self.part is self.data:
            return found
        scale = scale_of(self.part.problem, found.coef, found.fit.lawful)
        found = _followed(self.data, found, found.coef, scale)
        found = _with_more(self.data, found, most, lambda found: [found.fit.unexplained])
        return _parted(self.data, found, most) or found


def finer_modes(data: DiscreteData, found: Found, most: int) -> Found | None:
    """The same with more modes, `most` at most, for stays in modes that leave much.

    None where that is no better, or where measurements have noise. Laws that lack a little leave
    much, too, and are parted without end: free rollouts say which of both is right.
    """

    def some(found: Found) -> Iterator[NDArray[np.bool_]]:
        """Rows that no law explains, and the longest stay in each rough mode."""
        fit = found.fit
        yield fit.unexplained
        stays = _stays(data.problem, fit)
        for mode in np.flatnonzero(_is_rough(fit)):
            longest = max((own for own in stays if fit.lawful[own[0]] == mode), key=len)
            yield np.isin(np.arange(len(fit.modes)), longest)

    more = found if found.states is not None else _with_more(data, found, most, some)
    return None if more is found else more


def _parted(data: DiscreteData, found: Found, most: int) -> Found | None:
    """The same with rough modes parted into as few as explain their stays, if these are exact."""
    coef = None if found.states is not None else _of_stays(data, found.fit)
    if coef is None or len(coef) > most:
        return None
    parted = _followed(data, found, coef, scale_of(data.problem, coef, found.fit.lawful))
    better = parted.cost < found.cost and not _is_rough(parted.fit).any()
    return parted if better else None


def _stays(problem: RowProblem, fit: RowFit) -> list[NDArray[np.intp]]:
    """Rows of each stay."""
    begins = problem.begins | np.append(True, np.diff(fit.lawful) != 0)
    return np.split(np.arange(len(begins)), np.flatnonzero(begins)[1:])


def _of_stays(data: DiscreteData, fit: RowFit) -> Array | None:
    """Laws, those of rough modes replaced by as few as their stays have; None without rough ones.

    One law explains two stays if the one of all their rows leaves no more than the others do. The
    law of a stay alone need not explain the other one: a short motion does not determine it.
    """
    problem, rough = data.problem, _is_rough(fit)
    least, n_features = _ROUGH * fit.scale[~rough].max(axis=0), problem.features.shape[1]

    def explains(rows: NDArray[np.intp]) -> bool:
        left = problem.targets[rows] - problem.features[rows] @ law_of(problem, rows).T
        return bool((np.sqrt(np.square(left).mean(axis=0)) <= least).all())

    stays = [own for own in _stays(problem, fit) if rough[fit.lawful[own[0]]]]
    pieces = [piece for own in stays if fit.lawful[own[0]] >= 0 for piece in _exact(own, explains)]
    groups = [np.flatnonzero(fit.lawful == mode) for mode in np.flatnonzero(~rough)]
    for piece in sorted(pieces, key=len, reverse=True):
        if len(piece) <= n_features:  # any law explains it
            continue
        joined = (k for k, own in enumerate(groups) if explains(np.append(own, piece)))
        place = next(joined, None)
        if place is None:
            groups.append(piece)
        else:
            groups[place] = np.append(groups[place], piece)
    return np.array([law_of(problem, rows) for rows in groups]) if rough.any() else None


def _exact(
    rows: NDArray[np.intp], explains: Callable[[NDArray[np.intp]], bool]
) -> Iterator[NDArray[np.intp]]:
    """A stay in parts that one law each explains, each as long as can be."""
    while len(rows):
        fits, fails = 1, len(rows) + 1
        while fails - fits > 1:
            middle = len(rows) if fails > len(rows) else (fits + fails) // 2
            fits, fails = (middle, fails) if explains(rows[:middle]) else (fits, middle)
        yield rows[:fits]
        rows = rows[fits:]


def _with_more(
    data: DiscreteData,
    found: Found,
    most: int,
    some: Callable[[Found], Iterable[NDArray[np.bool_]]],
) -> Found:
    """With the laws of some rows as long as one of them is better, up to so many."""
    problem = data.problem
    while len(found.coef) < most:
        scale = scale_of(problem, found.coef, found.fit.lawful)
        scale = np.vstack([scale, scale.min(axis=0)])
        tried = [
            _followed(data, found, np.vstack([found.coef, law_of(problem, rows)[None]]), scale)
            for rows in some(found)
            if np.count_nonzero(rows) > problem.features.shape[1]
        ]
        better = [one for one in tried if len(found.coef) < len(one.coef) <= most]
        better = [one for one in better if one.cost < found.cost]
        if not better:
            break
        found = min(better, key=lambda one: one.cost)
    return found


def _followed(data: DiscreteData, found: Found, coef: Array, scale: Array) -> Found:
    """Laws led on all rows, with as much disturbance as in the part of them."""
    problem = data.problem
    if found.states is None:
        fit = without_momentary(data, alternate(problem, coef))
        return Found(fit, None, found.history + fit.history)
    fit = assigned(problem, coef, scale, found.fit.switching)
    start = Found(replace(fit, guards=found.fit.guards), None, found.history)
    return lasting_only(data, with_noise(data, start, [found.states.tie] * 2))


def without_momentary(data: DiscreteData, fit: RowFit) -> RowFit:
    """A fit without modes that are none."""
    lasting = _lasting(data, fit)
    if lasting.all() or not lasting.any():
        return fit
    return without_momentary(data, alternate(data.problem, fit.coef[lasting]))


def _lasting(data: DiscreteData, fit: RowFit) -> NDArray[np.bool_]:
    """Modes that are some, (n_modes,).

    The rows of a jump may have a law of their own. One row is a mode's that is left as soon as it
    is entered: that of the reset. All that straddle the jump have none in common, and what is left
    of them is more than of a law. A mode with no more rows than coefficients explains nothing.
    """
    modes = fit.lawful
    first = np.flatnonzero(data.rows.begins | np.append(True, np.diff(modes) != 0))
    length, of_stays = np.diff(np.append(first, len(modes))), modes[first]
    longest = np.where(_is_rough(fit), data.rows.lags + 1, 1)
    return np.array([
        np.mean(length[own] <= longest[mode]) < _MOMENTARY
        and length[own].sum() > data.problem.features.shape[1]
        if (own := of_stays == mode).any() else False
        for mode in range(len(fit.coef))
    ])  # fmt: skip


def _is_rough(fit: RowFit) -> NDArray[np.bool_]:
    """Modes whose law leaves more than that of the others."""
    size = np.linalg.norm(fit.scale, axis=1)
    return np.asarray(size > _ROUGH * size.min())


@step
def with_noise(data: DiscreteData, found: Found, ties: Sequence[Array | float]) -> Found:
    """Laws and modes in turn, with noise where it was measured and ever less disturbance.

    A disturbance is left as soon as the modes stay, or where the measurements have become much less
    likely: then the next one begins with the best that was found.
    """
    now, best, history = found, found, [*found.history]
    left: Array | float | None = None
    for tie in ties:
        if left is not None and np.array_equal(tie, left):
            continue
        states = with_states(data, now.fit, tie, now.states)
        history.append(states.cost)
        now = Found(now.fit, states, ())
        if best.states is None or now.cost < best.cost:
            best = now
        fit, _ = reassigned(data, now.fit, states)
        left = tie if np.array_equal(now.fit.lawful, fit.lawful) else None
        now = Found(fit, states, ())
        if states.cost > best.cost + _WORSE * len(data.rows):
            now, left = best, tie
    return replace(best, history=tuple(history))


@step
def with_both_noises(data: DiscreteData, found: Found) -> Found:
    """The same with the noise of the sensor and that in the equation told apart."""
    if found.states is None:
        return found
    told = replace(found, states=with_own_ratio(data, found.fit, found.states))
    assert told.states is not None
    fit, _ = reassigned(data, told.fit, told.states)
    again = replace(told, fit=fit, states=with_states(data, fit, told.states.tie, told.states))
    best = min(told, again, key=lambda one: one.cost)
    return lasting_only(data, replace(best, history=(*found.history, best.cost)))


def lasting_only(data: DiscreteData, found: Found) -> Found:
    """The same without modes that are none; no law explains their rows."""
    kept = _lasting(data, found.fit)
    if kept.all() or not kept.any() or found.states is None:
        return found
    names, near = np.cumsum(kept) - 1, replace(found.states, coef=found.states.coef[kept])
    gone = ~kept[found.fit.modes]
    modes, coef, scale = names[found.fit.modes], found.fit.coef[kept], found.fit.scale[kept]
    modes[gone] = 0
    unexplained = found.fit.unexplained | gone
    switching = switching_of(np.where(unexplained, -1, modes), data.problem)
    costs = row_costs(data.problem, coef, scale)
    fit = as_fit(data.problem, coef, scale, switching, modes, costs)
    fit = replace(fit, unexplained=unexplained, history=found.fit.history)
    return replace(found, fit=fit, states=with_states(data, fit, near.tie, near))


def _is_exact(fit: RowFit) -> bool:
    return bool((fit.scale < _EXACT).all())


def _best_of_each(found: Iterable[Found]) -> list[Found]:
    """The best with each number of modes."""
    best: dict[int, Found] = {}
    for one in found:
        count = len(one.coef)
        if count not in best or one.cost < best[count].cost:
            best[count] = one
    return list(best.values())
