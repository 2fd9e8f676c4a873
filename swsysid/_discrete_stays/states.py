r"""Laws and states of highest likelihood for given modes: noise is where it was measured.

Least squares over rows sees noise in the features and is biased by it. Here every state is unknown,
measured with noise :math:`\sigma_c`, and follows the law of its mode but for a disturbance, small
and white:

.. math:: \tfrac12 \sum_k \Big\| \frac{y_k - x_k}{\sigma} \Big\|^2
          + \tfrac12 \sum_i \Big\| \frac{x_{k_i + 1} - C_{j_i} \Phi(x_{k_i}, \dots)}{q_i} \Big\|^2 .

The disturbance is a share of the noise, small where a sensor makes it (`noises`); of a row that no
law explains it is as large as the states, so that those before and after a jump are free of each
other. States enter few rows each: Gauss and Newton's matrix has a band for them and a border for
the laws, and costs as much as the rows are many. Integrated over the states it gives the likelihood
of the laws.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve, cho_solve_banded, cholesky_banded
from scipy.linalg.lapack import dtbtrs

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.lagged import Labels
from swsysid._discrete_stays.rows import RowFit, nats_of_unexplained
from swsysid._results import Array
from swsysid._stays.information import covariance_of
from swsysid._stays.laws import slopes_of


@dataclass(frozen=True)
class StateFit:
    """Laws, all states and the noise, and what they are worth.

    `cost` is the negative log likelihood of the rows and what modes and coefficients take, in nats,
    to be compared with the cost of a `RowFit`.
    """

    coef: Array  # (n_modes, n_states, n_features)
    states: Array  # (n_samples, n_states)
    back: Labels  # (n_rows, lags + 2): places of x[k + 1], x[k], ... of every row among them
    left: Array  # (n_rows, n_states): what the laws leave of the states
    noise: Array  # (n_states,)
    tie: Array  # (n_states,): the disturbance as a share of the noise
    cost: float


@dataclass(frozen=True)
class _Normal:
    """Normal equations after the states are eliminated, and what gives their step."""

    matrix: Array  # (n_free, n_free)
    right: Array
    value: float
    factor: Array  # of the part of the states, in lower banded form
    border: Array  # (n_samples * n_states, n_free)
    right_of_states: Array

    @property
    def log_det(self) -> float:
        """Of the part of the states."""
        return 2.0 * float(np.log(self.factor[0]).sum())

    def step(self, damping: float) -> tuple[Array, Array]:
        """Steps of the laws and the states."""
        matrix = self.matrix.copy()
        places = np.diag_indices_from(matrix)
        matrix[places] += damping * matrix[places] + np.finfo(float).tiny
        change = cho_solve(cho_factor(matrix), self.right)
        right = self.right_of_states - self.border @ change
        return change, cho_solve_banded((self.factor, True), right)


class StateProblem:
    """The sum of squares above for rows whose modes are given (-1: no law explains the row)."""

    def __init__(self, data: DiscreteData, modes: Labels, free: NDArray[np.bool_]):
        rows = data.rows
        self.data, self.modes, self.free = data, modes, free
        # samples side by side, those of a recording in a row
        lengths = np.zeros(int(rows.recording.max()) + 1, dtype=np.intp)
        np.maximum.at(lengths, rows.recording, rows.sample + 2)
        self.offsets = np.concatenate([[0], np.cumsum(lengths)])
        self.now = self.offsets[rows.recording] + rows.sample
        self.back = self.now[:, None] - np.arange(-1, rows.lags + 1)  # x[k + 1], x[k], ...
        n_lagged = rows.n_states * (rows.lags + 1)
        self.inputs = rows.columns[:, n_lagged:]
        measured = rows.columns[:, :n_lagged].reshape(len(rows), rows.lags + 1, rows.n_states)
        self.y = np.zeros((self.offsets[-1], rows.n_states))
        self.y[self.back[:, 1:]] = measured / data.target_unit
        self.y[self.now + 1] = rows.targets / data.target_unit

    @cached_property
    def columns_of_coef(self) -> NDArray[np.intp]:
        """Place of every free coefficient among the unknowns, -1 where it is zero, like coef."""
        n_modes, n_features = self.free.shape
        every = np.repeat(self.free[:, None], self.y.shape[1], axis=1)
        return np.where(every, np.cumsum(every).reshape(every.shape) - 1, -1)

    def disturbance(self, noise: Array, tie: Array) -> Array:
        """Standard deviations of what the rows leave, (n_rows, n_states)."""
        return np.where((self.modes < 0)[:, None], 1.0, tie * noise)

    def left(self, coef: Array, states: Array, features: Array) -> Array:
        """What the laws leave of the rows."""
        left = states[self.now + 1].copy()
        for mode, law in enumerate(coef):
            own = self.modes == mode
            left[own] -= features[own] @ law.T
        own = self.modes < 0
        left[own] -= states[self.now[own]]
        return left

    def columns(self, states: Array) -> Array:
        """Lagged columns of estimated states."""
        return np.hstack([states[self.back[:, 1:]].reshape(len(self.now), -1), self.inputs])

    def value(self, coef: Array, states: Array, noise: Array, tie: Array) -> float:
        """The sum of squares."""
        left = self.left(coef, states, self.data.features(self.columns(states)))
        with np.errstate(over="ignore", invalid="ignore"):
            value = np.square((self.y - states) / noise).sum()
            value += np.square(left / self.disturbance(noise, tie)).sum()
        return float(0.5 * value) if np.isfinite(value) else np.inf

    def normal(self, coef: Array, states: Array, noise: Array, tie: Array) -> _Normal:
        """Gauss and Newton's equations of the laws, the states eliminated."""
        n_lags, n = self.back.shape[1] - 1, self.y.shape[1]
        features, by_column = slopes_of(
            self.data.features, self.columns(states), np.ones(n_lags * n)
        )
        disturbance = self.disturbance(noise, tie)
        left = self.left(coef, states, features) / disturbance
        slopes = np.zeros((n_lags + 1, len(left), n, n))  # of what is left, by x[k + 1], x[k], ...
        slopes[0] = np.eye(n)
        slopes[1, self.modes < 0] = -np.eye(n)
        for mode, law in enumerate(coef):
            own = self.modes == mode
            by_lag = (law @ by_column[own]).reshape(-1, n, n_lags, n)
            slopes[1:, own] = -by_lag.transpose(2, 0, 1, 3)
        slopes /= disturbance[:, :, None]
        return self._eliminated(slopes, left, features, disturbance, states, noise)

    def _eliminated(
        self,
        slopes: Array,
        left: Array,
        features: Array,
        disturbance: Array,
        states: Array,
        noise: Array,
    ) -> _Normal:
        n_samples, n = self.y.shape
        misfit = (states - self.y) / noise
        band = self._band(slopes, noise)
        gradient = misfit / noise
        for place, slope in enumerate(slopes):
            gradient[self.back[:, place]] += np.einsum("irc,ir->ic", slope, left)
        n_free = int(self.columns_of_coef.max()) + 1
        border = np.zeros((n_samples * n, n_free))
        matrix, right = np.zeros((n_free, n_free)), np.zeros(n_free)
        for mode, columns in enumerate(self.columns_of_coef):
            own = np.flatnonzero(self.modes == mode)
            used = features[own][:, self.free[mode]]
            for state, places in enumerate(columns):
                places = places[places >= 0]
                block = slice(places[0], places[-1] + 1) if len(places) else slice(0)
                by_coef = -used / disturbance[own, state][:, None]
                matrix[np.ix_(places, places)] = by_coef.T @ by_coef
                right[places] = -by_coef.T @ left[own, state]
                for lag, slope in enumerate(slopes):
                    for other in range(n):
                        at = self.back[own, lag] * n + other
                        border[at, block] += slope[own, state, other][:, None] * by_coef
        factor = cholesky_banded(band, lower=True)
        right_of_states = -gradient.ravel()
        half, _ = dtbtrs(factor, np.asfortranarray(border), uplo="L")
        half_right, _ = dtbtrs(factor, right_of_states, uplo="L")
        matrix -= half.T @ half
        right -= half.T @ half_right.ravel()
        value = 0.5 * float(np.square(misfit).sum() + np.square(left).sum())
        return _Normal(matrix, right, value, factor, border, right_of_states)

    def _band(self, slopes: Array, noise: Array) -> Array:
        """The part of the states in lower banded form: row d holds the d-th diagonal below."""
        n_samples, n = self.y.shape
        band = np.zeros((len(slopes) * n, n_samples * n))
        band[0] = np.tile(noise**-2.0, n_samples)
        for later in range(len(slopes)):
            for earlier in range(later, len(slopes)):
                products = slopes[later].transpose(0, 2, 1) @ slopes[earlier]
                for row in range(n):
                    for column in range(n):
                        below = (earlier - later) * n + row - column
                        if below >= 0:
                            band[below, self.back[:, earlier] * n + column] += products[
                                :, row, column
                            ]
        return band


