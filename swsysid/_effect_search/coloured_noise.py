r"""The likelihood of residuals that are noise and, beneath it, a force that is forgotten slowly.

The force d is a process of Ornstein and Uhlenbeck of size s and time constant T, and a residual is
:math:`y_i = d(t_i) + e_i` with white noise e of variance :math:`\sigma^2`. The precision Q of d at
the samples of a stretch is tridiagonal, so that with :math:`A = Q + I / \sigma^2`

.. math:: -2 \log p(y) = \log\det A - \log\det Q + n \log(2 \pi \sigma^2)
    + (y^\top y - y^\top A^{-1} y / \sigma^2) / \sigma^2

costs one banded factorisation (Rue and Held 2005, Gaussian Markov Random Fields), whatever the
times of the samples, and :math:`A^{-1} y / \sigma^2` is the smoothed course of the force.

What a sample has of it is what the samples before do not say of it, :math:`\log p(y_i | y_{<i})`:
these are independent, as parts of a sum that is compared with its scatter have to be. The factor
:math:`A = U^\top U` has them: with the future left out only the last pivot of the samples up to i
is another one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.linalg.lapack import dtbtrs
from scipy.optimize import minimize

from swsysid._data.records import Records
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.settings import SETTINGS
from swsysid._noise import robust_scale
from swsysid._results import Array

_SURE_SMEAR = 3.0  # standard errors of the correlation by which a filter is told
_N_GENERALISED = 12  # times at most that a law and the noise beneath it are fitted in turn
_FINE_SCALE = 0.01  # of sizes and times of a force, and nats: below every standard error
_SAME_LIKELIHOOD = 0.5  # nats: a gain by which neither of them changes


# First steps in the logarithms of a ratio and a time: by a factor of two.
_SIMPLEX = np.log(2.0) * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


@dataclass(frozen=True)
class Stretches:
    """Samples of one residual in order, cut into stretches that are taken as independent."""

    t: Array  # (n_samples,)
    stretch: NDArray[np.intp]  # (n_samples,), numbered from 0

    @classmethod
    def of(
        cls, records: Records, gap: float = np.inf, blocks: NDArray[np.intp] | None = None
    ) -> tuple[NDArray[np.intp], Stretches]:
        """The order of the samples of trajectories, and these: each trajectory is one stretch.

        It is cut where samples are farther apart than so many steps, and between blocks.
        """
        assert records.t is not None
        order = np.concatenate(records.trajectories)
        t, begins = records.t[order], np.zeros(len(order), dtype=bool)
        begins[np.cumsum([0, *map(len, records.trajectories[:-1])])] = True
        if np.isfinite(gap):
            begins |= np.diff(t, prepend=t[:1]) > gap * records.step
        if blocks is not None:
            begins |= np.diff(blocks[order], prepend=-1) != 0
        return order, cls(t, np.cumsum(begins) - 1)

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Whether a sample has its predecessor in the same stretch."""
        return np.diff(self.stretch, prepend=-1) == 0

    @cached_property
    def waits(self) -> Array:
        """Time from the sample before in the same stretch, infinite where there is none."""
        # The clock may begin anew with each trajectory.
        return np.where(self.inside, np.abs(np.diff(self.t, prepend=np.nan)), np.inf)

    @property
    def step(self) -> float:
        """Time from one sample to the next."""
        steps = np.diff(self.t)[self.inside[1:]]
        return float(np.median(steps)) if len(steps) else 0.0

    def smeared(self, y: Array) -> int:
        """Over about how many samples a filter has smeared a residual, one where none has.

        The increments of noise, and of a force that is forgotten slowly, are independent. Those of
        what a filter has smeared go on the same way at first, and then turn back, until they are
        about half of its window apart; to a factor of two.
        """
        count = np.count_nonzero(self.inside)
        if count < 3:
            return 1
        steps = np.where(self.inside, np.diff(y, prepend=y[:1]), 0.0)
        most = SETTINGS.gross * float(robust_scale(steps[self.inside][:, None])[0])
        steps = np.clip(steps, -most, most)  # a jump says nothing of its neighbours
        # those of a force that is forgotten in some ten samples turn back a little all along
        by_chance = _SURE_SMEAR / np.sqrt(count) * float(np.sum(steps**2))
        lag, clearest = 1, 0.0
        for sign in (1.0, -1.0):
            while (
                lag < len(steps) and (together := sign * np.sum(steps[lag:] * steps[:-lag])) > 0.0
            ):
                lag, clearest = lag + 1, max(clearest, together)
            if lag == 1:
                return 1
        if clearest <= by_chance:
            return 1
        return 2 * lag

    def runs(self, chosen: NDArray[np.bool_]) -> NDArray[np.intp]:
        """How many samples in a row are chosen, or not chosen, about each of them."""
        changes = ~self.inside | (np.diff(chosen, prepend=chosen[:1]) != 0)
        number = np.cumsum(changes) - 1
        return np.bincount(number)[number]

    def taken(self, chosen: NDArray[np.bool_]) -> Stretches:
        """Some of the samples, in the stretches that they are in."""
        return Stretches(self.t[chosen], self.stretch[chosen])

    def decimated(self, every: int) -> tuple[NDArray[np.intp], Stretches]:
        """An order of the samples in which each stretch is so many, of samples so far apart."""
        first = np.searchsorted(self.stretch, self.stretch)
        phase = (np.arange(len(self.t)) - first) % every
        part = every * self.stretch + phase
        order = np.argsort(part, kind="stable")
        return order, Stretches(self.t[order], part[order])


