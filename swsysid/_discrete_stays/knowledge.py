"""What rows of maps would rather have of each thing known of their laws, to first order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from swsysid._discrete_stays.identify import DiscreteStays
from swsysid._discrete_stays.states import LawsAndStates, StateProblem
from swsysid._known.checks import GuardDoubt, KnownCheck, Released, checks, least_unit
from swsysid._known.region import Region
from swsysid._known.sentences import Guard
from swsysid._results import Array
from swsysid._stays.arrow import covariance_of
from swsysid._stays.settings import LIMITS
from swsysid._ties import least_of
from swsysid.metrics._modes import best_matching, contingency

_HELD = 1e-10  # of the information of a coefficient, what holds those that nothing tells


def checked(
    stays: DiscreteStays,
    order: NDArray[np.intp],
    again: Callable[[frozenset[int]], DiscreteStays],
) -> tuple[KnownCheck, ...]:
    """One for each sentence; `order` are the modes as they are named, `again` identifies anew."""
    data = stays.searched.data
    if data.known is None:
        return ()
    return checks(MapFit(stays, order, again), data.region_of_user(len(stays.coef)))


@dataclass(frozen=True)
class MapFit:
    """The most likely laws in the user's units, all coefficients free."""

    stays: DiscreteStays
    order: NDArray[np.intp]
    again: Callable[[frozenset[int]], DiscreteStays]

    falls_short = False  # rows that no law explains are told elsewhere

    @property
    def coef(self) -> Array:
        """Of modes as they are named."""
        return self.stays.coef[self.order]

    @property
    def free(self) -> NDArray[np.bool_]:
        """All."""
        return np.ones(self.coef.shape, dtype=bool)

    @cached_property
    def _equations(self) -> tuple[float, Array, Array, Array]:
        """Half the squares that are left; information of the coefficients, and what pulls them.

        And by how much the information is rounded, where most of it was about states.
        """
        found, data = self.stays.searched.found, self.stays.searched.data
        fit, shape = found.fit, self.coef.shape
        n = self.coef[0].size
        if found.states is not None:
            told = found.states
            free = np.ones((shape[0], shape[2]), dtype=bool)
            problem = StateProblem(data, fit.lawful, free, told.noise, told.tie)
            own = np.ones(shape, dtype=bool)
            equations = problem.normal_equations(LawsAndStates(told.coef, own, told.states))
            value, matrix = equations.value, equations.arrow.schur
            rounded = LIMITS.rounding * np.diag(equations.arrow.corner)
            right = equations.arrow.pull(equations.right)
        else:
            value, matrix = 0.0, np.zeros((shape[0] * n,) * 2)
            right, rounded = np.zeros((2, shape[0] * n))
            for mode, law in enumerate(fit.coef):
                rows = fit.lawful == mode
                features = data.problem.features[rows]
                for state in range(shape[1]):
                    by = features / fit.scale[mode, state]
                    left = (data.problem.targets[rows, state] - features @ law[state]) / (
                        fit.scale[mode, state]
                    )
                    begin = mode * n + state * shape[2]
                    places = slice(begin, begin + shape[2])
                    matrix[places, places], right[places] = by.T @ by, by.T @ left
                    value += 0.5 * float(left @ left)
        names = self.stays.names[self.order]
        places = (names[:, None] * n + np.arange(n)).ravel()
        unit = np.tile((data.feature_unit / data.target_unit[:, None]).ravel(), shape[0])
        matrix = matrix[np.ix_(places, places)] * unit[:, None] * unit
        return value, matrix, right[places] * unit, rounded[places] * np.square(unit)

    @property
    def freedom(self) -> float:
        """Values less coefficients."""
        lawful = self.stays.searched.found.fit.lawful
        return max(1.0, float((lawful >= 0).sum() * self.coef.shape[1] - self.coef.size))

    def released(self, region: Region) -> Released:
        """By the step of Gauss and Newton, with the noise that is left after it."""
        value, matrix, right, rounded = self._equations
        diagonal = np.diag(matrix)
        held = matrix + np.diag(np.where(diagonal > 0.0, _HELD * diagonal + rounded, 1.0))
        steps = region.steps(self.coef, self.free)
        step = steps.least(held, right)
        gain = float(right @ step - 0.5 * step @ held @ step)
        least = least_unit(matrix, self.coef.ravel(), self.freedom, LIMITS.rounding)
        unit = max(2.0 * (value - gain) / self.freedom, least)

        def covariance() -> Array:
            return covariance_of(matrix, steps.at_bounds(held))

        return Released(step.reshape(self.coef.shape), gain, unit, self.freedom, covariance)

    def of_guard(self, guard: Guard) -> GuardDoubt | None:
        """Nothing: guards are refused."""
        return None

    def without(self, left_out: frozenset[int]) -> MapFit:
        """Identified with some sentences left out, modes named as these are."""
        stays, n_modes = self.again(left_out), len(self.coef)
        order = np.arange(len(stays.coef))
        if len(stays.coef) == n_modes:
            named = np.argsort(self.order)[self.stays.modes]
            joint = contingency(named, stays.modes, shape=(n_modes, n_modes))
            order = np.asarray(best_matching(joint)[1], dtype=np.intp)
        return MapFit(stays, order, self.again)

    @property
    def cost(self) -> float:
        """Nats, coefficients paid for."""
        return self.stays.searched.found.cost

    def log_p_beside(self, other: MapFit) -> float:
        """By both likelihoods."""
        return float(chi2.logsf(2.0 * max(0.0, self.cost - other.cost), 1))

    def likeliest(self, others: Mapping[int, MapFit]) -> int:
        """By what is minimised."""
        return least_of(sorted(others), lambda k: others[k].cost)
