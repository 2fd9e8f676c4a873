"""Modes by two thresholds of a column: what a relay does, and threshold autoregressions.

Where noise is large or stays are short, a row says little about its mode, and laws of few rows are
no start. Most plants switch where a column passes a threshold, up at one value and down at another
or at the same. Such modes need no laws: of all thresholds those are taken whose two laws of least
squares leave least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.lagged import KnownGuard, Labels
from swsysid._discrete_stays.rows import RowFit, as_fit, law_of, row_costs, scale_of, worth
from swsysid._discrete_stays.settings import SETTINGS
from swsysid._results import Array


@dataclass(frozen=True)
class Thresholds:
    """Mode 1 from where a column is not below `high`, until it is not above `low`."""

    column: int
    low: float
    high: float
    width: float  # by how much they may be off

    def modes(self, data: DiscreteData) -> Labels:
        """Modes of all rows, 0 until one of the thresholds is passed."""
        levels = np.array([[self.low, self.high]])
        return _modes(data, data.columns[:, self.column], levels)[0].astype(np.intp)

    def guards(self, data: DiscreteData) -> tuple[KnownGuard, ...]:
        """Of both ways, in the units of the user."""
        unit, n_columns = data.column_unit[self.column], data.columns.shape[1] + len(CLOCKS)
        powers = np.zeros((2, n_columns), dtype=np.intp)
        powers[1, self.column] = 1
        up = PolynomialGuard(np.array([-self.high * unit, 1.0]), powers)
        down = PolynomialGuard(np.array([self.low * unit, -1.0]), powers)
        return tuple(
            KnownGuard(source, 1 - source, guard, self.width * unit)
            for source, guard in enumerate((up, down))
        )

    def fit(self, data: DiscreteData) -> RowFit:
        """Laws of these modes, which cost what thresholds do and no switches."""
        problem, modes = data.problem, self.modes(data)
        coef = np.array([law_of(problem, modes == mode) for mode in range(2)])
        free = np.ones(coef[:, 0].shape, dtype=bool)
        scale = scale_of(problem, coef, modes, free.sum(axis=1))
        costs = row_costs(problem, coef, scale)
        fit = as_fit(problem, coef, scale, SETTINGS.switching, modes, costs)
        told = np.log(data.columns.shape[1]) + np.log(len(modes))  # half of this for a threshold
        cost = fit.cost - fit.of_switches + told + worth(problem, fit, free)
        return replace(fit, cost=float(cost), of_switches=float(told), guards=self.guards(data))


def best_thresholds(data: DiscreteData) -> list[Thresholds]:
    """Of every column the thresholds whose two laws leave least; the best column first."""
    sums = _Sums(data)
    found = [_best_of(column, data, sums) for column in range(data.columns.shape[1])]
    return [one for _, one in sorted(found, key=lambda one: one[0]) if one is not None]


def _best_of(column: int, data: DiscreteData, sums: _Sums) -> tuple[float, Thresholds | None]:
    """Nats and thresholds of one column, on a grid that becomes finer where they are."""
    values = data.columns[:, column]
    grid = np.unique(np.quantile(values, np.linspace(0.0, 1.0, SETTINGS.levels + 2)[1:-1]))
    if len(grid) < 2:
        return np.inf, None
    low, high, width = grid, grid, float(np.diff(grid).max())
    best: tuple[float, Thresholds | None] = np.inf, None
    for _ in range(SETTINGS.closer):
        levels = np.array([(a, b) for a in low for b in high if a <= b])
        nats = sums.nats(_modes(data, values, levels))
        place = int(nats.argmin())
        if nats[place] < best[0]:
            lower, upper = levels[place].tolist()
            best = float(nats[place]), Thresholds(column, lower, upper, width)
        if best[1] is None:
            return best
        around = width * np.linspace(-1.0, 1.0, SETTINGS.levels)
        low, high = best[1].low + around, best[1].high + around
        if best[1].low == best[1].high:  # one threshold for both ways stays one
            high = low
        width *= 2.0 / (SETTINGS.levels - 1.0)
    return best


def _modes(data: DiscreteData, values: Array, levels: Array) -> NDArray[np.bool_]:
    """True where a row is in mode 1 by pairs of thresholds, (n_pairs, n_rows)."""
    rows = np.arange(len(values))
    first = np.maximum.accumulate(np.where(data.rows.begins, rows, 0))
    up = values >= levels[:, 1:]
    told = up | (values <= levels[:, :1])
    last = np.maximum.accumulate(np.where(told, rows, -1), axis=1)
    return np.take_along_axis(up, last.clip(0), axis=1) & (last >= first)


class _Sums:
    """Sums over rows from which least squares of any of them follow."""

    def __init__(self, data: DiscreteData):
        features, targets = data.problem.features, data.problem.targets
        white = np.linalg.svd(features, full_matrices=False)[0] * np.sqrt(len(features))
        self.n_features, self.n_states = white.shape[1], targets.shape[1]
        self.floor = np.square(data.problem.floor)
        self.parts = np.hstack([
            np.ones((len(white), 1)),
            np.square(targets),
            (white[:, :, None] * targets[:, None, :]).reshape(len(white), -1),
            (white[:, :, None] * white[:, None, :]).reshape(len(white), -1),
        ])  # fmt: skip
        self.total = self.parts.sum(axis=0)

    def nats(self, modes: NDArray[np.bool_]) -> Array:
        """Negative log likelihood of modes (n_choices, n_rows), each with two laws."""
        upper = modes.astype(float) @ self.parts
        return self._of_one(upper) + self._of_one(self.total - upper)

    def _of_one(self, sums: Array) -> Array:
        p, n = self.n_features, self.n_states
        counts, squares, mixed, products = np.split(sums, [1, 1 + n, 1 + n + p * n], axis=1)
        enough = counts[:, 0] > 2 * p
        matrix = products.reshape(-1, p, p) + 1e-9 * np.eye(p)
        mixed = mixed.reshape(-1, p, n)
        left = squares - (mixed * np.linalg.solve(matrix, mixed)).sum(axis=1)
        variance = np.maximum(left / np.maximum(counts, 1.0), self.floor)
        nats = 0.5 * counts[:, 0] * np.log(variance).sum(axis=1)
        return np.where(enough, nats, np.inf)