def with_states(
    data: DiscreteData,
    fit: RowFit,
    tie: Array | float,
    near: StateFit | None = None,
    free: NDArray[np.bool_] | None = None,
) -> StateFit:
    """Laws, states and noise of highest likelihood, with the modes of a fit by rows.

    From the laws of that fit, or from those of another one; `tie` is the disturbance as a share of
    the noise, of each state or of all.
    """
    settings = data.settings
    free = np.ones(fit.coef[:, 0].shape, dtype=bool) if free is None else free
    tie = np.broadcast_to(np.asarray(tie, dtype=float), data.rows.n_states)
    problem = StateProblem(data, fit.lawful, free)
    coef, states, noise = fit.coef, problem.y, fit.scale.mean(axis=0)
    if near is not None:
        coef, states, noise = near.coef, near.states, near.noise
    coef, noise = np.where(free[:, None], coef, 0.0), np.maximum(noise, settings.least_noise)
    coef, states = _descended(problem, coef, states, noise, tie)
    noise = _noise(problem, coef, states, tie)
    normal = problem.normal(coef, states, noise, tie)
    left = problem.left(coef, states, data.features(problem.columns(states)))
    cost = _cost(problem, normal, noise, tie, fit)
    return StateFit(coef, states, problem.back, left, noise, tie, cost)


