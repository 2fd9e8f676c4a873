r"""Probabilities of the modes, from surfaces that the data allow: a sample of them, by hit-and-run.

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

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import log_expit, logsumexp
from sklearn.isotonic import IsotonicRegression

from swsysid._data.rows import spread_rows
from swsysid._results import Array
from swsysid._surfaces.mode_books import Book, decisions
from swsysid._surfaces.settings import POSTERIOR, PosteriorSettings


@dataclass(frozen=True)
class SurfaceEvidence:
    """What is known about one surface."""

    features: Array  # (n_samples, n_surface_features)
    odds: Array  # (n_samples,): log odds for the positive side, also infinite; 0 says nothing
    weight: Array  # (n_samples,)
    coef: Array  # (n_surface_features,): the surface that was fitted
    error_rate: float  # chance of a label on the wrong side

    @classmethod
    def of(
        cls,
        features: Array,
        odds: Array,
        weight: Array,
        coef: Array,
        settings: PosteriorSettings = POSTERIOR,
    ) -> SurfaceEvidence:
        """Evidence with the error rate that the fitted surface shows, half an error added."""
        wrong = ((features @ coef) * np.sign(odds) < 0.0) & (np.abs(odds) > settings.certain)
        rows = np.flatnonzero((odds != 0.0) & _any_monomial(features))
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
    settings: PosteriorSettings = POSTERIOR,
) -> Array:
    """Coefficients drawn from the posterior, shape (n_draws, n_surface_features)."""
    # Hit-and-run: from where a chain is, a random direction is taken, and the posterior along it, a
    # step function, is drawn from exactly. Directions are those of an ellipsoid that fits between
    # the rows, or differences of the other chains, which have found the posterior's shape.
    # no rows at all, where every row is as likely on either side, say nothing of the surface
    columns = np.sqrt((evidence.features**2).sum(axis=0) / max(len(evidence.features), 1))
    columns[columns == 0.0] = 1.0
    size = max(float(np.linalg.norm(evidence.coef * columns)), np.finfo(float).tiny)
    # Every other step doubles a difference, rounding errors included: on a grid that is far wider
    # than these the chains go the same way on every machine.
    known = evidence.features / columns, evidence.coef * columns / size, evidence.log_odds
    features, coef, odds = (np.round(values, settings.digits) for values in known)
    odds[~_any_monomial(features)] = 0.0
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
            chains[half[inside]] = np.round(moved[inside], settings.digits)
        if step >= burn_in and (step - burn_in + 1) % settings.every == 0:
            kept.append(chains * size / columns)
    return np.concatenate(kept)


def _any_monomial(features: Array) -> NDArray[np.bool_]:
    """Rows at which not all monomials vanish: there every surface does, and they say nothing."""
    return np.asarray(features.any(axis=1))


@dataclass(frozen=True)
class _Line:
    """The posterior along lines in the space of coefficients."""

    features: Array
    odds: Array
    settings: PosteriorSettings

    def draw(self, chains: Array, moves: Array, random_state) -> Array:
        """How far every chain goes along its move, drawn from the posterior on that line."""
        # f passes row i at t_i = -f_i / (change of f_i), where the log posterior jumps by the log
        # odds if f becomes positive, by their negative if it becomes negative.
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


@dataclass(frozen=True)
class ModePosterior:
    r"""Probabilities of the modes, from surfaces drawn from their posterior.

    Near a surface two things make a mode uncertain. The surface could have been elsewhere: a
    share v_j of the surfaces that the data allow votes for mode j (`sample_surface`). And the
    modes may not be a function of the state, or not one of this degree: of the training samples
    whose largest two decisions differ as much as at x a share :math:`\epsilon(x)` is in another
    mode than the fitted surfaces say, by isotonic regression. Both together are

    .. math:: P_j = (1 - \epsilon) v_j + \epsilon \frac{1 - v_j}{M - 1} .

    Surfaces are drawn when probabilities are first asked for.
    """

    evidence: tuple[SurfaceEvidence, ...]  # one for each surface
    book: Book  # (n_classes, n_surfaces)
    scale: Array  # (n_surfaces,): what makes surfaces comparable
    n_effective: float  # number of samples; a mode that no surface votes for gets half a sample
    # Difference of the largest two decisions, whether the label is another one,
    # and weight, of some training samples.
    misfits: tuple[Array, Array, Array]
    settings = POSTERIOR

    @classmethod
    def of_labels(
        cls,
        features: Array,
        labels: NDArray[np.intp],
        weight: Array,
        coef: Array,
        book: Book,
        scale: Array,
    ) -> ModePosterior:
        """What certain labels say about fitted surfaces `coef`, (n_surfaces, n_features)."""
        values = features @ coef.T
        some = spread_rows(len(values), cls.settings.misfits)
        decided = decisions(values[some], book, scale)
        wrong = decided.argmax(axis=1) != labels[some]
        odds = np.choose(book[labels] + 1, [-np.inf, 0.0, np.inf])
        return cls(
            _evidence(features, odds, weight, coef, cls.settings),
            book,
            scale,
            float(weight.sum()),
            (_lead(decided), wrong.astype(float), weight[some]),
        )

    def with_likelihood(
        self, features: Array, log_likelihood: Array, weight: Array
    ) -> ModePosterior:
        """The same with log likelihoods (n_samples, n_classes) in place of certain labels."""
        sides = [
            [logsumexp(log_likelihood[:, column == side], axis=1) for side in (1, -1)]
            for column in self.book.T
        ]
        odds = np.array([positive - negative for positive, negative in sides]).T
        # A surface between two of more modes is not told by samples that are likely in a third.
        odds[self.book[log_likelihood.argmax(axis=1)] == 0] = 0.0
        evidence = _evidence(features, odds, weight, self._coef, self.settings)
        return replace(self, evidence=evidence)

    def __call__(self, features: Array) -> Array:
        """Probabilities (n_samples, n_classes); the largest is that of the fitted surfaces."""
        if not self.evidence:  # a single class
            return np.ones((len(features), 1))
        n_parts = -(-len(features) // self.settings.at_once)
        votes = np.concatenate(list(map(self._votes, np.array_split(features, n_parts))))
        decided = decisions(features @ self._coef.T, self.book, self.scale)
        error = self._error_share.predict(_lead(decided))[:, None]
        mixed = (1.0 - error) * votes + error * (1.0 - votes) / (len(self.book) - 1)
        return _led_by(mixed, decided.argmax(axis=1))

    def of_decisions(self, features: Array, points: Array) -> Array:
        """Probabilities of two classes as a function of the decision alone, and increasing in it.

        The mean over `points` with that decision, (n_places, n_surface_features). Training samples
        would not do as points: the surfaces that the data allow agree on these.
        """
        known, asked = (
            decisions(part @ self._coef.T, self.book, self.scale) for part in (points, features)
        )
        mean = IsotonicRegression(y_min=0.0, y_max=1.0, out_of_bounds="clip")
        second = mean.fit(known[:, 1], self(points)[:, 1]).predict(asked[:, 1])
        is_second = asked[:, 1] > asked[:, 0]
        second = np.where(is_second, np.maximum(second, 0.5 + 1e-9), np.minimum(second, 0.5 - 1e-9))
        return np.column_stack([1.0 - second, second])

    @property
    def _coef(self) -> Array:
        return np.array([known.coef for known in self.evidence])

    @cached_property
    def _draws(self) -> Array:
        """Drawn surfaces, shape (n_features, n_draws, n_surfaces)."""
        random_state = np.random.RandomState(0)  # the same probabilities at every call
        drawn = [sample_surface(known, random_state, self.settings) for known in self.evidence]
        return np.array(drawn).transpose(2, 1, 0)

    @cached_property
    def _error_share(self) -> IsotonicRegression:
        lead, wrong, weight = self.misfits
        most = 1.0 - 1.0 / len(self.book)
        share = IsotonicRegression(y_max=most, increasing=False, out_of_bounds="clip")
        return share.fit(lead, wrong, sample_weight=weight)

    def _votes(self, features: Array) -> Array:
        n_features, n_draws, n_surfaces = self._draws.shape
        values = features @ self._draws.reshape(n_features, -1)
        decided = decisions(values.reshape(-1, n_surfaces), self.book, self.scale)
        chosen = decided.argmax(axis=1).reshape(-1, n_draws)
        n_classes = len(self.book)
        votes = np.stack([(chosen == mode).mean(axis=1) for mode in range(n_classes)], axis=1)
        half = 0.5 / self.n_effective
        shared: Array = (votes + half) / (1.0 + n_classes * half)
        return shared


def _evidence(
    features: Array, odds: Array, weight: Array, coef: Array, settings: PosteriorSettings
) -> tuple[SurfaceEvidence, ...]:
    return tuple(
        SurfaceEvidence.of(features, known, weight, surface, settings)
        for known, surface in zip(odds.T, coef, strict=True)
    )


def _lead(decided: Array) -> Array:
    """How much the largest decision exceeds the next one; infinitely where there is none."""
    if decided.shape[1] == 1:
        return np.full(len(decided), np.inf)
    largest = np.partition(decided, -2, axis=1)[:, -2:]
    lead: Array = largest[:, 1] - largest[:, 0]
    return lead


def _led_by(probability: Array, predicted: NDArray[np.intp]) -> Array:
    """Classes more probable than the predicted one share with it what they have together."""
    # The prediction is the fitted surface's, which need not be in the middle of those that the data
    # allow. A trace more decides the tie for it.
    own = np.take_along_axis(probability, predicted[:, None], axis=1)
    above = np.flatnonzero((probability >= own).sum(axis=1) > 1)
    sharing = probability[above] >= own[above]
    part = np.where(sharing, probability[above], 0.0).sum(axis=1) / sharing.sum(axis=1)
    led = probability.copy()
    led[above] = np.where(sharing, (1.0 - 1e-9) * part[:, None], probability[above])
    led[above, predicted[above]] += 1e-9 * part * sharing.sum(axis=1)
    return led
