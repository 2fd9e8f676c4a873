r"""Kalman's filter and smoother for laws that are known nearly.

The state follows the law of its mode but for a small disturbance of its velocity, white with the
spectral density :math:`q^2`, and is measured with white noise:

.. math:: x_{k+1} = F_j(x_k) + w_k, \quad \operatorname{cov} w_k = q^2 \Delta t, \qquad
          y_k = x_k + v_k, \quad \operatorname{cov} v_k = R .

In the interval of a switch the old law may have acted for any part of it, on average for a half.
Its velocity differs from the new one's by :math:`\Delta f`, which adds
:math:`(\Delta f \Delta t)^2 / 12` to the covariance. Where a recording slides along a surface the
state is known to lie on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.laws import Laws, Modes
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import LIMITS
from swsysid._stays.sliding import SlidingLaws


@dataclass(frozen=True)
class Belief:
    """What is known of the states of many rows: means and covariances."""

    mean: Array  # (n_rows, n_states)
    covariance: Array  # (n_rows, n_states, n_states)

    def take(self, rows) -> Belief:
        """Some of the rows."""
        return Belief(self.mean[rows], self.covariance[rows])


@dataclass(frozen=True)
class Prediction:
    """A belief one interval later, and the derivative of its mean by the one before."""

    belief: Belief
    transition: Array  # (n_rows, n_states, n_states)
    jump: Array  # (n_rows, n_states): by how much a switch may come earlier or later


@dataclass(frozen=True)
class Filter:
    """One interval of many rows; `noise` and `disturbance` are standard deviations."""

    laws: Laws  # no coefficient of them free
    noise: Array  # (n_states,): of the measurement
    disturbance: Array  # (n_states,) or (n_rows, n_states): of the velocity, times sqrt(s)
    first_step: float = 0.5  # part of an interval that is integrated at once, without a switch

    def predict(
        self, belief: Belief, old: Modes, new: Modes, u: Array, after: Array, duration: Array
    ) -> Prediction:
        """The belief after an interval in the mode `new`, which began as `old`."""
        n_states, step = belief.mean.shape[1], self.laws.varied_step
        transition = np.tile(np.eye(n_states), (len(belief.mean), 1, 1))
        slope = (after - u) / np.where(duration > 0.0, duration, np.inf)[:, None]
        rows = np.flatnonzero(old != new)
        share = np.full(len(old), self.first_step)
        share[rows] = 0.5
        middle = u + share[:, None] * (after - u)
        mean, transition = step(old, belief.mean, transition, u, middle, share * duration)
        jump = self.laws.velocities(new[rows], mean[rows], middle[rows], slope[rows])
        jump -= self.laws.velocities(old[rows], mean[rows], middle[rows], slope[rows])
        jump *= duration[rows, None]
        if (on := np.flatnonzero(share < 1.0)).size:
            left = (1.0 - share[on]) * duration[on]
            mean[on], transition[on] = step(
                new[on], mean[on], transition[on], middle[on], after[on], left
            )
        covariance = transition @ belief.covariance @ transition.transpose(0, 2, 1)
        every = np.arange(n_states)
        covariance[:, every, every] += self.disturbance**2 * duration[:, None]
        covariance[rows] += jump[:, :, None] * jump[:, None, :] / 12.0
        jumps = np.zeros_like(mean)
        jumps[rows] = jump
        return Prediction(Belief(mean, covariance), transition, jumps)

    def on_surface(self, prediction: Prediction, new: Modes, after: Array) -> tuple[Belief, Array]:
        """The predicted belief, of rows that slide on their surface, and how likely they got there.

        A crossing in the interval of a switch is as likely as the normal density of f, times what f
        changes by in the interval.
        """
        predicted, log_likelihood = prediction.belief, np.zeros(len(new))
        rows = np.flatnonzero(new >= len(self.laws.coef))
        if not rows.size:
            return predicted, log_likelihood
        assert isinstance(self.laws, SlidingLaws)
        value, gradient = self.laws.off(new[rows], predicted.mean[rows], after[rows])
        reach = np.einsum("ri,rij->rj", gradient, predicted.covariance[rows])
        variance = np.einsum("ri,ri->r", reach, gradient)
        gain = reach / variance[:, None]
        mean, covariance = predicted.mean.copy(), predicted.covariance.copy()
        mean[rows] -= gain * value[:, None]
        covariance[rows] -= gain[:, :, None] * reach[:, None, :]
        change = np.square(np.einsum("ri,ri->r", gradient, prediction.jump[rows]))
        enters = np.flatnonzero(change > 0.0)
        value, variance, change = value[enters], variance[enters], change[enters]
        squares = np.minimum(np.square(value) / variance, LIMITS.most_squares)
        log_likelihood[rows[enters]] = -0.5 * (squares + np.log(2.0 * np.pi * variance / change))
        return Belief(mean, covariance), log_likelihood

    def correct(self, predicted: Belief, y: Array) -> tuple[Belief, Array]:
        """The belief after a measurement, and the log likelihood of that."""
        seen = np.isfinite(y)
        error = np.where(seen, y - predicted.mean, 0.0)
        variance = self.noise**2 * np.where(seen, 1.0, LIMITS.missing)
        total = predicted.covariance + variance[:, :, None] * np.eye(y.shape[1])
        inverse, log_determinant = _inverted(total)
        gain = predicted.covariance @ inverse
        squares = np.einsum("ri,rij,rj->r", error, inverse, error)
        log_likelihood = -0.5 * (np.minimum(squares, LIMITS.most_squares) + log_determinant)
        mean = predicted.mean + np.einsum("rij,rj->ri", gain, error)
        # Joseph's form: what a switch leaves open may exceed the noise by ten powers of ten
        left = np.eye(y.shape[1]) - gain
        covariance = left @ predicted.covariance @ left.transpose(0, 2, 1)
        covariance += (gain * variance[:, None, :]) @ gain.transpose(0, 2, 1)
        return Belief(mean, covariance), log_likelihood

    def first(self, y: Array, guess: Array) -> Belief:
        """The belief at the first samples; what is not measured there is roughly known."""
        seen = np.isfinite(y)
        variance = np.where(seen, self.noise, LIMITS.roughly_known * self.laws.spread) ** 2
        return Belief(np.where(seen, y, guess), variance[:, :, None] * np.eye(y.shape[1]))


def _inverted(covariances: Array) -> tuple[Array, Array]:
    """Inverses of many covariances, and logarithms of their determinants.

    In units in which the diagonal is one, and what rounding leaves of a direction that is known
    exactly beside others that are not is that of rounding.
    """
    every = np.arange(covariances.shape[1])
    unit = np.sqrt(covariances[:, every, every])
    scaled = covariances / (unit[:, :, None] * unit[:, None, :])
    scaled[:, every, every] += LIMITS.rounding
    inverse = np.linalg.inv(scaled) / (unit[:, :, None] * unit[:, None, :])
    return inverse, np.linalg.slogdet(scaled)[1] + 2.0 * np.log(unit).sum(axis=1)


def smoothed_states(filter_: Filter, recordings: Recordings, modes: NDArray[np.intp]) -> Array:
    """States of all samples given all measurements (Rauch, Tung and Striebel).

    `modes` are those of the intervals, (n_times - 1, n_recordings); the answer is padded like
    `recordings.y`. A recording in which a law diverges keeps its rough states.
    """
    belief = filter_.first(recordings.y[0], recordings.guess[0])
    beliefs, predictions = [belief], []
    before = modes[0]
    for k, duration in enumerate(recordings.steps):
        u, after = recordings.u[k], recordings.u[k + 1]
        prediction = filter_.predict(belief, before, modes[k], u, after, duration)
        belief, _ = filter_.on_surface(prediction, modes[k], after)
        belief, _ = filter_.correct(belief, recordings.y[k + 1])
        predictions.append(prediction)
        beliefs.append(belief)
        before = modes[k]
    states = [belief.mean]
    for filtered, ahead in zip(beliefs[-2::-1], predictions[::-1], strict=True):
        known = np.nan_to_num(ahead.belief.covariance, posinf=0.0, neginf=0.0)
        inverse = np.linalg.pinv(known, hermitian=True)
        gain = filtered.covariance @ ahead.transition.transpose(0, 2, 1) @ inverse
        correction = np.einsum("rij,rj->ri", gain, states[-1] - ahead.belief.mean)
        states.append(filtered.mean + correction)
    smoothed = np.array(states[::-1])
    lost = ~np.isfinite(smoothed).all(axis=(0, 2))
    smoothed[:, lost] = recordings.guess[:, lost]
    return smoothed
