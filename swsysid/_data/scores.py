"""Scores of estimators on data that have been checked."""

from __future__ import annotations

from typing import Protocol

from numpy.typing import NDArray
from sklearn.metrics import accuracy_score, r2_score

from swsysid._checks.estimators import rows_and_classes, rows_and_velocities
from swsysid._data.rows import check_sample_weight


class Scored(Protocol):
    """What predicts, and is scored by that."""

    def predict(self, X: object) -> NDArray: ...


class ScoredByR2:
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


class ScoredByAccuracy:
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
