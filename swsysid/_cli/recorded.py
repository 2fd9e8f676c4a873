"""The trajectories of a file as they were measured, for an identification without derivatives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.measurement import Measurement
from swsysid._data.trajectories import group_labels, places_along, trajectories
from swsysid._output_error.stretches import thinning
from swsysid._results import Array
from swsysid._stays.given import FEWEST_SAMPLES


@dataclass(frozen=True)
class Steps:
    """Instants at which inputs that keep their value have a new one."""

    rows: NDArray[np.intp]  # of the table
    t: Array
    before: Array  # all inputs, (n_steps, n_inputs)
    after: Array


@dataclass(frozen=True)
class Recorded:
    """Measured states and inputs with their times, in order of time within each trajectory.

    Rows without a state are limits of inputs at instants at which these step.
    """

    states: Array  # as they are in the file; with order 2 positions
    inputs: Array
    signals: Array
    t: Array
    groups: NDArray

    @classmethod
    def of(cls, numbers: Array, labels: NDArray, what: Measurement) -> Recorded:
        """Every K-th row, without trajectories that are too short for a motion."""
        codes = np.unique(labels, return_inverse=True)[1]
        kept = places_along(codes) % what.decimate == 0
        kept &= np.bincount(codes, weights=kept)[codes] >= FEWEST_SAMPLES
        ends = np.cumsum([len(what.states), len(what.inputs), len(what.signals)])
        states, inputs, signals, times = np.split(numbers[kept], ends, axis=1)
        return cls(states, inputs, signals, times[:, -1], labels[kept])

    def with_steps(self, steps: Steps, labels: NDArray) -> Recorded:
        """With the limits of inputs where they step; `labels` are the trajectories of the steps.

        A line from one sample of the states to the next would begin too early, and end too late.
        """
        places, limits, order = [], [], np.argsort(steps.t, kind="stable")
        for label in set(self.groups.tolist()):
            own = np.flatnonzero(self.groups == label)
            for k in order[labels[order] == label]:
                after = int(np.searchsorted(self.t[own], steps.t[k]))
                if 0 < after < len(own):
                    measured = self.t[own[after]] == steps.t[k]
                    sides = (steps.before[k],) if measured else (steps.before[k], steps.after[k])
                    places += [own[after]] * len(sides)
                    limits += [(steps.t[k], label, side) for side in sides]
        if not places:
            return self
        t, names, inputs = map(list, zip(*limits, strict=True))
        return Recorded(
            np.insert(self.states, places, np.nan, axis=0),
            np.insert(self.inputs, places, inputs, axis=0),
            np.insert(self.signals, places, np.nan, axis=0),
            np.insert(self.t, places, t),
            np.insert(self.groups, places, np.array(names, dtype=self.groups.dtype)),
        )

    @property
    def holds_a_state(self) -> NDArray[np.bool_]:
        """The rows in which some state was measured."""
        return np.asarray(np.isfinite(self.states).any(axis=1), dtype=bool)

    @property
    def n_samples(self) -> int:
        """How many rows hold a state."""
        return int(self.holds_a_state.sum())

    def of_samples(self) -> Recorded:
        """Rows that hold a state, all inputs and all signals; no limits of inputs."""
        known = np.isfinite(np.hstack([self.inputs, self.signals])).all(axis=1)
        kept = self.holds_a_state & known
        columns = self.states, self.inputs, self.signals, self.t, self.groups
        return Recorded(*(column[kept] for column in columns))

    @property
    def thinning(self) -> int:
        """Every how many rows are enough, as for a search of what one law lacks; 1 with limits."""
        columns = np.hstack([self.states, self.inputs])
        if not np.isfinite(columns).all():
            return 1
        own = [rows for _, rows in trajectories(group_labels(self.groups, len(self.groups)))]
        every = thinning(columns, own, np.zeros(columns.shape[1], dtype=bool))
        return every if min(map(len, own)) >= every * FEWEST_SAMPLES else 1

    def every(self, k: int) -> Recorded:
        """Every k-th row of each trajectory."""
        codes = np.unique(self.groups, return_inverse=True)[1]
        kept = places_along(codes) % k == 0
        columns = self.states, self.inputs, self.signals, self.t, self.groups
        return Recorded(*(column[kept] for column in columns))

    def named(self, names: Sequence[str], rows) -> tuple:
        """States, times, trajectories and inputs of some rows, as an identifier takes them."""
        import pandas as pd

        n_states, n_inputs = self.states.shape[1], self.inputs.shape[1]
        x = pd.DataFrame(self.states[rows], columns=list(names[:n_states]))
        inputs = None
        if n_inputs:
            inputs = pd.DataFrame(self.inputs[rows], columns=list(names[-n_inputs:]))
        return x, self.t[rows], self.groups[rows], inputs

    @property
    def labels(self) -> list[object]:
        """Names of the trajectories, in the order in which `TrajectoryIdentifier` takes them."""
        found = trajectories(group_labels(self.groups, len(self.groups)))
        return [label for label, _ in found]

    def at(self, t: Array, groups: NDArray, values: NDArray, otherwise: NDArray) -> NDArray:
        """Values of the rows nearest to some times; `otherwise` in trajectories left out here."""
        found = otherwise.copy()
        for label in np.unique(groups):
            asked, own = groups == label, self.groups == label
            if own.any():
                middles = 0.5 * (self.t[own][1:] + self.t[own][:-1])
                found[asked] = values[own][np.searchsorted(middles, t[asked])]
        return found
