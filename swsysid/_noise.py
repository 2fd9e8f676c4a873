r"""The noise of measured velocities: what the right law leaves over.

One model serves wherever residuals are judged. A row is an outlier with a small probability e, of
a broad density u that knows no law; otherwise its residuals r in n outputs are Student-t errors
with nu degrees of freedom and scales s_k,

.. math:: p(r) = (1 - e) \, t_\nu\Big(\sum_k r_k^2 / s_k^2\Big) \prod_k s_k^{-1} + e \, u .

Infinite nu is the normal law. Scales are standard deviations of the normal law with the same
median size of residuals, or the most likely scales of Student's law. How heavy the tails are and
how broad the outliers is for the user of the model to say, with the measurement behind it.
Whether what is left goes on, as no noise does, is Ljung and Box's test of its normal scores.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln, ndtri
from scipy.stats import chi2, norm, rankdata

from swsysid._results import Array

# Median size of a standard normal variable.
_NORMAL_MEDIAN = float(ndtri(0.75))
# Scale of the Laplace law with the median size of the standard normal law.
LAPLACE_SCALE = _NORMAL_MEDIAN / float(np.log(2.0))
_SMALLEST = 1e-150  # its square is still a number
# Errors below this share of the spread of a velocity are roundoff as far as effects go.
_EXACT = 1e-4
_REWEIGHTINGS = 8
_SETTLED = 5.0  # correlation times: a sum of correlations up to there is complete


def weighted_quantile(values: Array, weight: Array, share: float | Array, axis: int = -1) -> Array:
    """Smallest value up to which at least a share of the weight lies; a weight is a repetition."""
    flat = weight.ravel()
    weights = None if (flat == flat[0]).all() else weight  # then a selection replaces the sort
    return np.asarray(np.quantile(values, share, axis=axis, weights=weights, method="inverted_cdf"))


def root_mean_square(errors: Array) -> Array:
    """Root mean square of each column."""
    return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


def robust_scale(residuals: Array, weight: Array | None = None) -> Array:
    """Standard deviation of the normal law with the median size of the residuals, by column."""
    size = np.abs(residuals)
    if weight is None:
        return np.asarray(np.median(size, axis=0) / _NORMAL_MEDIAN)
    return weighted_quantile(size, weight, 0.5, axis=0) / _NORMAL_MEDIAN


@dataclass(frozen=True)
class Noise:
    """Student-t noise."""

    dof: float  # degrees of freedom; infinite for the normal law

    def log_density(self, squares: Array, log_scale: Array, n_outputs: int = 1) -> Array:
        """Log density at sums of `n_outputs` squares in units of the scales."""
        # `log_scale` is the sum of the logarithms of the scales.
        if np.isinf(self.dof):
            return -0.5 * squares - (log_scale + 0.5 * n_outputs * np.log(2 * np.pi))
        half = 0.5 * (self.dof + n_outputs)
        constant = gammaln(half) - gammaln(0.5 * self.dof)
        constant -= 0.5 * n_outputs * np.log(self.dof * np.pi)
        return (constant - log_scale) - half * np.log1p(squares / self.dof)

    def cost(self, errors: Array, scale: Array) -> Array:
        """Negative log densities of errors that are independent, each of its own."""
        return -self.log_density(np.square(errors / scale), np.log(scale))

    def weight(self, squares: Array, n_outputs: int = 1) -> Array:
        """Weight of a row in the regression of most likelihood: less the larger its squares."""
        if np.isinf(self.dof):
            return np.ones_like(squares)
        return (self.dof + n_outputs) / (self.dof + squares)

    def influence(self, errors: Array) -> tuple[Array, Array]:
        """Weights w of the regression of one output, and the derivative of w e by the error e."""
        squares = np.square(errors / max(float(robust_scale(errors)), _SMALLEST))
        weight = self.weight(squares)
        return weight, weight * (self.dof - squares) / (self.dof + squares)

    def scale(self, errors: Array, floor: Array | float = _SMALLEST, n_rounds: int = 15) -> Array:
        """Most likely scale of the errors of each output, at least `floor`."""
        # The weights of the most likely scale have a mean of one; divided by their mean on the way
        # there, the rounds converge much sooner (Kent, Tyler and Vardi, 1994).
        scale, squares = np.maximum(np.median(np.abs(errors), axis=0), floor), np.square(errors)
        for _ in range(n_rounds):
            weight = self.weight(squares / np.square(scale))
            mean_square = np.sum(weight * squares, axis=0) / np.sum(weight, axis=0)
            scale = np.maximum(np.sqrt(mean_square), floor)
        return scale


NORMAL = Noise(np.inf)
# With few degrees of freedom no row has a large influence, however wrong it is.
STUDENT = Noise(4.0)


@dataclass(frozen=True)
class Outliers:
    """Velocities that know no law: normal about their median, and broad."""

    centre: Array  # (n_outputs,)
    deviation: Array  # (n_outputs,)

    @classmethod
    def among(
        cls, targets: Array, weight: Array, breadth: float, least: Array | float = 0.0
    ) -> Outliers:
        """Outliers among velocities (n_samples, n_outputs), so many median distances broad."""
        centre = weighted_quantile(targets, weight, 0.5, axis=0)
        typical = weighted_quantile(np.abs(targets - centre), weight, 0.5, axis=0)
        return cls(centre, np.maximum(breadth * typical, least))

    def log_density(self, targets: Array) -> Array:
        """Log density at every row."""
        squares = np.square((targets - self.centre) / self.deviation).sum(axis=1)
        return NORMAL.log_density(squares, np.log(self.deviation).sum(), targets.shape[1])


def mixed_with_outliers(inside: Array, outside: Array, share: Array | float) -> tuple[Array, Array]:
    """Log density where a share of the rows are outliers, and the probability of being none."""
    inside = np.log1p(-share) + inside
    density = np.logaddexp(inside, np.log(share) + outside)
    return density, np.exp(inside - density)


def exact_below(targets: Array) -> Array:
    """Errors of each state below which an equation is exact, such as q' = v."""
    # An equation without noise would otherwise win or lose nats on the last digits of roundoff.
    return np.maximum(_EXACT * targets.std(axis=0), _SMALLEST)


