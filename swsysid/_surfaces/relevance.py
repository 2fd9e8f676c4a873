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
from scipy.special import expit

from swsysid._data.rows import spread_rows
from swsysid._results import Array
from swsysid._surfaces.settings import RelevanceSettings

__all__ = ["Relevance", "feature_relevance"]

Subset = tuple[int, ...]

SETTINGS = RelevanceSettings()


@dataclass(frozen=True)
class Relevance:
    """What the samples say about the features of one surface.

    Attributes
    ----------
    share : ndarray of shape (n_features,)
        Posterior probability that the surface needs the feature; 0 for less than 0.05.
    advantage : float
        Log evidence of the best subset minus that of all features, in nats.
    gate : ndarray of shape (n_features,)
        Coefficients of the gate, averaged over the subsets.
    """

    share: Array
    advantage: float
    gate: Array


@dataclass(frozen=True)
class _Gate:
    """The gate of one subset."""

    coef: Array
    values: Array
    evidence: float


def feature_relevance(features: Array, log_ratio: Array, weight: Array) -> Relevance:
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
    subsets = _Subsets(
        features * scale, np.clip(log_ratio, -SETTINGS.certain, SETTINGS.certain), weight
    )
    everything = subsets.everything()
    subsets.grow()
    best = max(gate.evidence for gate in subsets.found.values())
    share, mean = np.zeros(len(scale)), np.zeros(len(scale))
    total = sum(np.exp(gate.evidence - best) for gate in subsets.found.values())
    for subset, gate in subsets.found.items():
        probability = np.exp(gate.evidence - best) / total
        share[list(subset)] += probability
        mean[list(subset)] += probability * gate.coef
    share[share < SETTINGS.negligible] = 0.0
    return Relevance(np.minimum(share, 1.0), float(best - everything.evidence), mean * scale)


class _Subsets:
    """Gates on subsets of features of root mean square one, found so far."""

    def __init__(self, features: Array, log_ratio: Array, weight: Array):
        self.features, self.log_ratio, self.weight = features, log_ratio, weight
        self.n_features = features.shape[1]
        self.found: dict[Subset, _Gate] = {}

    def everything(self) -> _Gate:
        """The gate on all features; where there are many rows, those near it are kept."""
        full = tuple(range(self.n_features))
        n_rows = len(self.features)
        if n_rows > SETTINGS.near + SETTINGS.far:
            self._thin(spread_rows(n_rows, SETTINGS.near + SETTINGS.far), full)
        self._fit([full], [np.zeros(self.n_features)])
        return self.found[full]

    def grow(self) -> None:
        """Add one feature after another to the best subsets of each size."""
        front: list[Subset] = [()]
        self.found[()] = self._empty()
        best, stall = self.found[()].evidence, 0
        while stall < SETTINGS.patience and len(front[0]) < min(
            SETTINGS.largest, self.n_features - 1
        ):
            starts = {child: start for parent in front for child, start in self._children(parent)}
            self._fit(list(starts), list(starts.values()))
            front = sorted(starts, key=lambda subset: -self.found[subset].evidence)[: SETTINGS.beam]
            top = self.found[front[0]].evidence
            stall = 0 if top > best else stall + 1
            best = max(best, top)

    def _thin(self, some: NDArray[np.intp], full: Subset) -> None:
        """Keep the rows nearest to a gate fitted to some, and a few of the others.

        Any gate in question explains the others; each counts once, as a weight of hundreds would
        let a single odd velocity decide about the monomials.
        """
        rows = self.features, self.log_ratio, self.weight
        sample = _Subsets(*(part[some] for part in rows))
        sample._fit([full], [np.zeros(self.n_features)])
        order = np.argsort(np.abs(self.features @ sample.found[full].coef), kind="stable")
        far = order[SETTINGS.near :][spread_rows(len(order) - SETTINGS.near, SETTINGS.far)]
        kept = np.concatenate([order[: SETTINGS.near], far])
        self.features, self.log_ratio, self.weight = (part[kept] for part in rows)

    def _empty(self) -> _Gate:
        nothing = np.zeros(len(self.weight))
        value = -_loss(nothing, self.log_ratio, self.weight)
        return _Gate(np.zeros(0), nothing, float(value))

    def _children(self, parent: Subset) -> Iterable[tuple[Subset, Array]]:
        """Subsets with one more feature, those of the largest score statistic."""
        gate = self.found[parent]
        slope, curvature = _derivatives(gate.values, self.log_ratio, self.weight)
        gradient = self.features.T @ slope
        score = gradient**2 / (np.square(self.features).T @ curvature + SETTINGS.prior**-2)
        score[list(parent)] = -1.0
        n_tried = SETTINGS.first_additions if len(parent) < 3 else SETTINGS.additions
        for feature in np.argsort(-score, kind="stable")[:n_tried]:
            if score[feature] >= 0.0:
                child = (*parent, int(feature))
                order = np.argsort(child)
                yield tuple(child[k] for k in order), np.append(gate.coef, 0.0)[order]

    def _fit(self, subsets: list[Subset], starts: list[Array]) -> None:
        """Fit the gates of subsets of one size together."""
        gates = _fit_gates(
            np.ascontiguousarray(self.features.T[np.array(subsets)].transpose(0, 2, 1)),
            self.log_ratio,
            self.weight,
            np.array(starts),
        )
        n_features, size = self.n_features, len(subsets[0])
        prior = lgamma(size + 1) + lgamma(n_features - size + 1) - lgamma(n_features + 1)
        for subset, coef, values, evidence in zip(subsets, *gates, strict=True):
            self.found[subset] = _Gate(coef, values, float(evidence + prior))


