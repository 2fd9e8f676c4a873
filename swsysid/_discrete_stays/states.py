r"""Laws and states of highest likelihood for given modes: noise is where it was measured.

Least squares over rows sees noise in the features and is biased by it. Here every state is unknown,
measured with noise :math:`\sigma_c`, and follows the law of its mode but for a disturbance, small
and white:

.. math:: \tfrac12 \sum_k \Big\| \frac{y_k - x_k}{\sigma} \Big\|^2
          + \tfrac12 \sum_i \Big\| \frac{x_{k_i + 1} - C_{j_i} \Phi(x_{k_i}, \dots)}{q_i} \Big\|^2 .

The disturbance is a share of the noise, small where a sensor makes it (below); of a row that no
law explains it is as large as the states, so that those before and after a jump are free of each
other. States enter few rows each: Gauss and Newton's matrix has a band for them and a border for
the laws, and costs as much as the rows are many. Integrated over the states it gives the likelihood
of the laws.

*Noise of the sensor and noise in the equation.* What a sensor adds is forgotten at the next sample;
what disturbs the equation goes on in the states. Least squares of rows is right for the second and
biased by the first, states that follow their law are right for the first and biased by the second.
With a variance of each, :math:`r` and :math:`q = \tau^2 r`, the rows are a linear state space whose
likelihood is known for every ratio :math:`\tau`; with a best :math:`r` and best laws for each it is
a profile. Towards zero it ends in noise of the sensor alone, towards infinity in noise of the
equation alone, and what it loses at its ends says how sure either is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from swsysid._discrete_stays.data import DiscreteData
from swsysid._discrete_stays.lagged import Labels
from swsysid._discrete_stays.rows import RowFit, nats_of_unexplained
from swsysid._known.program import Steps
from swsysid._results import Array
from swsysid._stays.arrow import Arrow, covariance_of
from swsysid._stays.descent import descended
from swsysid._stays.laws import slopes_of
from swsysid._stays.settings import SETTINGS as STAYS

_LEAST_NOISE = 1e-7
# Steps of a descent that ranks starts, of one in the course of a search, and of one that decides
# by itself. Profiles over the ratio of both noises compare hundredths of a nat. Features may be
# alike: from a damping of 1e-3 ten steps end up to some hundred nats from the best of right modes,
# from 1e-5 four are at it, and from 1e-7 laws of few rows run away (published spacecraft, tanks).
# With four, 25 rows that do not tell both noises apart seem to.
RANKING_STEPS, _MOST_STEPS, PATIENT_STEPS = 2, 6, 50
_CLOSELY = replace(STAYS, converged=1e-3, damping=1e-5)

# The disturbance as a share of the noise when they are told apart, from noise of the sensor alone
# to noise of the equation alone (a ten-thousandth of the variance is the other's), and the steps in
# which it climbs: likelihoods of 30 to 2000 rows have one summit. Nats that a step must gain, and
# by which a ratio is worse whose laws weigh nothing in a mean.
_RATIOS = (0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0)
_RATIO_STEPS = 10.0**0.5, 10.0**0.125
_CONVERGED, _WITHOUT_WEIGHT = 0.02, 40.0


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
class LawsAndStates:
    """A trial of both; `free` are the coefficients that are sought, of the shape of `coef`."""

    coef: Array
    free: NDArray[np.bool_]
    states: Array

    def moved(self, step: Array) -> LawsAndStates:
        """Some way off, by a step of the states and then of the free coefficients."""
        move, change = np.split(step, [self.states.size])
        coef = self.coef.copy()
        coef[self.free] += change
        return replace(self, coef=coef, states=self.states + move.reshape(self.states.shape))


@dataclass(frozen=True)
class StateEquations:
    """Gauss and Newton's equations: the states are the band, the free coefficients the corner."""

    value: float
    arrow: Arrow
    right: Array
    steps: Steps | None = None  # of the free coefficients, that are allowed; None for all

    def step(self, damping: float) -> tuple[Array, float]:
        """The step of damped equations, and by how much it should lower the value."""
        try:
            factor = self.arrow.factor(damping, np.finfo(float).tiny, self.steps)
            step = factor.solve(self.right)
        except LinAlgError:  # not positive by rounding, or not finite
            return np.zeros(len(self.right)), 0.0
        corner = step[len(self.right) - len(factor.more) :]
        held = factor.more @ np.square(corner)
        if self.steps is not None:
            held += corner @ factor.held_back(self.right, corner)
        return step, 0.5 * float(self.right @ step + held)