def _descended(
    problem: StateProblem, coef: Array, states: Array, noise: Array, tie: Array
) -> tuple[Array, Array]:
    """Levenberg and Marquardt's steps."""
    settings = problem.data.settings
    damping, free = settings.damping, problem.columns_of_coef >= 0
    for _ in range(settings.most_steps):
        normal = problem.normal(coef, states, noise, tie)
        for _ in range(settings.most_failures):
            try:
                change, move = normal.step(damping)
            except LinAlgError:
                damping = max(10.0 * damping, settings.damping)
                continue
            trial = coef.copy()
            trial[free] += change
            moved = states + move.reshape(states.shape)
            reached = problem.value(trial, moved, noise, tie)
            if reached < normal.value:
                break
            damping = max(10.0 * damping, settings.damping)
        else:
            return coef, states
        coef, states, damping = trial, moved, 0.1 * damping
        if normal.value - reached < settings.converged:
            break
    return coef, states


def _noise(problem: StateProblem, coef: Array, states: Array, tie: Array) -> Array:
    """Standard deviations of the measurements by what states and rows leave."""
    known = problem.modes >= 0
    left = problem.left(coef, states, problem.data.features(problem.columns(states)))[known]
    squares = np.square(problem.y - states).sum(axis=0) + np.square(left / tie).sum(axis=0)
    n_free = int(problem.columns_of_coef.max()) + 1
    freedom = max(1.0, known.sum() - n_free / len(squares))
    return np.maximum(np.sqrt(squares / freedom), problem.data.settings.least_noise)


def _cost(problem: StateProblem, normal: _Normal, noise: Array, tie: Array, fit: RowFit) -> float:
    """Negative log likelihood of the rows, the states integrated out, with what laws take."""
    n_samples = len(problem.y)
    nats = normal.value + n_samples * np.log(noise).sum() + 0.5 * normal.log_det
    nats += np.log(problem.disturbance(noise, tie)).sum()
    nats += nats_of_unexplained(problem.modes < 0)
    nats += 0.5 * float(np.linalg.slogdet(np.eye(len(normal.matrix)) + normal.matrix)[1])
    return float(nats + fit.of_switches)


def law_covariance(
    data: DiscreteData, fit: RowFit, found: StateFit, free: NDArray[np.bool_]
) -> Array:
    """Variances of the laws, like their coefficients; infinite where no row says anything."""
    problem = StateProblem(data, fit.lawful, free)
    matrix = problem.normal(found.coef, found.states, found.noise, found.tie).matrix
    variances, places = np.zeros(found.coef.shape), problem.columns_of_coef
    variances[places >= 0] = np.diag(covariance_of(matrix))[places[places >= 0]]
    return variances
