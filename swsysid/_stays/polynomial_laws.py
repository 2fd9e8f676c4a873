r"""Laws whose derivatives are known: polynomials, and those that are affine in states and inputs.

Along :math:`\dot x = A_j x + B_j u + c_j` with inputs of the rate s the derivatives of the state
are

.. math:: v_1 = A_j x + B_j u + c_j, \qquad v_2 = A_j v_1 + B_j s, \qquad v_3 = A_j v_2, \qquad
          v_4 = A_j v_3 ,

and the step of the classical method of Runge and Kutta is their Taylor polynomial,
:math:`x + h v_1 + h^2 v_2 / 2 + h^3 v_3 / 6 + h^4 v_4 / 24`. So is that of the sensitivities. Two
terms more cost less than twice as many steps: the order is as high as the noise asks for.

With :math:`z = (x, u, s, 1)`, which changes linearly along the law, the state at the end of a step
and its derivatives by the coefficients are linear functions of z: those of all steps that last
equally long are two products of matrices.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial

import numpy as np
from numpy.typing import NDArray

from swsysid._data.coordinates import Monomials
from swsysid._data.features import FeatureMap
from swsysid._results import Array
from swsysid._stays.laws import Features, Laws, Modes, slope_of
from swsysid._stays.settings import LIMITS

Powers = NDArray[np.intp]
_ORDERS = (4, 6, 8)  # of the steps of affine laws


def laws_of(coef: Array, feature_map: FeatureMap, spread: Array, free: NDArray[np.bool_]) -> Laws:
    """Laws of a library, those that are sooner stepped where it is affine or polynomial."""
    powers = feature_map.powers
    if powers is None:
        return Laws(coef, feature_map.at_rows, spread, free)
    return laws_of_monomials(coef, feature_map.at_rows, spread, free, powers)


def laws_of_monomials(
    coef: Array, features: Features, spread: Array, free: NDArray[np.bool_], powers: Powers
) -> PolynomialLaws:
    """Laws of features that are monomials of states and inputs, (n_features, n_columns)."""
    kind = AffineLaws if powers.sum(axis=1).max() <= 1 else PolynomialLaws
    return kind(coef, features, spread, free, powers)


@dataclass(frozen=True)
class PolynomialLaws(Laws):
    """Vector fields of monomials, whose derivatives are monomials again."""

    powers: Powers  # (n_features, n_states + n_inputs)

    @cached_property
    def _derived(self) -> tuple[Monomials, list[Array]]:
        """The monomials and those of their derivatives; these as sums of all, state by state."""
        n_states = len(self.spread)
        lower = np.vstack(
            [
                np.maximum(self.powers - unit, 0)
                for unit in np.eye(self.powers.shape[1], dtype=self.powers.dtype)[:n_states]
            ]
        )
        known = [tuple(row) for row in self.powers.tolist()]
        more = sorted({tuple(row) for row in lower.tolist()} - set(known))
        every = known + more
        sums = []
        for state in range(n_states):
            by_state = np.zeros((len(known), len(every)))
            for k, row in enumerate(known):
                if row[state]:
                    less = tuple(p - (c == state) for c, p in enumerate(row))
                    by_state[k, every.index(less)] = row[state]
            sums.append(by_state)
        return Monomials(np.array(every)), sums

    def linear(self, mode: int, columns: Array) -> tuple[Array, Array]:
        """As in `Laws`."""
        monomials, derived = self._derived
        values = monomials(columns).T
        jacobian = np.stack([(self.coef[mode] @ one) @ values for one in derived], axis=0)
        return values[: len(self.powers)], jacobian


@dataclass(frozen=True)
class AffineLaws(PolynomialLaws):
    """Vector fields A_j x + B_j u + c_j of the modes."""

    @property
    def sharper(self) -> Iterator[Laws]:
        """As in `Laws`."""
        return (replace(self, order=order) for order in _ORDERS)

    @cached_property
    def _parts(self) -> tuple[Array, Array, Array]:
        """A, B and c of all modes."""
        both, n_states = self.coef @ self.powers, self.coef.shape[1]
        return both[:, :, :n_states], both[:, :, n_states:], self.coef @ self._constant

    @property
    def _constant(self) -> NDArray[np.bool_]:
        """Which of the features are."""
        return self.powers.sum(axis=1) == 0

    def velocities(self, modes: Modes, x: Array, u: Array, slope: Array | None = None) -> Array:
        """Velocity of every row, each in a given mode; `slope`, of the inputs, is not asked."""
        of_states, of_inputs, constant = self._parts
        return _times(of_states[modes], x) + _times(of_inputs[modes], u) + constant[modes]

    def step(self, modes: Modes, x: Array, u: Array, after: Array, duration: Array) -> Array:
        """States after steps with inputs that go from `u` to `after`."""
        derivatives = self._derivatives(modes, x, u, slope_of(u, after, duration))
        return _taylor(x, derivatives, duration[:, None])

    def varied_step(
        self, modes: Modes, x: Array, Z: Array, u: Array, after: Array, duration: Array
    ) -> tuple[Array, Array]:
        """The same with sensitivities (n_rows, n_states, n_unknowns)."""
        slope = slope_of(u, after, duration)
        derivatives = self._derivatives(modes, x, u, slope)
        of_states = self._parts[0][modes]
        # what the features are made of, and its derivatives along the law
        rest = [np.zeros_like(u)] * (self.order - 2)
        moving = zip((x, *derivatives[:-1]), (u, slope, *rest), strict=True)
        varied, latest = [], Z
        for order, (of_x, of_u) in enumerate(moving):
            latest = np.matmul(of_states, latest)
            self._add_features(latest, modes, np.concatenate([of_x, of_u], axis=1), order == 0)
            varied.append(latest)
        return _taylor(x, derivatives, duration[:, None]), _taylor(
            Z, varied, duration[:, None, None]
        )

    def flow(
        self, mode: int, x: Array, u: Array, after: Array, duration: Array
    ) -> tuple[Array, Array, Array]:
        r"""As in `Laws`; of steps that last equally long all derivatives by states are one matrix.

        With the derivatives :math:`\varphi_m` of the features along the law those by coefficients
        are :math:`\sum_m P_m \varphi_m`, where :math:`P_m = \sum_{k > m} A^{k - 1 - m} h^k / k!`.
        """
        if self.inside:
            return super().flow(mode, x, u, after, duration)
        h, slope = duration, slope_of(u, after, duration)
        if len(h) and np.ptp(h) <= LIMITS.rounding * h.max():
            of_ends, of_unknowns = self._by_columns(mode, float(h[0]))
            columns = np.concatenate([x, u, slope, np.ones((len(x), 1))], axis=1).T
            by_law = of_unknowns.reshape(-1, len(columns)) @ columns
            by_law = by_law.reshape(*of_unknowns.shape[:2], len(x))
            by_state = of_ends[:, : x.shape[1]].T[:, :, None]
            return (of_ends @ columns).T, by_state, by_law
        rates, values = [x], []
        for of_inputs in (u, slope, *[np.zeros_like(u)] * (self.order - 2)):
            values.append(self.powers @ np.concatenate([rates[-1], of_inputs], axis=1).T)
            if not len(values) > 1:
                values[0][self._constant] = 1.0
            rates.append((self.coef[mode] @ values[-1]).T)
        matrix, changes = self._parts[0][mode], self._changes(mode, h).swapaxes(1, 2)
        by_state = np.eye(len(matrix))[:, :, None] + np.einsum("sar,sb->bar", changes[0], matrix)
        ends = _taylor(x, rates[1:], duration[:, None])
        return ends, by_state, self._by_unknowns(mode, [], np.array(values), changes)

    def _changes(self, mode: int, h: Array) -> Array:
        """P_m of steps (n_steps,), (order, n_states, n_states, n_steps)."""
        matrix = self._parts[0][mode]
        shares = [h**k / factorial(k) for k in range(1, self.order + 1)]
        changes = np.zeros((self.order, *matrix.shape, len(h)))
        for m in range(self.order):
            power = np.eye(len(matrix))
            for share in shares[m:]:
                changes[m] += power[:, :, None] * share
                power = matrix @ power
        return changes

    def _by_columns(self, mode: int, h: float) -> tuple[Array, Array]:
        """What ends of steps, and their derivatives by the unknowns, are by x, u, s and 1.

        (n_states, n_columns) and (n_unknowns, n_states, n_columns).
        """
        n_states, n_inputs = len(self.spread), self.powers.shape[1] - len(self.spread)
        no_slopes = np.zeros((len(self.powers), n_inputs))
        features = np.column_stack([self.powers, no_slopes, self._constant])
        moves = np.zeros((features.shape[1], features.shape[1]))
        moves[:n_states] = self.coef[mode] @ features
        moves[n_states : n_states + n_inputs, n_states + n_inputs : -1] = np.eye(n_inputs)
        changes = self._changes(mode, np.array([h]))[..., 0]
        by_law = np.zeros((n_states, *features.shape, n_states))
        ends, latest = np.eye(n_states, features.shape[1]), features
        for k, change in enumerate(changes, 1):
            ends = ends + h**k / factorial(k) * (self.coef[mode] @ latest)
            by_law += change.T[:, None, None, :] * latest[None, :, :, None]
            latest = latest @ moves
        return ends, np.ascontiguousarray(by_law[self.free[mode]].swapaxes(1, 2))

    def _derivatives(self, modes: Modes, x: Array, u: Array, slope: Array) -> list[Array]:
        """Of the state along its law, as many as the order."""
        of_states, of_inputs = self._parts[0][modes], self._parts[1][modes]
        rates = [self.velocities(modes, x, u)]
        rates.append(_times(of_states, rates[0]) + _times(of_inputs, slope))
        while len(rates) < self.order:
            rates.append(_times(of_states, rates[-1]))
        return rates

    def _add_features(self, rates: Array, modes: Modes, columns: Array, constant: bool) -> None:
        """What the free coefficients add to rates of sensitivities; constants have none."""
        mode, state, feature = self.places
        if not len(mode):
            return
        features = columns @ self.powers.T
        if constant:
            features[:, self._constant] = 1.0
        unknowns = rates.shape[1] + np.arange(len(mode))
        rates[:, state, unknowns] += features[:, feature] * (modes[:, None] == mode)


def _times(matrices: Array, vectors: Array) -> Array:
    return np.matmul(matrices, vectors[:, :, None])[:, :, 0]


def _taylor(value: Array, derivatives: list[Array], h: Array) -> Array:
    """The value after h; its derivatives are in rising order."""
    change = np.zeros_like(value)
    for order in range(len(derivatives), 0, -1):
        change = (derivatives[order - 1] + change) * (h / order)
    return value + change
