"""The main job: from a table of measured trajectories to an identified, tested model.

One pure function, ``run_job(table, options) -> JobResult``. Everything that the command line
prints is in the result; nothing is printed or written here.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.from_recordings import FromRecordings, identify_recordings
from swsysid._cli.options import JobOptions
from swsysid._cli.samples import Samples, measure
from swsysid._data.features import Monomials
from swsysid._data.recordings import Record
from swsysid._data.trajectories import trajectories
from swsysid._free_rollouts.courses import switches_of_samples
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._stays.given import read_given
from swsysid._tables.table import Table
from swsysid._verdict.comparison import Comparison, Split, Verdict, hold_out
from swsysid._verdict.held_out import free_of_records
from swsysid._verdict.memory import memory
from swsysid._verdict.rows import Rows, compared_rows
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.terms import Terms
from swsysid._verdict.verdict import SwitchingVerdict
from swsysid._verdict.words import COMMAND_LINE
from swsysid.differentiation import estimate_noise


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
    verdict: SwitchingVerdict  # on the modes that were found
    position_gain: float | None  # by which positions lower the error, where that decided
    notes: tuple[str, ...] = ()  # what the fit to derivatives warned about
    remark: str = ""  # why the model is one of derivatives, where they were computed

    @property
    def comparison(self) -> Comparison:
        """The modes that were found beside smooth laws of one mode."""
        return self.verdict.comparison

    @property
    def memory(self) -> str:
        """Where each of two modes begins, if a guard remembers; else ""."""
        return memory(self.modes, self.samples) if self.model.n_modes_ == 2 else ""

    @property
    def remembers(self) -> bool:
        """Whether a guard that remembers is why no surface tells the modes."""
        is_hidden = self.verdict.kind is Verdict.HIDDEN
        return self.verdict.remembers or (is_hidden and bool(self.memory))

    @property
    def given_up(self) -> int | None:
        """Modes that "auto" found before a smooth law proved as good."""
        return self.verdict.given_up


_NO_MODES = (Verdict.ONE_MODE, Verdict.SMOOTH, Verdict.USELESS)


def run_job(table: Table, options: JobOptions) -> JobResult:
    """Identify, and compare with smooth laws of one mode on what is held out.

    Where derivatives were computed, the recordings themselves decide if they can.
    TableError and ValueError say in a sentence what to change.
    """
    samples = measure(table, options.measurement)
    split = hold_out(samples.groups, options.test_fraction, options.random_state)
    terms, position_gain = _terms(samples, split, options)
    found, remark = identify_recordings(samples, terms, options)
    if found is None or remark:
        derived = _from_derivatives(samples, terms, split, options)
        # modes of derivatives alone that are not to be trusted tell less than one law of samples
        if found is None or derived.verdict.kind not in _NO_MODES:
            return replace(derived, position_gain=position_gain, remark=remark)
    return JobResult(
        model=found.model,
        modes=found.modes,
        declared=_regressor(found.terms, samples, options, options.modes),
        found=found,
        samples=samples,
        options=options,
        terms=found.terms,
        split=found.split,
        verdict=found.verdict,
        position_gain=position_gain,
    )


def _from_derivatives(
    samples: Samples, terms: Terms, split: Split, options: JobOptions
) -> JobResult:
    """What derivatives alone say."""

    def estimator(terms: Terms, n_modes: int | str) -> SwitchingSystemRegressor:
        return _regressor(terms, samples, options, n_modes)

    model, notes = _fit_with_notes(estimator(terms, options.modes), samples)
    comparison = compared_rows(model, _rows(samples), split, terms, estimator)
    given_up = None
    if options.modes == "auto" and comparison.verdict in (Verdict.SMOOTH, Verdict.ONE_MODE):
        given_up, terms = model.n_modes_, comparison.best.terms
        plain = estimator(terms, 1).set_params(sparsity="auto")
        model, notes = _fit_with_notes(plain, samples)
    has_rollouts = not options.measurement.quantity
    verdict = SwitchingVerdict(
        comparison,
        model.n_modes_,
        options.modes,
        samples.rate_names[samples.n_known :],
        str(terms),
        int(split.train.sum()),
        split.whole_groups,
        model.n_modes_ > 1,
        free=_free_rollouts(model, samples) if has_rollouts else None,
        given_up=given_up,
        words=COMMAND_LINE,
    )
    return JobResult(
        model=model,
        modes=model.modes_,
        declared=model,
        found=None,
        samples=samples,
        options=options,
        terms=terms,
        split=split,
        verdict=verdict,
        position_gain=None,
        notes=notes,
    )


def _rows(samples: Samples) -> Rows:
    return Rows(samples.frame, samples.Xdot, samples.groups, samples.n_known)


def _free_rollouts(model: SwitchingSystemRegressor, samples: Samples) -> FreeRollouts | None:
    """Of a model of derivatives along the trajectories; None where the times are not known."""
    if samples.t is None:
        return None
    recorded, n_states = samples.recorded, samples.Xdot.shape[1]
    if recorded is not None and samples.smoothing is not None:
        given = read_given(*recorded.named(samples.names, slice(None)))
        records, labels = given.records, given.labels
        noise = samples.smoothing.noise[: given.n_channels]
    else:
        rows = trajectories(samples.groups)
        X, t = samples.X, samples.t
        records = [Record(t[own], X[own, :n_states], X[own, n_states:]) for _, own in rows]
        labels = [label for label, _ in rows]
        noise = estimate_noise(X[:, :n_states], samples.groups)
    switches = [
        switches_of_samples(samples.t[own], model.modes_[own])
        for own in (samples.groups == label for label in labels)
    ]
    return free_of_records(model, records, labels, noise, samples.names, switches)


def _terms(samples: Samples, split: Split, options: JobOptions) -> tuple[Terms, float | None]:
    """Terms of the laws, and what the positions are worth in them where that was tested."""
    everything = tuple(range(samples.X.shape[1]))
    full = Terms(everything, options.library_degree, options.waves, *samples.angles)
    without = replace(full, columns=everything[samples.n_known :])
    if not samples.n_known or options.position == "yes":
        return full, None
    if options.position == "no":
        return without, None
    model = _rows(samples).fitted(_regressor(full, samples, options, options.modes), split.train)
    worth = _worth_of_positions(model, samples, split.train, options)
    return (full if worth >= JUDGING.worth else without), worth


def _regressor(
    terms: Terms, samples: Samples, options: JobOptions, n_modes: int | str
) -> SwitchingSystemRegressor:
    library, known = terms.library(samples.X.shape[1]), list(options.known) or None
    return options.regressor(n_modes, feature_library=library, known=known)


def _fit_with_notes(
    estimator: SwitchingSystemRegressor, samples: Samples
) -> tuple[SwitchingSystemRegressor, tuple[str, ...]]:
    """The estimator fitted to all rows, and what that warned about."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        estimator.fit(samples.frame, samples.Xdot, groups=samples.groups)
    return estimator, tuple(str(warning.message) for warning in caught)


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
