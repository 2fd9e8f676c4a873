"""Laws integrated along given states: the motion as a model draws it between the samples.

Between two samples the states are the cubic through their values and velocities. Where the mode
changes there, each part has the law of its own mode, up to the instant that the surface says.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._pipelines import switching_step
from swsysid._results import Array

Modes = NDArray[np.intp]

_BISECTIONS = 7  # of a step: the instant of a switch to less than its hundredth


@dataclass(frozen=True)
class Drawing:
    """Steps from sample to sample of a record, by the laws of a fit."""

    fit: JointFit
    records: Records

    def drawn(self) -> Array:
        """Integrals of the laws from the begin of each trajectory, (n_samples, n_states)."""
        steps, drawn = self._steps(), np.zeros((len(self.records), self.records.n_states))
        start = 0
        for rows in self.records.trajectories:
            own = steps[start : start + len(rows) - 1]
            drawn[rows[1:]], start = np.cumsum(own, axis=0), start + len(own)
        return drawn

    # -- from sample to sample -------------------------------------------------------------------

    @cached_property
    def _ends(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows at which each step begins and ends."""
        trajectories = self.records.trajectories
        first = np.concatenate([rows[:-1] for rows in trajectories])
        return first, np.concatenate([rows[1:] for rows in trajectories])

    @cached_property
    def _durations(self) -> Array:
        assert self.records.t is not None
        first, last = self._ends
        return (self.records.t[last] - self.records.t[first])[:, None]

    @cached_property
    def _at_samples(self) -> tuple[Array, Modes]:
        """Velocities and modes at the samples."""
        velocities, modes = self._laws(self.records.X)
        return velocities[modes, np.arange(len(modes))], modes

    def _steps(self) -> Array:
        """What each step adds to the states."""
        velocity, modes = self._at_samples
        first, last = self._ends
        each, before, after = np.arange(len(first)), modes[first], modes[last]
        middle = self._laws(self._between(0.5))[0][before, each]
        simpson = self._durations / 6.0 * (velocity[first] + 4.0 * middle + velocity[last])
        switched = before != after
        if not switched.any():
            return simpson
        share = self._switch(before)
        parts = [
            (share, self._laws(self._between(0.5 * share))[0][before, each]),
            (1.0 - share, self._laws(self._between(0.5 * (1.0 + share)))[0][after, each]),
        ]
        parted = self._durations * sum(part[:, None] * law for part, law in parts)
        return np.where(switched[:, None], parted, simpson)

    def _switch(self, before: Modes) -> Array:
        """Share of each step at which it leaves the mode that it begins in."""
        low, high = np.zeros(len(before)), np.ones(len(before))
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            stays = self._laws(self._between(middle))[1] == before
            low, high = np.where(stays, middle, low), np.where(stays, high, middle)
        return 0.5 * (low + high)

    def _between(self, share: Array | float) -> Array:
        """States and inputs inside the steps, the inputs linear."""
        (first, last), (velocity, _) = self._ends, self._at_samples
        n_states, X = self.records.n_states, self.records.X
        part = np.broadcast_to(np.asarray(share), (len(first),))[:, None]
        inside = X[first] + part * (X[last] - X[first])
        chord = (X[last] - X[first])[:, :n_states]
        bends = (1.0 - part) * (self._durations * velocity[first] - chord)
        bends -= part * (self._durations * velocity[last] - chord)
        inside[:, :n_states] += part * (1.0 - part) * bends
        return inside

    def _laws(self, X: Array) -> tuple[Array, Modes]:
        """Velocities in every mode, and the modes, of the declared model alone."""
        transform, switching = switching_step(self.fit.estimator)
        columns = np.asarray(transform(X))
        return np.array(switching.mode_velocities(columns)), switching.predict_modes(columns)

    @cached_property
    def near_a_switch(self) -> NDArray[np.intp]:
        """Rows after which the mode changes within their trajectory."""
        first, last = self._ends
        modes = self._at_samples[1]
        return first[modes[first] != modes[last]]
