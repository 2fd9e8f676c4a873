"""Tests of whether a residual is white along its trajectories, and of its mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import norm

from swsysid._checks.arrays import column, labels
from swsysid._checks.parameters import whole
from swsysid._noise import normal_scores, portmanteau
from swsysid._residual_report.dependence import correlation_length, holm
from swsysid._residual_report.findings import Finding
from swsysid._residual_report.noise_floor import FEWEST_NEIGHBOURS
from swsysid._residual_report.samples import ResidualSamples
from swsysid._results import Array

# Of the significance, of which the rearrangements have the rest (`findings`).
_WEIGHT_OF_WHITENESS = 0.1
_WEIGHT_OF_BIAS = 0.1

_ROWS_A_LAG = 5
_LEVEL_OF_A_TRAJECTORY = 0.01


@dataclass(frozen=True)
class WhitenessTest:
    """Ljung-Box test of the normal scores of a residual, all trajectories together.

    Attributes
    ----------
    statistic : float
        Chi-squared with `n_lags` degrees of freedom if the residual is white.
    p_value : float
    n_lags : int
    autocorrelation : tuple of float
        Of the normal scores, from lag one on.
    n_pairs : tuple of int
        Pairs of rows behind each.
    coloured_trajectories : tuple
        Trajectories that are not white when judged one by one (statsmodels' Ljung-Box test,
        Holm's correction, level 0.01).
    """

    statistic: float
    p_value: float
    n_lags: int
    autocorrelation: tuple[float, ...]
    n_pairs: tuple[int, ...]
    coloured_trajectories: tuple


@dataclass(frozen=True, kw_only=True)
class Whiteness(WhitenessTest):
    """`WhitenessTest` of one equation, its p-value corrected for all tests of the report."""

    equation: str
    significant: bool


def whiteness_test(
    residual: ArrayLike, groups: ArrayLike | None = None, *, n_lags: int = 10
) -> WhitenessTest:
    r"""Ljung-Box test along trajectories, blind to heavy tails.

    The residual is replaced by its normal scores z, the normal quantiles of its ranks. With
    :math:`c_k` the sum of :math:`z_t z_{t-k}` over the :math:`n_k` pairs within trajectories, the
    statistic is :math:`\frac{n + 2}{n} \sum_k c_k^2 / (\sigma^4 n_k)`; for one trajectory this is
    the test of Ljung and Box. Pairs are pooled rather than statistics added up, because a sum over
    many short trajectories is neither chi-squared nor sensitive to what they have in common.

    Parameters
    ----------
    residual : array-like of shape (n_samples,)
        In time order within each trajectory.
    groups : array-like of shape (n_samples,), default=None
        Trajectory of each row; None means one trajectory.
    n_lags : int, default=10

    Returns
    -------
    WhitenessTest

    Raises
    ------
    ValueError
        If no trajectory is long enough for a single lag.

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.diagnosis import whiteness_test
    >>> noise = np.random.default_rng(0).standard_normal(500)
    >>> bool(whiteness_test(noise).p_value > 0.01)
    True
    >>> bool(whiteness_test(noise[1:] + noise[:-1]).p_value < 0.01)
    True
    """
    whole("n_lags", n_lags)
    values = column("residual", residual)
    named = np.zeros(len(values), dtype=int)
    if groups is not None:
        named = labels("groups", groups, len(values))
    names, codes = np.unique(named, return_inverse=True)
    order = np.argsort(codes, kind="stable")
    scores, codes = normal_scores(values[order]), codes[order]
    seen = portmanteau(scores, codes, n_lags, FEWEST_NEIGHBOURS)
    if not seen.n_pairs:
        raise ValueError(
            f"fewer than {FEWEST_NEIGHBOURS} pairs of rows follow each other in a "
            "trajectory; whiteness needs longer trajectories."
        )
    return WhitenessTest(
        statistic=seen.statistic,
        p_value=seen.p_value,
        n_lags=len(seen.n_pairs),
        autocorrelation=seen.autocorrelation,
        n_pairs=seen.n_pairs,
        coloured_trajectories=_coloured(scores, codes, names, len(seen.n_pairs)),
    )


def _coloured(scores: Array, codes: NDArray, names: NDArray, n_lags: int) -> tuple:
    from statsmodels.stats.diagnostic import acorr_ljungbox

    long_enough, p_values = [], []
    for code, name in enumerate(names.tolist()):
        rows = scores[codes == code]
        if len(rows) >= _ROWS_A_LAG * n_lags and np.ptp(rows) > 0.0:
            long_enough.append(name)
            p_values.append(float(acorr_ljungbox(rows, lags=[n_lags])["lb_pvalue"].iloc[0]))
    if not long_enough:
        return ()
    rejected = holm(p_values) <= _LEVEL_OF_A_TRAJECTORY
    return tuple(name for name, is_not in zip(long_enough, rejected, strict=True) if is_not)


def whiteness(
    samples: ResidualSamples, equations: list[int], n_lags: int, significance: float
) -> list[Whiteness]:
    """The test of some equations; a ValueError where trajectories are too short for it."""
    if not samples.records.ordered or not equations:
        return []
    residuals, codes = samples.residual[:, equations].T, samples.codes
    tests = [whiteness_test(residual, codes, n_lags=n_lags) for residual in residuals]
    p_values = holm([test.p_value for test in tests]) / _WEIGHT_OF_WHITENESS
    p_values = np.minimum(1.0, p_values)
    return [
        Whiteness(
            **vars(test)
            | {
                "equation": samples.equations[i],
                "p_value": p_value,
                "significant": p_value <= significance,
                "coloured_trajectories": tuple(
                    samples.trajectories[code] for code in test.coloured_trajectories
                ),
            }
        )
        for i, test, p_value in zip(equations, tests, p_values.tolist(), strict=True)
    ]


def biases(samples: ResidualSamples, equations: list[int], significance: float) -> list[Finding]:
    """Tests of the means of some equations."""
    # Rows without order are independent.
    codes = samples.codes if samples.records.ordered else np.arange(len(samples.residual))
    residuals = [samples.residual[:, i] for i in equations]
    p_values = holm([_bias_p_value(residual, codes) for residual in residuals])
    p_values = np.minimum(1.0, p_values / _WEIGHT_OF_BIAS)
    found = []
    for i, residual, p_value in zip(equations, residuals, p_values.tolist(), strict=True):
        significant, mean = p_value <= significance, residual.mean()
        found.append(
            Finding(
                equation=samples.equations[i],
                mode=None,
                channel="nothing",
                kind="bias",
                aspect="mean",
                share=float(np.square(mean) / np.square(residual).mean()),
                p_value=p_value,
                significant=significant,
                direct=significant,
                shape=f"{mean:.3g}" if significant else "",
            )
        )
    return found


def _bias_p_value(residual: Array, codes: NDArray[np.intp]) -> float:
    """P-value of a residual that is not centred: both its mean and its signs must say so.

    A skewed residual has a mean or a median away from zero, depending on the loss that was
    fitted; only an offset moves both to the same side.
    """
    n_rows, length = len(residual), correlation_length(residual, codes)
    mean = residual.mean() / max(residual.std(), np.finfo(float).tiny)
    signs = np.sign(residual).mean()
    if mean * signs <= 0.0:
        return 1.0
    return float(2.0 * norm.sf(min(abs(mean), abs(signs)) * np.sqrt(n_rows / length)))
