"""Recordings of which some are held out, and models identified from the others alone."""

from __future__ import annotations

import warnings
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.free import free_of_records
from swsysid._cli.options import JobOptions
from swsysid._cli.samples import Samples
from swsysid._cli.settings import JUDGING
from swsysid._cli.stretches import Stretches
from swsysid._cli.terms import Terms
from swsysid._cli.verdict import Split, hold_out
from swsysid._data.recordings import Record
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._results import Array, SolverError
from swsysid._stays.given import read_given, without_clipped
from swsysid._stays.pieces import between_jumps
from swsysid._stays.start import differentiated
from swsysid._trajectory_identifier import TrajectoryIdentifier


class HeldOut:
    """Fits to some of the recordings, and what rollouts along the others leave of them."""

    def __init__(self, samples: Samples, options: JobOptions):
        assert samples.recorded is not None and samples.smoothing is not None
        self.samples, self.options, self.recorded = samples, options, samples.recorded
        recorded, self.order = self.recorded, options.measurement.order
        self.split: Split = hold_out(recorded.groups, options.test_fraction, options.random_state)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the fit to all recordings tells of clipped samples
            given = read_given(*self.recorded.named(samples.names, slice(None)))
            given = without_clipped(between_jumps(given).given)
            base = differentiated(given, self.order)
        recordings = base.recordings
        # of the samples that were measured, whichever cells are missing between them
        spread = recordings.joined(recordings.guess).std(axis=0)
        shown = samples.smoothing.noise[: given.n_channels]
        self.noise: Array = np.maximum(shown, JUDGING.integrated * spread[: given.n_channels])
        records, guess, places = [], [], []
        self.labels: list[object] = []  # of the recordings that are held out, or their ends
        for k, (record, rows) in enumerate(zip(given.records, given.rows, strict=True)):
            held = self.split.test[rows]
            if held.any():
                self.labels.append(given.labels[k])
                records.append(Record(record.t[held], record.y[held], record.u[held]))
                guess.append(recordings.guess[recordings.sampled[k][held], k])
                places.append(rows[held])
        self.records, self.stretches = records, Stretches.of(records, guess)
        measured = np.vstack([record.y for record in records])
        self.kept = np.isfinite(measured).any(axis=1)  # no sample are the limits of inputs
        self.measured, self.blocks = measured[self.kept], self.stretches.blocks[self.kept]
        self.rows = np.concatenate(places)[self.kept]  # of the recordings: those of the stretches

    def identified(
        self, terms: Terms, n_modes: int | str, *, whole: bool = False, **options
    ) -> TrajectoryIdentifier:
        """Laws, modes and surface of highest likelihood of all recordings.

        By rollouts over stretches, or with `whole` over whole ones; `options` are the regressor's.
        """
        library = terms.library(self.samples.X.shape[1])
        with warnings.catch_warnings():
            # smoothing told of clipped samples already
            warnings.filterwarnings("ignore", message="samples stand at an end of the range")
            return self._fitted(n_modes, slice(None), whole, feature_library=library, **options)

    def trained(self, terms: Terms, n_modes: int) -> TrajectoryIdentifier:
        """The same of those that are not held out; what it warns about is no news."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return self._fitted(n_modes, self.split.train, False, feature_library=terms.at_once())

    def rivals(self, terms: Terms) -> list[tuple[Terms, TrajectoryIdentifier]]:
        """Laws of one mode of the training recordings, with these terms and with more of them."""
        found = [(terms, self.trained(terms, 1))]
        for each in terms.richer(int(self.split.train.sum())):
            with suppress(ValueError, SolverError):  # such as sines of columns in the thousands
                found.append((each, self.trained(each, 1)))
        return found

    def left_by(self, identifier: TrajectoryIdentifier) -> Array:
        """What rollouts leave of all held-out samples."""
        system = identifier.estimator_.switching_model
        return self.stretches.left_by(system, self.noise)[self.kept]

    def free(self, identifier: TrajectoryIdentifier) -> FreeRollouts | None:
        """What free rollouts of a fit leave of the held-out samples."""
        model, names = identifier.estimator_, self.samples.names
        return free_of_records(model, self.records, self.labels, self.noise, names)

    def stretches_in(self, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Samples of the stretches all of whose samples are kept."""
        return (np.bincount(self.blocks, weights=~kept) == 0)[self.blocks]

    def _fitted(self, n_modes: int | str, rows, whole: bool, **options) -> TrajectoryIdentifier:
        estimator = self.options.regressor(n_modes).set_params(verbose=0, **options)
        identifier = TrajectoryIdentifier(
            estimator,
            order=self.order,
            refine=whole,
            n_jobs=self.options.n_jobs,
            verbose=int(self.options.verbose and not isinstance(rows, np.ndarray)),
        )
        return identifier.fit(*self.recorded.named(self.samples.names, rows))
