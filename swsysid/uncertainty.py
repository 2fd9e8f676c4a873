"""Uncertainty of an identified system: block bootstrap of its trajectories."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import linear_sum_assignment
from sklearn.base import clone
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted
from tqdm import tqdm

from swsysid._results import Array
from swsysid._setup import trajectory_codes

__all__ = ["BootstrapResult", "bootstrap"]

# Below this many resamples a percentile of the tails is no more than an extreme.
_LEAST_RESAMPLES = 20


@dataclass(frozen=True, repr=False)
class BootstrapResult:
    """Refits of one system to resampled data, and what they say about its coefficients.

    Attributes
    ----------
    estimate : ndarray of shape (n_modes, n_states, n_features_out)
        ``coef_`` of the fitted estimator.
    samples : ndarray of shape (n_kept, n_modes, n_states, n_features_out)
        Coefficients of every resample in which all modes were found, in the estimator's order
        of the modes.
    standard_error : ndarray like `estimate`
    low, high : ndarray like `estimate`
        Percentile interval: quantiles of `samples`.
    surface_low, surface_high : ndarray of shape (n_points, n_surfaces) or None
        Percentile interval of the surface values at the points asked for, each surface scaled
        to mean absolute value one at these points.
    confidence : float
    n_resamples : int
    n_lost : int
        Resamples in which a mode was lost; they are in none of the figures.
    blocks : str
        ``"trajectories"`` or ``"samples"``: what was drawn with replacement.
    names : tuple of str
        Features Phi.
    """

    estimate: Array
    samples: Array
    standard_error: Array
    low: Array
    high: Array
    surface_low: Array | None
    surface_high: Array | None
    confidence: float
    n_resamples: int
    n_lost: int
    blocks: str
    names: tuple[str, ...]

    @property
    def basic_low(self) -> Array:
        """Lower end of the basic interval: the percentile interval mirrored at the estimate."""
        return 2.0 * self.estimate - self.high

    @property
    def basic_high(self) -> Array:
        """Upper end of the basic interval."""
        return 2.0 * self.estimate - self.low

    def __str__(self) -> str:
        head = (
            f"{self.n_resamples} resamples of {self.blocks}, {self.n_lost} lost a mode, "
            f"{100 * self.confidence:g} % percentile intervals"
        )
        width = max(7, *(len(name) for name in self.names))
        title = (
            f"{'mode':>4} {'state':>5} {'feature':<{width}} {'coef':>11} {'std error':>10} "
            f"{'low':>11} {'high':>11}"
        )
        rows = [
            f"{mode:>4} {state:>5} {self.names[feature]:<{width}} {value:>11.4g} "
            f"{self.standard_error[mode, state, feature]:>10.2g} "
            f"{self.low[mode, state, feature]:>11.4g} {self.high[mode, state, feature]:>11.4g}"
            for (mode, state, feature), value in np.ndenumerate(self.estimate)
        ]
        return "\n".join([head, title, *rows])

    __repr__ = __str__


def bootstrap(
    estimator: Any,
    X: ArrayLike,
    y: ArrayLike,
    *,
    groups: ArrayLike | None = None,
    surface_points: ArrayLike | None = None,
    n_resamples: int = 200,
    confidence: float = 0.95,
    n_jobs: int | None = None,
    random_state=None,
    verbose: int = 0,
) -> BootstrapResult:
    r"""Confidence intervals of the coefficients of a fitted system, by the block bootstrap.

    A resample draws as many trajectories as there are, with replacement; a trajectory drawn k
    times gets weight k in a refit. Samples of one trajectory stay together because their errors
    are alike: drawn one by one they would pretend to be independent, and the intervals would be
    too narrow. Without `groups` single samples are drawn, which is right only if their errors
    are independent. Every refit starts from the fitted coefficients: the intervals are about
    noise in the answer found, not about the chance of another answer (see ``stability_``).

    Parameters
    ----------
    estimator : SwitchingSystemRegressor
        Fitted to `X` and `y`.
    X : array-like of shape (n_samples, n_states + n_inputs)
    y : array-like of shape (n_samples,) or (n_samples, n_states)
        Xdot, the measured velocities.
    groups : array-like of shape (n_samples,), default=None
        Trajectory of each sample. A handful of trajectories is too few: intervals are then too
        narrow.
    surface_points : array-like of shape (n_points, n_states + n_inputs), default=None
        Where intervals of the surface values are wanted.
    n_resamples : int, default=200
    confidence : float, default=0.95
    n_jobs : int, default=None
        Refits run in parallel; the result does not depend on it.
    random_state : int, RandomState instance or None, default=None
    verbose : int, default=0
        Above 0: a progress bar.

    Returns
    -------
    BootstrapResult
        Prints as a table.

    Raises
    ------
    ValueError
        If the parameters make no sense, there are fewer than two trajectories, or nearly every
        resample loses a mode.

    References
    ----------
    B. Efron and R. J. Tibshirani, An Introduction to the Bootstrap, 1993, sections 8.6 and 13.

    Examples
    --------
    >>> from swsysid import SwitchingSystemRegressor
    >>> from swsysid.datasets import make_damped_oscillator
    >>> from swsysid.uncertainty import bootstrap
    >>> data = make_damped_oscillator(400, noise=0.05, random_state=0)
    >>> model = SwitchingSystemRegressor(random_state=0).fit(data.X, data.Xdot)
    >>> result = bootstrap(
    ...     model, data.X, data.Xdot, groups=data.groups, n_resamples=20, random_state=0
    ... )
    >>> result.blocks, result.n_lost
    ('trajectories', 0)
    >>> damping = -model.coef_[:, 1, 1]
    >>> (result.standard_error[:, 1, 1] < 0.1 * damping.max()).tolist()
    [True, True]
    """
    check_is_fitted(estimator)
    _check(n_resamples, confidence)
    X, y = np.asarray(X), np.asarray(y)
    random_state = check_random_state(random_state)
    weights = _draw_weights(groups, len(X), n_resamples, random_state)
    # An array is a start that needs no search, and the seed of the refits decides nothing else.
    refit = clone(estimator).set_params(
        n_modes=estimator.n_modes_, init=estimator.coef_, n_init="auto", n_jobs=None,
        random_state=0, verbose=0,
    )  # fmt: skip
    points = None if surface_points is None else np.asarray(surface_points, dtype=float)
    answers = Parallel(n_jobs=n_jobs)(
        delayed(_refit)(refit, estimator, X, y, weight, points)
        for weight in tqdm(weights, desc="resamples", disable=not verbose)
    )
    kept = [answer for answer in answers if answer is not None]
    if len(kept) < max(2, n_resamples // 10):
        raise ValueError(
            f"{n_resamples - len(kept)} of {n_resamples} resamples lose a mode: the data do not "
            "determine all modes; measure more or use a smaller n_modes."
        )
    samples = np.array([coef for coef, _ in kept])
    tails = [0.5 * (1.0 - confidence), 0.5 * (1.0 + confidence)]
    low, high = np.quantile(samples, tails, axis=0)
    surface_low, surface_high = (
        (None, None)
        if points is None
        else np.quantile(np.array([values for _, values in kept]), tails, axis=0)
    )
    return BootstrapResult(
        estimate=estimator.coef_.copy(),
        samples=samples,
        standard_error=samples.std(axis=0, ddof=1),
        low=low,
        high=high,
        surface_low=surface_low,
        surface_high=surface_high,
        confidence=float(confidence),
        n_resamples=n_resamples,
        n_lost=n_resamples - len(kept),
        blocks="samples" if groups is None else "trajectories",
        names=tuple(str(name) for name in estimator.feature_names_out_),
    )


def _check(n_resamples, confidence) -> None:
    if n_resamples < _LEAST_RESAMPLES:
        raise ValueError(
            f"n_resamples={n_resamples}; intervals need at least {_LEAST_RESAMPLES} resamples."
        )
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence={confidence}; it is a fraction between 0 and 1, as 0.95.")


def _draw_weights(groups, n_samples, n_resamples, random_state) -> NDArray[np.float64]:
    """How often every sample occurs in every resample, shape (n_resamples, n_samples)."""
    blocks = np.arange(n_samples) if groups is None else trajectory_codes(groups, n_samples)
    n_blocks = int(blocks.max()) + 1
    if n_blocks < 2:
        raise ValueError(
            "groups names a single trajectory, which cannot be resampled; name more, or leave "
            "groups out if the errors of the samples are independent."
        )
    shares = np.full(n_blocks, 1.0 / n_blocks)
    weights: NDArray[np.float64] = random_state.multinomial(n_blocks, shares, size=n_resamples)
    return weights[:, blocks].astype(float)


def _refit(refit, estimator, X, y, weight, points) -> tuple[Array, Array | None] | None:
    """Coefficients and surface values of one resample; None if a mode is lost."""
    # What a resample has to complain about is counted, or was said when the data were fitted.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = clone(refit).fit(X, y, sample_weight=weight)
    if model.n_modes_ < estimator.n_modes_:
        return None
    order = _matching(estimator.modes_, model.modes_, weight, estimator.n_modes_)
    values = None if points is None else _surface_values(model.surface_, estimator, points, order)
    return model.coef_[order], values


def _matching(modes, found, weight, n_modes) -> NDArray[np.intp]:
    """For each original mode the one of the refit that shares the most samples with it."""
    shared = np.bincount(modes * n_modes + found, weight, n_modes**2).reshape(n_modes, n_modes)
    order: NDArray[np.intp] = linear_sum_assignment(shared, maximize=True)[1]
    return order


def _surface_values(surface, estimator, points, order) -> Array:
    """Surface values in the original book's signs, of mean absolute value one.

    A refit may name the modes, order the surfaces and choose their signs differently: its
    surfaces are matched to the original ones by their sign patterns over the modes.
    """
    book = surface.mode_book_[order]
    agreement = estimator.surface_.mode_book_.T @ book
    matched = linear_sum_assignment(np.abs(agreement), maximize=True)
    signs = np.where(agreement[matched] < 0, -1.0, 1.0)
    values = surface.surface_values(points)[:, matched[1]] * signs
    return values / np.abs(values).mean(axis=0)
