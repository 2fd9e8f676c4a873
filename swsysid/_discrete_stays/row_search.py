"""Modes and laws by rows: from starts to the best fit of every number of modes."""

from __future__ import annotations

import numpy as np

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.found import lasting, without_momentary
from swsysid._discrete_stays.rows import RowFit, alternate, law_of
from swsysid._discrete_stays.starts import LawPool, best_thresholds
from swsysid._journal import step

_THRESHOLDS = 3  # columns whose thresholds are a start
_PATIENCE = 2  # numbers of modes that are tried after the best one


class RowSearch:
    """Fits rows by ever more modes."""

    def __init__(self, data: DiscreteData, max_modes: int):
        self.data, self.max_modes = data, max_modes
        self.pool = LawPool(data.problem)
        few = best_thresholds(data)[:_THRESHOLDS]
        told = [thresholds.fit(data) for thresholds in few]
        self.told = [fit for fit in told if lasting(data, fit).all()]

    def fits(self, n_modes: int | None) -> list[RowFit]:
        """The best fit by rows of every number of modes, until two more modes say no more.

        With two modes also those that thresholds tell.
        """
        best: dict[int, RowFit] = {}
        last: RowFit | None = None
        in_vain = 0
        most = self.max_modes if n_modes is None else n_modes + _PATIENCE
        for count in range(1, most + 1):
            last = self._alternated(count, last)
            kept = without_momentary(self.data, last)
            n_kept = len(kept.coef)
            before = min((fit.cost for fit in best.values()), default=np.inf)
            if n_kept not in best or kept.cost < best[n_kept].cost:
                best[n_kept] = kept
            if n_modes is not None and n_kept >= n_modes:
                break
            in_vain = 0 if kept.cost < before else in_vain + 1
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
                rest = law_of(self.data.problem, last.unexplained)
                starts.append(np.concatenate([last.coef, rest[None]]))
        fits = [alternate(self.data.problem, coef) for coef in starts]
        return min(fits, key=lambda fit: fit.cost)
