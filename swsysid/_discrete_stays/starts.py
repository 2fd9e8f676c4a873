"""Where searches start: laws of windows of the rows, and modes by two thresholds of a column.

*Windows*: each law is led to the rows that it explains best.

*Thresholds*, as of a relay or a threshold autoregression: where noise is large or stays are short,
a row says little about its mode, and laws of few rows are no start. Most plants switch where a
column passes a threshold, up at one value and down at another or at the same. Such modes need no
laws: of all thresholds those are taken whose two laws of least squares leave least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.lagged import KnownGuard, Labels
from swsysid._discrete_stays.rows import (
    SWITCHING,
    RowFit,
    RowProblem,
    as_fit,
    fitted,
    row_costs,
    scale_of,
    worth,
)
from swsysid._results import Array

# Laws of windows of so many rows for each feature and a few to spare, and of the shortest ones in
# so many parts; so many windows of each length are tried and the best of neighbours kept (in parts
# a few in a hundred are in one mode); singular values below this share say nothing.
_WINDOW_FACTORS, _SPARE, _WINDOW_PARTS = (1.0, 2.0, 4.0, 8.0), 2, (2, 3, 4)
_TRIED, _TRIED_IN_PARTS, _WINDOWS = 400, 2000, 40
_RANK = 1e-10
_BLOCK = 3  # rows whose squares are averaged where starts are judged
_SHARE = 0.1  # of the rows, which a law should at least explain
_REWEIGHTINGS = 6
# Thresholds that are tried in a column, and how often finer ones around the best.
_LEVELS, _CLOSER = 9, 5


class LawPool:
    """Candidate laws, and how badly each explains every row.

    Rows of windows tell laws, for a stay is in one mode. Every law is then fitted to the rows that
    it explains best, by reweighting with :math:`1 / (r^2 + s^2)` and s of its best rows: a law
    that began in a window with a switch, or in too short a one, ends in a mode.
    """

    def __init__(self, problem: RowProblem):
        # in features that are orthonormal over the rows, products of them lose few digits
        left, sizes, right = np.linalg.svd(problem.features, full_matrices=False)
        kept = sizes > np.finfo(float).eps * len(left) * sizes[0]
        root = np.sqrt(len(left))
        basis = (right[kept] / sizes[kept, None]) * root  # features = white @ inverse of basis
        self.problem = replace(problem, features=left[:, kept] * root)
        raw = _of_windows(self.problem)
        white = np.concatenate([raw, _refined(self.problem, raw)])
        self.coef = white @ basis
        squares = _block_squares(self.problem, white)
        self.nats = self._nats(squares)  # (n_laws, n_rows)
        self.plain = problem

    def _nats(self, squares: Array) -> Array:
        """Nats of rows, each with a scale of its own: no noise need be known."""
        n_states = self.problem.targets.shape[1]
        return 0.5 * n_states * np.log(squares + np.square(self.problem.floor).sum())

    def best(self, n_laws: int) -> Array:
        """Laws that together explain the rows best: one by one, then exchanged one by one."""
        chosen = self._grown([], n_laws)
        for _ in range(n_laws):
            before = list(chosen)
            for place in range(n_laws):
                others = chosen[:place] + chosen[place + 1 :]
                chosen[place] = self._grown(others, n_laws)[-1]
            if chosen == before:
                break
        return self.coef[chosen]

    def beside(self, coef: Array) -> Array:
        """Laws, and that one of the pool that explains best what they do not."""
        known = self._nats(_block_squares(self.plain, coef).min(axis=0))
        another = np.minimum(self.nats, known).sum(axis=1).argmin()
        return np.concatenate([coef, self.coef[another][None]])

    def _grown(self, chosen: list[int], n_laws: int) -> list[int]:
        chosen = list(chosen)
        known = self.nats[chosen].min(axis=0, initial=np.inf)
        while len(chosen) < n_laws:
            chosen.append(int(np.minimum(self.nats, known).sum(axis=1).argmin()))
            known = np.minimum(known, self.nats[chosen[-1]])
        return chosen


def _of_windows(problem: RowProblem) -> Array:
    """Least squares in windows, long ones and short ones, and in several short ones together.

    Of neighbouring windows the one that fits best: one with a switch seldom does. Where stays are
    shorter than a law has coefficients every window has a switch, but some of several that are
    shorter still, here and there in the recordings, are in one mode all of them.
    """
    n_features = problem.features.shape[1]
    laws = [np.linalg.lstsq(problem.features, problem.targets, rcond=None)[0].T[None]]
    lengths = [int(factor * n_features) + _SPARE for factor in _WINDOW_FACTORS]
    for n_parts, length in [(1, length) for length in lengths] + [
        (n_parts, -(-lengths[0] // n_parts)) for n_parts in _WINDOW_PARTS
    ]:
        rows = _windows(problem, n_parts, length)
        if not len(rows):
            continue
        features, targets = problem.features[rows], problem.targets[rows]
        of_windows = np.linalg.pinv(features, rcond=_RANK) @ targets
        squares = np.square(targets - features @ of_windows).sum(axis=(1, 2))
        groups = np.array_split(np.arange(len(rows)), min(_WINDOWS, len(rows)))
        best = [group[squares[group].argmin()] for group in groups]
        laws.append(of_windows[best].transpose(0, 2, 1))
    return np.concatenate(laws)


def _windows(problem: RowProblem, n_parts: int, length: int) -> NDArray[np.intp]:
    """Rows (n_windows, n_rows) of windows spread over all stretches.

    Each has parts of so many successive rows, the first where it is and the others anywhere.
    """
    place, stretch = problem.places
    left = np.bincount(stretch)[stretch] - place  # rows of the stretch from each row on
    firsts = np.flatnonzero(left >= length)
    if not len(firsts):
        return np.zeros((0, 0), dtype=np.intp)
    most = _TRIED if n_parts == 1 else _TRIED_IN_PARTS
    tried = np.unique(np.linspace(0, len(firsts) - 1, most).round().astype(int))
    others = np.random.default_rng(0).integers(len(firsts), size=(len(tried), n_parts - 1))
    begins = firsts[np.column_stack([tried, others])]
    return (begins[:, :, None] + np.arange(length)).reshape(len(tried), -1)


def _refined(problem: RowProblem, coef: Array) -> Array:
    """Laws after some rounds of least squares with more weight on the rows they explain."""
    features = problem.features
    n_features = features.shape[1]
    products = (features[:, :, None] * features[:, None, :]).reshape(len(features), -1)
    mixed = (features[:, :, None] * problem.targets[:, None, :]).reshape(len(features), -1)
    hold = 1e-12 * np.eye(n_features)
    for _ in range(_REWEIGHTINGS):
        squares = _block_squares(problem, coef)
        least = np.quantile(squares, _SHARE, axis=1)[:, None]
        weight = 1.0 / (squares + least + np.square(problem.floor).sum())
        weight /= weight.sum(axis=1)[:, None]
        matrix = (weight @ products).reshape(-1, n_features, n_features) + hold
        right = (weight @ mixed).reshape(-1, n_features, problem.targets.shape[1])
        coef = np.linalg.solve(matrix, right).transpose(0, 2, 1)
    return np.asarray(coef)


def _block_squares(problem: RowProblem, coef: Array) -> Array:
    """Squared residuals of laws, averaged over a few successive rows, (n_laws, n_rows)."""
    squares = np.square(problem.residuals(coef)).sum(axis=2)
    sums = np.cumsum(np.pad(squares, ((0, 0), (1, 0))), axis=1)
    n, half = squares.shape[1], _BLOCK // 2
    rows = np.arange(n)
    first, last = np.maximum(rows - half, 0), np.minimum(rows + half + 1, n)
    return (sums[:, last] - sums[:, first]).clip(0.0) / (last - first)


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
        free = np.ones((2, problem.features.shape[1]), dtype=bool)
        coef = np.zeros((2, problem.targets.shape[1], problem.features.shape[1]))
        coef = fitted(problem, modes, coef, free)
        scale = scale_of(problem, coef, modes, free.sum(axis=1))
        costs = row_costs(problem, coef, scale)
        fit = as_fit(problem, coef, scale, SWITCHING, modes, costs)
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
    grid = np.unique(np.quantile(values, np.linspace(0.0, 1.0, _LEVELS + 2)[1:-1]))
    if len(grid) < 2:
        return np.inf, None
    low, high, width = grid, grid, float(np.diff(grid).max())
    best: tuple[float, Thresholds | None] = np.inf, None
    for _ in range(_CLOSER):
        levels = np.array([(a, b) for a in low for b in high if a <= b])
        nats = sums.nats(_modes(data, values, levels))
        place = int(nats.argmin())
        if nats[place] < best[0]:
            lower, upper = levels[place].tolist()
            best = float(nats[place]), Thresholds(column, lower, upper, width)
        if best[1] is None:
            return best
        around = width * np.linspace(-1.0, 1.0, _LEVELS)
        low, high = best[1].low + around, best[1].high + around
        if best[1].low == best[1].high:  # one threshold for both ways stays one
            high = low
        width *= 2.0 / (_LEVELS - 1.0)
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
