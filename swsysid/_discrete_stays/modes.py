r"""Modes of rows by the filter of their states: for known laws and noise where it was measured.

A row by itself says little where noise is as large as what tells two laws apart. The filter knows
the states from all rows before, so that a mode shows in where the states go.

A transition is as likely as any, or where its guard says. At a row in mode i the guard of i -> j is
not below zero with probability

.. math:: P_{ij} = \Phi\Big( \frac{g_{ij}(c)}{\sqrt{\nabla g_{ij}^\top \Sigma\, \nabla g_{ij}
          + w_{ij}^2}} \Big)

where :math:`\Sigma` is the covariance of what is known of the states and :math:`w_{ij}` how well
the guard itself is known. One transition without a guard is as likely as a switch is at any row. A
mode is left by one of its transitions or by none; and guards are doubted a little, for a plant may
do what they do not say.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from swsysid._data.recordings import Record
from swsysid._discrete_stays.data import FARTHEST, DiscreteData
from swsysid._discrete_stays.lagged import KnownGuard, Labels
from swsysid._discrete_stays.rows import (
    UNEXPLAINED,
    RowFit,
    as_fit,
    assigned,
    row_costs,
    scale_of,
    switching_of,
)
from swsysid._discrete_stays.states import StateFit, StateProblem
from swsysid._results import Array
from swsysid._stays.decoding import decode
from swsysid._stays.filtering import Belief
from swsysid._stays.laws import Laws, Modes, slopes_of
from swsysid._stays.recordings import Recordings

# Rows to both sides of a piece in which a hypothesis settles, as many as tell two laws apart, the
# rows of the piece in units of these, and its hypotheses, one for so many of them: a switch is told
# as closely. Of a published cell whose rates differ by a fiftieth of the noise 99.0 % of the
# samples have their mode with 15 rows and 4 hypotheses, 99.6 % with 150 and 4, 99.7 % with 24.
_OVERLAP, _IN_OVERLAPS, _ROWS_OF_ONE, _FEWEST_KEPT = (15, 150), 4, 12, 4
_DOUBT = 0.01  # probability that a row does what no guard says


def reassigned(data: DiscreteData, fit: RowFit, found: StateFit) -> tuple[RowFit, float]:
    """The modes of all rows for laws and noise of highest likelihood, and that in nats."""
    problem, likelihood = data.problem, 0.0
    unexplained = _unexplained(data, fit, found)
    scale = scale_of(problem, found.coef, np.where(unexplained, -1, fit.modes))
    modes = assigned(problem, found.coef, scale, fit.switching).modes
    if len(found.coef) > 1 and not unexplained.all():
        inside = ~unexplained
        begins = inside & (data.rows.begins | np.append(True, unexplained[:-1]))
        ends = inside & np.append((data.rows.begins | unexplained)[1:], True)
        first = np.flatnonzero(begins)
        recordings = _stretches(data, first, np.flatnonzero(ends) + 1)
        overlap = _rows_that_tell(data, fit, found)
        side_by_side, pieces = recordings.cut(_IN_OVERLAPS * overlap, overlap)
        # the first row of a piece tells all lagged states, the others the newest
        side_by_side.y[1:, :, data.rows.n_states :] = np.nan
        maps = MapFilter.of(data, found, fit.switching, fit.guards, side_by_side.u)
        n_kept = max(_FEWEST_KEPT, overlap // _ROWS_OF_ONE)
        decoded = decode(maps, side_by_side, price=0.0, n_kept=n_kept)
        likelihood = float(decoded.log_likelihood.sum())
        found_modes = recordings.of_pieces(decoded.modes, pieces)
        modes[inside] = found_modes.T[recordings.steps.T > 0.0]
    switching = switching_of(np.where(unexplained, -1, modes), problem)
    costs = row_costs(problem, found.coef, scale)
    again = replace(
        as_fit(problem, found.coef, scale, switching, modes, costs),
        unexplained=unexplained,
        history=fit.history,
        guards=fit.guards,
    )
    if fit.guards:
        again = replace(again, of_switches=_of_switches(data, again, found))
    return again, likelihood


def _rows_that_tell(data: DiscreteData, fit: RowFit, found: StateFit) -> int:
    r"""Rows after which no two laws are as likely as each other but for a switch.

    Laws that are :math:`\delta` deviations of the noise apart at each row are
    :math:`\delta^2 n^3 / 24` nats apart after n of them, where they begin is not known.
    """
    features, nats = data.problem.features, -np.log(fit.switching)
    told, least = found.coef / found.noise[:, None], np.inf
    for i, j in combinations(range(len(told)), 2):
        own = features[np.isin(fit.lawful, (i, j))]
        if len(own):
            least = min(least, np.square(own @ (told[i] - told[j]).T).sum(axis=1).mean())
    rows = np.cbrt(24.0 * nats / max(least, np.finfo(float).tiny))
    return int(np.clip(np.ceil(rows), *_OVERLAP))


def decoded_anew(data: DiscreteData, found: StateFit, scale: Array, like: RowFit) -> RowFit:
    """The modes of rows of which no states are known yet, by laws and noises of others.

    `scale` is what the laws leave of rows; switches are as likely, and guards those, of a fit.
    """
    every = StateProblem(
        data, np.zeros(len(data.rows), dtype=np.intp), found.coef[:, 0] != 0.0, found.noise,
        found.tie,
    )  # fmt: skip
    nothing = np.zeros((len(data.rows), data.rows.n_states))
    measured = replace(found, states=every.y, back=every.back, left=nothing)
    fit = assigned(data.problem, found.coef, scale, like.switching)
    fit = replace(fit, unexplained=np.ones(len(data.rows), dtype=bool), guards=like.guards)
    return reassigned(data, fit, measured)[0]


def _of_switches(data: DiscreteData, fit: RowFit, found: StateFit) -> float:
    """Nats that modes take where guards tell them, states no better known than measured."""
    told = ~fit.unexplained
    rows = np.flatnonzero(told & np.append(False, told[:-1]) & ~data.rows.begins)
    mean = found.states[found.back[rows, 1:]].reshape(len(rows), -1)
    variance = np.tile(np.square(found.noise), data.rows.lags + 1)
    covariance = np.tile(np.diag(variance), (len(rows), 1, 1))
    switching = Switching.of(data, len(found.coef), fit.switching, fit.guards)
    modes, u = fit.modes, data.columns[rows, data.n_lagged :]
    return float(-switching.nats(modes[rows - 1], modes[rows], mean, covariance, u).sum())


def _unexplained(data: DiscreteData, fit: RowFit, found: StateFit) -> NDArray[np.bool_]:
    """Rows between states that are no disturbance apart, or, so far unexplained, no noise."""
    allowed = found.tie * found.noise
    nats = (0.5 * np.square(found.left / allowed) + np.log(allowed)).sum(axis=1)
    rows, n_lagged = np.flatnonzero(fit.unexplained), data.n_lagged
    before = found.states[found.back[rows, 1:]].reshape(len(rows), n_lagged)
    features = data.features(np.hstack([before, data.columns[rows, n_lagged:]]))
    left = found.states[found.back[rows, 0]] - features @ found.coef.transpose(0, 2, 1)
    by_noise = 0.5 * np.square(left / fit.scale[:, None]) + np.log(fit.scale)[:, None]
    nats[rows] = by_noise.sum(axis=2).min(axis=0)
    return np.asarray(nats > -np.log(UNEXPLAINED))


def _stretches(data: DiscreteData, first: Labels, end: Labels) -> Recordings:
    """Lagged states of stretches of rows as recordings, and what follows the last row."""
    n, n_lagged, records = data.rows.n_states, data.n_lagged, []
    targets = data.rows.targets / data.target_unit
    for rows in map(slice, first, end):
        states, u = data.columns[rows, :n_lagged], data.columns[rows, n_lagged:]
        after = np.concatenate([targets[rows][-1], states[-1, : n_lagged - n]])
        t = np.arange(len(states) + 1.0)
        records.append(Record(t, np.vstack([states, after]), np.vstack([u, u[-1:]])))
    return Recordings.of(records)


@dataclass(frozen=True)
class MapFilter:
    """Kalman's filter of the lagged states of maps; a switch is at a sample."""

    laws: Laws
    noise: Array  # (n_lagged,)
    disturbance: Array  # (n_lagged,)
    u: Array  # (n_rows, n_pieces, n_inputs)
    switching: Switching
    farthest: float  # a state that is further off says nothing

    @classmethod
    def of(
        cls,
        data: DiscreteData,
        found: StateFit,
        probability: float,
        guards: tuple[KnownGuard, ...],
        u: Array,
    ) -> MapFilter:
        """The filter of identified laws, states in units of the data."""
        n, memory = data.rows.n_states, data.rows.lags + 1
        laws = Laws(found.coef, data.features, np.ones(n * memory), np.zeros_like(found.coef) > 0)
        disturbance = np.zeros(n * memory)
        farthest = FARTHEST * float(np.abs(found.states).max())
        disturbance[:n] = found.tie * found.noise
        switching = Switching.of(data, len(found.coef), probability, guards)
        return cls(laws, np.tile(found.noise, memory), disturbance, u, switching, farthest)

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.laws.coef)

    @property
    def spread(self) -> Array:
        """Typical size of each lagged state, in units of the data."""
        return self.laws.spread

    def ahead(self, k: int, belief: Belief, modes: Modes) -> tuple[Belief, Array]:
        """As `swsysid._stays.filtering.Filter.ahead`, every hypothesis by the law of each mode."""
        shape, n_columns = (*modes.shape, self.n_modes), len(belief.mean)
        x = belief.mean.reshape(n_columns, -1).T
        wide = belief.covariance.reshape(n_columns, n_columns, -1).transpose(2, 0, 1)
        u = np.repeat(self.u[k], modes.shape[1], axis=0)
        features, slopes = slopes_of(self.laws.features, np.hstack([x, u]), self.spread)
        n, older = self.laws.coef.shape[1], np.arange(self.laws.coef.shape[1], n_columns)
        transition = np.zeros((len(x), self.n_modes, n_columns, n_columns))
        transition[:, :, :n] = np.matmul(self.laws.coef, slopes[:, None])
        transition[:, :, older, older - n] = 1.0
        mean = np.empty((len(x), self.n_modes, n_columns))
        mean[:, :, :n] = np.einsum("jnf,rf->rjn", self.laws.coef, features)
        mean[:, :, n:] = x[:, None, : n_columns - n]
        lost = ~(np.abs(mean) < self.farthest).all(axis=2)
        mean[lost], transition[lost] = 0.0, np.eye(n_columns) * self.farthest / self.noise
        covariance = transition @ wide[:, None] @ transition.transpose(0, 1, 3, 2)
        told, known = self.switching.told(modes.ravel(), x, wide, u)
        mean += np.matmul(transition, told[..., None])[..., 0]
        known = np.matmul(transition, known[..., None])
        covariance -= known * known.transpose(0, 1, 3, 2)
        every = np.arange(n_columns)
        covariance[:, :, every, every] += self.disturbance**2
        old, new = np.repeat(modes.ravel(), self.n_modes), np.tile(np.arange(self.n_modes), len(x))
        parts = (np.repeat(part, self.n_modes, axis=0) for part in (x, wide, u))
        nats = self.switching.nats(old, new, *parts).reshape(shape)
        ahead = Belief(
            mean.transpose(2, 0, 1).reshape(n_columns, *shape),
            covariance.transpose(2, 3, 0, 1).reshape(n_columns, n_columns, *shape),
        )
        return ahead, nats


