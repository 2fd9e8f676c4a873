"""Whether claimed probabilities of modes come true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from swsysid._checks.arrays import labels, table
from swsysid._checks.parameters import whole
from swsysid._data.rows import check_sample_weight
from swsysid._results import Array
from swsysid.metrics._modes import match_modes


@dataclass(frozen=True)
class ModeReliability:
    """Claimed against observed, in bins of the claimed probability.

    Attributes
    ----------
    edges : ndarray of shape (n_bins + 1,)
        Edges of the bins; a claim at an edge belongs to the bin above it.
    claimed : ndarray of shape (n_bins,)
        Mean probability of the predicted mode; NaN in an empty bin.
    observed : ndarray of shape (n_bins,)
        Share of samples whose predicted mode is right; NaN in an empty bin.
    count : ndarray of shape (n_bins,)
        Samples (sum of their weights) in each bin.
    error : float
        Expected calibration error: mean of abs(claimed - observed) over the samples.
    """

    edges: Array
    claimed: Array
    observed: Array
    count: Array
    error: float


def mode_reliability(
    modes_true, probability, n_bins: int = 10, sample_weight=None
) -> ModeReliability:
    r"""Compare how sure a model is of its modes with how often it is right.

    A sample's claim is the largest of its probabilities, its mode the one that has it. Predicted
    modes are first matched to the true ones, as in `mode_accuracy`. With the samples B_b in bin b
    the expected calibration error is

    .. math:: \sum_b \frac{|B_b|}{n} \, | \mathrm{claimed}_b - \mathrm{observed}_b | .

    Parameters
    ----------
    modes_true : array-like of shape (n_samples,)
        Labels of any kind.
    probability : array-like of shape (n_samples, n_modes)
        For example ``model.predict_mode_proba(X)``, for samples that were not fitted.
    n_bins : int, default=10
        Bins of equal width from the smallest possible claim, 1 / n_modes, to 1.
    sample_weight : array-like of shape (n_samples,), default=None

    Returns
    -------
    ModeReliability

    Examples
    --------
    Ten samples of which the model is sure to 90 %, and one of them is wrong:

    >>> import numpy as np
    >>> from swsysid.metrics import mode_reliability
    >>> found = mode_reliability([0] * 9 + [1], np.tile([0.9, 0.1], (10, 1)), n_bins=2)
    >>> found.claimed, found.observed, found.count, round(found.error, 12)
    (array([nan, 0.9]), array([nan, 0.9]), array([ 0., 10.]), 0.0)
    """
    modes_true = labels("modes_true", modes_true)
    probability = table("probability", probability, len(modes_true))
    if probability.min() < 0.0 or not np.allclose(probability.sum(axis=1), 1.0, atol=1e-6):
        raise ValueError("every row of probability must be non-negative and sum to one.")
    whole("n_bins", n_bins, most=100_000)
    weight = check_sample_weight(sample_weight, len(modes_true))
    predicted, claim = probability.argmax(axis=1), probability.max(axis=1)
    names = match_modes(modes_true, predicted, weight)
    right = np.array(
        [names.get(mode) == true for mode, true in zip(predicted, modes_true, strict=True)]
    )
    edges = np.linspace(1.0 / probability.shape[1], 1.0, n_bins + 1)
    bins = np.clip(np.digitize(claim, edges) - 1, 0, n_bins - 1)
    count, claimed, observed = (
        np.bincount(bins, weights=weight * value, minlength=n_bins).astype(float)
        for value in (np.ones(len(claim)), claim, right)
    )
    error = float(np.abs(claimed - observed).sum() / count.sum())
    filled = np.where(count > 0.0, count, np.nan)
    return ModeReliability(edges, claimed / filled, observed / filled, count, error)
