r"""Slides along a surface, as modes of their own.

Where the laws of two modes both point at the surface :math:`f = 0` between them, a recording can
only go along it (Filippov). With the rates :math:`r = \nabla f \cdot (f_\bullet, \dot u)` of f in
the two modes its velocity is

.. math:: \dot x = (1 - \lambda) f_i + \lambda f_j, \qquad \lambda = \frac{r_i}{r_i - r_j},

in which f stays what it is. The slide of modes i and j is there while :math:`\lambda` is between 0
and 1; beyond, one of the two laws goes on alone. Slides are numbered after the modes, by their
pairs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws, Modes, slopes_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS


def pairs_of(n_modes: int) -> NDArray[np.intp]:
    """Modes of every slide, (n_slides, 2)."""
    return np.array(list(combinations(range(n_modes), 2)), dtype=np.intp).reshape(-1, 2)


def with_slides(names: NDArray[np.intp]) -> NDArray[np.intp]:
    """New names of modes, and after them those of their slides."""
    n_modes = len(names)
    numbers = np.zeros((n_modes, n_modes), dtype=np.intp)
    first, second = pairs_of(n_modes).T
    numbers[first, second] = numbers[second, first] = n_modes + np.arange(len(first))
    return np.concatenate([names, numbers[names[first], names[second]]])


class Slide(NamedTuple):
    """Rows that slide, or would."""

    share: Array  # (n_rows,): lambda of the second mode
    apart: Array  # (n_rows,): r_i - r_j
    surfaces: NDArray[np.intp]
    gradients: Array  # (n_rows, n_states + n_inputs): of the surface
    slopes: Array  # (n_rows, n_surface_features, n_states + n_inputs): of its features

    @property
    def held(self) -> Array:
        """The share between 0 and 1: beyond, one law goes on alone."""
        return np.clip(self.share, 0.0, 1.0)


@dataclass(frozen=True)
class SlidingLaws(Laws):
    """Laws of the modes and of the slides between them.

    The free coefficients of the surfaces are unknowns after those of the laws.
    """

    guards: Guards
    alone: Laws  # laws of modes that step as those of these do

    @classmethod
    def of(cls, laws: Laws, guards: Guards) -> SlidingLaws:
        """The laws, with the surfaces along which their modes slide."""
        own = laws.coef, laws.features, laws.spread, laws.free, guards, laws
        return cls(*own, inside=laws.inside, region=laws.region, order=laws.order)

    @cached_property
    def plain(self) -> Laws:
        """The laws of the modes alone."""
        return replace(
            self.alone, coef=self.coef, free=self.free, inside=self.inside, region=self.region
        )

    @property
    def modes(self) -> range:
        """Numbers of the modes and the slides."""
        return range(len(self.coef) + len(pairs_of(len(self.coef))))

    @property
    def n_free(self) -> int:
        """Number of unknowns of laws and surfaces."""
        return super().n_free + self.guards.n_free

    def known(self) -> SlidingLaws:
        """The same with no coefficient free."""
        guards = replace(self.guards, free=np.zeros_like(self.guards.free))
        return replace(self, free=np.zeros_like(self.free), inside=(), region=None, guards=guards)

    def sides(self, old: Modes, new: Modes) -> tuple[Modes, Modes]:
        """Modes that the surface of each switch separates; the same one where there is none.

        A slide begins on its surface, and on it also ends.
        """
        first, second = self._pairs(new)
        leaves, enters = old >= len(self.coef), new >= len(self.coef)
        return np.where(leaves, 0, np.where(enters, first, old)), np.where(leaves, 0, second)

    def velocities(self, modes: Modes, x: Array, u: Array, slope: Array | None = None) -> Array:
        """Velocity of every row; `slope` is that of the inputs."""
        first, second = self._pairs(modes)
        velocities = super().velocities(first, x, u)
        if (rows := self._sliding(modes)).size:
            assert slope is not None
            other = super().velocities(second[rows], x[rows], u[rows])
            own = self.slide(modes[rows], velocities[rows], other, x[rows], u[rows], slope[rows])
            velocities[rows] += own.held[:, None] * (other - velocities[rows])
        return velocities

    def larger(self, modes: Modes, x: Array, u: Array, slope: Array) -> Modes:
        """The mode with the larger share in rows that slide."""
        first, second = self._pairs(modes)
        both = [super(SlidingLaws, self).velocities(one, x, u) for one in (first, second)]
        share = self.slide(modes, both[0], both[1], x, u, slope).share
        return np.where(share > 0.5, second, first)

    def off(self, modes: Modes, x: Array, u: Array) -> tuple[Array, Array]:
        """Values of the surfaces of rows that slide, and their derivatives by the states."""
        surfaces = self._surfaces(modes)
        coef = self.guards.coef[surfaces]
        basis, slopes = slopes_of(
            self.guards.features, np.hstack([x, u]), self.guards.spread[: x.shape[1]]
        )
        return np.einsum("kf,kf->k", coef, basis), np.einsum("kf,kfc->kc", coef, slopes)

    def slide(
        self, modes: Modes, first: Array, second: Array, x: Array, u: Array, slope: Array
    ) -> Slide:
        """What slides of some rows are, with the velocities of their two modes."""
        surfaces = self._surfaces(modes)
        slopes = slopes_of(self.guards.features, np.hstack([x, u]), self.guards.spread)[1]
        gradients = np.einsum("kf,kfc->kc", self.guards.coef[surfaces], slopes)
        n_states = x.shape[1]
        of_inputs = np.einsum("kc,kc->k", gradients[:, n_states:], slope)
        rates = [
            np.einsum("kc,kc->k", gradients[:, :n_states], one) + of_inputs
            for one in (first, second)
        ]
        apart = rates[0] - rates[1]
        share = np.divide(rates[0], apart, out=np.zeros(len(apart)), where=apart != 0.0)
        return Slide(share, apart, surfaces, gradients, slopes)

    def step(self, modes: Modes, x: Array, u: Array, after: Array, duration: Array) -> Array:
        """States after steps with inputs that go from `u` to `after`."""
        first, _ = self._pairs(modes)
        ends, rows = self.plain.step(first, x, u, after, duration), self._sliding(modes)
        own = x[rows]
        for part in self._in_parts(u[rows], after[rows], duration[rows]):
            own = super().step(modes[rows], own, *part)
        ends[rows] = own
        return ends

    def varied_step(
        self, modes: Modes, x: Array, Z: Array, u: Array, after: Array, duration: Array
    ) -> tuple[Array, Array]:
        """The same with sensitivities (n_rows, n_states, n_unknowns)."""
        first, _ = self._pairs(modes)
        ends, rows = self.plain.varied_step(first, x, Z, u, after, duration), self._sliding(modes)
        own = x[rows], Z[rows]
        for part in self._in_parts(u[rows], after[rows], duration[rows]):
            own = super().varied_step(modes[rows], *own, *part)
        for end, one in zip(ends, own, strict=True):
            end[rows] = one
        return ends

    def _sliding(self, modes: Modes) -> Modes:
        return np.flatnonzero(modes >= len(self.coef))

    def _in_parts(
        self, u: Array, after: Array, duration: Array
    ) -> Iterator[tuple[Array, Array, Array]]:
        """Parts of steps, so many that a slide is followed as exactly as the modes are."""
        n_parts = self.order // 2 - 1 if len(u) else 0
        for k in range(n_parts):
            begin, end = (u + share / n_parts * (after - u) for share in (k, k + 1))
            yield begin, end, duration / n_parts

    def varied_velocities(
        self, modes: Modes, x: Array, Z: Array, u: Array, slope: Array
    ) -> tuple[Array, Array]:
        """Velocities and the rates of the sensitivities.

        What would change f is taken back along the difference of the two laws. How the gradient of
        a curved surface changes from place to place is left out.
        """
        first, second = self._pairs(modes)
        velocities, rates = super().varied_velocities(first, x, Z, u, slope)
        rows = self._sliding(modes)
        if not rows.size:
            return velocities, rates
        x, Z, u, slope = x[rows], Z[rows], u[rows], slope[rows]
        other, other_rates = super().varied_velocities(second[rows], x, Z, u, slope)
        own = self.slide(modes[rows], velocities[rows], other, x, u, slope)
        jump, share = other - velocities[rows], own.held
        velocities[rows] += share[:, None] * jump
        mixed = rates[rows] + share[:, None, None] * (other_rates - rates[rows])
        n_states = x.shape[1]
        off = np.einsum("kc,kcz->kz", own.gradients[:, :n_states], mixed)
        surface, feature = np.nonzero(self.guards.free)
        unknowns = n_states + super().n_free + np.arange(len(surface))
        moving = np.hstack([velocities[rows], slope])
        off[:, unknowns] += np.einsum("kfc,kc->kf", own.slopes[:, feature], moving) * (
            own.surfaces[:, None] == surface
        )
        inside = (own.share > 0.0) & (own.share < 1.0)
        back = np.divide(jump, own.apart[:, None], out=np.zeros_like(jump), where=inside[:, None])
        rates[rows] = mixed + back[:, :, None] * off[:, None, :]
        return velocities, rates

    def columns_of(self, mode: int) -> Modes:
        """Numbers of the free coefficients that a mode has; a slide has all of them."""
        return np.arange(self.n_free) if mode >= len(self.coef) else super().columns_of(mode)

    def flow(
        self, mode: int, x: Array, u: Array, after: Array, duration: Array
    ) -> tuple[Array, Array, Array]:
        """States of rows of one mode or slide after steps, and their derivatives, rows last."""
        if mode < len(self.coef):
            return self.plain.flow(mode, x, u, after, duration)
        n_states, modes = x.shape[1], np.full(len(x), mode, dtype=np.intp)
        Z = np.zeros((len(x), n_states, n_states + self.n_free))
        Z[:, np.arange(n_states), np.arange(n_states)] = 1.0
        x, Z = self.varied_step(modes, x, Z, u, after, duration)
        Z = Z.transpose(2, 1, 0)
        return x, Z[:n_states], Z[n_states:]

    def _pairs(self, modes: Modes) -> tuple[Modes, Modes]:
        """Both modes of every slide; a mode itself, twice."""
        n_modes = len(self.coef)
        every = np.repeat(np.arange(n_modes)[:, None], 2, axis=1)
        first, second = np.vstack([every, pairs_of(n_modes)]).T
        return first[modes], second[modes]

    def _surfaces(self, modes: Modes) -> NDArray[np.intp]:
        """Surface of every slide, the first one where none separates the two modes alone."""
        first, second = self._pairs(modes)
        book = self.guards.mode_book
        return (book[first] * book[second] < 0).argmax(axis=1)


def slides_there(
    laws: SlidingLaws, recordings: Recordings, noise: Array, beyond: float
) -> NDArray[np.bool_]:
    """Intervals in which a slide may be, (n_times - 1, n_recordings, n_slides).

    Both laws point at the surface, for shares up to `beyond` off the range from 0 to 1, and a rough
    state is on it as closely as noise and a switch between two samples allow.
    """
    columns = np.concatenate([recordings.guess, recordings.u], axis=2)
    middle = 0.5 * (columns[1:] + columns[:-1])
    steps = np.where(recordings.steps > 0.0, recordings.steps, np.inf)
    n_states, n_modes = len(laws.spread), len(laws.coef)
    flat = middle.reshape(-1, middle.shape[2])
    x, u = flat[:, :n_states], flat[:, n_states:]
    slope = (np.diff(recordings.u, axis=0) / steps[:, :, None]).reshape(u.shape)
    book, there = laws.guards.mode_book, []
    for number, (first, second) in enumerate(pairs_of(n_modes)):
        if (book[first] * book[second] < 0).sum() != 1:
            there.append(np.zeros(len(x), dtype=bool))
            continue
        modes = np.full(len(x), n_modes + number)
        value, gradient = laws.off(modes, x, u)
        blur = np.square(gradient * noise).sum(axis=1)
        # the likeliest state on the surface
        on = x - gradient * noise**2 * (value / np.maximum(blur, np.finfo(float).tiny))[:, None]
        in_first, in_second = (laws.velocities(np.full(len(x), k), on, u) for k in (first, second))
        own = laws.slide(modes, in_first, in_second, on, u, slope)
        toward = own.apart * book[second, own.surfaces]
        speeds = np.abs(np.einsum("kc,kc->k", gradient, in_first))
        attracts = toward > LIMITS.slowest_crossing * np.median(speeds)
        inside = np.abs(own.share - 0.5) < 0.5 + beyond
        reach = np.sqrt(blur) + recordings.interval * np.abs(own.apart)
        there.append(attracts & inside & (np.abs(value) < LIMITS.far_miss * reach))
    return np.stack(there, axis=1).reshape(*middle.shape[:2], -1)