@dataclass(frozen=True)
class Switching:
    """Log probabilities of going on in a mode or entering another one."""

    n_modes: int
    probability: float  # of a switch at any row
    guards: tuple[KnownGuard, ...]
    unit: Array  # of the columns
    doubt: float  # probability that a row does what no guard says

    @classmethod
    def of(
        cls, data: DiscreteData, n_modes: int, probability: float, guards: tuple[KnownGuard, ...]
    ) -> Switching:
        """Those of some guards, for columns in the units of the data."""
        told = tuple(one for one in guards if not one.reads_clocks)
        return cls(n_modes, probability, told, data.column_unit, _DOUBT)

    def nats(self, old: Modes, new: Modes, mean: Array, covariance: Array, u: Array) -> Array:
        """Of rows with known lagged states, each from one mode to another or the same."""
        rows = np.arange(len(old))
        often = np.full((len(old), self.n_modes), self.probability / max(1, self.n_modes - 1))
        often[rows, old] = 1.0 - self.probability
        if not self.guards:
            return np.asarray(np.log(often[rows, new]))
        leaves = often.copy()
        values = self._risen(mean, covariance, u)[:2]
        for one, value, spread in zip(self.guards, *values, strict=True):
            own = old == one.source
            leaves[own, one.target] = norm.cdf(value[own] / spread[own])
        leaves[rows, old] = 0.0
        leaves[rows, old] = np.prod(1.0 - leaves, axis=1)
        leaves /= leaves.sum(axis=1)[:, None]
        told = (1.0 - self.doubt) * leaves + self.doubt * often
        return np.asarray(np.log(told[rows, new]))

    def told(self, old: Modes, mean: Array, covariance: Array, u: Array) -> tuple[Array, Array]:
        r"""How far states move once the next mode is known, and what is then known of them.

        Both (n_rows, n_modes, n_columns). A guard that has not risen at a row was below zero there,
        and one whose transition is taken was not: of a normal value :math:`g` that is the mean and
        the variance of a normal one cut off at zero, and the states go along. Without it a mode
        that is near its guard for many rows is left at each of them anew, as if the state were
        drawn again. The covariance shrinks by the product of the second with itself.
        """
        shift = np.zeros((len(old), self.n_modes, mean.shape[1]))
        known = np.zeros_like(shift)
        if not self.guards:
            return shift, known
        value, spread, slopes = self._risen(mean, covariance, u)
        nearest = np.full(len(old), -np.inf)  # of the guards that have not risen
        for place, one in enumerate(self.guards):
            own = np.flatnonzero(old == one.source)
            z = value[place, own] / spread[place, own]
            gain = np.einsum("rij,rj->ri", covariance[own], slopes[own, place])
            gain /= spread[place, own][:, None]
            stays = z > nearest[own]
            for rows, modes, sign in (
                (stays, old[own], -1.0), (slice(None), np.full(len(own), one.target), 1.0)
            ):  # fmt: skip
                beyond = z[rows] * sign
                pull = np.exp(norm.logpdf(beyond) - norm.logcdf(beyond))
                cut = np.sqrt((pull * (pull + beyond)).clip(0.0, 1.0))
                p = norm.cdf(beyond)
                obeyed = (1.0 - self.doubt) * p / ((1.0 - self.doubt) * p + self.doubt)
                at = own[rows], modes[rows]
                shift[at] = (obeyed * sign * pull)[:, None] * gain[rows]
                known[at] = (np.sqrt(obeyed) * cut)[:, None] * gain[rows]
            nearest[own] = np.maximum(nearest[own], z)
        return shift, known

    def _risen(self, mean: Array, covariance: Array, u: Array) -> tuple[Array, Array, Array]:
        """Value and deviation of every guard, (n_guards, n_rows) both, and slopes of the values."""

        def values(columns: Array) -> Array:
            columns = columns * self.unit
            return np.column_stack([one.values(columns) for one in self.guards])

        value, slopes = slopes_of(values, np.hstack([mean, u]), np.ones(mean.shape[1]))
        variance = np.einsum("rgi,rij,rgj->rg", slopes, covariance, slopes)
        width = np.array([one.width for one in self.guards])
        return value.T, np.sqrt(variance.clip(0.0) + width**2).T, slopes
