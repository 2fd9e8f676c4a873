r"""Surfaces that the data allow: a sample of them, by hit-and-run.

Samples on both sides of a surface leave it room to move. With the log odds :math:`o_i` for the
positive side of row i, which are :math:`\pm\infty` where its label is certain, and a flat prior,
the surface :math:`f(x) = a^\top \phi(x)` has the posterior

.. math:: p(a) \propto \prod_i \big( \epsilon + (1 - 2 \epsilon) \,
          \sigma(\pm o_i) \big)^{w_i}, \qquad \pm = \mathrm{sign} f(x_i),

where :math:`\epsilon` is the chance of a wrong label: piecewise constant in a, with a jump where f
passes a row. Of coefficients that differ by a factor one is kept, by a linear condition
:math:`g^\top a = g^\top \hat a`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import log_expit

from swsysid._data.rows import spread_rows
from swsysid._results import Array
from swsysid._surfaces.settings import PosteriorSettings

__all__ = ["SurfaceEvidence", "sample_surface"]

SETTINGS = PosteriorSettings()


@dataclass(frozen=True)
class SurfaceEvidence:
    """What is known about one surface.

    Attributes
    ----------
    features : ndarray of shape (n_samples, n_surface_features)
    odds : ndarray of shape (n_samples,)
        Log odds for the positive side, also infinite; 0 says nothing.
    weight : ndarray of shape (n_samples,)
    coef : ndarray of shape (n_surface_features,)
        The surface that was fitted.
    error_rate : float
        Chance of a label on the wrong side.
    """

    features: Array
    odds: Array
    weight: Array
    coef: Array
    error_rate: float

    @classmethod
    def of(
        cls,
        features: Array,
        odds: Array,
        weight: Array,
        coef: Array,
        settings: PosteriorSettings = SETTINGS,
    ) -> SurfaceEvidence:
        """Evidence with the error rate that the fitted surface shows, half an error added."""
        wrong = ((features @ coef) * np.sign(odds) < 0.0) & (np.abs(odds) > settings.certain)
        rows = np.flatnonzero(odds)
        rate = (weight[wrong].sum() + 0.5) / (weight[rows].sum() + 1.0)
        most = settings.most_rows
        if len(rows) > most:
            some = features[rows]
            distance = np.abs(some @ coef) / np.linalg.norm(some, axis=1)
            rows = rows[np.sort(np.argpartition(distance, most - 1)[:most])]
        return cls(features[rows], odds[rows], weight[rows], coef, float(min(rate, 0.5)))

    @property
    def log_odds(self) -> Array:
        """Log odds for the positive side in view of the error rate, times the weight."""
        with np.errstate(divide="ignore"):
            right, wrong = np.log(1.0 - 2.0 * self.error_rate), np.log(self.error_rate)
        sides = (np.logaddexp(wrong, right + log_expit(side * self.odds)) for side in (1.0, -1.0))
        return self.weight * np.subtract(*sides)


def sample_surface(
    evidence: SurfaceEvidence,
    random_state: np.random.RandomState,
    settings: PosteriorSettings = SETTINGS,
) -> Array:
    """Coefficients drawn from the posterior, shape (n_draws, n_surface_features).

    Hit-and-run: from where a chain is, a random direction is taken, and the posterior along it,
    a step function, is drawn from exactly. Directions are those of an ellipsoid that fits
    between the rows, or differences of the other chains, which have found the posterior's shape.
    """
    columns = np.sqrt(np.mean(evidence.features**2, axis=0))
    columns[columns == 0.0] = 1.0
    features, coef = evidence.features / columns, evidence.coef * columns
    odds = evidence.log_odds
    informed = np.minimum(np.abs(odds), evidence.weight)
    gauge = (np.sign(odds) * informed) @ features
    if not gauge @ coef > 0.0:  # the surface vanished, or the labels say nothing
        return np.repeat(evidence.coef[None, :], settings.chains * settings.kept, axis=0)
    root = _ellipsoid(features, informed, coef)
    rows = _stopping_rows(features, informed, coef, root, settings)
    line = _Line(features[rows], odds[rows], settings)

    chains, kept = np.repeat(coef[None, :], settings.chains, axis=0), []
    halves = np.arange(settings.chains).reshape(2, -1)
    farthest = settings.farthest * np.linalg.norm(coef)
    burn_in = settings.burn_in + settings.burn_in_a_coefficient * len(coef)
    for step in range(burn_in + settings.kept * settings.every):
        for half, other in (halves, halves[::-1]):
            if step >= settings.first_steps and random_state.random_sample() < 0.5:
                spread = chains[other] - chains[other].mean(axis=0)
                moves = random_state.standard_normal((len(half), len(other))) @ spread
                moves /= np.sqrt(len(other))
            else:
                moves = random_state.standard_normal((len(half), len(coef))) @ root
                moves -= np.outer(moves @ gauge / (gauge @ coef), coef)
            moved = chains[half] + line.draw(chains[half], moves, random_state)[:, None] * moves
            inside = np.linalg.norm(moved, axis=1) <= farthest
            chains[half[inside]] = moved[inside]
        if step >= burn_in and (step - burn_in + 1) % settings.every == 0:
            kept.append(chains / columns)
    return np.concatenate(kept)


@dataclass(frozen=True)
class _Line:
    """The posterior along lines in the space of coefficients."""

    features: Array
    odds: Array
    settings: PosteriorSettings

    def draw(self, chains: Array, moves: Array, random_state) -> Array:
        """How far every chain goes along its move, drawn from the posterior on that line.

        f passes row i at t_i = -f_i / (change of f_i), where the log posterior jumps by the log
        odds if f becomes positive, by their negative if it becomes negative.
        """
        longest, n_met = self.settings.longest, self.settings.met
        values, change = chains @ self.features.T, moves @ self.features.T
        with np.errstate(divide="ignore", invalid="ignore"):
            passing = np.nan_to_num(-values / change, nan=longest).clip(-longest, longest)
        jump = np.where(change > 0.0, self.odds, -self.odds)
        chain = np.arange(len(chains))[:, None]
        end = np.full((len(chains), 1), longest)
        if passing.shape[1] > n_met:
            met = np.argpartition(np.abs(passing), n_met - 1, axis=1)[:, :n_met]
            passing, jump = passing[chain, met], jump[chain, met]
            end = np.abs(passing).max(axis=1, keepdims=True)
        order = passing.argsort(axis=1, kind="stable")
        edges = np.hstack([-end, passing[chain, order], end])
        height = np.hstack([np.zeros_like(end), jump[chain, order].cumsum(axis=1)])
        height = np.exp(height - height.max(axis=1, keepdims=True))
        area = np.cumsum(np.diff(edges, axis=1) * height, axis=1)
        drawn = random_state.random_sample((len(chains), 1)) * area[:, -1:]
        step = np.minimum((area < drawn).sum(axis=1, keepdims=True), area.shape[1] - 1)
        before_edge = (area - drawn)[chain, step] / np.maximum(height[chain, step], 1e-300)
        distance: Array = np.clip(edges[chain, step + 1] - before_edge, -end, end)[:, 0]
        return distance


def _ellipsoid(features: Array, informed: Array, coef: Array) -> Array:
    """Rows span the ellipsoid a'Ha <= 1, H = sum_i i_i phi_i phi_i' / (f_i^2 + w^2), as z @ root.

    It is that of a logarithmic barrier, rounded off where about five rows for each coefficient
    are nearer.
    """
    values = np.abs(features @ coef)
    order = np.argsort(values, kind="stable")
    known = informed[order].cumsum()
    enough = min(5.0 * len(coef), 0.5 * known[-1])
    width = values[order[np.searchsorted(known, enough)]]
    share = informed / np.maximum(values**2 + width**2, np.finfo(float).tiny)
    barrier = features.T @ (features * share[:, None])
    barrier[np.diag_indices(len(coef))] += 1e-9 * np.trace(barrier) / len(coef)
    lower = np.linalg.cholesky(barrier)
    root: Array = solve_triangular(lower, np.eye(len(coef)), lower=True)
    return root


def _stopping_rows(features, informed, coef, root, settings) -> NDArray[np.intp]:
    """Rows that a surface meets first, and some of all others that stop it far away."""
    rows = np.flatnonzero(informed > 0.0)
    if len(rows) <= settings.near + settings.anywhere:
        return rows
    some = features[rows]
    deviation = np.linalg.norm(some @ root.T, axis=1)
    steps = np.abs(some @ coef) / (deviation * np.maximum(informed[rows], 1e-3))
    near = np.argpartition(steps, settings.near - 1)[: settings.near]
    return rows[np.union1d(near, spread_rows(len(rows), settings.anywhere))]
