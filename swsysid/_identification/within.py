"""Vector fields within what is known of them, which may join modes and equations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._data.coordinates import shifted_monomials
from swsysid._data.features import FeatureMap
from swsysid._identification.settings import Parameters
from swsysid._known.known import Known
from swsysid._known.region import Region
from swsysid._known.sentences import Guard, Names
from swsysid._losses.base import Summary
from swsysid._losses.within import Block, least_within
from swsysid._results import Array
from swsysid._surfaces.polynomials import Basis, plain_basis
from swsysid._surfaces.surface import takes_relevance

_HARD = 1.0 - 1e-9  # membership of a row that is in one mode


@dataclass(frozen=True)
class KnownLaws:
    """What is known, of equations and terms of these names."""

    known: Known
    equations: tuple[str, ...]
    terms: tuple[str, ...]
    n_beside: int = 0  # further columns, of which nothing is known

    @classmethod
    def of(cls, known: Known | None, feature_map: FeatureMap, n_states: int) -> KnownLaws | None:
        """Of the laws of a library; None where nothing is known of them."""
        if known is None or (laws := known.of_laws) is None:
            return None
        names = known.columns or feature_map.names_in
        return cls(laws, tuple(names[:n_states]), tuple(map(str, feature_map.names(names))))

    def region(self, n_modes: int) -> Region:
        """The coefficients of so many modes that it allows."""
        return _region(self, n_modes)


@lru_cache(maxsize=32)
def _region(laws: KnownLaws, n_modes: int) -> Region:
    region = laws.known.region(laws.equations, laws.terms, n_modes)
    return region.beside_columns(laws.n_beside) if laws.n_beside else region


@dataclass(frozen=True)
class KnownGuard:
    """What is known of the surfaces of a classifier between columns of some names."""

    guard: Guard
    surface: PolynomialSurfaceClassifier
    names: Sequence[str]
    offset: Array  # where the columns of a fit are counted from

    @classmethod
    def of(
        cls, guard: Guard, estimator: Parameters, names: Sequence[str], offset: Array | None = None
    ) -> KnownGuard:
        """That of a regressor; ValueError where its surfaces cannot be of this kind."""
        given = estimator.surface
        surface = PolynomialSurfaceClassifier() if given is None else given
        if not isinstance(surface, PolynomialSurfaceClassifier) or not takes_relevance(surface):
            raise ValueError(
                f'known="{guard}" needs a surface that may be any polynomial, a '
                "PolynomialSurfaceClassifier that is told no relevance or span."
            )
        known = cls(guard, surface, names, np.zeros(len(names)) if offset is None else offset)
        if guard.span(known.monomials).shape[1] == 1 and estimator.n_modes not in ("auto", 1, 2):
            raise ValueError(
                f'known="{guard}" is one surface, which parts two modes and not '
                f"{estimator.n_modes}; leave the threshold to be found, such as guard x >= *."
            )
        return known

    @property
    def within(self) -> PolynomialSurfaceClassifier:
        """The classifier held to it."""
        return clone(self.surface).set_params(span=self.counted(self.guard.span(self.monomials)))

    @cached_property
    def basis(self) -> Basis:
        """The monomials of which surfaces are."""
        return plain_basis(self.surface.degree, self.surface.feature_library, len(self.names))

    @cached_property
    def monomials(self) -> Names:
        """Their names."""
        return Names([], list(map(str, self.basis.names(self.names))), 1)

    def counted(self, columns: Array) -> Array:
        """Columns of coefficients (n_monomials, n_columns) where the columns are counted from."""
        if not self.offset.any():
            return columns
        assert self.basis.exponents is not None, "only monomials are counted from elsewhere"
        unit = np.ones(len(self.offset))
        return shifted_monomials(self.basis.exponents, -self.offset, unit) @ columns


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


def better_within(
    region: Region, loss: str, summaries: Sequence[Summary], coef: Array, support: NDArray[np.bool_]
) -> Array:
    """Better vector fields than those that rows of each mode were summarised at.

    What rows do not tell stays: of a mode without rows, and of an equation that it meets exactly.
    """
    told = [summary.regression for summary in summaries]
    free = support & ~region.fixed[0]
    for mode, state in np.argwhere(free.any(axis=2)).tolist():
        n_heavy = told[mode].n_heavy
        few = len(told[mode].rows[state][1]) - n_heavy < free[mode, state].sum()
        free[mode, state] &= not (n_heavy and few)
    place, n_free = np.cumsum(free).reshape(free.shape) - 1, int(free.sum())
    blocks, begin = [], 0
    gradient, hessian = np.zeros(n_free), np.zeros((n_free, n_free))
    for mode, own in enumerate(told):
        for state, (design, target) in enumerate(own.rows):
            some, at = free[mode, state], begin + np.arange(len(target))
            left, each = target - design @ coef[mode, state], np.ones(len(target))
            places = place[mode, state][some]
            blocks.append(Block(design[:, some], left, each, at, places, own.n_heavy))
        begin += max((len(target) for _, target in own.rows), default=0)
        if own.gradient is not None and own.hessian is not None:
            places = place[mode][free[mode]]
            gradient[places] = own.gradient[free[mode]]
            hessian[np.ix_(places, places)] = own.hessian[free[mode]][:, free[mode]]
    steps, moved = region.steps(coef, free), coef.copy()
    moved[free] += least_within(loss, blocks, steps, np.zeros(n_free), (gradient, hessian))
    return moved.clip(*region.box)
