"""What is known of the laws of a model that is refined: coefficients that follow others, bounds.

Equalities are eliminated: some of the free coefficients are those that are sought, and the others
follow them, c = c_0 + T (c_sought). Rollouts then say of each sentence what they would rather have,
to first order, by the derivatives that they have by all coefficients of which anything is known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.stats import f as fisher

from swsysid._known.checks import GuardDoubt, Released, least_unit
from swsysid._known.known import Known
from swsysid._known.region import Region
from swsysid._known.sentences import Guard
from swsysid._results import Array
from swsysid._simulation.model import SwitchingModel
from swsysid._stays.settings import LIMITS
from swsysid._ties import least_of

_HELD = 1e-10  # of the information of a coefficient, what holds those that nothing tells
_ROUNDING = 1e-9  # below which a sum has no part of a coefficient


@dataclass(frozen=True)
class Followers:
    """Coefficients that meet what is known, those that are sought, and those that follow them."""

    coef: Array  # (n_modes, n_states, n_features): where to start
    free: NDArray[np.bool_]  # like coef: those that are sought
    following: NDArray[np.bool_]  # like coef: those that change with them
    by: Array  # (n_following, n_free): derivatives of those that follow
    bounds: tuple[Array, Array]  # (n_free,), of those that are sought

    @classmethod
    def of(cls, region: Region | None, coef: Array, free: NDArray[np.bool_]) -> Followers:
        """Of some coefficients, as many of those that are `free` sought as can be."""
        if region is None:
            nothing = np.full(int(free.sum()), np.inf)
            return cls(
                coef, free, np.zeros_like(free), np.zeros((0, len(nothing))), (-nothing, nothing)
            )
        if region.cones:
            raise ValueError(
                "known has an energy that never rises, and refine holds equalities and bounds of "
                "single coefficients; leave it out, or say x' = v beside it."
            )
        told, values = region.fixed
        chosen = region.closed(free) & ~told
        start = np.where(told, values, coef)
        sizes = np.maximum(np.abs(start[chosen]), 1e-3 * np.abs(start).max(initial=1.0))
        start = region.nearest(start, chosen, np.diag(1.0 / np.square(sizes)))
        steps = region.steps(start, chosen)
        basis = steps.basis
        first = np.linspace(1.0 + _ROUNDING**0.5, 1.0, len(basis))  # of equal ones
        order = qr((first[:, None] * basis).T, mode="r", pivoting=True)[-1][: basis.shape[1]]
        sought = np.zeros(len(basis), dtype=bool)
        sought[order] = True
        basis = basis @ np.linalg.inv(basis[sought])
        basis[np.abs(basis) < _ROUNDING] = 0.0
        low, high = np.full((2, basis.shape[1]), np.array([[-np.inf], [np.inf]]))
        now = start[chosen][sought]
        for row, room in zip(steps.most @ basis, steps.room, strict=True):
            if (places := np.flatnonzero(row)).size > 1:
                raise ValueError(
                    "known bounds a sum of coefficients, and refine holds bounds of single ones; "
                    "leave that sentence out."
                )
            for place in places:
                end = now[place] + room / row[place]
                if row[place] > 0.0:
                    high[place] = min(high[place], max(end, now[place]))
                else:
                    low[place] = max(low[place], min(end, now[place]))
        own, following = np.zeros_like(chosen), np.zeros_like(chosen)
        own[chosen], following[chosen] = sought, ~sought
        return cls(start, own, following, basis[~sought], (low, high))


def region_of(
    known: Known | None, model: SwitchingModel, left_out: frozenset[int] = frozenset()
) -> Region | None:
    """The coefficients of a model that are allowed; None for all."""
    if known is None:
        return None
    if known.of_guard() is not None:
        raise ValueError(
            f'known="{known.of_guard()}" is no question of laws; a surface that is known stays as '
            "it is with fit_surface=False."
        )
    names, shape = model.feature_map.names_in, model.coef.shape
    terms = list(map(str, model.feature_map.names_out))
    return known.region(names[: shape[1]], terms, shape[0], left_out)


@dataclass(frozen=True)
class RefinedFit:
    """Rollouts of least error, and their derivatives by all that anything is known of."""

    coef: Array
    free: NDArray[np.bool_]
    slopes: Array  # (n_residuals, n_free): by the free coefficients, all else eliminated
    misfit: Array  # (n_residuals,): likewise
    as_one: float  # residuals that count as one
    n_unknowns: int
    again: Callable[[frozenset[int]], RefinedFit]

    @property
    def falls_short(self) -> bool:
        """Never: its modes are those of the model."""
        return False

    @property
    def freedom(self) -> float:
        """Residuals less unknowns."""
        return float(max(1, len(self.misfit) - self.n_unknowns))

    def released(self, region: Region) -> Released:
        """By the step of Gauss and Newton."""
        matrix, right = self.slopes.T @ self.slopes, -self.slopes.T @ self.misfit
        diagonal = np.diag(matrix)
        told = diagonal > 0.0
        matrix = matrix + np.diag(np.where(told, _HELD * diagonal, 1.0))
        steps = region.steps(self.coef, self.free)
        step = steps.least(matrix, right)
        change = np.zeros(self.coef.shape)
        change[self.free] = step
        left = np.square(self.misfit + self.slopes @ step).sum() / self.freedom

        def covariance() -> Array:
            inverse = steps.at_bounds(matrix).inverse(matrix)
            inverse[~told, ~told] = np.inf
            return inverse

        gain = float(right @ step - 0.5 * step @ matrix @ step)
        information = self.slopes.T @ self.slopes
        least = least_unit(information, self.coef[self.free], self.freedom, LIMITS.exactly)
        unit = max(float(left), least) * self.as_one
        return Released(change, gain, unit, self.freedom / self.as_one, covariance)

    def of_guard(self, guard: Guard) -> GuardDoubt | None:
        """Nothing: guards are refused."""
        return None

    def without(self, left_out: frozenset[int]) -> RefinedFit:
        """Refined with some sentences left out."""
        return self.again(left_out)

    @property
    def value(self) -> float:
        """Half the squares that are left."""
        return 0.5 * float(np.square(self.misfit).sum())

    def log_p_beside(self, other: RefinedFit) -> float:
        """By what both leave."""
        n_free = max(1, other.n_unknowns - self.n_unknowns)
        unit = max(2.0 * other.value / other.freedom, np.finfo(float).tiny) * other.as_one
        statistic = 2.0 * max(0.0, self.value - other.value) / (n_free * unit)
        return float(fisher.logsf(statistic, n_free, other.freedom / other.as_one))

    def likeliest(self, others: Mapping[int, RefinedFit]) -> int:
        """By what each leaves of the noise, and has free."""
        unit = min(max(2.0 * one.value / one.freedom, 1e-300) for one in others.values())
        price = 0.5 * np.log(max(2.0, self.freedom))
        return least_of(
            sorted(others), lambda k: others[k].value / unit + price * others[k].n_unknowns
        )
