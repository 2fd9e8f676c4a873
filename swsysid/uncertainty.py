"""Uncertainty of an identified system: block bootstrap of its trajectories."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import ArrayLike
from scipy.stats import norm as normal
from scipy.stats import t as student
from sklearn.base import clone

from swsysid._checks.estimators import rows_and_velocities, rows_of
from swsysid._checks.parameters import MOST_RESAMPLES, jobs, random_numbers, real, verbosity, whole
from swsysid._data.rows import CanonicalRows
from swsysid._data.trajectories import group_labels
from swsysid._identification.descent import alternate
from swsysid._identification.problem import calibrate
from swsysid._identification.setup import build_problem
from swsysid._losses import get_loss
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._rendering.progress import watched
from swsysid._results import Array
from swsysid._simulation.model import fitted_system
from swsysid._surfaces.surface import fit_weighted, mode_book_of
from swsysid._whole_or_nothing import failing_in_words
from swsysid.relaxations._base import one_hot

# Below this many resamples a percentile of the tails is no more than an extreme.
_LEAST_RESAMPLES = 20
_SAME = 1e-6  # relative difference of two losses that are the same ...
_ROUNDING = 1e-9  # ... and rounding, relative to the loss of the velocities

__all__ = ["BootstrapResult", "bootstrap"]


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
        Percentile interval: quantiles of `samples`, a little wider if there are few blocks.
    surface_low, surface_high : ndarray of shape (n_points, n_surfaces) or None
        Percentile interval of the surface values at the points asked for, each surface scaled
        to mean absolute value one at these points.
    confidence : float
    n_resamples : int
    n_lost : int
        Number of resamples in which a mode was lost; they enter none of the figures.
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
    def covariance(self) -> Array:
        """Of ``coef_.ravel()``, from `samples`, each coefficient as certain as `standard_error`.

        Given to the model, ``model.covariance_ = result.covariance``, it makes bands of rollouts
        (``model.simulate(..., n_draws=200)``), in which the surface stays where it is.
        """
        with np.errstate(divide="ignore", invalid="ignore"):  # of those that are the same in all
            together = np.corrcoef(self.samples.reshape(len(self.samples), -1).T)
        error = self.standard_error.ravel()
        return np.nan_to_num(np.atleast_2d(together)) * error * error[:, None]

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


@failing_in_words
def bootstrap(
    estimator: SwitchingSystemRegressor,
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
    are independent. Every refit starts from the fitted modes and keeps what the fit has chosen
    (number of modes, monomials of the surface, terms of a sparse model): the intervals are about
    noise in the answer found, not about the chance of another answer (see ``stability_``).
    ``benchmarks/coverage.py`` prints how often they hold the truth.

    Parameters
    ----------
    estimator : SwitchingSystemRegressor
        Fitted to `X` and `y`.
    X : array-like of shape (n_samples, n_states + n_inputs)
    y : array-like of shape (n_samples,) or (n_samples, n_states)
        Xdot, the measured velocities.
    groups : array-like of shape (n_samples,), default=None
        Trajectory of each sample. Few of them make the intervals wide: they are corrected for
        their number, but a handful remains too few for an honest 95 %.
    surface_points : array-like of shape (n_points, n_states + n_inputs), default=None
        Where intervals of the surface values are wanted.
    n_resamples : int, default=200
    confidence : float, default=0.95
    n_jobs : int, default=None
        Refits run in parallel; the result does not depend on it.
    random_state : int, RandomState instance or None, default=None
    verbose : int, default=0
        Above 0, a progress bar is shown.

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
    T. C. Hesterberg, What Teachers Should Know About the Bootstrap, The American Statistician,
    2015 (the expanded percentile interval).

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
    fitted_system(estimator)
    whole("n_resamples", n_resamples, least=_LEAST_RESAMPLES, most=MOST_RESAMPLES)
    real("confidence", confidence, above=0, below=1)
    jobs(n_jobs)
    verbosity(verbose)
    rng = random_numbers(random_state)
    problem, modes, blocks = _fitted_problem(estimator, X, y, groups)
    n_blocks = int(blocks.max()) + 1
    if n_blocks < 2:
        raise ValueError(
            "groups names a single trajectory, which cannot be resampled; name more, or leave "
            "groups out if the errors of the samples are independent."
        )
    # How often every block, and so each of its samples, occurs in every resample.
    drawn = rng.multinomial(n_blocks, np.full(n_blocks, 1.0 / n_blocks), n_resamples)
    points = None if surface_points is None else rows_of(estimator, surface_points)
    settle = {"max_iter": estimator.max_iter, "tol": estimator.tol}
    answers = Parallel(n_jobs=n_jobs)(
        delayed(_refit)(problem, modes, weight, points, settle)
        for weight in watched(list(drawn[:, blocks].astype(float)), "resamples", bool(verbose))
    )
    kept = [answer for answer in answers if answer is not None]
    if len(kept) < max(2, n_resamples // 10):
        raise ValueError(
            f"{n_resamples - len(kept)} of {n_resamples} resamples lose a mode: the data do not "
            "determine all modes; measure more or use a smaller n_modes."
        )
    samples = np.array([coef for coef, _ in kept])
    tails, factor = _corrections(confidence, n_blocks)
    low, high = np.quantile(samples, tails, axis=0, method="weibull")
    surface_low = surface_high = None
    if points is not None:
        values = np.array([values for _, values in kept])
        surface_low, surface_high = np.quantile(values, tails, axis=0, method="weibull")
    return BootstrapResult(
        estimate=estimator.coef_.copy(),
        samples=samples,
        standard_error=factor * samples.std(axis=0, ddof=1),
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


def _fitted_problem(estimator, X, y, groups):
    """The fitted problem, and modes and blocks of its rows, which are sorted.

    What the fit has chosen stays as it is: number of modes, monomials and mode-book of the
    surface, terms that a sparse fit has kept. The order of the rows means nothing.
    """
    X, y = rows_and_velocities(estimator, X, y)
    targets = y.reshape(len(y), -1)
    if len(X) != len(estimator.modes_):
        raise ValueError(
            f"X has {len(X)} samples but the estimator was fitted to {len(estimator.modes_)}; "
            "give the samples that it was fitted to."
        )
    if targets.shape[1] != estimator.coef_.shape[1]:
        raise ValueError(
            f"y has {targets.shape[1]} columns; give {estimator.coef_.shape[1]}, one for each "
            "velocity of the model."
        )
    fields = fitted_system(estimator).velocities(X)[estimator.modes_, np.arange(len(X))]
    loss = get_loss(estimator.loss)
    found = float(loss.values(targets - fields).sum())
    rounding = _ROUNDING * float(loss.values(targets).sum())
    if abs(found - estimator.objective_) > _SAME * estimator.objective_ + rounding:
        raise ValueError(
            "the laws have another loss on these samples than on those of the fit; give the very "
            "samples that the estimator was fitted to, without weights."
        )
    blocks = np.arange(len(X))
    if groups is not None:
        _, blocks = np.unique(group_labels(groups, len(X)), return_inverse=True)
    order = np.lexsort(np.column_stack([X, targets, blocks]).T[::-1])
    if groups is not None:
        blocks = blocks[order]
    rows = CanonicalRows((X[order], targets[order], blocks), np.ones(len(X)), order)
    fitted = build_problem(estimator, rows, estimator.switching_model.feature_map)
    book = mode_book_of(estimator.surface_)
    surface = clone(estimator.surface_)
    if book is not None:
        # A book with zeros cannot be given; that of pairs is the only one.
        surface.set_params(mode_book="pairwise" if (book == 0).any() else book)
    support = None if estimator.sparsity is None else estimator.coef_ != 0.0
    problem = replace(fitted, n_modes=estimator.n_modes_, surface=surface, support=support)
    return problem, estimator.modes_[order], blocks


def _corrections(confidence: float, n_blocks: int) -> tuple[Array, float]:
    """Tails of the percentile interval, and factor of the standard error, for few blocks.

    The mean of G blocks varies over resamples by (1 - 1 / G)^(1/2) of its standard error, and its
    interval has the quantiles of Student's t with G - 1 degrees of freedom, not normal ones. The
    tails are those that are right for a mean.
    """
    factor = np.sqrt(n_blocks / (n_blocks - 1.0))
    reach = factor * student.ppf(0.5 * (1.0 + confidence), n_blocks - 1)
    return normal.cdf([-reach, reach]), float(factor)


def _refit(problem, modes, weight, points, settle) -> tuple[Array, Array | None] | None:
    """Coefficients and surface values of one resample; None if a mode is lost."""
    drawn = np.flatnonzero(weight)
    problem = replace(problem.some(drawn), weight=weight[drawn])
    start = one_hot(modes[drawn], problem.n_modes)
    # What a resample has to complain about is counted, or was said when the data were fitted.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if problem.coupling:
            first = replace(problem, coupling=0.0).estimate(start)
            problem = calibrate(problem, first, modes[drawn])
        found = alternate(problem, start, **settle)
        if len(np.unique(found.modes)) < problem.n_modes:
            return None
        if points is None:
            return found.coef, None
        surface = fit_weighted(
            clone(problem.surface), problem.coordinates, found.modes, problem.weight
        )
        values = surface.surface_values(points)
    return found.coef, values / np.abs(values).mean(axis=0)