def _loss(values: Array, log_ratio: Array, weight: Array) -> Array:
    """-sum_i w_i log[(sigma(z) e^rho + sigma(-z)) / max(e^rho, 1)], for a batch of z."""
    nats = _softplus(values) - _softplus(values + log_ratio)
    return (nats + np.maximum(log_ratio, 0.0)) @ weight


def _softplus(values: Array) -> Array:
    """log(1 + e^z), to an absolute error of rounding; a third of the time of ``logaddexp``."""
    small = np.exp(-np.abs(values))
    small += 1.0
    np.log(small, out=small)
    small += np.maximum(values, 0.0)
    return small


def _derivatives(values: Array, log_ratio: Array, weight: Array) -> tuple[Array, Array]:
    """First and second derivative of minus the loss, and of it, by every z_i.

    The loss is concave where a sample is doubtful; a share of the convex part keeps the second
    derivative positive.
    """
    prior, posterior = expit(values), expit(values + log_ratio)
    convex = prior * (1.0 - prior)
    curvature = np.maximum(convex - posterior * (1.0 - posterior), 0.05 * convex)
    return weight * (posterior - prior), weight * curvature


def _fit_gates(
    features: Array, log_ratio: Array, weight: Array, coef: Array
) -> tuple[Array, Array, Array]:
    """Newton's method with step halving, for a batch of gates, from `coef` (n_gates, size).

    `features` are (n_gates, n_samples, size). Returns coefficients, values (n_gates, n_samples)
    and evidence (n_gates,), without the prior of the subset.
    """
    transposed = np.ascontiguousarray(features.transpose(0, 2, 1))
    precision = SETTINGS.prior**-2 * np.eye(features.shape[2])

    def objective(values, coef):
        penalty = 0.5 * SETTINGS.prior**-2 * np.square(coef).sum(axis=1)
        return _loss(values, log_ratio, weight) + penalty

    values = _product(features, coef)
    objectives = objective(values, coef)
    active = np.arange(len(coef))
    for _ in range(SETTINGS.newton_steps):
        now, at = values[active], coef[active]
        slope, curvature = _derivatives(now, log_ratio, weight)
        gradient = SETTINGS.prior**-2 * at - _product(transposed[active], slope)
        hessian = np.matmul(transposed[active] * curvature[:, None, :], features[active])
        step = -np.linalg.solve(hessian + precision, gradient[..., None])[..., 0]
        change = _product(features[active], step)
        descent = 1e-4 * (gradient * step).sum(axis=1)
        before = objectives[active]
        length, after = np.ones(len(active)), before.copy()
        waiting = np.arange(len(active))
        for _ in range(SETTINGS.halvings):
            moved = length[waiting, None]
            tried = objective(
                now[waiting] + moved * change[waiting], at[waiting] + moved * step[waiting]
            )
            good = tried <= before[waiting] + length[waiting] * descent[waiting]
            after[waiting[good]] = tried[good]
            waiting = waiting[~good]
            length[waiting] *= 0.5
        length[waiting] = 0.0
        coef[active] = at + length[:, None] * step
        values[active] = now + length[:, None] * change
        objectives[active] = after
        active = active[before - after > SETTINGS.tolerance]
        if not active.size:
            break
    return coef, values, -objectives - _occam(features, transposed, values, log_ratio, weight)


def _occam(features, transposed, values, log_ratio, weight) -> Array:
    """|S| log tau + log det(H) / 2; directions that no sample bends keep the prior's curvature."""
    prior, posterior = expit(values), expit(values + log_ratio)
    curvature = weight * (prior * (1.0 - prior) - posterior * (1.0 - posterior))
    hessian = np.matmul(transposed * curvature[:, None, :], features)
    bends = np.maximum(np.linalg.eigvalsh(hessian) + SETTINGS.prior**-2, SETTINGS.prior**-2)
    return features.shape[2] * np.log(SETTINGS.prior) + 0.5 * np.log(bends).sum(axis=1)


def _product(matrices: Array, vectors: Array) -> Array:
    return np.matmul(matrices, vectors[..., None])[..., 0]