class StateProblem:
    """The sum of squares above for rows whose modes are given (-1: no law explains the row).

    `free` are the features of each law, `noise` and `tie` the deviations of the measurements and
    the disturbance as a share of them, (n_states,).
    """

    def __init__(
        self, data: DiscreteData, modes: Labels, free: NDArray[np.bool_], noise: Array, tie: Array
    ):
        rows = data.rows
        self.data, self.modes, self.free, self.noise = data, modes, free, noise
        self.region = None if data.known is None else data.region(len(free))
        # standard deviations of what the rows leave, (n_rows, n_states)
        self.disturbance = np.where((modes < 0)[:, None], 1.0, tie * noise)
        # samples of the rows side by side, those of a recording in a row: of a part few are there
        place = rows.recording * (int(rows.sample.max()) + 2) + rows.sample
        place = place[:, None] - np.arange(-1, rows.lags + 1)  # x[k + 1], x[k], ...
        every, back = np.unique(place, return_inverse=True)
        self.back = back.reshape(place.shape)
        self.now = self.back[:, 1]
        n_lagged = rows.n_states * (rows.lags + 1)
        self.inputs = rows.columns[:, n_lagged:]
        measured = rows.columns[:, :n_lagged].reshape(len(rows), rows.lags + 1, rows.n_states)
        self.y = np.zeros((len(every), rows.n_states))
        self.y[self.back[:, 1:]] = measured / data.target_unit
        self.y[self.now + 1] = rows.targets / data.target_unit

    @cached_property
    def columns_of_coef(self) -> NDArray[np.intp]:
        """Place of every free coefficient among the unknowns, -1 where it is zero, like coef."""
        n_modes, n_features = self.free.shape
        every = np.repeat(self.free[:, None], self.y.shape[1], axis=1)
        return np.where(every, np.cumsum(every).reshape(every.shape) - 1, -1)

    def allows(self, trial: LawsAndStates) -> bool:
        """True of every trial."""
        return True

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

    def normal_equations(self, trial: LawsAndStates) -> StateEquations:
        """Gauss and Newton's equations at a trial."""
        n_lags, n, coef = self.back.shape[1] - 1, self.y.shape[1], trial.coef
        with np.errstate(over="ignore", invalid="ignore"):
            features, by_column = slopes_of(
                self.data.features, self.columns(trial.states), np.ones(n_lags * n)
            )
            left = self.left(coef, trial.states, features) / self.disturbance
            misfit = (trial.states - self.y) / self.noise
            value = 0.5 * float(np.square(misfit).sum() + np.square(left).sum())
        slopes = np.zeros((n_lags + 1, len(left), n, n))  # of what is left, by x[k + 1], x[k], ...
        slopes[0] = np.eye(n)
        slopes[1, self.modes < 0] = -np.eye(n)
        for mode, law in enumerate(coef):
            own = self.modes == mode
            by_lag = (law @ by_column[own]).reshape(-1, n, n_lags, n)
            slopes[1:, own] = -by_lag.transpose(2, 0, 1, 3)
        slopes /= self.disturbance[:, :, None]
        gradient = misfit / self.noise
        for place, slope in enumerate(slopes):
            gradient[self.back[:, place]] += np.einsum("irc,ir->ic", slope, left)
        border, corner, right = self._of_laws(slopes, left, features)
        arrow = Arrow(self._band(slopes), border, corner)
        steps = None if self.region is None else self.region.steps(coef, trial.free)
        return StateEquations(value, arrow, np.append(-gradient.ravel(), right), steps)

    def _of_laws(self, slopes: Array, left: Array, features: Array) -> tuple[Array, Array, Array]:
        """What the free coefficients have in common with the states and with each other."""
        n, n_free = self.y.shape[1], int(self.columns_of_coef.max()) + 1
        border = np.zeros((n_free, self.y.size)).T
        corner, right = np.zeros((n_free, n_free)), np.zeros(n_free)
        for mode, columns in enumerate(self.columns_of_coef):
            own = np.flatnonzero(self.modes == mode)
            used = features[own][:, self.free[mode]]
            for state, places in enumerate(columns):
                places = places[places >= 0]
                block = slice(places[0], places[-1] + 1) if len(places) else slice(0)
                by_coef = -used / self.disturbance[own, state][:, None]
                corner[block, block] = by_coef.T @ by_coef
                right[block] = -by_coef.T @ left[own, state]
                for lag, slope in enumerate(slopes):
                    for other in range(n):
                        at = self.back[own, lag] * n + other
                        border[at, block] += slope[own, state, other][:, None] * by_coef
        return border, corner, right

    def _band(self, slopes: Array) -> Array:
        """The part of the states in lower banded form: row d holds the d-th diagonal below."""
        n_samples, n = self.y.shape
        band = np.zeros((len(slopes) * n, n_samples * n))
        band[0] = np.tile(self.noise**-2.0, n_samples)
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
    most_steps: int = _MOST_STEPS,
) -> StateFit:
    """Laws, states and noise of highest likelihood, with the modes of a fit by rows.

    From the laws of that fit, or from those of another one; `tie` is the disturbance as a share of
    the noise, of each state or of all.
    """
    free = np.ones(fit.coef[:, 0].shape, dtype=bool) if free is None else free
    tie = np.broadcast_to(np.asarray(tie, dtype=float), data.rows.n_states)
    coef, states, noise = fit.coef, None, fit.scale.mean(axis=0)
    if near is not None:
        coef, states, noise = near.coef, near.states, near.noise
    problem = StateProblem(data, fit.lawful, free, np.maximum(noise, _LEAST_NOISE), tie)
    coef, states = np.where(free[:, None], coef, 0.0), problem.y if states is None else states
    own = problem.columns_of_coef >= 0
    if problem.region is not None:
        coef = problem.region.nearest(coef, own, np.eye(int(own.sum())))
    trial = LawsAndStates(coef, own, states)
    found, _ = descended(trial, problem, most_steps, _CLOSELY)
    left = problem.left(found.coef, found.states, data.features(problem.columns(found.states)))
    noise = _noise(problem, found.states, left, tie)
    problem = StateProblem(data, fit.lawful, free, noise, tie)
    try:
        cost = _cost(problem, problem.normal_equations(found), fit)
    except LinAlgError:  # a law that is known and far from the rows, so that no state is near both
        cost = np.inf
    return StateFit(found.coef, found.states, problem.back, left, noise, tie, cost)