def robust_weights(residuals: Array, floor: Array | float = _SMALLEST) -> Array:
    """Weights of a Student-t regression for residuals of shape (n_samples, n_states)."""
    # One weight a row: a row that is wrong in one state is not trusted in the others.
    smallest = 1e-12 * np.abs(residuals).max(axis=0, initial=0.0)
    scale = np.maximum(np.maximum(robust_scale(residuals), smallest), floor)
    return STUDENT.weight(np.mean(np.square(residuals / scale), axis=1))


def robust_regression(
    design: Array, target: Array, robust: bool = True, prior: Array | None = None
) -> Array:
    """Student-t regression by iteratively reweighted least squares, or plain least squares.

    `prior` (n_rows, n_coefficients) are rows beside the data, whose targets are zero.
    """
    size = np.linalg.norm(design, axis=0)
    size[size == 0.0] = 1.0
    scaled, weight = design / size, np.ones(len(target))
    known = np.zeros((0, design.shape[1])) if prior is None else prior / size
    zeros = np.zeros(len(known))
    for _ in range(_REWEIGHTINGS if robust else 1):
        root = np.sqrt(weight)
        left, right = np.vstack([root[:, None] * scaled, known]), np.r_[root * target, zeros]
        coef = np.linalg.lstsq(left, right, rcond=1e-10)[0]
        weight = robust_weights((target - scaled @ coef)[:, None])
    return coef / size


def memory(values: Array, series: Sequence[NDArray[np.intp]]) -> float:
    """Integrated correlation time of the values of rows that follow each other, at least 1."""
    # `series` are the rows of each trajectory in the order of time, none if that is not known.
    longest = max(map(len, series), default=0)
    if longest < 2:
        return 1.0
    size = int(2 ** np.ceil(np.log2(2 * longest)))
    centred = values - values.mean()
    power = sum(np.abs(np.fft.rfft(centred[rows], size)) ** 2 for rows in series)
    products = np.fft.irfft(power, size)[:longest]
    if products[0] <= 0.0:
        return 1.0
    times = 1.0 + 2.0 * np.cumsum(products[1:] / products[0])
    settled = np.arange(1, longest) >= _SETTLED * times
    return max(1.0, float(times[np.argmax(settled)] if settled.any() else times.max()))


class Portmanteau(NamedTuple):
    """Autocorrelations of scores, and Ljung and Box's test of all of them together."""

    statistic: float  # chi-squared with as many degrees of freedom as there are lags
    autocorrelation: tuple[float, ...]  # from lag one on
    n_pairs: tuple[int, ...]  # behind each

    @property
    def p_value(self) -> float:
        """Chance of so large a statistic where nothing goes on."""
        return float(chi2.sf(self.statistic, len(self.n_pairs)))


def normal_scores(values: Array) -> Array:
    """Normal quantiles of the ranks."""
    return np.asarray(norm.ppf(rankdata(values) / (len(values) + 1.0)))


def portmanteau(
    scores: Array, series: NDArray[np.intp], n_lags: int, fewest: int = 1
) -> Portmanteau:
    """Of scores with the number of their series, one after the other; of `fewest` pairs a lag.

    Pairs of all series are pooled.
    """
    sums, pairs = [], []
    for lag in range(1, min(n_lags, len(scores) - 1) + 1):
        together = series[lag:] == series[:-lag]
        if together.sum() < fewest:
            break
        sums.append((scores[lag:] * scores[:-lag])[together].sum())
        pairs.append(int(together.sum()))
    variance = max(float(np.square(scores).mean()), np.finfo(float).tiny)
    rho = np.array(sums) / np.array(pairs) / variance
    statistic = (len(scores) + 2) / len(scores) * float(np.square(rho) @ np.array(pairs))
    return Portmanteau(statistic, tuple(rho.tolist()), tuple(pairs))
