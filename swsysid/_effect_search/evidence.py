r"""Whether one structure predicts better than another one by chance.

Three tests, each valid if the simpler structure is true, and the clearer of them counts, corrected
for all. With likelihoods p of a row before and q after, :math:`z = (q - p) / (q + p)` has no
positive mean where p is true, whatever q is, for it is concave in q / p; unlike the logarithm, of
which a few rows hold most, it is bounded. So (i) the sums of z in independent blocks, and (ii) bets
on it, are tested. And (iii) the errors of the simpler structure are regressed on what the other one
predicts besides: noise of any size has no share in that, and where it is the same everywhere a few
stretches of the record are enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swsysid._effect_search.chance import BlockSum, Slope, chance_of_bets
from swsysid._effect_search.folds import memory_of
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._noise import robust_scale


@dataclass(frozen=True)
class Evidence:
    """Probabilities of a gain by chance."""

    chance: float
    chance_by_blocks: float  # whatever the noise of each block is


def structural_evidence(context: SearchContext, before: Structure, after: Structure) -> Evidence:
    """Of predictions that are so much better."""
    by_blocks = _chance_of_gains(context, before, after)
    if not _is_judged_unseen(after):
        return Evidence(by_blocks, by_blocks)
    besides = _errors_against_change(context, before, after)
    return Evidence(min(1.0, 2.0 * min(by_blocks, besides.chance)), by_blocks)


def _is_judged_unseen(structure: Structure) -> bool:
    # Modes, a surface and weights that were fitted to all rows bend to those that are to be
    # predicted; where there are several modes fits that have not seen the rows are judge.
    return structure.fit.n_modes > 1 and structure.fit.guard is None


def _chance_of_gains(context: SearchContext, before: Structure, after: Structure) -> float:
    """Of gains of the rows: of their sums in blocks, and of bets on them."""
    gains = before.rows - after.rows
    if _is_judged_unseen(after):
        gains = context.unseen_rows(before).cost - context.unseen_rows(after).cost
    values, data = np.tanh(0.5 * gains), context.data
    # What it remembers by chance is what the residuals do.
    left = after.fit.residuals(data.records, data.rows, data.targets)
    remembered = memory_of(data.records.take(data.rows), left[:, data.counted_states])
    blocks = data.folds.blocks_beyond(remembered)
    sums = BlockSum.of(np.bincount(blocks, values).astype(float))
    bets = chance_of_bets(values, blocks, remembered)
    chance = min(1.0, 2.0 * min(sums.chance, bets))  # the clearer of two tests
    if not after.fit.remembers or before.fit.remembers:
        return chance
    # A guard that remembers concerns few rows in few blocks. None of them decides, for a sure
    # surface is wrong now and then; and chance makes a likelihood ratio r with 1 / r at most.
    ratio = float(np.exp(min(0.0, (after.price - before.price) / remembered)))
    return min(1.0, 2.0 * min(chance, ratio))


def _errors_against_change(context: SearchContext, before: Structure, after: Structure) -> Slope:
    """The errors of one structure against what another one predicts besides."""
    data, folds = context.data, context.data.folds
    first, other = (context.unseen_rows(one).errors for one in (before, after))
    scale = np.maximum(robust_scale(other), data.exact)
    change = ((first - other) / scale)[:, data.counted_states]
    gross = context.settings.gross
    errors = np.clip(first / scale, -gross, gross)[:, data.counted_states]
    # along the direction in which the two differ in each row
    size = np.linalg.norm(change, axis=1)
    along = np.sum(errors * change, axis=1) / np.where(size > 0.0, size, 1.0)
    return Slope(size, along, np.ones(len(size)), folds.series, folds.blocks)
