"""Which rows are held out, and how much better one model predicts them than another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._tables.refusal import TableError

__all__ = ["Split", "certainty", "hold_out", "relative_error"]

WHOLE_GROUPS = 5  # from so many trajectories on, whole ones are held out
BLOCKS = 10  # contiguous stretches on which two models are compared
EXACT = 1e-12  # squared errors below this fraction of the largest are round-off


@dataclass(frozen=True)
class Split:
    """Rows to train on and rows to test on.

    Attributes
    ----------
    test : ndarray of shape (n_samples,), bool
    whole_groups : bool
        Whole trajectories are held out, not the last stretch of each.
    """

    test: NDArray[np.bool_]
    whole_groups: bool

    @property
    def train(self) -> NDArray[np.bool_]:
        """Rows to train on."""
        return ~self.test


def hold_out(groups: NDArray, fraction: float, random_state: int) -> Split:
    """Rows to test on: whole trajectories if there are enough, else the last of each."""
    if not 0.0 < fraction < 1.0:
        raise TableError(f"The test fraction {fraction:g} is not between 0 and 1.")
    names, codes = np.unique(groups, return_inverse=True)
    whole = len(names) >= WHOLE_GROUPS
    if whole:
        n_test = max(1, round(fraction * len(names)))
        generator = np.random.default_rng(random_state)
        test = np.isin(codes, generator.permutation(len(names))[:n_test])
    else:
        position = np.empty(len(codes))
        for code, count in enumerate(np.bincount(codes)):
            position[codes == code] = np.arange(count) / count
        test = position >= 1.0 - fraction
    if not test.any() or test.all():
        raise TableError(f"{len(groups)} samples are too few to hold out {fraction:g} of them.")
    return Split(test, whole)


def relative_error(errors: Array, spread: Array) -> float:
    """Root mean square of errors (n_rows, n_rates), each rate in units of its spread."""
    return float(np.sqrt(np.mean((errors / _scale(spread)) ** 2)))


def certainty(simple: Array, rich: Array, spread: Array) -> float:
    """Gain of a rich model over a simple one, in standard errors over contiguous blocks.

    The mean log ratio of the squared errors over its standard error, the blocks being
    independent. Ratios, because the errors of a decaying trajectory differ by decades between
    its blocks.
    """
    scale = _scale(spread)
    size = np.array([np.sum((error / scale) ** 2, axis=1) for error in (simple, rich)])
    blocks = np.array_split(size, min(BLOCKS, size.shape[1]), axis=1)
    if len(blocks) < 2:
        return 0.0
    means = np.array([block.mean(axis=1) for block in blocks])
    ratios = np.diff(np.log(means + EXACT * means.max()), axis=1)[:, 0]
    error = ratios.std(ddof=1) / np.sqrt(len(ratios))
    return float(-ratios.mean() / error) if error > 0 else 0.0


def _scale(spread: Array) -> Array:
    return np.where(spread > 0, spread, 1.0)
