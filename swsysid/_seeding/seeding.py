"""Seeds: partitions of the samples from which the alternation finds the right answer.

1. Scale the targets robustly, whiten the features, cap the degree of the gate.
2. Search with soft EM from random level sets and from laws of neighbourhoods (`search`).
3. Fit the best distinct partitions again with normal noise and an outlier class, and rank them by
   their joint likelihood.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from sklearn.utils import check_random_state

from swsysid._data.rows import thinned_rows
from swsysid._journal import step
from swsysid._noise import NORMAL, Outliers, weighted_quantile
from swsysid._results import Array
from swsysid._seeding.designs import Basis, centre_and_scale, whiten
from swsysid._seeding.experts import Experts, GateFeatures, Samples, gate_degree_within
from swsysid._seeding.search import refine, same_partition, search
from swsysid._seeding.settings import DEFAULTS, SeedingSettings


@dataclass(frozen=True)
class Preparation:
    """What turns features, targets and coordinates into samples of the mixtures."""

    basis: Basis  # of the dynamics features
    gate_features: GateFeatures
    # (n_outputs,): false for an output that one model of all samples explains exactly (a known
    # equation, a constant): it says nothing about the modes and is left out.
    informative: NDArray[np.bool_]
    # (n_informative,): typical deviation of the informative outputs; the targets are divided by it.
    scale: Array
    outliers: Outliers  # of the scaled targets
    settings: SeedingSettings

    @classmethod
    def of(
        cls,
        features: Array,
        targets: Array,
        coordinates: Array,
        weights: Array,
        degree: int,
        settings: SeedingSettings,
    ) -> Preparation:
        """Units and bases of some rows, for a gate of some degree."""
        middle = weighted_quantile(targets, weights, 0.5, axis=0)
        distance = np.abs(targets - middle)
        # The median alone would vanish for an output that is constant on most samples.
        scale = np.maximum(
            weighted_quantile(distance, weights, 0.5, axis=0),
            settings.least_of_mean * (weights @ distance) / weights.sum(),
        )
        informative = scale > 1e-12 * np.abs(middle)
        basis = whiten(features, weights)
        rows = basis(features)
        scaled = targets[:, informative] / scale[informative]
        single = rows.cross(weights * scaled.T) / weights.sum()
        left = np.abs(scaled.T - rows.evaluate(single)).max(axis=1)
        size = 1 + np.abs(middle[informative] / scale[informative])
        varies = left > settings.exact * size
        informative[informative] = varies
        centre = middle[informative] / scale[informative]
        outliers = Outliers(centre, np.full(len(centre), settings.outlier_breadth))
        gate_features = GateFeatures.of(coordinates, degree, weights)
        return cls(basis, gate_features, informative, scale[informative], outliers, settings)

    def __call__(
        self, features: Array, targets: Array, coordinates: Array, weights: Array
    ) -> Samples:
        """Samples at the given rows."""
        scaled = targets[:, self.informative] / self.scale
        return Samples(
            self.basis(features),
            self.gate_features(coordinates),
            np.ascontiguousarray(scaled.T),
            weights,
            self.outliers.log_density(scaled),
            self.gate_features.count(self.settings.coarse_degree),
            self.settings,
        )


@dataclass(frozen=True)
class Seed:
    """One partition of the samples, and the mixture that made it."""

    # (n_samples,): most probable mode of every sample, given its coordinates and its target.
    labels: NDArray[np.intp]
    # (n_samples, n_modes): their probabilities; those of an outlier come from the gate alone.
    responsibilities: Array
    inlier: Array  # (n_samples,): probability that a sample is no outlier
    # Weighted sum of the log densities of the targets in the user's units, given the coordinates,
    # over the informative outputs.
    log_likelihood: float
    # How many of the starts that reached the last stage of the search found this partition.
    hits: int
    n_starts: int  # how many starts were drawn
    experts: Experts  # a batch of one mixture
    preparation: Preparation

    def held_out_residuals(self, features: Array, targets: Array, coordinates: Array) -> Array:
        """Residuals of held-out samples in the mode that their coordinates alone say."""
        # Shape (n_samples, n_informative), each output in units of its typical deviation.
        samples = self.preparation(features, targets, coordinates, np.ones(len(features)))
        experts = self.experts.at(samples)
        modes = experts.log_gate[0].argmax(axis=0)
        return experts.residuals[0, modes, :, np.arange(len(modes))]


@step
def seed_modes(
    features: Array,
    targets: Array,
    coordinates: Array,
    *,
    n_modes: int,
    gate_degree: int = 2,
    sample_weight: Array | None = None,
    n_starts: int | str = "auto",
    first_labels: NDArray[np.intp] | None = None,
    random_state=None,
    settings: SeedingSettings = DEFAULTS,
) -> list[Seed]:
    r"""Partitions of the samples into modes, the most likely first.

    Local maxima of the likelihood of a mixture of linear experts with a polynomial gate,

    .. math:: \prod_i \Big[ (1 - e) \sum_m \pi_m(x_i) \,
              \mathcal N(\dot x_i; C_m \Phi(x_i), \mathrm{diag}(s^2)) + e \, u(\dot x_i) \Big],
              \qquad \pi = \mathrm{softmax}(a_m^\top q(x)),

    with q the monomials of the coordinates and u a broad normal law for outliers.

    One to three seeds, no two of the same partition; a mode may be empty where the samples do not
    determine it. `gate_degree` is lowered where the samples do not support so many monomials, never
    below 1. ``n_starts="auto"`` stops when the best partition repeats; `first_labels`, (n_given,
    n_samples), are starts besides the random ones. Many rows are thinned for the search and for
    the fit; labels are given to all of them.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid._seeding.seeding import seed_modes
    >>> x = np.linspace(-1, 1, 200)[:, None]
    >>> seeds = seed_modes(x, np.abs(x), x, n_modes=2, gate_degree=1, random_state=0)
    >>> bool((seeds[0].labels[x[:, 0] > 0] == seeds[0].labels[-1]).all())
    True
    """
    weights = np.ones(len(features)) if sample_weight is None else np.asarray(sample_weight, float)
    centre, scale = centre_and_scale(coordinates, weights)
    rows, counts = thinned_rows(weights, settings.most_rows)
    fitted = features[rows], targets[rows], coordinates[rows], counts
    degree = gate_degree_within(gate_degree, coordinates.shape[1], counts.sum(), n_modes, settings)
    preparation = Preparation.of(*fitted, degree, settings)
    samples = preparation(*fitted)
    given = np.empty((0, len(weights)), dtype=np.intp) if first_labels is None else first_labels
    pool, drawn = search(
        samples,
        (coordinates[rows] - centre) / scale,
        n_modes=n_modes,
        n_starts=n_starts,
        first_labels=given[:, rows],
        random_state=check_random_state(random_state),
    )
    experts = refine(samples, pool.experts).most_populated_first(samples.weights)
    everything = features, targets, coordinates, weights
    seeds = [
        _seed(preparation, experts.take([member]), everything, int(hits), drawn)
        for member, hits in enumerate(pool.hits)
    ]
    return _distinct(sorted(seeds, key=lambda seed: -seed.log_likelihood), weights)


def _seed(preparation, experts, everything, hits, n_starts) -> Seed:
    """The partition of all rows by a mixture, some of them at a time."""
    weights, n_at_once = everything[-1], preparation.settings.most_rows
    parts, inliers = [], []
    log_likelihood = -weights.sum() * np.log(preparation.scale).sum()
    for start in range(0, len(weights), n_at_once):
        some = slice(start, start + n_at_once)
        samples = preparation(*(values[some] for values in everything))
        moved = experts.at(samples)
        posterior = moved.posterior(samples, NORMAL)
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
        for place, other in enumerate(kept):
            if same_partition(other.labels, seed.labels, weights):
                kept[place] = replace(other, hits=other.hits + seed.hits)
                break
        else:
            kept.append(seed)
    return kept
