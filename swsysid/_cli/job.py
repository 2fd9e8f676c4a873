"""The main job: from a table of measured trajectories to an identified, tested model.

One pure function, ``run_job(table, options) -> JobResult``. Everything that the command line
prints is in the result; nothing is printed or written here.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.free import free_of_samples
from swsysid._cli.from_recordings import FromRecordings, identify_recordings
from swsysid._cli.options import JobOptions
from swsysid._cli.samples import Samples, measure
from swsysid._cli.settings import JUDGING
from swsysid._cli.terms import Terms
from swsysid._cli.verdict import Comparison, Rival, Split, Verdict, count_switches, hold_out
from swsysid._data.features import Monomials
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._tables.table import Table


@dataclass(frozen=True)
class JobResult:
    """What was identified and how well such models predict rows that they never saw."""

    model: SwitchingSystemRegressor  # of all rows; its columns have names
    modes: NDArray[np.intp]  # of the rows, by that model
    declared: SwitchingSystemRegressor  # what is searched for on derivatives
    found: FromRecordings | None  # the model beside what else the recordings tell
    samples: Samples
    options: JobOptions
    terms: Terms  # of the laws of the model
    split: Split
    comparison: Comparison  # of the modes that were found with smooth laws of one mode
    given_up: int | None  # modes that "auto" found before a smooth law proved as good
    position_gain: float | None  # by which positions lower the error, where that decided
    notes: tuple[str, ...] = ()  # what the fit to derivatives warned about
    remark: str = ""  # why the model is one of derivatives, where they were computed
    free: FreeRollouts | None = None  # of a model of derivatives; None without times

    @property
    def free_rollouts(self) -> list[FreeRollouts | None]:
        """What free rollouts leave of the trajectories, and of those that are held out."""
        found = self.found
        return [self.free] if found is None else [found.free, found.free_of_held_out]


def run_job(table: Table, options: JobOptions) -> JobResult:
    """Identify, and compare with smooth laws of one mode on what is held out.

    Where derivatives were computed, the recordings themselves decide if they can.
    TableError and ValueError say in a sentence what to change.
    """
    samples = measure(table, options.measurement)
    split = hold_out(samples.groups, options.test_fraction, options.random_state)
    terms, position_gain = _terms(samples, split, options)
    found, remark = identify_recordings(samples, terms, options)
    if found is None:
        derived = _from_derivatives(samples, terms, split, options)
        return replace(derived, position_gain=position_gain, remark=remark)
    return JobResult(
        model=found.model,
        modes=found.modes,
        declared=_regressor(found.terms, samples, options, options.modes),
        found=found,
        samples=found.samples,
        options=options,
        terms=found.terms,
        split=found.split,
        comparison=found.comparison,
        given_up=found.given_up,
        position_gain=position_gain,
    )


def _from_derivatives(
    samples: Samples, terms: Terms, split: Split, options: JobOptions
) -> JobResult:
    """What derivatives alone say."""
    what = options.measurement
    model, notes = _fit_with_notes(_regressor(terms, samples, options, options.modes), samples)
    comparison = _compare(model, terms, samples, split, options)
    given_up = None
    if options.modes == "auto" and comparison.verdict in (Verdict.SMOOTH, Verdict.ONE_MODE):
        given_up, terms = model.n_modes_, comparison.best.terms
        plain = _regressor(terms, samples, options, 1).set_params(sparsity="auto")
        model, notes = _fit_with_notes(plain, samples)
    return JobResult(
        model=model,
        modes=model.modes_,
        declared=model,
        found=None,
        samples=samples,
        options=options,
        terms=terms,
        split=split,
        comparison=comparison,
        given_up=given_up,
        position_gain=None,
        notes=notes,
        free=None if what.quantity else free_of_samples(model, samples, model.modes_),
    )


def _terms(samples: Samples, split: Split, options: JobOptions) -> tuple[Terms, float | None]:
    """Terms of the laws, and what the positions are worth in them where that was tested."""
    everything = tuple(range(samples.X.shape[1]))
    full = Terms(everything, options.library_degree, options.waves, *samples.angles)
    without = replace(full, columns=everything[samples.n_known :])
    if not samples.n_known or options.position == "yes":
        return full, None
    if options.position == "no":
        return without, None
    model = _fit_quietly(_regressor(full, samples, options, options.modes), samples, split.train)
    worth = _worth_of_positions(model, samples, split.train, options)
    return (full if worth >= JUDGING.worth else without), worth


def _regressor(
    terms: Terms, samples: Samples, options: JobOptions, n_modes: int | str
) -> SwitchingSystemRegressor:
    return options.regressor(n_modes, feature_library=terms.library(samples.X.shape[1]))


def _compare(
    model: SwitchingSystemRegressor,
    terms: Terms,
    samples: Samples,
    split: Split,
    options: JobOptions,
) -> Comparison:
    """The model's modes, searched for in the training rows alone, against smooth laws."""
    frame = samples.frame
    shares = np.bincount(model.modes_[split.train], minlength=model.n_modes_) / split.train.sum()
    is_seen = shares >= JUDGING.rare_mode
    judged = split.test & is_seen[model.modes_]
    judged = judged if judged.any() else split.test

    def errors(terms: Terms, n_modes: int):
        again = _regressor(terms, samples, options, n_modes)
        fitted = _fit_quietly(again, samples, split.train)
        return (samples.Xdot[judged] - fitted.predict(frame[judged]))[:, samples.n_known :]

    smooth = [terms, *terms.richer(int(split.train.sum()))]
    predicted = model.predict_modes(frame)
    constant = bool(model.n_modes_ > 1 and (predicted == predicted[0]).all())
    laws = model.mode_velocities(frame[judged])
    told = samples.Xdot[judged] - laws[model.modes_[judged], np.arange(judged.sum())]
    return Comparison(
        errors=errors(terms, int(is_seen.sum())),
        rivals=tuple(Rival(each, errors(each, 1)) for each in smooth),
        spread=samples.Xdot[judged, samples.n_known :].std(axis=0),
        n_switches=count_switches(predicted, samples.groups),
        constant=constant,
        told_by_rates=None if np.isnan(model.guard_score_) else told[:, samples.n_known :],
        untested=tuple(int(mode) for mode in np.flatnonzero(~is_seen)),
    )