def in_trajectories(data: SearchData) -> Stretches:
    """The same rows, where one after a gap still remembers those before it in its trajectory."""
    return Stretches.of(data.records.take(data.rows))[1]


def rows_in_order(data: SearchData) -> tuple[NDArray[np.intp], Stretches]:
    """The rows of a search in order, in the blocks of its tests, cut where the record has gaps."""
    return Stretches.of(data.records.take(data.rows), SETTINGS.gap_steps, data.folds.blocks)


@dataclass(frozen=True)
class Coloured:
    """White noise, and beneath it a force that is forgotten slowly; none of size zero."""

    size: float
    time_constant: float
    noise: float

    def log_likelihood(self, y: Array, where: Stretches) -> Array:
        """That of each sample given those before it."""
        determinants, squares = self.parts(y, where)
        noise = self.noise**2
        return -0.5 * (np.log(2.0 * np.pi * noise) + determinants + squares / noise)

    def parts(self, y: Array, where: Stretches) -> tuple[Array, Array]:
        """The log of the variance of each sample given those before it, and its squared error.

        Each error is in units of that variance, and each variance in those of the noise. Their sums
        are log det C and y'C^-1 y, for the covariance C of all samples.
        """
        if self.size == 0.0:
            return np.zeros_like(y), y**2
        (coupling, pivots), precision, known = self._reduced(y, where)
        # the last pivot of the samples up to each one, which no later one has had a part in
        last = np.sqrt(precision + 1.0 - coupling**2)
        squares = (known * pivots / last) ** 2  # of what is known of the force at the last sample
        logs = 2.0 * np.log(last)
        # and what becomes of both at the next sample
        determinants = logs - np.log(precision)
        determinants[1:] += (2.0 * np.log(pivots) - logs)[:-1]
        left = y**2 - squares
        left[1:] += (squares - known**2)[:-1]
        return determinants, left

    def totals(self, y: Array, where: Stretches) -> tuple[float, float]:
        """Their sums alone, log det C and y'C^-1 y, which a search for the model asks for often."""
        if self.size == 0.0:
            return 0.0, float(y @ y)
        (_, pivots), precision, known = self._reduced(y, where)
        determinant = 2.0 * float(np.log(pivots).sum()) - float(np.log(precision).sum())
        return determinant, float(y @ y - known @ known)

    def precise(self, columns: Array, where: Stretches) -> Array:
        """The inverse of the covariance of all samples times some columns, shaped like these."""
        if self.size == 0.0:
            return columns / self.noise**2
        factor, _ = self._factor(where)
        return (columns - _solved(factor, columns)) / self.noise**2

    def course(self, y: Array, where: Stretches) -> tuple[Array, Array]:
        """The force at every sample and its standard deviation, from all samples (a smoother)."""
        if self.size == 0.0:
            return np.zeros_like(y), np.zeros_like(y)
        factor, _ = self._factor(where)
        mean = _solved(factor, y)
        # the diagonal of the inverse of U' U with a bidiagonal U, from its end
        variance, later = np.empty_like(y), 0.0
        for place in range(len(y) - 1, -1, -1):
            coupling = factor[0, place + 1] if place + 1 < len(y) else 0.0
            later = (1.0 + coupling**2 * later) / factor[1, place] ** 2
            variance[place] = later
        return mean, self.noise * np.sqrt(variance)

    def _reduced(self, y: Array, where: Stretches) -> tuple[Array, Array, Array]:
        """What `_factor` gives, and U'^-1 y for its factor U."""
        factor, precision = self._factor(where)
        known, _ = dtbtrs(factor, y, uplo="U", trans="T")
        return factor, precision, known

    def _factor(self, where: Stretches) -> tuple[Array, Array]:
        """Cholesky factor of A, upper banded, and the precision of each sample given the last.

        Both are in units of the noise.
        """
        kept = np.minimum(np.exp(-where.waits / self.time_constant), 1.0 - 1e-9)
        # precision of each sample given the last
        new = (self.noise / self.size) ** 2 / (1.0 - kept**2)
        diagonal = new + 1.0
        diagonal[:-1] += (kept**2 * new)[1:]
        banded = np.stack([-kept * new, diagonal])
        return cholesky_banded(banded, check_finite=False), new


