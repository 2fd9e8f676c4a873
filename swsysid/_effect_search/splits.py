"""Where one more mode may begin: the threshold beyond which a law of its own explains most more.

A search for modes from chance starts overlooks one that few rows have. Each mode is cut at many
values of each channel, as the node of a regression tree is, with the whole library on both sides.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from swsysid._effect_search.candidates import CandidateContext
from swsysid._noise import robust_scale
from swsysid._results import Array


def with_one_split(beside: CandidateContext) -> NDArray[np.intp] | None:
    """Modes of which one is two now; None if none has the rows for two laws."""
    data, problem = beside.data, beside.regression
    left = beside.fit.residuals(data.records, data.rows, data.targets)[:, beside.targets]
    scale = np.maximum(robust_scale(left), data.exact[beside.targets])
    gross = data.settings.gross * scale
    left = np.clip(left, -gross, gross)
    X = beside.records.X[data.rows]
    best, answer = 0.0, None
    for mode in range(problem.n_modes):
        own = np.flatnonzero(problem.modes == mode)
        features, gone = problem.features[own], left[own]
        least = data.settings.rows_a_column * features.shape[1]
        before = _squares(features, gone, [len(own)])[0]
        for values in X[own].T:
            order = np.argsort(values, kind="stable")
            cuts = _cuts(values[order], least, data.settings.n_splits)
            if not len(cuts):
                continue
            backwards = order[::-1]
            below = _squares(features[order], gone[order], cuts)
            above = _squares(features[backwards], gone[backwards], len(own) - cuts[::-1])[::-1]
            after = np.maximum(below + above, len(own) * data.exact[beside.targets] ** 2)
            gains = 0.5 * len(own) * np.log(np.maximum(before, after) / after).sum(axis=1)
            if gains.max() > best:
                best, answer = float(gains.max()), problem.modes.copy()
                answer[own[order[cuts[int(gains.argmax())] :]]] = problem.n_modes
    return answer


def _cuts(ordered: Array, least: int, most: int) -> NDArray[np.intp]:
    """Numbers of rows below thresholds, with so many on either side; equal values stay together."""
    if len(ordered) < 2 * least:
        return np.zeros(0, dtype=np.intp)
    ranks = np.linspace(least, len(ordered) - least, most).astype(np.intp)
    cuts = np.unique(np.searchsorted(ordered, ordered[ranks - 1], side="right"))
    return np.asarray(cuts[cuts <= len(ordered) - least])


def _squares(features: Array, targets: Array, cuts: NDArray[np.intp] | list[int]) -> Array:
    """Sums of squares that a regression leaves of the first rows, (n_cuts, n_states)."""
    return np.array(list(_each(features, targets, cuts)))


def _each(features: Array, targets: Array, cuts: NDArray[np.intp] | list[int]) -> Iterator[Array]:
    # gram, moment and squares of the rows up to a cut are those up to the one before and a few more
    width, start = features.shape[1], 0
    gram, moment = np.zeros((width, width)), np.zeros((width, targets.shape[1]))
    squares = np.zeros(targets.shape[1])
    for cut in cuts:
        some, wanted = features[start:cut], targets[start:cut]
        gram, moment = gram + some.T @ some, moment + some.T @ wanted
        squares, start = squares + np.sum(wanted**2, axis=0), cut
        coef = np.linalg.pinv(gram, hermitian=True) @ moment
        yield squares - np.sum(moment * coef, axis=0)