def _fit_with_notes(
    estimator: SwitchingSystemRegressor, samples: Samples
) -> tuple[SwitchingSystemRegressor, tuple[str, ...]]:
    """The estimator fitted to all rows, and what that warned about."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        estimator.fit(samples.frame, samples.Xdot, groups=samples.groups)
    return estimator, tuple(str(warning.message) for warning in caught)


def _fit_quietly(estimator, samples: Samples, rows) -> SwitchingSystemRegressor:
    """A fit for comparison: what it warns about is no news of the model that is delivered."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        X, Xdot, groups = samples.frame[rows], samples.Xdot[rows], samples.groups[rows]
        return estimator.fit(X, Xdot, groups=groups)


def _worth_of_positions(model, samples: Samples, train, options: JobOptions) -> float:
    """Fraction by which positions lower the error of the law, cross-validated over blocks.

    The modes are those of the model that may use the positions; given them the laws are plain
    least squares, so that the comparison costs nothing. An angle that turns over matters by its
    sine, whatever the library, and products of it say nothing.
    """
    X, targets = samples.X[train], samples.Xdot[train, samples.n_known :]
    modes, n_blocks = model.predict_modes(samples.frame[train]), JUDGING.blocks
    block = np.arange(len(X)) * n_blocks // len(X)
    degree, positions = options.library_degree or 1, X[:, : samples.n_known]
    without, full = (
        Monomials.up_to(degree, columns.shape[1])(columns)
        for columns in (X[:, samples.n_known :], X)
    )
    errors = []
    for design in (without, full, np.hstack([full, np.sin(positions), np.cos(positions)])):
        residuals = np.full_like(targets, np.nan)
        for mode in np.unique(modes):
            for held in range(n_blocks):
                inside = (modes == mode) & (block != held)
                outside = (modes == mode) & (block == held)
                if inside.sum() > design.shape[1]:
                    coef = np.linalg.lstsq(design[inside], targets[inside], rcond=None)[0]
                    residuals[outside] = targets[outside] - design[outside] @ coef
        errors.append(np.sqrt(np.nanmean((residuals / targets.std(axis=0)) ** 2)))
    return float(1.0 - min(errors[1:]) / errors[0]) if errors[0] > 0 else 0.0
