"""Recordings held out, models of the others alone, and rollouts over stretches of the unseen."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from swsysid._data.recordings import Record
from swsysid._data.trajectories import label_text, spread
from swsysid._free_rollouts.courses import Course
from swsysid._free_rollouts.judge import FreeRollouts, free_rollouts
from swsysid._free_rollouts.sample_noise import SampleNoise
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array, SolverError
from swsysid._simulation.model import SwitchingModel
from swsysid._stays.given import FEWEST_SAMPLES, Given, without_clipped
from swsysid._stays.output_error import OutputError
from swsysid._stays.pieces import between_jumps, without_limits
from swsysid._stays.recording_report import RecordingReport
from swsysid._stays.start import differentiated
from swsysid._verdict.comparison import Split
from swsysid._verdict.memory import NamedRows, memory
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.terms import Terms
from swsysid.refinement._parameters import ParametrizedPlant, grid_of
from swsysid.refinement._rollout_score import start_of
from swsysid.refinement._trajectories import substeps_for


@dataclass(frozen=True)
class Stretches:
    """Recordings cut into stretches of about as many samples, with all states roughly."""

    parts: list[Record]
    guess: list[Array]  # of each part, (n_samples, n_states)

    @classmethod
    def of(cls, records: Sequence[Record], guess: Sequence[Array], length: int) -> Stretches:
        """Of about so many samples each, none of which is in two stretches."""
        parts, states = [], []
        for record, rough in zip(records, guess, strict=True):
            count = max(1, round(len(record.t) / length))
            for rows in np.array_split(np.arange(len(record.t)), count):
                parts.append(Record(record.t[rows], record.y[rows], record.u[rows]))
                states.append(rough[rows])
        return cls(parts, states)

    @property
    def blocks(self) -> NDArray[np.intp]:
        """Stretch of every sample."""
        return np.repeat(np.arange(len(self.parts)), [len(part.t) for part in self.parts])

    def left_by(self, system: SwitchingModel, noise: Array) -> Array:
        """What rollouts leave of all samples, (n_samples, n_channels); NaN where none is measured.

        The start of every stretch is the one of highest likelihood, all of them sought at once.
        `noise` are the standard deviations of the channels.
        """
        problem = self._problem(system, noise)
        begun = problem.begun(np.zeros(0), np.array([one[0] for one in self.guess]))
        best, _ = problem.least(begun, JUDGING.turns, JUDGING.settled)
        found = np.full(problem.y.shape, np.nan)
        found[problem.measured] = best.misfit
        return found * noise

    def _problem(self, model: SwitchingModel, noise: Array) -> OutputError:
        """Rollouts of all stretches, of which nothing but their starts is free."""
        guess, u = np.vstack(self.guess), np.vstack([part.u for part in self.parts])
        columns, n_states = np.hstack([guess, u]), guess.shape[1]
        sizes = spread(columns)
        longest = max(float(np.diff(part.t).max()) for part in self.parts)
        plant = ParametrizedPlant.known(model, sizes, len(noise))
        steps = substeps_for(plant.parts(np.zeros(0)).laws, columns, longest)
        return OutputError(
            plant,
            grid_of(plant.system, self.parts, self.guess, held=False, substeps=steps),
            np.concatenate([part.y for part in self.parts]),
            noise,
            np.full(n_states, np.inf),
        )


class Identified(Protocol):
    """A fit to recordings."""

    n_modes_: int
    modes_: NDArray[np.intp]
    switch_times_: list[Array]


class IdentifiedTrajectories(Identified, Protocol):
    """The same of one surface, as `TrajectoryIdentifier`."""

    estimator_: SwitchingSystemRegressor
    states_: Array
    report_: RecordingReport


Fit = TypeVar("Fit", bound=Identified)
OfSurface = TypeVar("OfSurface", bound=IdentifiedTrajectories)
Fit_co = TypeVar("Fit_co", bound=Identified, covariant=True)


class Fits(Protocol[Fit_co]):
    """The same fit again, of some rows."""

    def __call__(
        self, rows: NDArray[np.bool_] | slice, n_modes: int | str, whole: bool, **options: object
    ) -> Fit_co:
        """By rollouts over stretches, or over `whole` recordings; `options` are the regressor's."""


