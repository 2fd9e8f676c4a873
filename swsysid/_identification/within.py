"""Vector fields within what is known of them, which may join modes and equations."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._known.known import Known
from swsysid._known.region import Region
from swsysid._losses.within import Block, least_within
from swsysid._results import Array

_HARD = 1.0 - 1e-9  # membership of a row that is in one mode


@dataclass(frozen=True)
class KnownLaws:
    """What is known, of equations and terms of these names."""

    known: Known
    equations: tuple[str, ...]
    terms: tuple[str, ...]

    def region(self, n_modes: int) -> Region:
        """The coefficients of so many modes that it allows."""
        return _region(self, n_modes)


@lru_cache(maxsize=32)
def _region(laws: KnownLaws, n_modes: int) -> Region:
    return laws.known.region(laws.equations, laws.terms, n_modes)


class Rows(NamedTuple):
    """What vector fields are fitted to."""

    features: Array  # (n_samples, n_features_out)
    targets: Array  # (n_samples, n_states)
    weight: Array  # (n_samples,)


def estimate_within(
    region: Region,
    loss: str,
    rows: Rows,
    membership: Array,
    support: NDArray[np.bool_] | None,
    start: Array | None,
) -> Array:
    """Vector fields of least loss for given memberships, (n_modes, n_states, n_features_out)."""
    fixed, values = region.fixed
    free = ~fixed if support is None else support & ~fixed
    coef = np.where(fixed, values, 0.0)
    if start is not None:  # a mode without samples keeps its vector field
        empty = ~(membership[rows.weight > 0.0] > 0.0).any(axis=0)
        coef[empty] = np.where(fixed[empty], coef[empty], start[empty])
    targets = rows.targets.copy()
    for state, of_state in enumerate(coef.swapaxes(0, 1)):  # what is fixed
        if of_state.any():
            targets[:, state] -= (membership * (rows.features @ of_state.T)).sum(axis=1)
    blocks = _blocks(Rows(rows.features, targets, rows.weight), membership, free)
    near = None if start is None else start[free] - coef[free]
    coef[free] += least_within(loss, blocks, region.steps(coef, free), near)
    return coef.clip(*region.box)


def _blocks(given: Rows, membership: Array, free: NDArray[np.bool_]) -> list[Block]:
    """One for each mode and equation, or each equation where rows are in several modes."""
    every, place = range(len(free)), np.cumsum(free).reshape(free.shape) - 1
    hard = (membership.max(axis=1) > _HARD).all()
    blocks = []
    for modes in [[mode] for mode in every] if hard else [list(every)]:
        share = membership[:, modes]
        rows = np.flatnonzero((share.max(axis=1) > 1.0 - _HARD) & (given.weight > 0.0))
        whole = given.features[rows]
        if not hard:
            whole = (share[rows, :, None] * whole[:, None, :]).reshape(len(rows), -1)
        for state, target in enumerate(given.targets.T):
            own = free[modes, state]
            design = whole if own.all() else whole[:, own.ravel()]
            places = place[modes, state][own]
            blocks.append(Block(design, target[rows], given.weight[rows], rows, places))
    return blocks
