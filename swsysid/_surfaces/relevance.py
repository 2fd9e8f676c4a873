r"""Which monomials a surface needs: Bayesian evidence of logistic gates on subsets of them.

A gate on the monomials S gives sample i to the positive side with probability
:math:`\sigma(z_i), z_i = \sum_{k \in S} a_k \phi_{ik}`. With the log ratio
:math:`\rho_i = \log p(\dot x_i | +) - \log p(\dot x_i | -)` of what its velocity says, and prior
:math:`a_k \sim \mathcal N(0, \tau^2)` on monomials of root mean square one,

.. math:: \log p(S) \propto \max_a \Big[ \sum_i w_i \log \frac{\sigma(z_i) e^{\rho_i} +
          \sigma(-z_i)}{\max(e^{\rho_i}, 1)} - \frac{|a|^2}{2 \tau^2} \Big]
          - |S| \log \tau - \tfrac12 \log\det H_S - \log \binom{p}{|S|}

is Laplace's approximation of the evidence, with H the Hessian of what is minimised; the last term
gives every *number* of monomials the same prior. A known label is an infinite ratio, a sample
that says nothing has ratio zero. The relevance of a monomial is the posterior probability of the
subsets that hold it (MacKay 1992, "The evidence framework applied to classification networks").
Where samples are separable, likelihood alone cannot choose; the evidence still measures how much
room a subset leaves to surfaces that separate them.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import lgamma

import numpy as np
from numpy.typing import NDArray

from swsysid._data.rows import spread_rows
from swsysid._results import Array
from swsysid._surfaces.settings import RELEVANCE, RelevanceSettings

Subset = tuple[int, ...]


@dataclass(frozen=True)
class Relevance:
    """What the samples say about the features of one surface."""

    # (n_features,): posterior probability that the surface needs the feature; 0 for less than 0.05.
    share: Array
    advantage: float  # log evidence of the best subset minus that of all features, in nats
    gate: Array  # (n_features,): coefficients of the gate, averaged over the subsets


@dataclass(frozen=True)
class _Gate:
    """The gate of one subset."""

    coef: Array
    values: Array
    evidence: float


def feature_relevance(
    features: Array, log_ratio: Array, weight: Array, settings: RelevanceSettings = RELEVANCE
) -> Relevance:
    """Search subsets of features, the best first, and sum up their evidence.

    `log_ratio` is what the velocity of each sample says for the positive side, in nats.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.linspace(-1, 1, 201)
    >>> cubic = np.column_stack([x**0, x, x**2, x**3])
    >>> found = feature_relevance(cubic, np.where(x**2 > 0.3, 60.0, -60.0), np.ones(201))
    >>> (found.share > 0.5).tolist(), found.advantage > 0
    ([True, False, True, False], True)
    """
    size = np.sqrt(np.average(features**2, axis=0, weights=weight))
    scale = 1.0 / np.where(size > 0.0, size, 1.0)
    log_ratio = np.clip(log_ratio, -settings.certain, settings.certain)
    subsets = _Subsets(features * scale, log_ratio, weight, settings)
    everything = subsets.everything()
    subsets.grow()
    best = max(gate.evidence for gate in subsets.found.values())
    share, mean = np.zeros(len(scale)), np.zeros(len(scale))
    total = sum(np.exp(gate.evidence - best) for gate in subsets.found.values())
    for subset, gate in subsets.found.items():
        probability = np.exp(gate.evidence - best) / total
        share[list(subset)] += probability
        mean[list(subset)] += probability * gate.coef
    share[share < settings.negligible] = 0.0
    return Relevance(np.minimum(share, 1.0), float(best - everything.evidence), mean * scale)


class _Subsets:
    """Gates on subsets of features of root mean square one, found so far."""

    def __init__(self, features, log_ratio, weight, settings: RelevanceSettings):
        self.features, self.log_ratio, self.weight = features, log_ratio, weight
        self.settings = settings
        self.n_features = features.shape[1]
        self.found: dict[Subset, _Gate] = {}

    def everything(self) -> _Gate:
        """The gate on all features; where there are many rows, those near it are kept."""
        full = tuple(range(self.n_features))
        n_rows, n_kept = len(self.features), self.settings.near + self.settings.far
        if n_rows > n_kept:
            self._thin(spread_rows(n_rows, n_kept), full)
        self.fit([full], [np.zeros(self.n_features)])
        return self.found[full]

    def grow(self) -> None:
        """Add one feature after another to the best subsets of each size."""
        front: list[Subset] = [()]
        nothing = np.zeros(len(self.weight))
        best, stall = -float(_loss(nothing, self.log_ratio, self.weight)), 0
        self.found[()] = _Gate(np.zeros(0), nothing, best)
        largest = min(self.settings.largest, self.n_features - 1)
        while stall < self.settings.patience and len(front[0]) < largest:
            starts = {child: start for parent in front for child, start in self._children(parent)}
            self.fit(list(starts), list(starts.values()))
            ranked = sorted(starts, key=lambda subset: -self.found[subset].evidence)
            front = ranked[: self.settings.beam]
            top = self.found[front[0]].evidence
            stall = 0 if top > best else stall + 1
            best = max(best, top)

    def _thin(self, some: NDArray[np.intp], full: Subset) -> None:
        """Keep the rows nearest to a gate fitted to some, and a few of the others."""
        # Any gate in question explains the others; each counts once, as a weight of hundreds would
        # let a single odd velocity decide about the monomials.
        rows, near = (self.features, self.log_ratio, self.weight), self.settings.near
        features, log_ratio, weight = (part[some] for part in rows)
        sample = _Subsets(features, log_ratio, weight, self.settings)
        sample.fit([full], [np.zeros(self.n_features)])
        order = np.argsort(np.abs(self.features @ sample.found[full].coef), kind="stable")
        far = order[near:][spread_rows(len(order) - near, self.settings.far)]
        kept = np.concatenate([order[:near], far])
        self.features, self.log_ratio, self.weight = (part[kept] for part in rows)

    def _children(self, parent: Subset) -> Iterable[tuple[Subset, Array]]:
        """Subsets with one more feature, those of the largest score statistic."""
        gate = self.found[parent]
        slope, curvature = _derivatives(gate.values, self.log_ratio, self.weight)
        gradient = self.features.T @ slope
        score = gradient**2 / (np.square(self.features).T @ curvature + self.settings.prior**-2)
        score[list(parent)] = -1.0
        n_tried = self.settings.first_additions if len(parent) < 3 else self.settings.additions
        for feature in np.argsort(-score, kind="stable")[:n_tried]:
            if score[feature] >= 0.0:
                child = (*parent, int(feature))
                order = np.argsort(child)
                yield tuple(child[k] for k in order), np.append(gate.coef, 0.0)[order]

    def fit(self, subsets: list[Subset], starts: list[Array]) -> None:
        """Fit the gates of subsets of one size together."""
        gates = _fit_gates(
            np.ascontiguousarray(self.features.T[np.array(subsets)].transpose(0, 2, 1)),
            self.log_ratio,
            self.weight,
            np.array(starts),
            self.settings,
        )
        n_features, size = self.n_features, len(subsets[0])
        prior = lgamma(size + 1) + lgamma(n_features - size + 1) - lgamma(n_features + 1)
        for subset, coef, values, evidence in zip(subsets, *gates, strict=True):
            self.found[subset] = _Gate(coef, values, float(evidence + prior))


def _loss(values: Array, log_ratio: Array, weight: Array) -> Array:
    """-sum_i w_i log[(sigma(z) e^rho + sigma(-z)) / max(e^rho, 1)], for a batch of z."""
    shifted = values + log_ratio
    ratio = (1.0 + np.exp(-np.abs(values))) / (1.0 + np.exp(-np.abs(shifted)))
    nats = np.log(ratio) + np.maximum(values, 0.0) - np.maximum(shifted, 0.0)
    return (nats + np.maximum(log_ratio, 0.0)) @ weight


def _gate(values: Array) -> tuple[Array, Array]:
    """sigma(z) and its derivative, from the one exponential that both need."""
    small = np.exp(-np.abs(values))
    unlikely = small / (1.0 + small)
    likely = 1.0 - unlikely
    return np.where(values < 0.0, unlikely, likely), unlikely * likely


def _derivatives(values: Array, log_ratio: Array, weight: Array) -> tuple[Array, Array]:
    """First and second derivative of minus the loss, and of it, by every z_i."""
    # The loss is concave where a sample is doubtful; a share of the convex part keeps the second
    # derivative positive.
    (prior, convex), (posterior, concave) = _gate(values), _gate(values + log_ratio)
    curvature = np.maximum(convex - concave, 0.05 * convex)
    return weight * (posterior - prior), weight * curvature


def _fit_gates(
    features: Array,
    log_ratio: Array,
    weight: Array,
    coef: Array,
    settings: RelevanceSettings = RELEVANCE,
) -> tuple[Array, Array, Array]:
    """Newton's method with step halving, for a batch of gates, from `coef` (n_gates, size)."""
    # `features` are (n_gates, n_samples, size). Returns coefficients, values (n_gates, n_samples)
    # and evidence (n_gates,), without the prior of the subset.
    transposed = np.ascontiguousarray(features.transpose(0, 2, 1))
    precision = settings.prior**-2

    ridge = precision * np.eye(features.shape[2])

    def objective(values, coef):
        penalty = 0.5 * precision * np.square(coef).sum(axis=1)
        return _loss(values, log_ratio, weight) + penalty

    values = _product(features, coef)
    objectives = objective(values, coef)
    active = np.arange(len(coef))
    for _ in range(settings.newton_steps):
        now, at = values[active], coef[active]
        slope, curvature = _derivatives(now, log_ratio, weight)
        gradient = precision * at - _product(transposed[active], slope)
        hessian = np.matmul(transposed[active] * curvature[:, None, :], features[active])
        step = -np.linalg.solve(hessian + ridge, gradient[..., None])[..., 0]
        change = _product(features[active], step)
        descent = 1e-4 * (gradient * step).sum(axis=1)
        before = objectives[active]
        length, after = np.ones(len(active)), before.copy()
        waiting = np.arange(len(active))
        for _ in range(settings.halvings):
            moved = length[waiting, None]
            tried = objective(
                now[waiting] + moved * change[waiting], at[waiting] + moved * step[waiting]
            )
            good = tried <= before[waiting] + length[waiting] * descent[waiting]
            after[waiting[good]] = tried[good]
            waiting = waiting[~good]
            if not waiting.size:
                break
            length[waiting] *= 0.5
        length[waiting] = 0.0
        coef[active] = at + length[:, None] * step
        values[active] = now + length[:, None] * change
        objectives[active] = after
        active = active[before - after > settings.tolerance]
        if not active.size:
            break
    return (
        coef,
        values,
        -objectives - _occam(features, transposed, values, log_ratio, weight, settings.prior),
    )


def _occam(features, transposed, values, log_ratio, weight, prior) -> Array:
    """|S| log tau + log det(H) / 2; directions that no sample bends keep the prior's curvature."""
    (_, convex), (_, concave) = _gate(values), _gate(values + log_ratio)
    curvature = weight * (convex - concave)
    hessian = np.matmul(transposed * curvature[:, None, :], features)
    bends = np.maximum(np.linalg.eigvalsh(hessian) + prior**-2, prior**-2)
    return features.shape[2] * np.log(prior) + 0.5 * np.log(bends).sum(axis=1)


def _product(matrices: Array, vectors: Array) -> Array:
    return np.matmul(matrices, vectors[..., None])[..., 0]
