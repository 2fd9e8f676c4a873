"""Agreement of two labellings by mode, and whether claimed probabilities of modes come true.

Modes carry arbitrary names, so every metric first matches the predicted modes to the true ones.
Each finds the matching that is best *for itself*, as an assignment problem on the contingency
table; the numbers of modes may differ.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from swsysid._checks.arrays import labels, table
from swsysid._checks.parameters import whole
from swsysid._data.rows import check_sample_weight
from swsysid._results import Array

Labels = NDArray[np.intp]


def mode_accuracy(modes_true, modes_pred, sample_weight=None) -> float:
    r"""Fraction of samples in the right mode, for the best matching of the modes.

    .. math:: \max_{\pi} \; \sum_i w_i \, [\pi(\hat q_i) = q_i] \Big/ \sum_i w_i

    over one-to-one matchings :math:`\pi` of predicted to true modes; a predicted mode without
    partner is wrong everywhere.

    Parameters
    ----------
    modes_true, modes_pred : array-like of shape (n_samples,)
        Labels of any kind; the two need not use the same names nor the same number of modes.
    sample_weight : array-like of shape (n_samples,), default=None

    Returns
    -------
    float
        Between 0 and 1.

    Examples
    --------
    >>> from swsysid.metrics import mode_accuracy
    >>> mode_accuracy([0, 0, 1, 1], [1, 1, 0, 1])
    0.75
    """
    table = _contingency(modes_true, modes_pred, sample_weight)[0]
    return float(table[best_matching(table)].sum() / table.sum())


def balanced_mode_accuracy(modes_true, modes_pred, sample_weight=None) -> float:
    """Mean over the true modes of the fraction found, for the matching that maximises it.

    Every mode counts the same however rarely it is visited: where one mode holds 95 % of the
    samples, calling everything that mode scores 0.5 here and 0.95 in `mode_accuracy`.

    Parameters
    ----------
    modes_true, modes_pred : array-like of shape (n_samples,)
    sample_weight : array-like of shape (n_samples,), default=None

    Returns
    -------
    float
        Between 0 and 1.

    Examples
    --------
    >>> from swsysid.metrics import balanced_mode_accuracy
    >>> balanced_mode_accuracy(["a", "a", "a", "b"], [0, 0, 0, 0])
    0.5
    """
    table = _contingency(modes_true, modes_pred, sample_weight)[0]
    recalls = table / table.sum(axis=1, keepdims=True)
    return float(recalls[best_matching(recalls)].sum() / len(table))


def mode_iou(modes_true, modes_pred, sample_weight=None) -> float:
    """Mean intersection over union (the paper's mIoU), for the matching that maximises it.

    The mean runs over the larger of the two numbers of modes: a mode without partner, true or
    predicted, has intersection zero.

    Parameters
    ----------
    modes_true, modes_pred : array-like of shape (n_samples,)
    sample_weight : array-like of shape (n_samples,), default=None

    Returns
    -------
    float
        Between 0 and 1.

    Examples
    --------
    >>> from swsysid.metrics import mode_iou
    >>> round(mode_iou([0, 0, 1, 1], [1, 1, 0, 1]), 4)  # (2/3 + 1/2) / 2
    0.5833
    """
    table = _contingency(modes_true, modes_pred, sample_weight)[0]
    unions = table.sum(axis=1, keepdims=True) + table.sum(axis=0, keepdims=True) - table
    shares = table / unions
    return float(shares[best_matching(shares)].sum() / max(table.shape))


def match_modes(modes_true, modes_pred, sample_weight=None) -> dict:
    """Name of the true mode of each predicted mode, in the matching with the most agreement.

    The matching is found by `scipy.optimize.linear_sum_assignment`.

    Parameters
    ----------
    modes_true, modes_pred : array-like of shape (n_samples,)
    sample_weight : array-like of shape (n_samples,), default=None

    Returns
    -------
    dict
        ``{predicted: true}``. With as many predicted as true modes it is a permutation; with
        more, the predicted modes left without partner are absent.

    Examples
    --------
    >>> from swsysid.metrics import match_modes
    >>> match_modes(["slow", "fast", "fast"], [0, 1, 1])
    {0: 'slow', 1: 'fast'}
    """
    table, names_true, names_pred = _contingency(modes_true, modes_pred, sample_weight)
    pairs = zip(*best_matching(table), strict=True)
    matched = {names_pred[column].item(): names_true[row].item() for row, column in pairs}
    return {name: matched[name] for name in names_pred.tolist() if name in matched}


def _contingency(modes_true, modes_pred, sample_weight):
    """Weight of each pair of a true mode (rows) and a predicted mode, with the modes' names."""
    modes_true = labels("modes_true", modes_true)
    modes_pred = labels("modes_pred", modes_pred, len(modes_true))
    weights = check_sample_weight(sample_weight, len(modes_true))
    present = weights > 0
    names_true, rows = np.unique(modes_true[present], return_inverse=True)
    names_pred, columns = np.unique(modes_pred[present], return_inverse=True)
    shape = len(names_true), len(names_pred)
    return contingency(rows, columns, weights[present], shape), names_true, names_pred


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


def contingency(
    first: Labels, second: Labels, weight: Array | None = None, shape: tuple[int, int] | None = None
) -> Array:
    """Weight of the rows of each pair of labels; square if no shape is given.

    >>> contingency(np.array([0, 0, 1]), np.array([1, 1, 1]))
    array([[0., 2.],
           [0., 1.]])
    """
    n = int(max(first.max(), second.max())) + 1
    n_rows, n_columns = (n, n) if shape is None else shape
    flat = np.bincount(first * n_columns + second, weight, n_rows * n_columns)
    return flat.reshape(n_rows, n_columns).astype(float)


def best_matching(gains: Array) -> tuple[Labels, Labels]:
    """Rows and columns of the one-to-one matching with the largest sum of gains."""
    rows, columns = linear_sum_assignment(gains, maximize=True)
    return rows, columns
