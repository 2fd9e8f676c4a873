"""Laws to start from: of windows of the rows, each led to the rows that it explains best."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._discrete_stays.rows import RowProblem
from swsysid._discrete_stays.settings import SETTINGS
from swsysid._results import Array


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
    lengths = [int(factor * n_features) + SETTINGS.spare for factor in SETTINGS.window_factors]
    for n_parts, length in [(1, length) for length in lengths] + [
        (n_parts, -(-lengths[0] // n_parts)) for n_parts in SETTINGS.window_parts
    ]:
        rows = _windows(problem, n_parts, length)
        if not len(rows):
            continue
        features, targets = problem.features[rows], problem.targets[rows]
        of_windows = np.linalg.pinv(features, rcond=SETTINGS.rank) @ targets
        squares = np.square(targets - features @ of_windows).sum(axis=(1, 2))
        groups = np.array_split(np.arange(len(rows)), min(SETTINGS.windows, len(rows)))
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
    most = SETTINGS.tried if n_parts == 1 else SETTINGS.tried_in_parts
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
    for _ in range(SETTINGS.reweightings):
        squares = _block_squares(problem, coef)
        least = np.quantile(squares, SETTINGS.share, axis=1)[:, None]
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
    n, half = squares.shape[1], SETTINGS.block // 2
    rows = np.arange(n)
    first, last = np.maximum(rows - half, 0), np.minimum(rows + half + 1, n)
    return (sums[:, last] - sums[:, first]).clip(0.0) / (last - first)
