"""The main job: from a table of measured trajectories to an identified, tested model.

One pure function, ``run_job(table, options) -> JobResult``. Everything that the command line
prints is in the result; nothing is printed or written here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sklearn.base import clone
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._command.measurement import Measurement
from swsysid._command.refusal import TableError
from swsysid._command.samples import Samples, measure
from swsysid._command.tables import Table
from swsysid._regressor import SwitchingSystemRegressor

__all__ = ["JobOptions", "JobResult", "run_job"]

WHOLE_GROUPS = 5  # from so many trajectories on, whole ones are held out
BLOCKS = 10  # contiguous stretches on which two models are compared
WORTH = 0.05  # positions and modes must lower the error by this fraction to be worth having
EXACT = 1e-12  # squared errors below this fraction of the largest are round-off
CERTAIN = 2.0  # standard errors from which on a gain is called certain


@dataclass(frozen=True)
class JobOptions:
    """What to identify.

    Attributes
    ----------
    measurement : Measurement
    modes : int or "auto"
    library_degree : int
        Degree of the law of each mode; 0 means linear without a constant.
    surface_degree : int
    loss : {"l1", "l2", "squared"}
    position : {"auto", "yes", "no"}
        Whether the law may depend on the positions, with ``order=2``.
    test_fraction : float
    random_state : int
    n_jobs : int or None
    verbose : bool
        Whether fits show their progress.
    """

    measurement: Measurement
    modes: int | str = 2
    library_degree: int = 1
    surface_degree: int = 1
    loss: str = "l1"
    position: str = "auto"
    test_fraction: float = 0.3
    random_state: int = 0
    n_jobs: int | None = None
    verbose: bool = False


@dataclass(frozen=True)
class JobResult:
    """What was identified and how well it predicts rows that it never saw.

    Attributes
    ----------
    model : SwitchingSystemRegressor
        Fitted on all rows, started from what the training rows found.
    samples : Samples
    options : JobOptions
    n_train, n_test : int
    whole_groups : bool
        Whole trajectories were held out, not the last stretch of each.
    spread, single, switching : ndarray of shape (n_unknown,)
        Of the held-out rates whose law is sought: standard deviation, and root mean squared
        error of the best single mode and of the switching model, trained on the other rows.
    gain : float
        Mean gain of switching over contiguous held-out blocks, in standard errors of that mean.
    position_gain : float or None
        Fraction by which positions lower the error, where that decided about them.
    stability : float
        Fraction of the starts that found the same answer.
    """

    model: SwitchingSystemRegressor
    samples: Samples
    options: JobOptions
    n_train: int
    n_test: int
    whole_groups: bool
    spread: np.ndarray
    single: np.ndarray
    switching: np.ndarray
    gain: float
    position_gain: float | None
    stability: float

    @property
    def improvement(self) -> float:
        """Fraction by which switching lowers the held-out error of a single mode."""
        scale = np.where(self.spread > 0, self.spread, 1.0)
        single, switching = (np.linalg.norm(e / scale) for e in (self.single, self.switching))
        return float(1.0 - switching / single) if single > 0 else 0.0

    @property
    def switches(self) -> bool:
        """True if the held-out samples speak for switching: a gain both certain and worthwhile."""
        return self.gain > CERTAIN and self.improvement > WORTH


def run_job(table: Table, options: JobOptions) -> JobResult:
    """Differentiate, identify, and compare with the best single mode on held-out rows.

    Raises
    ------
    TableError, ValueError
        With a sentence on what to change.
    """
    if not 0.0 < options.test_fraction < 1.0:
        raise TableError(f"The test fraction {options.test_fraction:g} is not between 0 and 1.")
    samples = measure(table, options.measurement)
    test, whole_groups = _held_out(samples.groups, options)
    estimator, position_gain = _estimator(samples, ~test, options)
    switching = _fit(estimator, samples, ~test)
    single = _fit(clone(estimator).set_params(n_modes=1), samples, ~test)
    errors = [_residuals(model, samples, test) for model in (single, switching)]
    spread = samples.Xdot[test, samples.n_known :].std(axis=0)
    # Refined on all rows from what the training rows found, not searched for again.
    whole = clone(estimator).set_params(n_modes=switching.n_modes_, init=switching.coef_)
    return JobResult(
        model=_fit(whole, samples, np.ones_like(test)),
        samples=samples,
        options=options,
        n_train=int((~test).sum()),
        n_test=int(test.sum()),
        whole_groups=whole_groups,
        spread=spread,
        single=np.sqrt(np.mean(errors[0] ** 2, axis=0)),
        switching=np.sqrt(np.mean(errors[1] ** 2, axis=0)),
        gain=_gain(errors[0], errors[1], spread),
        position_gain=position_gain,
        stability=switching.stability_,
    )


def _held_out(groups, options: JobOptions) -> tuple[np.ndarray, bool]:
    """Rows to test on: whole trajectories if there are enough, else the last of each."""
    names, codes = np.unique(groups, return_inverse=True)
    whole = len(names) >= WHOLE_GROUPS
    if whole:
        n_test = max(1, round(options.test_fraction * len(names)))
        generator = np.random.default_rng(options.random_state)
        test = np.isin(codes, generator.permutation(len(names))[:n_test])
    else:
        rank = np.concatenate([np.flatnonzero(codes == k) for k in range(len(names))])
        position = np.empty(len(codes))
        counts = np.bincount(codes)
        position[rank] = np.concatenate([np.arange(n) / n for n in counts])
        test = position >= 1.0 - options.test_fraction
    if not test.any() or test.all():
        raise TableError(
            f"{len(groups)} samples are too few to hold out {options.test_fraction:g} of them."
        )
    return test, whole


def _estimator(samples: Samples, train, options: JobOptions):
    """The regressor to fit, and what the positions are worth where that was tested."""
    everything = list(range(samples.X.shape[1]))
    others = everything[samples.n_known :]
    if not samples.n_known or options.position == "yes":
        return _regressor(everything, samples, options), None
    if options.position == "no":
        return _regressor(others, samples, options), None
    full = _regressor(everything, samples, options)
    worth = _worth_of_positions(_fit(full, samples, train), samples, train, options)
    return (full if worth >= WORTH else _regressor(others, samples, options)), worth


def _regressor(columns, samples: Samples, options: JobOptions) -> SwitchingSystemRegressor:
    return SwitchingSystemRegressor(
        n_modes=options.modes,
        feature_library=_library(columns, samples.X.shape[1], options.library_degree),
        surface=PolynomialSurfaceClassifier(degree=options.surface_degree),
        loss=options.loss,
        n_jobs=options.n_jobs,
        random_state=options.random_state,
        verbose=int(options.verbose),
    )


def _library(columns, n_columns: int, degree: int):
    """Monomials of some columns; degree 0 leaves the columns as they are."""
    if len(columns) == n_columns:
        return degree or None
    chosen = ColumnTransformer(
        [("chosen", "passthrough", columns)], verbose_feature_names_out=False
    )
    return make_pipeline(chosen, PolynomialFeatures(degree)) if degree else chosen


def _fit(estimator, samples: Samples, rows) -> SwitchingSystemRegressor:
    return estimator.fit(samples.X[rows], samples.Xdot[rows], groups=samples.groups[rows])


def _residuals(model, samples: Samples, rows):
    residuals = samples.Xdot[rows] - model.predict(samples.X[rows])
    return residuals[:, samples.n_known :]


def _gain(single, switching, spread) -> float:
    """Mean log ratio of the squared errors over its standard error, blocks being independent.

    Ratios, because the errors of a decaying trajectory differ by decades between its blocks.
    """
    scale = np.where(spread > 0, spread, 1.0)
    size = np.array([np.sum((error / scale) ** 2, axis=1) for error in (single, switching)])
    blocks = np.array_split(size, min(BLOCKS, size.shape[1]), axis=1)
    if len(blocks) < 2:
        return 0.0
    means = np.array([block.mean(axis=1) for block in blocks])
    ratios = np.diff(np.log(means + EXACT * means.max()), axis=1)[:, 0]
    error = ratios.std(ddof=1) / np.sqrt(len(ratios))
    return float(-ratios.mean() / error) if error > 0 else 0.0


def _worth_of_positions(model, samples: Samples, train, options: JobOptions) -> float:
    """Fraction by which positions lower the error of the law, cross-validated over blocks.

    The modes are those of the model that may use the positions; given them the laws are plain
    least squares, so that the comparison costs nothing.
    """
    X, targets = samples.X[train], samples.Xdot[train, samples.n_known :]
    modes = model.predict_modes(X)
    block = np.arange(len(X)) * BLOCKS // len(X)
    everything = list(range(X.shape[1]))
    errors = []
    for columns in (everything[samples.n_known :], everything):
        design = PolynomialFeatures(options.library_degree or 1).fit_transform(X[:, columns])
        residuals = np.full_like(targets, np.nan)
        for mode in np.unique(modes):
            for held in range(BLOCKS):
                inside = (modes == mode) & (block != held)
                outside = (modes == mode) & (block == held)
                if inside.sum() > design.shape[1]:
                    coef = np.linalg.lstsq(design[inside], targets[inside], rcond=None)[0]
                    residuals[outside] = targets[outside] - design[outside] @ coef
        errors.append(np.sqrt(np.nanmean((residuals / targets.std(axis=0)) ** 2)))
    return float(1.0 - errors[1] / errors[0]) if errors[0] > 0 else 0.0
