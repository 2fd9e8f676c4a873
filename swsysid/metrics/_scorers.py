"""Scores of estimators on checked data, and scorers for scikit-learn's searches."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.metrics import accuracy_score, r2_score
from sklearn.utils.metadata_routing import UNUSED

from swsysid._checks.arrays import table
from swsysid._checks.estimators import FittedLater, rows_and_classes, rows_and_velocities
from swsysid._checks.parameters import flag, shown
from swsysid._data.rows import check_sample_weight
from swsysid.metrics._modes import balanced_mode_accuracy, mode_accuracy


def mode_accuracy_scorer(modes: Callable | None = None, *, balanced: bool = False):
    """Scorer that compares ``estimator.predict_modes(X)`` with the true modes.

    The true modes come from the function `modes`, or as score metadata.

    Parameters
    ----------
    modes : callable, default=None
        True labels as a function of X.
    balanced : bool, default=False
        Score by `balanced_mode_accuracy` in place of `mode_accuracy`.

    Returns
    -------
    callable
        To be given as ``scoring`` to `GridSearchCV` or `cross_validate`. The estimator may be a
        pipeline or a search around the regressor.

    Examples
    --------
    True modes known for every row of X travel as metadata::

        sklearn.set_config(enable_metadata_routing=True)
        scorer = mode_accuracy_scorer().set_score_request(modes=True)
        cross_validate(model, X, Xdot, scoring=scorer, params={"modes": modes})

    True modes known as a function need no routing:

    >>> from swsysid.metrics import mode_accuracy_scorer
    >>> scorer = mode_accuracy_scorer(modes=lambda X: X[:, 0] > 0)
    """
    if modes is not None and not callable(modes):
        raise TypeError(
            f"modes={shown(modes)} must be a function X -> labels; true modes of the rows of X "
            "are routed with .set_score_request(modes=True), since folds have only some of them."
        )
    flag("balanced", balanced)
    return _ModeAccuracyScorer(modes=modes, balanced=balanced)


class _ModeAccuracyScorer(BaseEstimator):
    # a BaseEstimator carries metadata requests and survives clone; `estimator` is no metadata
    __metadata_request__score = {"estimator": UNUSED}

    def __init__(self, modes, balanced):
        self.modes = modes
        self.balanced = balanced

    def score(self, estimator, X, y=None, *, modes=None, sample_weight=None) -> float:
        """Accuracy of the predicted modes; `y` is not used."""
        if modes is None and self.modes is None:
            raise ValueError(
                "the true modes are missing; route them with .set_score_request(modes=True) and "
                'params={"modes": modes} under sklearn.set_config(enable_metadata_routing=True), '
                "or give mode_accuracy_scorer a function X -> labels."
            )
        truth = self.modes(X) if modes is None else modes
        regressor, features = _switching_step(estimator, X)
        metric = balanced_mode_accuracy if self.balanced else mode_accuracy
        return metric(truth, regressor.predict_modes(features), sample_weight)

    __call__ = score


class _ModeConsistencyScorer(BaseEstimator):
    """Fraction of held-out samples at which surface and velocities agree on the mode.

    The surface's answer is ``predict_modes(X)``; the velocities' answer is the mode of least
    residual, the argmin over j of the sum over states of abs(y - v_j). Where several modes tie,
    any of them agrees. No true modes are needed. Compare only models with the same number of
    modes: a single mode is always consistent.

    Give it as ``scoring=mode_consistency_scorer``; called without arguments it returns a copy
    of itself, on which ``set_score_request`` may be used.
    """

    __metadata_request__score = {"estimator": UNUSED}

    def score(self, estimator, X, y, *, sample_weight=None) -> float:
        """Weighted fraction of the samples at which the two answers agree."""
        regressor, features = _switching_step(estimator, X)
        velocities = regressor.mode_velocities(features)
        targets = table("y", y, *velocities.shape[1:])
        losses = np.abs(velocities - targets).sum(axis=2)
        chosen = losses[regressor.predict_modes(features), np.arange(len(targets))]
        # residuals of the size of roundoff do not tell modes apart
        roundoff = 1e-12 * np.abs(targets).sum(axis=1)
        agree = chosen <= losses.min(axis=0) + roundoff
        return float(np.average(agree, weights=check_sample_weight(sample_weight, len(targets))))

    def __call__(self, estimator=None, X=None, y=None, *, sample_weight=None):
        if estimator is None:
            return clone(self)
        return self.score(estimator, X, y, sample_weight=sample_weight)


mode_consistency_scorer = _ModeConsistencyScorer()


def _switching_step(estimator, X):
    """The regressor inside searches and pipelines, and X as that regressor sees it."""
    while isinstance(estimator, type) or not hasattr(estimator, "predict_modes"):
        if hasattr(estimator, "best_estimator_"):
            estimator = estimator.best_estimator_
        elif hasattr(estimator, "steps"):
            X = estimator[:-1].transform(X) if len(estimator) > 1 else X
            estimator = estimator[-1]
        else:
            raise TypeError(
                f"{shown(estimator)} has no predict_modes; mode scorers need a fitted "
                "SwitchingSystemRegressor, or a pipeline that ends in one."
            )
    return estimator, X


class Scored(Protocol):
    """What predicts, and is scored by that."""

    def predict(self, X: object) -> NDArray: ...


class ScoredByR2(FittedLater):
    """A regressor whose score is R2."""

    def score(self: Scored, X, y, sample_weight=None):
        """R2 of the predicted velocities, the mean over the states.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_states + n_inputs)
        y : array-like of shape (n_samples,) or (n_samples, n_states)
            Measured velocities.
        sample_weight : array-like of shape (n_samples,), default=None

        Returns
        -------
        float
        """
        targets = rows_and_velocities(self, X, y)[1]
        return explained(targets, self.predict(X), sample_weight)


class ScoredByAccuracy(FittedLater):
    """A classifier whose score is the share of the rows in the right class."""

    def score(self: Scored, X, y, sample_weight=None):
        """Share of the rows whose class is predicted.

        Parameters
        ----------
        X : array-like of shape (n_samples, n_features)
        y : array-like of shape (n_samples,)
        sample_weight : array-like of shape (n_samples,), default=None

        Returns
        -------
        float
        """
        labels = rows_and_classes(self, X, y)[1]
        if sample_weight is not None:
            sample_weight = check_sample_weight(sample_weight, len(labels))
        return float(accuracy_score(labels, self.predict(X), sample_weight=sample_weight))


def explained(targets, predicted, sample_weight=None) -> float:
    """R2 of predicted velocities, checked targets given."""
    if len(targets) < 2:
        raise ValueError("R2 needs at least two samples; give more.")
    if targets.size != predicted.size:
        raise ValueError(
            f"y has shape {targets.shape} and the model predicts {predicted.shape}; give one "
            "column for each velocity."
        )
    if sample_weight is not None:
        sample_weight = check_sample_weight(sample_weight, len(targets))
    return float(r2_score(targets, predicted, sample_weight=sample_weight))
