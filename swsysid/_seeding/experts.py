"""Gated mixtures of linear experts: soft EM, for a batch of mixtures at once.

The model of one sample, with Phi(x) the dynamics features and q(x) those of the gate:

    mode m with probability pi_m(x) = softmax(a_m' q(x)),
    xdot = C_m Phi(x) + noise, whose scale s_k in output k is the same in all modes,
    or, with probability e and whatever the mode, an outlier: a broad density without x in it.

The noise is Student-t (the search: outliers have bounded pull) or Gaussian with the outlier
class (the final fit). Every iteration is made of steps that cannot decrease the penalised
log-likelihood: exact E-step, proximal weighted least squares, variances moved towards their
optimum, guarded Newton on the gate.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from swsysid._noise import weighted_quantile
from swsysid._results import Array
from swsysid._seeding.designs import WhitenedRows
from swsysid._seeding.gate import log_softmax, newton_step, softmax

__all__ = ["Experts", "Noise", "Posterior", "Samples", "em", "initial_experts", "single_model"]

# Targets are of order one: a residual of 1e-7 is as good as none.
VARIANCE_FLOOR = 1e-14
_SHRINK = 0.25
_PROXIMAL = 1e-10
_OUTLIER_SHARE = (1e-4, 0.3)
_SMALL_RESIDUAL = 1e-3


@dataclass(frozen=True)
class Samples:
    """The rows that a batch of mixtures is fitted to.

    Attributes
    ----------
    features : WhitenedRows
        Dynamics features, (n_features, n_samples).
    gate_features : WhitenedRows
        Polynomials of the coordinates, low degrees first, (n_gate_features, n_samples).
    targets : ndarray of shape (n_outputs, n_samples)
        Scaled to order one.
    weights : ndarray of shape (n_samples,)
    outlier_log_density : ndarray of shape (n_samples,)
    """

    features: WhitenedRows
    gate_features: WhitenedRows
    targets: Array
    weights: Array
    outlier_log_density: Array

    def take(self, rows: NDArray[np.intp], weights: Array) -> Samples:
        """Some of the rows, with weights of their own."""
        return Samples(
            self.features.take(rows),
            self.gate_features.take(rows),
            self.targets[:, rows],
            weights,
            self.outlier_log_density[rows],
        )


@dataclass(frozen=True)
class Noise:
    """Student-t noise of the output vector; infinite degrees of freedom are Gaussian.

    Attributes
    ----------
    dof : float
    """

    dof: float

    def log_density(self, distance: Array, variance: Array) -> Array:
        """Log density at squared Mahalanobis distances (R, M, N) for variances (R, K)."""
        size = variance.shape[-1]
        half_log_det = 0.5 * np.log(variance).sum(axis=-1)[:, None, None]
        if np.isinf(self.dof):
            return -0.5 * distance - (half_log_det + 0.5 * size * np.log(2 * np.pi))
        half = 0.5 * (self.dof + size)
        norm = gammaln(half) - gammaln(0.5 * self.dof) - 0.5 * size * np.log(self.dof * np.pi)
        return (norm - half_log_det) - half * np.log1p(distance / self.dof)

    def pull(self, distance: Array, n_outputs: int) -> Array:
        """Weight of a sample in the M-step: bounded influence for Student-t, one for Gaussian."""
        if np.isinf(self.dof):
            return np.ones_like(distance)
        return (self.dof + n_outputs) / (self.dof + distance)


@dataclass(frozen=True)
class Posterior:
    """What a batch of mixtures says about the samples.

    Attributes
    ----------
    modes : ndarray of shape (R, n_modes, n_samples)
        Probability of every mode given that the sample is no outlier.
    inlier : ndarray of shape (R, n_samples)
        Probability that it is none.
    distance : ndarray of shape (R, n_modes, n_samples)
        Squared Mahalanobis distance to every mode's velocity.
    log_density : ndarray of shape (R, n_samples)
    """

    modes: Array
    inlier: Array
    distance: Array
    log_density: Array


@dataclass(frozen=True)
class Experts:
    """A batch of R mixtures, with their residuals and gates at the samples.

    Attributes
    ----------
    coef : ndarray of shape (R, n_modes, n_outputs, n_features)
    gate : ndarray of shape (R, n_modes, n_gate_features)
    variance : ndarray of shape (R, n_outputs)
    outlier_share : ndarray of shape (R,)
        Zero switches the outlier class off for good.
    residuals : ndarray of shape (R, n_modes, n_outputs, n_samples)
    log_gate : ndarray of shape (R, n_modes, n_samples)
    """

    coef: Array
    gate: Array
    variance: Array
    outlier_share: Array
    residuals: Array
    log_gate: Array

    def at(self, samples: Samples) -> Experts:
        """The same mixtures at other samples."""
        return replace(
            self,
            residuals=samples.targets - samples.features.evaluate(self.coef),
            log_gate=log_softmax(samples.gate_features.evaluate(self.gate)),
        )

    def take(self, members) -> Experts:
        """Some members of the batch."""
        return Experts(*(getattr(self, name)[members] for name in self.__dataclass_fields__))

    @classmethod
    def concatenate(cls, batches: list[Experts]) -> Experts:
        """One batch of several."""
        names = cls.__dataclass_fields__
        return cls(*(np.concatenate([getattr(b, name) for b in batches]) for name in names))

    def posterior(self, samples: Samples, noise: Noise) -> Posterior:
        """The E-step."""
        distance = (np.square(self.residuals) / self.variance[:, None, :, None]).sum(axis=2)
        modes, inlier = softmax(self.log_gate + noise.log_density(distance, self.variance))
        inlier = inlier[:, 0]
        if not self.outlier_share.any():
            return Posterior(modes, np.ones_like(inlier), distance, inlier)
        outlier = np.log(self.outlier_share)[:, None] + samples.outlier_log_density
        inlier = np.log1p(-self.outlier_share)[:, None] + inlier
        density = np.logaddexp(inlier, outlier)
        return Posterior(modes, np.exp(inlier - density), distance, density)


def em(
    samples: Samples,
    experts: Experts,
    noise: Noise,
    *,
    ridge: float | Array,
    max_iter: int,
    tol: float,
    floor: float | Array = VARIANCE_FLOOR,
) -> tuple[Experts, Array]:
    """Run EM until no mixture of the batch gains more than `tol` nats in an iteration.

    Parameters
    ----------
    samples : Samples
    experts : Experts
    noise : Noise
    ridge : float or ndarray of shape (n_gate_features,)
        Price of a unit of the gate's mean squared score, per unit of weight.
    max_iter : int
    tol : float
    floor : float or ndarray of shape (n_outputs,)
        Variances stay above it.

    Returns
    -------
    experts : Experts
    history : ndarray of shape (n_iter + 1, R)
        Penalised log-likelihoods before every iteration and at the end; non-decreasing as long
        as the floor does not lift a variance.
    """
    history: list[Array] = []
    for _ in range(max_iter):
        posterior = experts.posterior(samples, noise)
        history.append(_penalised(samples, experts, posterior, ridge))
        if len(history) > 1 and (history[-1] - history[-2]).max() < tol:
            return experts, np.array(history)
        experts = _maximise(samples, experts, posterior, noise, ridge, floor)
    history.append(_penalised(samples, experts, experts.posterior(samples, noise), ridge))
    return experts, np.array(history)


def _penalised(samples, experts, posterior, ridge) -> Array:
    price = 0.5 * samples.weights.sum() * ridge
    penalty = (price * np.square(experts.gate)).sum(axis=(1, 2))
    return posterior.log_density @ samples.weights - penalty


def _maximise(samples, experts, posterior, noise, ridge, floor) -> Experts:
    weights, n_outputs = samples.weights, len(samples.targets)
    soft_labels = posterior.modes * posterior.inlier[:, None]
    pulled = weights * soft_labels * noise.pull(posterior.distance, n_outputs)
    coef = _weighted_fit(samples, pulled, experts.coef)
    residuals = samples.targets - samples.features.evaluate(coef)
    inlier_weight = posterior.inlier @ weights
    spread = (pulled[:, :, None] * np.square(residuals)).sum(axis=(1, 3))
    variance = spread / np.maximum(inlier_weight, 1e-12 * weights.sum())[:, None]
    # A step towards the optimum, not past it: the likelihood cannot fall, and no start can
    # collapse onto a handful of samples within one iteration.
    variance = np.maximum(np.maximum(variance, _SHRINK * experts.variance), floor)
    gate, log_gate = newton_step(
        samples.gate_features, experts.gate, experts.log_gate, soft_labels, weights, ridge
    )
    share = np.clip(1.0 - inlier_weight / weights.sum(), *_OUTLIER_SHARE)
    share = np.where(experts.outlier_share > 0, share, 0.0)
    return Experts(coef, gate, variance, share, residuals, log_gate)


def _weighted_fit(samples, weights, previous) -> Array:
    """Proximal weighted least squares of every mode: weights (R, M, N) -> coef (R, M, K, P).

    Minimises Sum_i w_i |y_i - C q_i|^2 + tau |C - C_previous|^2. The proximal term leaves the
    fixed points of an iteration alone, and keeps a mode without samples where it was.
    """
    tau = _PROXIMAL * samples.weights.sum()
    gram = samples.features.gram(weights) + tau * np.eye(len(samples.features.values))
    moment = samples.features.cross(weights[:, :, None] * samples.targets) + tau * previous
    return np.linalg.solve(gram, moment.swapaxes(-1, -2)).swapaxes(-1, -2)


def _towards_l1(samples, weights, coef, n_steps) -> tuple[Array, Array]:
    """Coefficients and residuals after least squares and some reweightings by 1 / |residual|."""
    reweighted = weights
    for _ in range(n_steps + 1):
        coef = _weighted_fit(samples, reweighted, coef)
        residuals = samples.targets - samples.features.evaluate(coef)
        size = np.maximum(np.abs(residuals).sum(axis=2), _SMALL_RESIDUAL)
        reweighted = weights / size
    return coef, residuals


def single_model(samples: Samples) -> tuple[Array, Array, Array]:
    """One model of all samples: least-squares residuals, then robust coefficients and residuals.

    Returns
    -------
    least_squares : ndarray of shape (n_outputs, n_samples)
    coef : ndarray of shape (n_outputs, n_features)
    residuals : ndarray of shape (n_outputs, n_samples)
    """
    shape = (1, 1, len(samples.targets), len(samples.features.values))
    everything = samples.weights[None, None]
    start, least_squares = _towards_l1(samples, everything, np.zeros(shape), 0)
    coef, residuals = _towards_l1(samples, everything, start, 5)
    return least_squares[0, 0], coef[0, 0], residuals[0, 0]


def initial_experts(
    samples: Samples, soft_labels: Array, coef: Array, ridge: float | Array
) -> Experts:
    """Mixtures from soft labels (R, M, N): robust experts, then two steps of the gate.

    `coef` (n_outputs, n_features) is the single model, where modes without samples stay.
    """
    n_batch, n_modes, _ = soft_labels.shape
    start = np.broadcast_to(coef, (n_batch, n_modes, *coef.shape))
    fitted, residuals = _towards_l1(samples, samples.weights * soft_labels, start, 2)
    nearest = np.square(residuals).min(axis=1)
    variance = np.maximum(2 * weighted_quantile(nearest, samples.weights, 0.5), VARIANCE_FLOOR)
    gate = np.zeros((n_batch, n_modes, len(samples.gate_features.values)))
    log_gate = np.full(soft_labels.shape, -np.log(n_modes))
    for _ in range(2):
        gate, log_gate = newton_step(
            samples.gate_features, gate, log_gate, soft_labels, samples.weights, ridge
        )
    return Experts(fitted, gate, variance, np.zeros(n_batch), residuals, log_gate)
