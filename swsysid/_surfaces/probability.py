"""Probabilities of the modes: how many of the surfaces that the data allow agree."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp
from sklearn.isotonic import IsotonicRegression

from swsysid._data.rows import spread_rows
from swsysid._results import Array
from swsysid._surfaces.mode_books import Book, decisions
from swsysid._surfaces.posterior import SETTINGS, SurfaceEvidence, sample_surface

__all__ = ["ModePosterior"]


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

    Attributes
    ----------
    evidence : tuple of SurfaceEvidence
        One for each surface.
    book : ndarray of shape (n_classes, n_surfaces)
    scale : ndarray of shape (n_surfaces,)
        What makes surfaces comparable.
    n_effective : float
        Number of samples; a mode that no surface votes for gets half a sample.
    misfits : tuple of ndarray
        Difference of the largest two decisions, whether the label is another one, and weight, of
        some training samples.
    """

    evidence: tuple[SurfaceEvidence, ...]
    book: Book
    scale: Array
    n_effective: float
    misfits: tuple[Array, Array, Array]

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
        some = spread_rows(len(values), SETTINGS.misfits)
        decided = decisions(values[some] / scale, book)
        wrong = decided.argmax(axis=1) != labels[some]
        odds = np.choose(book[labels] + 1, [-np.inf, 0.0, np.inf])
        return cls(
            _evidence(features, odds, weight, coef),
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
        return replace(self, evidence=_evidence(features, odds, weight, self._coef))

    def __call__(self, features: Array) -> Array:
        """Probabilities (n_samples, n_classes); the largest is that of the fitted surfaces."""
        if not self.evidence:  # a single class
            return np.ones((len(features), 1))
        votes = np.concatenate(
            [
                self._votes(features[start : start + SETTINGS.at_once])
                for start in range(0, len(features), SETTINGS.at_once)
            ]
        )
        decided = decisions(features @ self._coef.T / self.scale, self.book)
        error = self._error_share.predict(_lead(decided))[:, None]
        mixed = (1.0 - error) * votes + error * (1.0 - votes) / (len(self.book) - 1)
        return _led_by(mixed, decided.argmax(axis=1))

    def of_decisions(self, features: Array, places: Array) -> Array:
        """Probabilities of two classes as a function of the decision alone, and increasing in it.

        The mean over `places` with that decision, (n_places, n_surface_features). Training samples
        would not do as places: the surfaces that the data allow agree on these.
        """
        known, asked = (
            decisions(part @ self._coef.T / self.scale, self.book) for part in (places, features)
        )
        mean = IsotonicRegression(y_min=0.0, y_max=1.0, out_of_bounds="clip")
        second = mean.fit(known[:, 1], self(places)[:, 1]).predict(asked[:, 1])
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
        drawn = [sample_surface(known, random_state) for known in self.evidence]
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
        values = values.reshape(-1, n_surfaces) / self.scale
        chosen = decisions(values, self.book).argmax(axis=1).reshape(-1, n_draws)
        n_classes = len(self.book)
        votes = np.stack([(chosen == mode).mean(axis=1) for mode in range(n_classes)], axis=1)
        half = 0.5 / self.n_effective
        shared: Array = (votes + half) / (1.0 + n_classes * half)
        return shared


def _evidence(
    features: Array, odds: Array, weight: Array, coef: Array
) -> tuple[SurfaceEvidence, ...]:
    return tuple(
        SurfaceEvidence.of(features, known, weight, surface)
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
    """Classes more probable than the predicted one share with it what they have together.

    The prediction is the fitted surface's, which need not be in the middle of those that the
    data allow. A trace more decides the tie for it.
    """
    own = np.take_along_axis(probability, predicted[:, None], axis=1)
    above = np.flatnonzero((probability >= own).sum(axis=1) > 1)
    sharing = probability[above] >= own[above]
    part = np.where(sharing, probability[above], 0.0).sum(axis=1) / sharing.sum(axis=1)
    led = probability.copy()
    led[above] = np.where(sharing, (1.0 - 1e-9) * part[:, None], probability[above])
    led[above, predicted[above]] += 1e-9 * part * sharing.sum(axis=1)
    return led
