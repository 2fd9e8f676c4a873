"""Seeds: partitions of the samples from which the alternation finds the right answer.

1. Scale the targets robustly, whiten the features, cap the degree of the gate.
2. Search with soft EM from random level sets (`search`).
3. Fit the best distinct partitions again with Gaussian noise and an outlier class, and rank
   them by their joint likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sklearn.utils import check_random_state

from swsysid._noise import weighted_quantile
from swsysid._results import Array
from swsysid._seeding.designs import Basis, centre_and_scale, whiten
from swsysid._seeding.experts import Experts, Samples
from swsysid._seeding.gate import GateFeatures, fit_gate_features, gate_degree_within, log_softmax
from swsysid._seeding.search import GAUSSIAN, MOST_STARTS, refine, same_partition, search
from swsysid._seeding.starts import some_rows

__all__ = ["Preparation", "Seed", "held_out_residuals", "seed_modes"]

_MAX_ROWS = 20_000
_COARSE_DEGREE = 2
_OUTLIER_SPREAD = 5.0
_EXACT = 1e-7


@dataclass(frozen=True)
class Preparation:
    """What turns features, targets and coordinates into samples of the mixtures.

    Attributes
    ----------
    basis : Basis
        Of the dynamics features.
    gate_features : GateFeatures
    informative : ndarray of shape (n_outputs,), bool
        False for an output that one model of all samples explains exactly (a known equation,
        a constant): it says nothing about the modes and is left out.
    scale : ndarray of shape (n_informative,)
        Typical deviation of the informative outputs; the targets are divided by it.
    centre : ndarray of shape (n_informative,)
        Their medians over `scale`, where the outlier class is centred.
    """

    basis: Basis
    gate_features: GateFeatures
    informative: NDArray[np.bool_]
    scale: Array
    centre: Array

    def __call__(
        self, features: Array, targets: Array, coordinates: Array, weights: Array
    ) -> Samples:
        """Samples at the given rows."""
        scaled = np.ascontiguousarray((targets[:, self.informative] / self.scale).T)
        distance = np.square((scaled - self.centre[:, None]) / _OUTLIER_SPREAD).sum(axis=0)
        log_norm = len(scaled) * np.log(_OUTLIER_SPREAD * np.sqrt(2 * np.pi))
        return Samples(
            self.basis(features),
            self.gate_features(coordinates),
            scaled,
            weights,
            -0.5 * distance - log_norm,
        )


@dataclass(frozen=True)
class Seed:
    """One partition of the samples, and the mixture that made it.

    Attributes
    ----------
    labels : ndarray of shape (n_samples,), int
        Most probable mode of every sample, given its coordinates and its target.
    responsibilities : ndarray of shape (n_samples, n_modes)
        Their probabilities; those of an outlier come from the gate alone.
    inlier : ndarray of shape (n_samples,)
        Probability that a sample is no outlier.
    log_likelihood : float
        Weighted sum of the log densities of the targets in the user's units, given the
        coordinates, over the informative outputs.
    hits : int
        How many of the starts that reached the last stage of the search found this partition.
    n_starts : int
        How many starts were drawn.
    experts : Experts
        A batch of one mixture.
    preparation : Preparation
    """

    labels: NDArray[np.intp]
    responsibilities: Array
    inlier: Array
    log_likelihood: float
    hits: int
    n_starts: int
    experts: Experts
    preparation: Preparation

    def gate_probabilities(self, coordinates: Array) -> Array:
        """Probabilities of the modes at coordinates alone, (n_samples, n_modes)."""
        gate_features = self.preparation.gate_features(coordinates)
        return np.exp(log_softmax(gate_features.evaluate(self.experts.gate[0]))).T


def seed_modes(
    features: Array,
    targets: Array,
    coordinates: Array,
    *,
    n_modes: int,
    gate_degree: int = 2,
    sample_weight: Array | None = None,
    n_starts: int | str = "auto",
    most_starts: int = MOST_STARTS,
    first_labels: NDArray[np.intp] | None = None,
    random_state=None,
) -> list[Seed]:
    r"""Partitions of the samples into modes, the most likely first.

    Local maxima of the likelihood of a mixture of linear experts with a polynomial gate,

    .. math:: \prod_i \Big[ (1 - e) \sum_m \pi_m(x_i) \,
              \mathcal N(\dot x_i; C_m \Phi(x_i), \mathrm{diag}(s^2)) + e \, u(\dot x_i) \Big],
              \qquad \pi = \mathrm{softmax}(a_m^\top q(x)),

    with q the monomials of the coordinates and u a broad Gaussian for outliers.

    Parameters
    ----------
    features : ndarray of shape (n_samples, n_features)
        :math:`\Phi(X)`.
    targets : ndarray of shape (n_samples, n_outputs)
        Velocities.
    coordinates : ndarray of shape (n_samples, n_coordinates)
        Where the gate lives.
    n_modes : int
    gate_degree : int, default=2
        Lowered where the monomials would exceed 50, or a fifth of the weight for each mode but
        one; never below 1.
    sample_weight : ndarray of shape (n_samples,), default=None
        Repetitions of the rows.
    n_starts : int or "auto", default="auto"
        Number of random starts; ``"auto"`` stops when the best partition repeats.
    most_starts : int, default=96
        Limit of ``n_starts="auto"``.
    first_labels : ndarray of shape (n_given, n_samples), default=None
        Labels to start from besides the random ones.
    random_state : int, RandomState or None, default=None

    Returns
    -------
    list of Seed
        One to three, no two of the same partition. A mode may be empty where the samples do not
        determine it.

    Notes
    -----
    More than 20000 rows are thinned to that many for the fit, and to 3000 for the search; labels
    are given to all rows.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid._seeding.seeding import seed_modes
    >>> x = np.linspace(-1, 1, 200)[:, None]
    >>> seeds = seed_modes(x, np.abs(x), x, n_modes=2, gate_degree=1, random_state=0)
    >>> bool((seeds[0].labels[x[:, 0] > 0] == seeds[0].labels[-1]).all())
    True
    """
    random_state = check_random_state(random_state)
    weights = np.ones(len(features)) if sample_weight is None else np.asarray(sample_weight, float)
    points = _standardised(coordinates, weights)
    rows, counts = some_rows(points, weights, _MAX_ROWS, random_state)
    fitted_rows = features[rows], targets[rows], coordinates[rows], counts
    preparation = _prepare(*fitted_rows, gate_degree=gate_degree, n_modes=n_modes)
    samples = preparation(*fitted_rows)
    n_coarse = preparation.gate_features.count(_COARSE_DEGREE)
    given = np.empty((0, len(weights)), dtype=np.intp) if first_labels is None else first_labels
    pool, drawn = search(
        samples,
        points[rows],
        n_modes=n_modes,
        n_starts=n_starts,
        most_starts=most_starts,
        first_labels=given[:, rows],
        n_coarse=n_coarse,
        random_state=random_state,
    )
    experts = refine(samples, pool.experts, n_coarse)
    all_rows = features, targets, coordinates, weights
    seeds = [
        _describe(preparation, experts.take([member]), all_rows, int(hits), drawn)
        for member, hits in enumerate(pool.hits)
    ]
    return _distinct(sorted(seeds, key=lambda seed: -seed.log_likelihood), weights)


def held_out_residuals(seed: Seed, features: Array, targets: Array, coordinates: Array) -> Array:
    """Residuals of held-out samples in the mode that their coordinates alone say.

    Shape (n_samples, n_informative), each output in units of its typical deviation.
    """
    samples = seed.preparation(features, targets, coordinates, np.ones(len(features)))
    experts = seed.experts.at(samples)
    modes = experts.log_gate[0].argmax(axis=0)
    return experts.residuals[0, modes, :, np.arange(len(modes))]


def _standardised(coordinates, weights) -> Array:
    centre, scale = centre_and_scale(coordinates, weights)
    return (coordinates - centre) / scale


def _prepare(features, targets, coordinates, weights, *, gate_degree, n_modes) -> Preparation:
    middle = weighted_quantile(targets.T, weights, 0.5)
    deviation = np.abs(targets.T - middle[:, None])
    # The median alone would vanish for an output that is constant on most samples.
    scale = np.maximum(
        weighted_quantile(deviation, weights, 0.5), 0.25 * (deviation @ weights) / weights.sum()
    )
    basis = whiten(features, weights)
    informative = scale > 1e-12 * np.abs(middle)
    scaled = targets.T[informative] / scale[informative, None]
    centre = middle[informative] / scale[informative]
    rows = basis(features)
    single = rows.cross(weights * scaled) / weights.sum()
    left = np.abs(scaled - rows.evaluate(single)).max(axis=1)
    varies = left > _EXACT * (1 + np.abs(centre))
    informative[informative] = varies
    degree = gate_degree_within(gate_degree, coordinates.shape[1], weights.sum(), n_modes)
    gate_features: GateFeatures = fit_gate_features(coordinates, degree, weights)
    return Preparation(basis, gate_features, informative, scale[informative], centre[varies])


def _describe(preparation, experts, all_rows, hits, n_starts) -> Seed:
    weights = all_rows[-1]
    parts, inliers = [], []
    log_likelihood = -weights.sum() * np.log(preparation.scale).sum()
    for start in range(0, len(weights), _MAX_ROWS):
        samples = preparation(*(part[start : start + _MAX_ROWS] for part in all_rows))
        moved = experts.at(samples)
        posterior = moved.posterior(samples, GAUSSIAN)
        # An outlier's target says nothing about its mode: Bayes leaves the gate.
        inlier = posterior.inlier[0]
        inliers.append(inlier)
        parts.append(inlier * posterior.modes[0] + (1 - inlier) * np.exp(moved.log_gate[0]))
        log_likelihood += posterior.log_density[0] @ samples.weights
    responsibilities = np.concatenate(parts, axis=1).T
    return Seed(
        labels=responsibilities.argmax(axis=1),
        responsibilities=responsibilities,
        inlier=np.concatenate(inliers),
        log_likelihood=float(log_likelihood),
        hits=hits,
        n_starts=n_starts,
        experts=experts,
        preparation=preparation,
    )


def _distinct(seeds: list[Seed], weights: Array) -> list[Seed]:
    """Each partition once: final fits of two candidates may have met."""
    kept: list[Seed] = []
    for seed in seeds:
        twins = [
            k for k, other in enumerate(kept) if same_partition(other.labels, seed.labels, weights)
        ]
        if twins:
            kept[twins[0]] = replace(kept[twins[0]], hits=kept[twins[0]].hits + seed.hits)
        else:
            kept.append(seed)
    return kept
