r"""Laws of all modes with their derivatives, stepped for many rows at once.

With the sensitivity :math:`Z = \partial x / \partial \theta` of a state to any unknowns,

.. math:: \dot x = C_j \Phi(x, u), \qquad
          \dot Z = C_j \frac{\partial \Phi}{\partial x} Z
          + \frac{\partial C_j}{\partial \theta} \Phi

are integrated together by the classical method of Runge and Kutta.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._known.program import Steps
from swsysid._known.region import Region
from swsysid._results import Array
from swsysid._stays.settings import LIMITS

_RIDGE = 1e-9  # of the metric of coefficients: what features do not tell moves least

Modes = NDArray[np.intp]
Features = Callable[[Array], Array]  # rows (states, inputs) -> (n_rows, n_features)


class Shape(NamedTuple):
    """What becomes of the rate of a state that its law says, and the slope of that."""

    state: int
    of_rate: Callable[..., tuple[Array, Array]]  # of rates, states and what follows
    arguments: tuple


class Bound(NamedTuple):
    """A level that a state does not pass, upwards (1) or downwards (-1), where it is held."""

    state: int
    side: int
    level: float


@dataclass(frozen=True)
class Laws:
    """Vector fields C_j Phi(x, u) of the modes, of which shapes may make something else."""

    coef: Array  # (n_modes, n_states, n_features)
    features: Features
    spread: Array  # (n_states,): typical size of each state
    free: NDArray[np.bool_]  # of the shape of coef: the coefficients that are unknown
    # derivatives of the features by unknowns inside them, which come after the coefficients
    inside: tuple[Features, ...] = field(default=(), kw_only=True)
    shapes: tuple[Shape, ...] = field(default=(), kw_only=True)
    bounds: tuple[Bound, ...] = field(default=(), kw_only=True)
    # of the shape of coef: terms that are left out where samples do not tell them from others
    untold: NDArray[np.bool_] | None = field(default=None, kw_only=True)
    region: Region | None = field(default=None, kw_only=True)  # of coefficients, as is known
    order: int = field(default=4, kw_only=True)  # of a step

    @cached_property
    def places(self) -> tuple[Modes, Modes, Modes]:
        """Mode, state and feature of every free coefficient."""
        mode, state, feature = np.nonzero(self.free)
        return mode, state, feature

    def known(self) -> Laws:
        """The same laws with no coefficient free."""
        return replace(self, free=np.zeros_like(self.free), inside=(), region=None)

    def taken(self, modes: Modes) -> Laws:
        """Those of some modes, in another order."""
        region = None if self.region is None else self.region.of_modes(len(modes))
        untold = None if self.untold is None else self.untold[modes]
        return replace(
            self, coef=self.coef[modes], free=self.free[modes], untold=untold, region=region
        )

    def moved(self, step: Array) -> Laws:
        """The laws after a step of their unknowns, those inside of features left as they are."""
        coef = self.coef.copy()
        coef[self.places] += step[: len(self.places[0])]
        return replace(self, coef=coef if self.region is None else coef.clip(*self.region.box))

    @property
    def steps(self) -> Steps | None:
        """The steps of their unknowns that are allowed by what is known; None for all."""
        return None if self.region is None else self.region.steps(self.coef, self.free)

    @property
    def freedom(self) -> int:
        """Number of unknowns that are not told by others."""
        steps = self.steps
        return self.n_free if steps is None else self.n_free - steps.rank

    @property
    def n_told(self) -> int:
        """Number of coefficients that say what the laws are, those included that are known.

        A mode of few samples would else cost nothing where most of its law is known.
        """
        given = 0 if self.region is None else int((self.region.fixed[0] & (self.coef != 0.0)).sum())
        return self.freedom + given

    @property
    def leaps(self) -> bool:
        """True if a step goes to its end at once, whatever surface is in between."""
        return False

    @property
    def modes(self) -> range:
        """Numbers of the modes."""
        return range(len(self.coef))

    @property
    def n_free(self) -> int:
        """Number of unknowns, free coefficients and those inside of features."""
        return len(self.places[0]) + len(self.inside)

    @property
    def sharper(self) -> Iterator[Laws]:
        """The same laws whose steps are ever more exact, where that costs less than finer ones."""
        return iter((self,))

    def error_of_steps(
        self, x: Array, u: Array, after: Array, duration: Array, ends: Array
    ) -> Array:
        """By how much steps miss two of half their length; shape of `x`.

        Each in the mode that comes nearest the end of the step: the law of another one may be
        anything there.
        """
        errors, misses, half, middle = [], [], 0.5 * duration, 0.5 * (u + after)
        for mode in self.modes:
            modes = np.full(len(x), mode, dtype=np.intp)
            halved = self.step(modes, x, u, middle, half)
            halved = self.step(modes, halved, middle, after, half)
            errors.append(np.abs(halved - self.step(modes, x, u, after, duration)))
            misses.append(np.square((halved - ends) / self.spread).sum(axis=1))
        nearest = np.nan_to_num(misses, nan=np.inf).argmin(axis=0)
        return np.array(errors)[nearest, np.arange(len(x))]

    def sides(self, old: Modes, new: Modes) -> tuple[Modes, Modes]:
        """Modes that the surface of each switch separates."""
        return old, new

    def velocities(self, modes: Modes, x: Array, u: Array, slope: Array | None = None) -> Array:
        """Velocity of every row, each in a given mode; `slope`, of the inputs, is not asked."""
        features = self.features(np.concatenate([x, u], axis=1))
        return self._shaped(np.matmul(self.coef[modes], features[:, :, None])[:, :, 0], x)[0]

    def _shaped(self, rates: Array, x: Array) -> tuple[Array, Array | None]:
        """What becomes of rates (n_rows, n_states) of the laws, and by how much it changes.

        None where they stay what they are.
        """
        if not self.shapes:
            return rates, None
        slopes = np.ones_like(rates)
        for state, of_rate, arguments in self.shapes:
            rates[:, state], slope = of_rate(rates[:, state], x[:, state], *arguments)
            slopes[:, state] *= slope
        return rates, slopes

    def _beyond(self, ends: Array) -> list[tuple[NDArray[np.bool_], Bound]]:
        """Which rows have passed each bound; there the step ends (catching up, Moreau 1977)."""
        return [(one.side * (ends[:, one.state] - one.level) > 0.0, one) for one in self.bounds]

    def step(self, modes: Modes, x: Array, u: Array, after: Array, duration: Array) -> Array:
        """States after steps with inputs that go from `u` to `after`."""
        h, middle, slope = duration[:, None], 0.5 * (u + after), slope_of(u, after, duration)
        first = self.velocities(modes, x, u, slope)
        second = self.velocities(modes, x + h / 2 * first, middle, slope)
        third = self.velocities(modes, x + h / 2 * second, middle, slope)
        fourth = self.velocities(modes, x + h * third, after, slope)
        ends = x + h / 6 * (first + 2 * (second + third) + fourth)
        for beyond, bound in self._beyond(ends):
            ends[beyond, bound.state] = bound.level
        return ends

    def varied_step(
        self, modes: Modes, x: Array, Z: Array, u: Array, after: Array, duration: Array
    ) -> tuple[Array, Array]:
        """The same with sensitivities (n_rows, n_states, n_unknowns).

        The first n_states unknowns are states at some start, the next are those of the laws, and
        any others may follow.
        """
        h, middle, slope = duration[:, None], 0.5 * (u + after), slope_of(u, after, duration)
        hz = h[:, :, None]
        first, z_first = self.varied_velocities(modes, x, Z, u, slope)
        second, z_second = self.varied_velocities(
            modes, x + h / 2 * first, Z + hz / 2 * z_first, middle, slope
        )
        third, z_third = self.varied_velocities(
            modes, x + h / 2 * second, Z + hz / 2 * z_second, middle, slope
        )
        fourth, z_fourth = self.varied_velocities(
            modes, x + h * third, Z + hz * z_third, after, slope
        )
        x = x + h / 6 * (first + 2 * (second + third) + fourth)
        return x, Z + hz / 6 * (z_first + 2 * (z_second + z_third) + z_fourth)

    def columns_of(self, mode: int) -> Modes:
        """Numbers of the unknowns that a mode has."""
        n_coef = len(self.places[0])
        inside = n_coef + np.arange(len(self.inside))
        return np.append(np.flatnonzero(self.places[0] == mode), inside)

    def flow(
        self, mode: int, x: Array, u: Array, after: Array, duration: Array
    ) -> tuple[Array, Array, Array]:
        r"""States of rows of one mode after steps, and their derivatives, rows last.

        By the states before, (n_states, n_states, n_rows), or (..., 1) where they are the same for
        all rows, and by the unknowns of `columns_of` the mode, (n_columns, n_states, n_rows), each
        entry by the first index of the second one. With the features :math:`\Phi_i` of the four
        stages of a step and what a velocity added there changes, :math:`M_i`, those by coefficients
        are :math:`\sum_i M_i \Phi_i`.
        """
        h, middle = duration, 0.5 * (u + after)
        stages, values, jacobians, slopes = [], [], [], []
        rates: list[Array] = []
        for ahead, at in ((0.0, u), (0.5, middle), (0.5, middle), (1.0, after)):
            now = x + (ahead * h)[:, None] * rates[-1] if rates else x
            stages.append(np.concatenate([now, at], axis=1))
            value, jacobian = self.linear(mode, stages[-1])
            rate, slope = self._shaped((self.coef[mode] @ value).T, now)
            if slope is not None:
                slopes.append(slope.T)
                jacobian = jacobian * slope.T
            rates.append(rate)
            values.append(value)
            jacobians.append(jacobian)
        ends = x + (h / 6.0)[:, None] * (rates[0] + 2.0 * (rates[1] + rates[2]) + rates[3])
        # from the last stage backwards
        every, changes = np.arange(x.shape[1]), np.zeros((4, x.shape[1], x.shape[1], len(x)))
        changes[3, every, every] = h / 6.0
        for stage, ahead, weight in ((2, 1.0, 2.0), (1, 0.5, 2.0), (0, 0.5, 1.0)):
            changes[stage] = chained(ahead * h * jacobians[stage + 1], changes[stage + 1])
            changes[stage, every, every] += weight / 6.0 * h
        by_state = np.einsum("ibcr,icar->bar", np.array(jacobians), changes)
        by_state[every, every] += 1.0
        if slopes:
            changes = changes * np.array(slopes)[:, :, None]
        by_law = self._by_unknowns(mode, stages, np.array(values), changes)
        for beyond, bound in self._beyond(ends):
            ends[beyond, bound.state] = bound.level
            by_state[:, bound.state, beyond] = by_law[:, bound.state, beyond] = 0.0
        return ends, by_state, by_law

    def _by_unknowns(self, mode: int, stages: list[Array], values: Array, changes: Array) -> Array:
        """What unknowns change, with features of stages and what velocities added there change."""
        own = self.free[mode]
        if changes.shape[3] == 1:
            by_law = np.matmul(changes[..., 0].reshape(len(changes), -1).T, values.swapaxes(0, 1))
            by_law = by_law.reshape(-1, *changes.shape[1:3], values.shape[2]).swapaxes(0, 1)[own]
        else:
            by_law = np.einsum("isar,ifr->sfar", changes, values, order="C")[own]
        if not self.inside:
            return by_law
        rates = [[self.coef[mode] @ one(stage).T for stage in stages] for one in self.inside]
        return np.concatenate([by_law, np.einsum("isar,pisr->par", changes, np.array(rates))])

    def linear(self, mode: int, columns: Array) -> tuple[Array, Array]:
        """Features of rows (n_features, n_rows), and derivatives of velocities by states.

        The latter are (n_states, n_states, n_rows), each entry by the first index of the second.
        """
        values, slopes = slopes_of(self.features, columns, self.spread)
        return values.T, np.matmul(self.coef[mode], slopes.transpose(2, 1, 0))

    def varied_velocities(
        self, modes: Modes, x: Array, Z: Array, u: Array, slope: Array
    ) -> tuple[Array, Array]:
        """Velocities and the rates of the sensitivities."""
        columns = np.concatenate([x, u], axis=1)
        features, slopes = slopes_of(self.features, columns, self.spread)
        coef = self.coef[modes]
        rates = np.matmul(np.matmul(coef, slopes), Z)
        mode, state, feature = self.places
        unknowns = x.shape[1] + np.arange(len(mode))
        rates[:, state, unknowns] += features[:, feature] * (modes[:, None] == mode)
        for number, one in enumerate(self.inside, x.shape[1] + len(mode)):
            rates[:, :, number] += np.matmul(coef, one(columns)[:, :, None])[:, :, 0]
        return np.matmul(coef, features[:, :, None])[:, :, 0], rates


@dataclass(frozen=True)
class Maps(Laws):
    """Laws in discrete time, C_j Phi(x, u) the next state: a step is one turn, however long."""

    @property
    def leaps(self) -> bool:
        return True

    def step(self, modes: Modes, x: Array, u: Array, after: Array, duration: Array) -> Array:
        return np.where(duration[:, None] > 0.0, self.velocities(modes, x, u), x)

    def flow(
        self, mode: int, x: Array, u: Array, after: Array, duration: Array
    ) -> tuple[Array, Array, Array]:
        columns = np.concatenate([x, u], axis=1)
        value, by_state = self.linear(mode, columns)
        changes = np.tile(np.eye(x.shape[1])[None, :, :, None], (1, 1, 1, len(x)))
        by_unknowns = self._by_unknowns(mode, [columns], value[None], changes)
        return (self.coef[mode] @ value).T, by_state, by_unknowns


def chained(by: Array, further: Array) -> Array:
    """Derivatives (n_unknowns, n, n_rows) of what changes by (m, n, n_rows) with others."""
    return np.einsum("kbr,bar->kar", by, further)


def slope_of(u: Array, after: Array, duration: Array) -> Array:
    """Rates of the inputs in steps; zero in steps that last no time."""
    lasting = duration[:, None] > 0.0
    return np.divide(after - u, duration[:, None], out=np.zeros_like(u), where=lasting)


def slopes_of(features: Features, columns: Array, spread: Array) -> tuple[Array, Array]:
    """Features of rows, and their derivatives (n_rows, n_features, n_varied).

    Varied are the first columns, as many as `spread` has entries.
    """
    n_varied = len(spread)
    moves = np.zeros((n_varied, columns.shape[1]))
    moves[np.arange(n_varied), np.arange(n_varied)] = LIMITS.difference * spread
    values = features(np.concatenate([columns, *(columns + move for move in moves)]))
    values = values.reshape(n_varied + 1, len(columns), values.shape[1])
    slopes = (values[1:] - values[0]) / (LIMITS.difference * spread)[:, None, None]
    return values[0], slopes.transpose(1, 2, 0)


def placed(laws: Laws, columns: Array) -> Laws:
    """The laws whose velocities at rows are nearest to given ones, of those that are allowed."""
    if laws.region is None:
        return laws
    features = laws.features(columns)
    mode, state, feature = laws.places
    gram = features.T @ features / len(features)
    gram += _RIDGE * np.diag(np.where(np.diag(gram) > 0.0, np.diag(gram), 1.0))
    alike = (mode[:, None] == mode) & (state[:, None] == state)
    metric = np.where(alike, gram[np.ix_(feature, feature)], 0.0) / np.square(laws.spread[state])
    return replace(laws, coef=laws.region.nearest(laws.coef, laws.free, metric))