def _noise(problem: StateProblem, states: Array, left: Array, tie: Array) -> Array:
    """Standard deviations of the measurements by what states and rows leave."""
    known = problem.modes >= 0
    squares = np.square(problem.y - states).sum(axis=0) + np.square(left[known] / tie).sum(axis=0)
    n_free = int(problem.columns_of_coef.max()) + 1
    freedom = max(1.0, known.sum() - n_free / len(squares))
    return np.maximum(np.sqrt(squares / freedom), _LEAST_NOISE)


def _cost(problem: StateProblem, equations: StateEquations, fit: RowFit) -> float:
    """Negative log likelihood of the rows, the states integrated out, with what laws take."""
    arrow = equations.arrow
    nats = equations.value + len(problem.y) * np.log(problem.noise).sum()
    nats += 0.5 * arrow.log_det_of_band + np.log(problem.disturbance).sum()
    nats += nats_of_unexplained(problem.modes < 0)
    told = np.eye(len(arrow.corner)) + arrow.schur
    if equations.steps is not None:  # of what is known no nat is paid
        told = equations.steps.basis.T @ told @ equations.steps.basis
    nats += 0.5 * float(np.linalg.slogdet(told)[1])
    return float(nats + fit.of_switches)


def law_covariance(
    data: DiscreteData, fit: RowFit, found: StateFit, free: NDArray[np.bool_]
) -> Array:
    """Variances of the laws, like their coefficients; infinite where no row says anything."""
    problem = StateProblem(data, fit.lawful, free, found.noise, found.tie)
    own = problem.columns_of_coef >= 0
    equations = problem.normal_equations(LawsAndStates(found.coef, own, found.states))
    variances = np.zeros(found.coef.shape)
    variances[own] = np.diag(covariance_of(equations.arrow.schur, equations.steps))
    if problem.region is not None:
        variances[problem.region.fixed[0]] = 0.0
    return variances


