"""Laws to start from: of windows of the rows, each led to the rows that it explains best."""

from __future__ import annotations

import numpy as np

from swsysid._automaton_search.discrete_rows import RowProblem
from swsysid._results import Array


class LawPool:
    """Candidate laws, and how badly each explains every row.

    Rows of windows tell laws, for a stay is in one mode. Every law is then fitted to the rows that
    it explains best, by reweighting with :math:`1 / (r^2 + s^2)` and s of its best rows: a law
    that began in a window with a switch, or in too short a one, ends in a mode.
    """

    def __init__(self, problem: RowProblem):
        self.problem = problem
        self.coef = _refined(problem, _of_windows(problem))
        squares = _block_squares(problem, self.coef)
        floor = np.square(problem.floor).sum()
        # nats of a row with a scale of its own: no noise need be known
        n_states = problem.targets.shape[1]
        self.nats = 0.5 * n_states * np.log(squares + floor)  # (n_laws, n_rows)

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
        squares = _block_squares(self.problem, coef)
        floor = np.square(self.problem.floor).sum()
        known = 0.5 * self.problem.targets.shape[1] * np.log(squares.min(axis=0) + floor)
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
    """Least squares in windows of several lengths, spread over all stretches."""
    settings, n_features = problem.settings, problem.features.shape[1]
    place, stretch = problem.places
    left = np.bincount(stretch)[stretch] - place  # rows of the stretch from each row on
    laws = [np.linalg.lstsq(problem.features, problem.targets, rcond=None)[0].T[None]]
    for factor in settings.window_factors:
        length = max(settings.shortest_window, int(factor * (n_features + 1)))
        firsts = np.flatnonzero(left >= length)
        if not len(firsts):
            break
        count = min(settings.windows, len(firsts))
        firsts = firsts[np.linspace(0, len(firsts) - 1, count).round().astype(int)]
        rows = firsts[:, None] + np.arange(length)
        inverse = np.linalg.pinv(problem.features[rows], rcond=1e-10)
        laws.append((inverse @ problem.targets[rows]).transpose(0, 2, 1))
    return np.concatenate(laws)


def _refined(problem: RowProblem, coef: Array) -> Array:
    """Laws after some rounds of least squares with more weight on the rows they explain."""
    settings, features = problem.settings, problem.features
    n_features = features.shape[1]
    products = (features[:, :, None] * features[:, None, :]).reshape(len(features), -1)
    mixed = (features[:, :, None] * problem.targets[:, None, :]).reshape(len(features), -1)
    hold = 1e-12 * np.eye(n_features)
    for _ in range(settings.reweightings):
        squares = _block_squares(problem, coef)
        least = np.quantile(squares, settings.share, axis=1)[:, None]
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
    n, half = squares.shape[1], problem.settings.block // 2
    rows = np.arange(n)
    first, last = np.maximum(rows - half, 0), np.minimum(rows + half + 1, n)
    return (sums[:, last] - sums[:, first]).clip(0.0) / (last - first)