@dataclass(frozen=True)
class Cut:
    """What is held out, cut into stretches, which count as independent."""

    records: list[Record]  # recordings, or their ends
    labels: list[object]
    guess: list[Array]  # of all their states, roughly
    kept: NDArray[np.bool_]  # rows of the stretches that are samples: limits of inputs are none
    rows: NDArray[np.intp]  # of the recordings, those of the samples
    length: int  # samples of a stretch

    @classmethod
    def of(cls, given: Given, states: Sequence[Array], split: Split) -> Cut:
        """Of recordings, and all of their states, roughly."""
        records, labels, guess, places = [], [], [], []
        for k, (record, own) in enumerate(zip(given.records, given.rows, strict=True)):
            # where an input steps between two rows, both limits go with the row before
            rows = own[np.maximum.accumulate(np.where(own >= 0, np.arange(len(own)), 0))]
            held = split.test[rows]
            if held.any():
                labels.append(given.labels[k])
                records.append(Record(record.t[held], record.y[held], record.u[held]))
                guess.append(states[k][held])
                places.append(rows[held])
        kept = np.asarray(np.isfinite(np.vstack([record.y for record in records])).any(axis=1))
        rows = np.concatenate(places)[kept]
        length = max(FEWEST_SAMPLES, min(JUDGING.stretch, len(rows) // JUDGING.fewest_stretches))
        return cls(records, labels, guess, kept, rows, length)

    @cached_property
    def stretches(self) -> Stretches:
        """The stretches."""
        return Stretches.of(self.records, self.guess, self.length)

    @property
    def longer(self) -> Cut | None:
        """The same in stretches twice as long; None where a stretch is a whole recording."""
        if len(self.stretches.parts) == len(self.records):
            return None
        longest = max(len(record.t) for record in self.records)
        return replace(self, length=min(2 * self.length, longest))

    @property
    def measured(self) -> Array:
        """The samples, (n_samples, n_channels)."""
        return np.vstack([record.y for record in self.records])[self.kept]

    @property
    def columns(self) -> Array:
        """States, roughly, and inputs at these, (n_samples, n_states + n_inputs)."""
        inputs = np.vstack([record.u for record in self.records])
        return np.hstack([np.vstack(self.guess), inputs])[self.kept]

    @property
    def blocks(self) -> NDArray[np.intp]:
        """Stretch of each."""
        return self.stretches.blocks[self.kept]

    def whole(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Samples of the stretches all of whose samples are kept."""
        return (np.bincount(self.blocks, weights=~kept) == 0)[self.blocks]


class HeldOut(ABC, Generic[Fit]):
    """Fits to some of the recordings, and what rollouts along the others leave of them."""

    cut: Cut
    made_from: Cut  # the others, in stretches of as many samples at first
    noise: Array  # (n_channels,)
    n_columns: int  # of states and inputs in a law
    laws: HeldOut  # the same of smooth laws of one mode

    def __init__(self, given: Given, split: Split, fits: Fits[Fit]):
        self.given, self.split, self.fits = given, split, fits

    @property
    def n_trained(self) -> int:
        """Samples of the training recordings."""
        pairs = zip(self.given.records, self.given.rows, strict=True)
        return sum(
            int((self.split.train[rows] & np.isfinite(one.y).any(axis=1)).sum())
            for one, rows in pairs
        )

    def trained(self, terms: Terms, n_modes: int, is_rival: bool = False) -> Fit:
        """Modes of the training recordings; what that warns about is no news."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self.fits(self.split.train, n_modes, False, **self._options(terms, is_rival))

    def _options(self, terms: Terms, is_rival: bool) -> dict[str, object]:
        """What is known is said of the declared terms, and not of those of a rival."""
        return terms.of_rival() if is_rival else terms.declared(self.n_columns)

    def rivals(self, terms: Terms) -> list[tuple[Terms, Fit]]:
        """Laws of one mode of the training recordings, with these terms and with more of them."""
        found = [(terms, self.trained(terms, 1))]
        for each in terms.richer(int(self.split.train.sum())):
            with suppress(ValueError, SolverError):  # such as sines of columns in the thousands
                found.append((each, self.trained(each, 1, is_rival=True)))
        return found

    def lengthened(self) -> bool:
        """Whether stretches become twice as long; not where they are whole recordings."""
        longer = self.cut.longer
        if longer is not None:
            self.cut = self.laws.cut = longer
        return longer is not None

    @abstractmethod
    def left_by(self, fit: Fit, cut: Cut) -> Array:
        """What rollouts over the stretches of a cut leave of all their samples."""

    @abstractmethod
    def free(self, fit: Fit) -> FreeRollouts | None:
        """What free rollouts of a fit leave of the held-out recordings."""

    @abstractmethod
    def rollouts(self, fit: Fit) -> FreeRollouts:
        """What those of a fit leave of its own recordings."""

    @abstractmethod
    def leaves_noise(self, fit: Fit) -> bool:
        """Whether nothing but noise is left where the laws are told when to switch."""

    @abstractmethod
    def channels(self, fit: Fit) -> tuple[str, ...]:
        """Names of the measured columns."""

    def is_one_law(self, fit: Fit) -> bool:
        """Whether nothing switches."""
        return fit.n_modes_ == 1

    def memory(self, fit: Fit) -> str:
        """Where each of two modes begins, if a guard remembers that it does not tell."""
        return ""

    def told(self, fit: Fit) -> Array | None:
        """What the laws leave of samples that tell the modes, (1, n_channels), if that is known."""
        return None


class HeldOutTrajectories(HeldOut[OfSurface]):
    """The same of fits of one surface, all stretches rolled out at once.

    No such model jumps: where states do, a stretch begins anew. Beside a model whose states jump
    rollouts go `through_jumps`, or it would stand beside laws that are told where a jump leads.
    """

    def __init__(
        self,
        given: Given,
        split: Split,
        fits: Fits[OfSurface],
        order: int = 1,
        units: Mapping[str, str] | None = None,
        through_jumps: bool = False,
    ):
        super().__init__(given, split, fits)
        self.laws, self.units = self, units or {}
        self.n_columns = order * given.n_channels + given.n_inputs
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the fit to all recordings tells of clipped samples
            pieces = without_limits(given) if through_jumps else between_jumps(given).given
            given = without_clipped(pieces)
            base = differentiated(given, order)
        recordings = base.recordings
        # of the samples that were measured, whichever cells are missing between them
        spread = recordings.joined(recordings.guess).std(axis=0)[: given.n_channels]
        self.noise = np.maximum(base.noise[: given.n_channels], JUDGING.integrated * spread)
        guess = [recordings.guess[own, k] for k, own in enumerate(recordings.sampled)]
        self.cut, self.made_from = Cut.of(given, guess, split), Cut.of(given, guess, split.swapped)

    def left_by(self, fit: OfSurface, cut: Cut) -> Array:
        """What rollouts over the stretches of a cut leave of all their samples."""
        return cut.stretches.left_by(fit.estimator_.switching_model, self.noise)[cut.kept]

    def free(self, fit: OfSurface) -> FreeRollouts | None:
        """What free rollouts of a fit leave of the held-out recordings."""
        cut, channels = self.cut, self.channels(fit)
        return free_of_records(fit.estimator_, cut.records, cut.labels, self.noise, channels)

    def rollouts(self, fit: OfSurface) -> FreeRollouts:
        """What those of a fit leave of its own recordings."""
        return fit.report_.rollouts

    def leaves_noise(self, fit: OfSurface) -> bool:
        """Whether nothing but noise is left where the laws are told when to switch."""
        return bool((fit.report_.excess <= JUDGING.noise_alone).all())

    def channels(self, fit: OfSurface) -> tuple[str, ...]:
        """Names of the measured columns."""
        return fit.report_.channels

    def memory(self, fit: OfSurface) -> str:
        """Where each of two modes begins, if their surface cannot tell it."""
        if fit.n_modes_ != 2 or fit.report_.rollouts.tells_switches:
            return ""
        inputs = self.given.by_rows([record.u for record in self.given.records])
        names = fit.estimator_.switching_model.feature_map.names_in
        X = np.hstack([fit.states_, inputs])
        return memory(fit.modes_, NamedRows(X, self.given.places, names, self.units))


def free_of_records(
    model: SwitchingSystemRegressor,
    records: Sequence[Record],
    labels: Sequence[object],
    noise: Array,
    names: Sequence[str],
    switches: Sequence | None = None,
) -> FreeRollouts | None:
    """Of the first few trajectories, each from the start that fits its first samples best.

    Without `switches` the model has not seen them.
    """
    long = [k for k, record in enumerate(records) if len(record.t) >= FEWEST_SAMPLES]
    courses = [
        Course(
            label_text(labels[k]),
            records[k],
            start_of(model, records[k], JUDGING.samples_of_start),
            switches=None if switches is None else switches[k],
        )
        for k in long[: JUDGING.most_rolled_out]
    ]
    if not courses:
        return None
    spread = np.nanstd(np.vstack([course.record.y for course in courses]), axis=0)
    noise = np.maximum(noise, JUDGING.integrated * spread)
    known = SampleNoise.constant(noise, [course.label for course in courses])
    unseen = switches is None
    return free_rollouts(model, courses, known, names[: len(noise)], unseen=unseen)
