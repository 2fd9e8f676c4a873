r"""Surfaces that recordings cross at the instants of their switches.

The surface between two modes is zero where a recording goes from one to the other,
:math:`f(x(\tau)) = 0`. What is missing there is told as a time: :math:`f / \dot f` is how long the
recording would take to the surface, whatever the scale of f.

Where an input that is held steps, which says when, f jumps, and its zero is anywhere between the
values before and after. It is told as if the step took an interval: in the middle of it on average,
with the standard deviation of :math:`1 / \sqrt{12}` of an interval.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from scipy.stats import norm

from swsysid._results import Array
from swsysid._stays.laws import Features, Modes, slopes_of
from swsysid._stays.settings import LIMITS
from swsysid._surfaces.surface import Surface, is_linear

_NEVER = 1e-100  # a rate at which a surface that is nowhere is reached; its squares are numbers


class Crossings(NamedTuple):
    """Where recordings switch, one row for each switch; modes that its surface separates.

    Columns are states, inputs, the time since the old mode was entered (NaN where nobody knows),
    and the time.
    """

    old: Modes
    new: Modes
    told_by: Modes  # number of the transition whose guard tells it, -1 for none
    columns: Array  # (n_switches, n_states + n_inputs + 2); of inputs that step, the middle
    rates: Array  # of the columns, in the old mode; where inputs step, their change by interval
    steps: NDArray[np.bool_]  # (n_switches,): where they do
    varied: Array | None  # of the states, (n_switches, n_states, n_unknowns)


class Sides(NamedTuple):
    """What samples say of surfaces: on which side of each they lie."""

    basis: Array  # (n_surfaces, n_rows, n_surface_features), in units of a time from the surface
    signs: NDArray[np.int64]  # (n_surfaces, n_rows): of the mode that a sample is in
    # (n_surfaces, n_rows): how far it must be, a unit where the surface stands still: one that is
    # zero at a value of an input that is held has no sides there
    margins: Array


class Misses(NamedTuple):
    """By how much crossings miss their surface, with derivatives; rows of the switches used."""

    switches: NDArray[np.intp]
    times: Array  # (n_used,): f / |df/dt|
    steps: NDArray[np.bool_]  # (n_used,): where inputs step
    by_columns: Array  # (n_used, n_states + n_inputs + 2)
    by_instants: Array  # (n_used,): -1 or 1, less where the crossing grazes, 0 where inputs step
    by_coef: Array  # (n_used, n_free): by the free coefficients

    @property
    def since(self) -> NDArray[np.intp]:
        """Switches since which a clock runs that tells one of these, the one after them."""
        return self.switches[self._timed] - 1

    @property
    def by_since(self) -> Array:
        """By the instants of these, (n_used, n_since): a later one shortens the stay."""
        timed = self._timed
        by_since = np.zeros((len(self.switches), len(timed)))
        by_since[timed, np.arange(len(timed))] = -self.by_columns[timed, -2]
        return by_since

    @property
    def _timed(self) -> NDArray[np.intp]:
        return np.flatnonzero(self.by_columns[:, -2])


@dataclass(frozen=True)
class Guards:
    """Surfaces f_l = coef_l . features between modes."""

    coef: Array  # (n_surfaces, n_surface_features)
    features: Features
    spread: Array  # (n_states + n_inputs,)
    mode_book: NDArray[np.int64]  # (n_modes, n_surfaces)
    free: NDArray[np.bool_]  # of the shape of coef
    sides: Sides | None = None

    @classmethod
    def of(cls, surface: Surface, spread: Array, n_modes: int) -> Guards | None:
        """The surfaces of a classifier; None if they are not linear in coefficients."""
        if not is_linear(surface):
            return None
        form = surface.linear_form(len(spread))
        if len(form.classes) != n_modes or not len(form.coef):
            return None
        guards = cls(form.coef, form.features, spread, form.mode_book, form.coef != 0.0)
        return guards.pivoted()

    def pivoted(self, at: Crossings | None = None) -> Self:
        """The same, one coefficient of each surface held: it fixes the scale.

        That which adds most to the rate at which the surface is crossed, and so is surely there;
        the largest where no crossing is known.
        """
        adds = np.abs(self.coef)
        if at is not None:
            surfaces, switches = self.crossed(at)
            _, slopes, rates = self._crossing(at, switches)
            of_crossings = np.zeros(self.coef.shape)
            each = np.abs(self.coef[surfaces] * np.einsum("kfc,kc->kf", slopes, rates))
            np.add.at(of_crossings, surfaces, each)
            adds = np.where(of_crossings.any(axis=1, keepdims=True), of_crossings, adds)
        free = (self.coef != 0.0) | self.free
        free[np.arange(len(free)), adds.argmax(axis=1)] = False
        return replace(self, free=free)

    def crossed(self, at: Crossings) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Surfaces that are crossed, and at which switches: where one alone separates the modes."""
        apart = self.mode_book[at.old] * self.mode_book[at.new] < 0
        used = np.flatnonzero(apart.sum(axis=1) == 1)
        return apart[used].argmax(axis=1), used

    def usual_speeds(self, at: Crossings) -> Array:
        """Median of the rates at which each surface is crossed; infinite where it is not."""
        surfaces, switches = self.crossed(at)
        _, slopes, moving = self._crossing(at, switches)
        rates = np.abs(np.einsum("kf,kfc,kc->k", self.coef[surfaces], slopes, moving))
        return self._medians(surfaces, rates)

    def _medians(self, surfaces: NDArray[np.intp], rates: Array) -> Array:
        medians = np.full(len(self.coef), np.inf)
        for surface in np.unique(surfaces):
            medians[surface] = np.median(rates[surfaces == surface])
        return medians

    def _crossing(self, at: Crossings, switches: NDArray[np.intp]) -> tuple[Array, Array, Array]:
        """Features at some switches, their derivatives, and the rates of the columns they use."""
        n_columns = len(self.spread)
        columns = np.nan_to_num(at.columns[switches, :n_columns])
        return *slopes_of(self.features, columns, self.spread), at.rates[switches, :n_columns]

    def known(self) -> Self:
        """The same with no coefficient free."""
        return replace(self, free=np.zeros_like(self.free))

    @property
    def n_free(self) -> int:
        """Number of free coefficients."""
        return int(self.free.sum())

    def moved(self, step: Array) -> Self:
        """Surfaces with other free coefficients."""
        coef = self.coef.copy()
        coef[self.free] += step
        return replace(self, coef=coef)

    def with_sides(self, columns: Array, rates: Array, modes: Modes, unit: float) -> Guards:
        """The same, told the modes of samples; `unit` is a time that counts as one."""
        basis, slopes = slopes_of(self.features, columns, self.spread)
        speeds = np.abs(np.einsum("lf,kfc,kc->lk", self.coef, slopes, rates))
        moving = [own[_moves(own, own.max())] for own in speeds]
        usual = np.array([np.median(own) if own.size else 0.0 for own in moving])[:, None]
        margins = np.where(_moves(speeds, usual), 0.0, 1.0)
        speeds = _not_still(speeds, usual)
        speeds[speeds == 0.0] = np.inf  # a surface that is not there has no sides
        scaled = basis / (speeds * unit)[:, :, None]
        # samples that slide are on no side
        signs = np.zeros((len(modes), len(self.coef)), dtype=np.int64)
        beside = modes < len(self.mode_book)
        signs[beside] = self.mode_book[modes[beside]]
        return replace(self, sides=Sides(scaled, signs.T, np.where(signs.T == 0, 0.0, margins)))

    def wrong_sides(self) -> Array:
        """Times by which samples lie on the wrong side, (n_surfaces, n_rows), in the unit."""
        if self.sides is None:
            return np.zeros((len(self.coef), 0))
        values = np.matmul(self.sides.basis, self.coef[:, :, None])[:, :, 0]
        return np.maximum(0.0, self.sides.margins - self.sides.signs * values)

    def side_equations(self) -> tuple[Array, Array, float]:
        """Gauss and Newton's matrix of half the squares of these, negative gradient, value."""
        wrong, n = self.wrong_sides(), self.n_free
        matrix, right = np.zeros((n, n)), np.zeros(n)
        for surface, place in enumerate(self.own_places()):
            rows = np.flatnonzero(wrong[surface])
            if self.sides is None or not rows.size:
                continue
            varied = self.sides.basis[surface, rows][:, self.free[surface]]
            matrix[np.ix_(place, place)] = varied.T @ varied
            right[place] = varied.T @ (self.sides.signs[surface, rows] * wrong[surface, rows])
        return matrix, right, float(0.5 * np.square(wrong).sum())

    def misses(self, at: Crossings) -> Misses:
        """Times to the surface, for switches between modes that one surface separates."""
        surfaces, used = self.crossed(at)
        basis, slopes, moving = self._crossing(at, used)
        coef = self.coef[surfaces]
        values = np.einsum("kf,kf->k", coef, basis)
        gradients = np.einsum("kf,kfc->kc", coef, slopes)
        rates = np.einsum("kc,kc->k", gradients, moving)
        usual = self._medians(surfaces, np.abs(rates))[surfaces]
        size = np.maximum(_not_still(np.abs(rates), usual), _NEVER)
        by_columns = np.zeros((len(used), at.columns.shape[1]))
        by_columns[:, : gradients.shape[1]] = gradients / size[:, None]
        by_coef = np.zeros((len(used), *self.coef.shape))
        by_coef[np.arange(len(used)), surfaces] = basis / size[:, None]
        steps = at.steps[used]
        by_instants = np.where(steps, 0.0, rates / size)
        return Misses(used, values / size, steps, by_columns, by_instants, by_coef[:, self.free])

    def log_probabilities(
        self, columns: Array, rates: Array, covariance: Array | None, blurred: float
    ) -> Array:
        r"""Log probability of every mode at rows, (n_rows, n_modes).

        A surface is passed with the probability :math:`\Phi(f / \sigma)`: f is known as the
        coefficients are, and the state as if it were taken at a time `blurred` off.
        """
        basis, slopes = slopes_of(self.features, columns, self.spread)
        values = basis @ self.coef.T
        speeds = np.abs(np.einsum("lf,kfc,kc->kl", self.coef, slopes, rates))
        speeds = np.maximum(speeds, np.median(speeds, axis=0))
        variance = np.square(blurred * speeds)
        if covariance is not None:
            for surface, place in enumerate(self.own_places()):
                varied = basis[:, self.free[surface]]
                own = covariance[np.ix_(place, place)]
                variance[:, surface] += np.einsum("kf,fg,kg->k", varied, own, varied)
        scores = values / np.sqrt(np.maximum(variance, np.finfo(float).tiny))
        logs = norm.logcdf(scores[:, None, :] * self.mode_book)
        logs = np.where(self.mode_book == 0, 0.0, logs).sum(axis=2)
        return logs - logsumexp(logs, axis=1, keepdims=True)

    def own_places(self) -> list[NDArray[np.intp]]:
        """Places of the free coefficients of each surface among all of them."""
        counts = self.free.sum(axis=1)
        return np.split(np.arange(counts.sum()), np.cumsum(counts)[:-1])


def _moves(rates: Array, usual: Array) -> NDArray[np.bool_]:
    """False where a surface stands still, as one of inputs that are held between their steps."""
    return rates > LIMITS.difference * usual


def _not_still(rates: Array, usual: Array) -> Array:
    """Rates at which a surface is told, by the usual ones.

    Those far below, where a crossing grazes, count as a part of these; where it stands still, it
    counts as usual.
    """
    grazing = np.maximum(rates, LIMITS.slowest_crossing * usual)
    return np.where(_moves(rates, usual), grazing, usual)