def white(y: Array) -> Coloured:
    """Noise alone, of highest likelihood."""
    return Coloured(0.0, 1.0, max(float(np.sqrt(np.mean(y**2))), 1e-300))


def coloured(
    y: Array, where: Stretches, slowest: float = np.inf, near: Coloured | None = None
) -> Coloured:
    """The model of highest likelihood, of those whose force is forgotten within a time.

    The search for it begins at one that is `near`, or where neighbours and the whole record say.
    """
    inside = where.inside[1:]
    steps = np.diff(where.t)[inside]
    whole = white(y).noise
    if len(steps) < 3 or whole <= 1e-300:
        return white(y)
    scatter = float(robust_scale(np.diff(y)[inside][:, None])[0]) / np.sqrt(2.0)
    noise = min(max(scatter, 0.05 * whole), 0.95 * whole)
    step = where.step
    longest = min(float(np.sum(steps)), slowest)

    def bounded(logs: Array) -> tuple[Coloured, float]:
        # the noise of highest likelihood is known for each ratio of the force to it
        ratio, time = np.exp(np.clip(logs, -300.0, 300.0)).tolist()
        unit = Coloured(ratio, min(max(time, 0.5 * step), longest), 1.0)
        determinant, squares = unit.totals(y, where)
        variance = max(squares / len(y), (1e-4 * whole) ** 2)
        cost = 0.5 * (len(y) * float(np.log(variance)) + determinant + squares / variance)
        noise = float(np.sqrt(variance))
        return Coloured(ratio * noise, unit.time_constant, noise), cost

    ratio, times = np.sqrt(whole**2 - noise**2) / noise, (4.0 * step, 30.0 * step)
    starts = [np.log([ratio, min(time, 0.5 * longest)]) for time in times]
    if near is not None and near.size > 0.0:
        starts = [np.log([near.size / near.noise, near.time_constant])]
    enough = {"xatol": _FINE_SCALE, "fatol": _FINE_SCALE}
    found = [
        minimize(
            lambda logs: bounded(logs)[1],
            start,
            method="Nelder-Mead",
            options=enough | {"initial_simplex": start + _SIMPLEX},
        )
        for start in starts
    ]
    return bounded(min(found, key=lambda one: float(one.fun)).x)[0]


def beneath_a_law(features: Array, y: Array, where: Stretches) -> tuple[Coloured, Array]:
    """Noise and force of highest likelihood beneath a linear law of the features, and residuals.

    The states of the next samples remember the force, so that least squares gives their
    coefficients what it does, and anything that tells the force from the states, such as the input
    a while ago, seems to act. Generalised least squares does not.
    """
    coef = np.linalg.lstsq(features, y, rcond=None)[0]
    left, before, model = y - features @ coef, -np.inf, None
    for _ in range(_N_GENERALISED):
        model = coloured(left, where, near=model)
        likelihood = float(model.log_likelihood(left, where).sum())
        if likelihood < before + _SAME_LIKELIHOOD:
            break
        precise, before = model.precise(features, where), likelihood
        coef = np.linalg.lstsq(features.T @ precise, precise.T @ y, rcond=None)[0]
        left = y - features @ coef
    return coloured(left, where, near=model), left


def _solved(factor: Array, columns: Array) -> Array:
    """A's inverse times columns."""
    return np.asarray(cho_solve_banded((factor, False), columns, check_finite=False))