def law_information(data: DiscreteData, fit: RowFit, found: StateFit) -> Array:
    """What rows tell of each law for itself, (n_modes, n_coef, n_coef) by states and features."""
    free = np.ones(found.coef[:, 0].shape, dtype=bool)
    problem = StateProblem(data, fit.lawful, free, found.noise, found.tie)
    every = np.ones(found.coef.shape, dtype=bool)
    equations = problem.normal_equations(LawsAndStates(found.coef, every, found.states))
    n = found.coef[0].size
    parts = equations.arrow.schur.reshape(len(free), n, len(free), n)
    return np.array([parts[mode, :, mode] for mode in range(len(free))])


def with_own_ratio(data: DiscreteData, fit: RowFit, found: StateFit) -> StateFit:
    """The same modes with the ratio of both noises at which they are likelier than beside it.

    The states climb together, then each by itself, which has to be worth a coefficient.
    """
    n_states = data.rows.n_states
    alone = [(one, 1.0) for one in np.eye(n_states)] if n_states > 1 else []
    for direction, worth in [(np.ones(n_states), _CONVERGED), *alone]:
        for step in _RATIO_STEPS:
            for way in (step, 1.0 / step):
                found = _climbed(data, fit, found, way**direction, worth)
    return found


def _climbed(
    data: DiscreteData, fit: RowFit, found: StateFit, step: Array, worth: float
) -> StateFit:
    """The same with ratios as many steps further as are worth it."""
    least, most = _RATIOS[0], _RATIOS[-1]
    while ((tie := found.tie * step) >= least).all() and (tie <= most).all():
        trial = with_states(data, fit, tie, found)
        if not trial.cost < found.cost - worth:
            break
        found = trial
    return found


def _outwards(
    data: DiscreteData, fit: RowFit, found: StateFit, ratios: Array, free: NDArray[np.bool_]
) -> list[StateFit]:
    """From the best ratio to others, each from the one beside it; then at once to the last."""
    told = [found]
    for ratio in ratios:
        if ratio == ratios[-1] or told[-1].cost < found.cost + _WITHOUT_WEIGHT:
            told.append(with_states(data, fit, np.full_like(found.tie, ratio), told[-1], free))
    return told


@dataclass(frozen=True)
class NoiseProfile:
    """Laws by the ratio of both noises, in the units and the order of the search.

    Attributes
    ----------
    nats : ndarray of shape (n_ratios,)
        What each ratio is worse by than the best, from noise of the sensor alone to that of the
        equation; between, only where laws are likely.
    coef : ndarray of shape (n_ratios, n_modes, n_states, n_features)
    best : int
    variance : ndarray of shape (n_modes, n_states, n_features)
        Of the laws, the ratio not known; infinite where the rows say nothing.
    """

    nats: Array
    coef: Array
    best: int
    variance: Array

    @classmethod
    def of(cls, data: DiscreteData, fit: RowFit, found: StateFit) -> NoiseProfile:
        """That of modes which are known."""
        free = (found.coef != 0.0).any(axis=1)
        ratios = np.asarray(_RATIOS)
        up, down = (
            _outwards(data, fit, found, own, free)
            for own in (ratios[ratios > found.tie.max()], ratios[ratios < found.tie.min()][::-1])
        )
        every = [*down[:0:-1], *up]
        nats = np.array([one.cost for one in every])
        best, nats = len(down) - 1, nats - nats.min()
        coef = np.array([one.coef for one in every])
        weights = np.exp(-nats) / np.exp(-nats).sum()
        between = np.einsum("r,rmsf->msf", weights, np.square(coef - coef[best]))
        return cls(nats, coef, best, law_covariance(data, fit, found, free) + between)
