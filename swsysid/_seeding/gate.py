"""The gate: probabilities of the modes as a softmax of polynomials of the coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import comb

import numpy as np
from scipy.special import log_softmax

from swsysid._data.features import Monomials
from swsysid._results import Array
from swsysid._seeding.designs import Basis, WhitenedRows, centre_and_scale, whiten
from swsysid._seeding.settings import DEFAULTS, SeedingSettings


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
