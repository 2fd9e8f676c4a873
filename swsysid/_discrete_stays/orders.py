"""How long the memory is: lags chosen by rollouts of stretches that the laws have not seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._discrete_stays.data import FARTHEST, DiscreteData
from swsysid._discrete_stays.found import Found
from swsysid._discrete_stays.lagged import Labels
from swsysid._discrete_stays.rows import fitted
from swsysid._discrete_stays.search import Searched
from swsysid._discrete_stays.states import with_states
from swsysid._results import Array

# The share of a recording that is held out, samples after which a rollout begins anew, standard
# errors by which a longer memory must be better, and the error of a rollout that is rounding.
_HELD_OUT, _HORIZON, _STANDARD_ERRORS, _EXACT = 0.3, 40, 2.0, 1e-8


@dataclass(frozen=True)
class LagCandidate:
    """One number of lags, and the mean square of its held-out rollouts in units of the states."""

    lags: int
    n_modes: int
    error: float


class HeldOut:
    """Rollouts of the last part of every recording, by laws of the parts before.

    The modes are known in a rollout, which begins anew every few samples and after a row that no
    law explains; such a row counts as far off as the states are apart.
    """

    def __init__(self, data: DiscreteData, found: Found, first_sample: int):
        rows = data.rows
        last = np.zeros(int(rows.recording.max()) + 1, dtype=np.intp)
        np.maximum.at(last, rows.recording, rows.sample)
        border = np.maximum((1.0 - _HELD_OUT) * last, first_sample).astype(np.intp)
        counts = (last - border).clip(0) // _HORIZON + 1
        offsets = np.cumsum(counts) - counts
        along = rows.sample - border[rows.recording]
        self.data, self.found, self.n_stretches = data, found, int(counts.sum())
        self.seen, self.held = np.flatnonzero(along < 0), np.flatnonzero(along >= 0)
        # stretches are of the same samples whatever the lags are
        self.stretch = (offsets[rows.recording] + along // _HORIZON)[self.held]
        self.place = (along % _HORIZON)[self.held]

    def errors(self, free: NDArray[np.bool_]) -> Array:
        """Mean square of every stretch by laws with the features `free`; NaN where it has no row.

        `free` is of shape (n_modes, n_features).
        """
        squares = self._squares(refitted(self.data, self.found, free, self.seen).coef)
        counts = np.bincount(self.stretch, minlength=self.n_stretches)
        sums = np.bincount(self.stretch, squares, self.n_stretches)
        return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)

    def _squares(self, coef: Array) -> Array:
        """Mean square over the states of every row that is held out."""
        data, held, n = self.data, self.held, self.data.rows.n_states
        modes, targets = self.found.fit.lawful[held], data.problem.targets[held]
        known, inputs = self.found.lagged_states(data)[held], data.columns[held][:, data.n_lagged :]
        farthest = FARTHEST * float(np.abs(targets).max(initial=1.0))
        begins = (data.rows.begins | np.append(True, self.found.fit.unexplained[:-1]))[held]
        begins |= self.place == 0
        states = np.zeros((self.n_stretches, data.n_lagged))
        squares = np.ones(len(held))
        for step in range(int(self.place.max(initial=-1)) + 1):
            at = np.flatnonzero(self.place == step)
            own, anew = self.stretch[at], begins[at]
            states[own[anew]] = known[at[anew]]
            features = data.features(np.hstack([states[own], inputs[at]]))
            after = np.matmul(coef[modes[at]], features[:, :, None])[:, :, 0]
            after = np.clip(np.nan_to_num(after, nan=farthest), -farthest, farthest)
            error = np.square(after - targets[at]).mean(axis=1)
            squares[at] = np.where(modes[at] < 0, 1.0, error)
            states[own] = np.hstack([after, states[own][:, :-n]])
        return squares


def choose_lags(
    searched: Callable[[int], Searched], most: int
) -> tuple[int, tuple[LagCandidate, ...]]:
    """The fewest lags whose held-out rollouts are about as good as the best."""
    errors, tried = [], []
    for lags in range(most + 1):
        one = searched(lags)
        held_out = HeldOut(one.data, one.found, most)
        errors.append(held_out.errors(_every_feature(one.found)))
        tried.append(LagCandidate(lags, len(one.found.coef), float(np.nanmean(errors[-1]))))
    best = errors[int(np.argmin([one.error for one in tried]))]
    good = [_as_good(own, best) for own in errors]
    return good.index(True), tuple(tried)


def with_own_orders(searched: Searched) -> tuple[Searched, Labels]:
    """Laws without the longer lags that do not help in a mode, and the lags of every mode."""
    data, found = searched.data, searched.found
    held_out, free = HeldOut(data, found, data.rows.lags), _every_feature(found)
    best, lags = held_out.errors(free), np.full(len(free), data.rows.lags)
    for mode in range(len(free)):
        for fewer in range(data.rows.lags):
            trial = free.copy()
            trial[mode] &= data.memory <= fewer
            if trial[mode].any() and _as_good(held_out.errors(trial), best):
                free, lags[mode] = trial, fewer
                break
    if free.all():
        return searched, lags
    again = refitted(data, found, free, np.arange(len(data.rows)))
    return replace(searched, found=again), lags


def refitted(
    data: DiscreteData, found: Found, free: NDArray[np.bool_], rows: NDArray[np.intp]
) -> Found:
    """Laws of some rows with some features, the modes as they are."""
    part, fit = data.take(rows), found.fit.take(rows)
    if found.states is None:
        return replace(
            found, fit=replace(fit, coef=fitted(part.problem, fit.lawful, fit.coef, free))
        )
    fit = replace(fit, coef=found.coef, scale=np.tile(found.states.noise, (len(fit.coef), 1)))
    return replace(found, fit=fit, states=with_states(part, fit, found.states.tie, free=free))


def _every_feature(found: Found) -> NDArray[np.bool_]:
    return np.ones(found.coef[:, 0].shape, dtype=bool)


def _as_good(errors: Array, best: Array) -> bool:
    """True if errors of stretches are larger than others by chance or rounding alone."""
    common = np.isfinite(errors) & np.isfinite(best)
    excess = (errors - best)[common]
    chance = excess.std(ddof=1) / np.sqrt(len(excess)) if len(excess) > 1 else 0.0
    exact = np.square(_EXACT)
    return bool(excess.mean() <= max(_STANDARD_ERRORS * chance, exact))
