"""Gated mixtures of linear experts: soft EM, for a batch of mixtures at once.

The model of one sample, with Phi(x) the dynamics features and q(x) those of the gate:

    mode m with probability pi_m(x) = softmax(a_m' q(x)),
    xdot = C_m Phi(x) + noise, whose scale s_k in output k is the same in all modes,
    or, with probability e and whatever the mode, an outlier: a broad density without x in it.

The noise is Student-t (the search: outliers have bounded pull) or normal with the outlier class
(the final fit). Every iteration is made of steps that cannot decrease the penalised
log-likelihood: exact E-step, proximal weighted least squares, variances moved towards their
optimum, guarded Newton on the gate.

The features q(x) of the gate are polynomials of the coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from swsysid._data.features import Monomials
from swsysid._noise import Noise, mixed_with_outliers, weighted_quantile
from swsysid._results import Array
from swsysid._seeding.designs import Basis, WhitenedRows, centre_and_scale, whiten
from swsysid._seeding.settings import DEFAULTS, SeedingSettings


@dataclass(frozen=True)
class Samples:
    """The rows that a batch of mixtures is fitted to."""

    features: WhitenedRows  # dynamics features, (n_features, n_samples)
    # Polynomials of the coordinates, low degrees first, (n_gate_features, n_samples).
    gate_features: WhitenedRows
    targets: Array  # (n_outputs, n_samples): scaled to order one
    weights: Array  # (n_samples,)
    outlier_log_density: Array  # (n_samples,)
    n_coarse: int  # how many gate features span the coarse polynomials
    settings: SeedingSettings = DEFAULTS

    def take(self, rows: NDArray[np.intp], weights: Array) -> Samples:
        """Some of the rows, with weights of their own."""
        return replace(
            self,
            features=self.features.take(rows),
            gate_features=self.gate_features.take(rows),
            targets=self.targets[:, rows],
            weights=weights,
            outlier_log_density=self.outlier_log_density[rows],
        )

    @property
    def tolerance(self) -> float:
        """Iterations end where none gains so many nats."""
        settings = self.settings
        return max(settings.tolerance, settings.tolerance_a_sample * self.weights.sum())

    def gate_ridges(self, ridge: float) -> Array:
        """Prices of the gate features; those beyond the coarse polynomials cost more."""
        fine = np.arange(len(self.gate_features.values)) >= self.n_coarse
        return np.where(fine, max(ridge, self.settings.fine_ridge), ridge)


@dataclass(frozen=True)
class Posterior:
    """What a batch of mixtures says about the samples."""

    # (R, n_modes, n_samples): probability of every mode given that the sample is no outlier.
    modes: Array
    inlier: Array  # (R, n_samples): probability that it is none
    squares: Array  # (R, n_modes, n_samples): sum of the squared residuals in units of the noise
    log_density: Array  # (R, n_samples)


@dataclass(frozen=True)
class Experts:
    """A batch of R mixtures, with their residuals and gates at the samples."""

    coef: Array  # (R, n_modes, n_outputs, n_features)
    gate: Array  # (R, n_modes, n_gate_features)
    variance: Array  # (R, n_outputs)
    outlier_share: Array  # (R,): zero switches the outlier class off for good
    residuals: Array  # (R, n_modes, n_outputs, n_samples)
    log_gate: Array  # (R, n_modes, n_samples)

    def at(self, samples: Samples) -> Experts:
        """The same mixtures at other samples."""
        return replace(
            self,
            residuals=samples.targets - samples.features.evaluate(self.coef),
            log_gate=log_softmax(samples.gate_features.evaluate(self.gate), axis=1),
        )

    def take(self, members) -> Experts:
        """Some members of the batch."""
        return Experts(*(values[members] for values in vars(self).values()))

    def most_populated_first(self, weights: Array) -> Experts:
        """The same mixtures with their modes in an order that no rounding decides."""
        order = np.argsort(-np.exp(self.log_gate) @ weights, axis=1, kind="stable")
        members = np.arange(len(order))[:, None]
        return replace(
            self,
            coef=self.coef[members, order],
            gate=self.gate[members, order],
            residuals=self.residuals[members, order],
            log_gate=self.log_gate[members, order],
        )

    @classmethod
    def concatenate(cls, batches: list[Experts]) -> Experts:
        """One batch of several."""
        parts = zip(*(vars(batch).values() for batch in batches), strict=True)
        return cls(*(np.concatenate(values) for values in parts))

    def posterior(self, samples: Samples, noise: Noise) -> Posterior:
        """The E-step."""
        squares = (np.square(self.residuals) / self.variance[:, None, :, None]).sum(axis=2)
        log_scale = 0.5 * np.log(self.variance).sum(axis=1)[:, None, None]
        joint = self.log_gate + noise.log_density(squares, log_scale, self.variance.shape[1])
        top = joint.max(axis=1, keepdims=True)
        modes = np.exp(joint - top)
        total = modes.sum(axis=1, keepdims=True)
        modes /= total
        density = (top + np.log(total))[:, 0]
        if not self.outlier_share.any():
            return Posterior(modes, np.ones_like(density), squares, density)
        density, inlier = mixed_with_outliers(
            density, samples.outlier_log_density, self.outlier_share[:, None]
        )
        return Posterior(modes, inlier, squares, density)


def em(
    samples: Samples,
    experts: Experts,
    noise: Noise,
    *,
    ridge: float | Array,
    max_iter: int,
    tol: float | None = None,
    floor: float | Array = 0.0,
) -> tuple[Experts, Array]:
    """Run EM until no mixture of the batch gains more than the tolerance in an iteration."""
    # `ridge` is the price of a unit of the gate's mean squared score, per unit of weight; variances
    # stay above the `floor` of their output. The history (n_iter + 1, R) holds the penalised
    # log-likelihoods before every iteration and at the end: they do not decrease as long as the
    # floor does not lift a variance.
    floor = np.maximum(floor, samples.settings.exact**2)
    tol = samples.tolerance if tol is None else tol
    price = 0.5 * samples.weights.sum() * ridge
    history: list[Array] = []
    while True:
        posterior = experts.posterior(samples, noise)
        penalty = (price * np.square(experts.gate)).sum(axis=(1, 2))
        history.append(posterior.log_density @ samples.weights - penalty)
        if len(history) > max_iter:
            break
        if len(history) > 1 and (history[-1] - history[-2]).max() < tol:
            break
        experts = _maximise(samples, experts, posterior, noise, ridge, floor)
    return experts, np.array(history)


def _maximise(samples, experts, posterior, noise, ridge, floor) -> Experts:
    weights, n_outputs, settings = samples.weights, len(samples.targets), samples.settings
    soft_labels = posterior.modes * posterior.inlier[:, None]
    pulled = weights * soft_labels * noise.weight(posterior.squares, n_outputs)
    coef = _weighted_fit(samples, pulled, experts.coef)
    residuals = samples.targets - samples.features.evaluate(coef)
    inlier_weight = posterior.inlier @ weights
    spread = (pulled[:, :, None] * np.square(residuals)).sum(axis=(1, 3))
    variance = spread / np.maximum(inlier_weight, 1e-12 * weights.sum())[:, None]
    # A step towards the optimum, not past it: the likelihood cannot fall.
    least = np.maximum(settings.least_shrinkage * experts.variance, floor)
    gate, log_gate = newton_step(
        samples.gate_features, experts.gate, experts.log_gate, soft_labels, weights, ridge, settings
    )
    share = np.clip(1.0 - inlier_weight / weights.sum(), *settings.outlier_limits)
    share = np.where(experts.outlier_share > 0, share, 0.0)
    return Experts(coef, gate, np.maximum(variance, least), share, residuals, log_gate)


def _weighted_fit(samples, weights, previous) -> Array:
    """Proximal weighted least squares of every mode: weights (R, M, N) -> coef (R, M, K, P)."""
    # Minimises Sum_i w_i |y_i - C q_i|^2 + tau |C - C_previous|^2. The proximal term leaves the
    # fixed points of an iteration alone, and keeps a mode without samples where it was.
    tau = samples.settings.proximal * samples.weights.sum()
    gram = samples.features.gram(weights) + tau * np.eye(len(samples.features.values))
    moment = samples.features.cross(weights[:, :, None] * samples.targets) + tau * previous
    return np.linalg.solve(gram, moment.swapaxes(-1, -2)).swapaxes(-1, -2)


def _towards_l1(samples, weights, coef, n_steps) -> tuple[Array, Array]:
    """Coefficients and residuals after least squares and some reweightings by 1 / |residual|."""
    reweighted = weights
    for _ in range(n_steps + 1):
        coef = _weighted_fit(samples, reweighted, coef)
        residuals = samples.targets - samples.features.evaluate(coef)
        size = np.abs(residuals).sum(axis=2)
        reweighted = weights / np.maximum(size, samples.settings.small)
    return coef, residuals


def single_model(samples: Samples) -> tuple[Array, Array, Array]:
    """One model of all samples: least-squares residuals, then robust coefficients and residuals."""
    everything = samples.weights[None, None]
    zero = np.zeros((1, 1, len(samples.targets), len(samples.features.values)))
    start, least_squares = _towards_l1(samples, everything, zero, 0)
    coef, residuals = _towards_l1(samples, everything, start, 5)
    return least_squares[0, 0], coef[0, 0], residuals[0, 0]


def initial_experts(
    samples: Samples, soft_labels: Array, coef: Array, ridge: float | Array
) -> Experts:
    """Mixtures from soft labels (R, M, N): robust experts, then two steps of the gate."""
    # `coef` (n_outputs, n_features) is the single model, where modes without samples stay.
    n_batch, n_modes, _ = soft_labels.shape
    start = np.broadcast_to(coef, (n_batch, n_modes, *coef.shape))
    fitted, residuals = _towards_l1(samples, samples.weights * soft_labels, start, 2)
    nearest = np.square(residuals).min(axis=1)
    variance = 2 * weighted_quantile(nearest, samples.weights, 0.5)
    gate = np.zeros((n_batch, n_modes, len(samples.gate_features.values)))
    log_gate = np.full(soft_labels.shape, -np.log(n_modes))
    for _ in range(2):
        gate, log_gate = newton_step(
            samples.gate_features, gate, log_gate, soft_labels, samples.weights, ridge,
            samples.settings,
        )  # fmt: skip
    variance = np.maximum(variance, samples.settings.exact**2)
    return Experts(fitted, gate, variance, np.zeros(n_batch), residuals, log_gate)


@dataclass(frozen=True)
class GateFeatures:
    """Whitened monomials of standardised coordinates."""

    centre: Array  # (n_coordinates,)
    scale: Array  # (n_coordinates,)
    degree: int
    basis: Basis

    @classmethod
    def of(cls, coordinates: Array, degree: int, weights: Array) -> GateFeatures:
        """Centre, scale and whiten the monomials of some coordinates."""
        centre, scale = centre_and_scale(coordinates, weights)
        design = Monomials.up_to(degree, coordinates.shape[1])((coordinates - centre) / scale)
        return cls(centre, scale, degree, whiten(design, weights))

    def __call__(self, coordinates: Array) -> WhitenedRows:
        """The features at the rows of `coordinates`."""
        points = (coordinates - self.centre) / self.scale
        return self.basis(Monomials.up_to(self.degree, points.shape[1])(points))

    def count(self, degree: int) -> int:
        """How many features span the polynomials up to a degree; they come first."""
        n_coordinates = len(self.centre)
        return self.basis.count_within(comb(n_coordinates + degree, degree))


def gate_degree_within(
    degree: int,
    n_coordinates: int,
    total_weight: float,
    n_modes: int,
    settings: SeedingSettings = DEFAULTS,
) -> int:
    """The largest degree up to `degree` whose monomials the samples can support."""
    # Never below one, where the ridge on the gate takes over.
    supported = total_weight / (settings.samples_a_coefficient * max(n_modes - 1, 1))
    allowed = min(settings.most_gate_features, supported)
    degree = min(degree, max(int(allowed), 1))  # there are more monomials than degrees
    while degree > 1 and comb(n_coordinates + degree, degree) > allowed:
        degree -= 1
    return degree


def newton_step(
    features: WhitenedRows,
    coef: Array,
    log_gate: Array,
    soft_labels: Array,
    weights: Array,
    ridge: float | Array,
    settings: SeedingSettings = DEFAULTS,
) -> tuple[Array, Array]:
    r"""One guarded Newton step on the gate, for a batch of R gates at once.

    Increases, or leaves alone,

    .. math:: \sum_i w_i \sum_m t_{im} \log \pi_m(x_i) - \frac{W}{2} \sum_{mg} r_g a_{mg}^2 ,
              \qquad \pi = \mathrm{softmax}(a_m^\top q(x)), \; W = \sum_i w_i,

    over gates with :math:`\sum_m a_m = 0` (the softmax does not see a common shift, and the
    ridge r removes it). `coef` (R, n_modes, n_gate_features) are the gates a and `log_gate`
    (R, n_modes, n_samples) their log probabilities; both are returned after the step. The soft
    labels t of a sample may sum to less than one: the rest belongs to no mode.
    """
    if coef.shape[1] == 1 or coef.shape[2] == 0:
        return coef, log_gate
    penalty = np.broadcast_to(ridge * weights.sum(), coef.shape[2])
    share = weights * soft_labels.sum(axis=1)
    gate = np.exp(log_gate)
    gradient = features.cross(weights * soft_labels - share[:, None] * gate) - penalty * coef
    step = _newton_direction(features, gate, share, gradient, penalty)
    change = features.evaluate(step)
    largest = np.maximum(np.abs(change).max(axis=(1, 2), keepdims=True), 1e-300)
    shorten = np.minimum(1.0, settings.most_score_change / largest)
    moved = coef + shorten * step
    # log_gate differs from the scores by a shift of each sample, which the softmax removes
    moved_log = log_softmax(log_gate + shorten * change, axis=1)

    def objective(coef, log_gate):
        fit = (soft_labels * log_gate).sum(axis=1) @ weights
        return fit - 0.5 * (penalty * np.square(coef)).sum(axis=(1, 2))

    worse = objective(moved, moved_log) < objective(coef, log_gate)
    if worse.any():
        # The softmax's Hessian is at most I/2, so a gradient step of this length never loses.
        bound = 0.5 * np.linalg.eigvalsh(features.gram(weights)).max() + penalty.max()
        moved[worse] = coef[worse] + gradient[worse] / bound
        moved_log[worse] = log_softmax(features.evaluate(moved[worse]), axis=1)
    return moved, moved_log


def _newton_direction(features, gate, share, gradient, penalty) -> Array:
    # -Hessian = sum_{m<l} (e_m - e_l)(e_m - e_l)' kron G_ml + diag(penalty), with the Gram
    # matrices G_ml of the weightings share * pi_m * pi_l: a graph Laplacian in the modes.
    # Orthonormal coordinates of {sum_m a_m = 0} remove its kernel and one mode of unknowns.
    n_batch, n_modes, n_features = gradient.shape
    pairs = list(combinations(range(n_modes), 2))
    between = features.gram(
        np.stack([share * gate[:, first] * gate[:, second] for first, second in pairs], axis=1)
    )
    reduced = np.linalg.qr((np.eye(n_modes) - 1.0 / n_modes)[:, :-1])[0]
    edges = np.stack([reduced[first] - reduced[second] for first, second in pairs])
    curvature = np.einsum("ea,eb,refg->rafbg", edges, edges, between, optimize=True)
    size = (n_modes - 1) * n_features
    curvature = curvature.reshape(n_batch, size, size) + np.diag(np.tile(penalty, n_modes - 1))
    slope = (reduced.T @ gradient).reshape(n_batch, size, 1)
    step = np.linalg.solve(curvature, slope)
    return reduced @ step.reshape(n_batch, n_modes - 1, n_features)
