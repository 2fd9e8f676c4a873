"""Agreement of two labellings by mode, whatever the modes are called.

Modes carry arbitrary names, so every metric first matches the predicted modes to the true ones.
Each finds the matching that is best *for itself*, as an assignment problem on the contingency
table; the numbers of modes may differ.
"""

from __future__ import annotations

import numpy as np

from swsysid._checks.arrays import labels
from swsysid._data.matching import best_matching, contingency
from swsysid._data.rows import check_sample_weight


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
