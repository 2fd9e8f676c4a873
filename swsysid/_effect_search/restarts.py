"""Modes that were wrong because an effect or a mode was missing: they are sought anew.

Beside wrong modes a right effect explains little, and one that imitates what the modes get wrong
explains more. So not only the best candidate is fitted together with the modes, but every kind.

A search for modes from chance starts overlooks one that few rows have. Each mode is cut at many
values of each channel, as the node of a regression tree is, with the whole library on both sides:
one more mode begins at the threshold beyond which a law of its own explains most more.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from swsysid._effect_search.candidates import CandidateContext, Trial
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._noise import robust_scale
from swsysid._rendering.progress import watched
from swsysid._results import Array
from swsysid.effects import PlacedEffect

_SAME_MODES = 0.995  # share of the rows: then an effect has left the modes as they were
_N_SPLITS = 17  # thresholds of a channel: about every twentieth row of a mode


def is_large(base: CandidateContext, best: Trial) -> bool:
    """Whether a candidate gains more than an effect must, be it significant or not."""
    # Beside wrong modes a right effect gains where they are right, in a few blocks of rows; beneath
    # a slow force a regression is in doubt of everything.
    least = SETTINGS.gain_a_row * len(base.data.rows)
    return float(base.gains([best]).sum()) > least


def with_modes(
    context: SearchContext, current: Structure, candidates: Sequence[PlacedEffect]
) -> list[Structure]:
    """The first candidate with the present modes, and all of them with modes sought anew."""
    terms, first = current.terms, candidates[0]
    warm = context.structure((*terms, first), current.fit.modes)
    known = context.data.records.decoded_modes
    modes = None if known is None else known[context.data.rows]
    unchanged = np.mean(warm.fit.modes == current.fit.modes)
    # Modes that are told may be wrong together with those of the declared model: few rows are left
    # in the stays, and one that is wrong decides between two kinds.
    if current.fit.n_modes == 1 or (modes is None and unchanged >= _SAME_MODES):
        return [warm]  # the modes were right without the effect
    restarts = [
        replace(candidate, mode=None, replaced=None)
        for candidate in candidates[: SETTINGS.n_restarts]
    ]
    anew = Parallel(n_jobs=context.n_jobs)(
        delayed(context.structure)((*terms, candidate), modes, 1)
        for candidate in watched(restarts, "modes anew", bool(context.verbose))
    )
    return [warm, *anew]


@dataclass(frozen=True)
class Cut:
    """Rows on the far side of a threshold of a channel, and what a law of their own is worth."""

    gain: float  # in log likelihood, of two laws over one
    rows: NDArray[np.intp]


def with_one_split(base: CandidateContext) -> NDArray[np.intp] | None:
    """Modes of which one is two now; None if none has the rows for two laws."""
    data, problem, targets = base.data, base.regression, base.targets
    left = base.fit.residuals(data.records, data.rows, data.targets)[:, targets]
    floor = data.exact[targets]
    gross = SETTINGS.gross * np.maximum(robust_scale(left), floor)
    left, X = np.clip(left, -gross, gross), base.records.X[data.rows]
    least = SETTINGS.rows_a_column * problem.features.shape[1]
    cuts = []
    for mode in range(problem.n_modes):
        own = np.flatnonzero(problem.modes == mode)
        for values in X[own].T:
            cut = best_cut(problem.features[own], left[own], values, least, _N_SPLITS, floor)
            cuts += [Cut(cut.gain, own[cut.rows])] if cut is not None else []
    if not cuts:
        return None
    answer = problem.modes.copy()
    answer[max(cuts, key=lambda cut: cut.gain).rows] = problem.n_modes
    return answer


def best_cut(
    features: Array, targets: Array, values: Array, least: int, most: int, floor: Array
) -> Cut | None:
    """Of so many thresholds at most the best; None if fewer rows than `least` are on each side.

    `floor` are errors below which there is nothing to explain, (n_states,).
    """
    order, n_rows = np.argsort(values, kind="stable"), len(values)
    counts = _counts(values[order], least, most)
    if not len(counts):
        return None
    reverse = order[::-1]
    below = _squares(features[order], targets[order], [*counts, n_rows])
    above = _squares(features[reverse], targets[reverse], n_rows - counts[::-1])[::-1]
    smallest = n_rows * floor**2 + np.finfo(float).tiny
    one, two = np.maximum(below[-1], smallest), np.maximum(below[:-1] + above, smallest)
    gains = 0.5 * n_rows * np.log(one / two).sum(axis=1)
    best = int(gains.argmax())
    return Cut(float(gains[best]), order[counts[best] :])


def _counts(ordered: Array, least: int, most: int) -> NDArray[np.intp]:
    """Numbers of rows below thresholds, with so many on either side; equal values stay together."""
    if len(ordered) < 2 * least:
        return np.zeros(0, dtype=np.intp)
    ranks = np.linspace(least, len(ordered) - least, most).astype(np.intp)
    counts = np.unique(np.searchsorted(ordered, ordered[ranks - 1], side="right"))
    return np.asarray(counts[counts <= len(ordered) - least])


def _squares(features: Array, targets: Array, counts: Sequence[int] | NDArray[np.intp]) -> Array:
    """Sums of squares that a regression leaves of so many first rows, (n_counts, n_states)."""
    return np.array(list(_left_of_the_first(features, targets, counts)))


def _left_of_the_first(
    features: Array, targets: Array, counts: Sequence[int] | NDArray[np.intp]
) -> Iterator[Array]:
    # the sums of the rows up to a threshold are those up to the one before, and of a few rows more
    width, start = features.shape[1], 0
    gram, moment = np.zeros((width, width)), np.zeros((width, targets.shape[1]))
    squares = np.zeros(targets.shape[1])
    for count in counts:
        some, wanted = features[start:count], targets[start:count]
        gram, moment = gram + some.T @ some, moment + some.T @ wanted
        squares, start = squares + np.sum(wanted**2, axis=0), count
        coef = np.linalg.pinv(gram, hermitian=True) @ moment
        yield squares - np.sum(moment * coef, axis=0)
