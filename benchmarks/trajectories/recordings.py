"""Recordings of a plant: noise on the measured states, and what was true."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.trajectories.plants import Plant
from swsysid.results import Trajectory

__all__ = ["Campaign", "Scenario", "record"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scenario:
    """How a plant is measured.

    Attributes
    ----------
    noise : float
        Standard deviation of white noise, as a fraction of the spread of each measured state.
    per_period : int
        Samples in a period.
    n_recordings : int
    """

    noise: float
    per_period: int
    n_recordings: int

    @property
    def told(self) -> str:
        """The scenario in words."""
        return (
            f"{100 * self.noise:g} % noise, {self.per_period} samples a period, "
            f"{self.n_recordings} recordings"
        )


@dataclass(frozen=True)
class Campaign:
    """All recordings of one scenario; rows of all recordings follow each other.

    Attributes
    ----------
    t : ndarray of shape (n_samples,)
    x : ndarray of shape (n_samples, n_measured)
        As measured.
    inputs : ndarray of shape (n_samples, n_inputs) or None
    groups : ndarray of shape (n_samples,)
    states : ndarray of shape (n_samples, n_states)
        Without noise.
    modes : ndarray of shape (n_samples,)
    stays : list of (modes, times)
        For every recording the modes that it goes through, and when it switches.
    """

    t: Array
    x: Array
    inputs: Array | None
    groups: NDArray[np.intp]
    states: Array
    modes: NDArray[np.intp]
    stays: list[tuple[list[int], list[float]]]

    @property
    def columns(self) -> Array:
        """True states and inputs."""
        return self.states if self.inputs is None else np.hstack([self.states, self.inputs])

    def recordings(self) -> list[dict]:
        """What was measured, one dictionary for each recording."""
        found = []
        for label in np.unique(self.groups):
            rows = self.groups == label
            one = {"t": self.t[rows], "x": self.x[rows]}
            found.append(one if self.inputs is None else one | {"inputs": self.inputs[rows]})
        return found


def record(plant: Plant, scenario: Scenario, seed: int) -> Campaign:
    """Simulate a plant with events located, and add noise to what is measured.

    The noise-free states depend on the seed and the sampling alone.
    """
    rng, truth = np.random.default_rng([seed, 0]), plant.truth()
    step = plant.period / scenario.per_period
    t = step * np.arange(round(plant.duration * scenario.per_period) + 1)
    runs, inputs = [], []
    for _ in range(scenario.n_recordings):
        start = plant.start(rng)
        given = None if plant.inputs is None else plant.inputs(rng, t)
        runs.append(truth.simulate(start, t, given, input_hold="linear"))
        inputs.append(given)
    states = np.vstack([run.x for run in runs])
    measured = states[:, : plant.n_measured]
    noise = scenario.noise * measured.std(axis=0)
    white = np.random.default_rng([seed, 1]).standard_normal(measured.shape)
    return Campaign(
        t=np.tile(t, len(runs)),
        x=measured + noise * white,
        inputs=None if plant.inputs is None else np.vstack(inputs),
        groups=np.repeat(np.arange(len(runs)), len(t)),
        states=states,
        modes=np.concatenate([run.modes for run in runs]),
        stays=[_stays(run) for run in runs],
    )


def _stays(run: Trajectory) -> tuple[list[int], list[float]]:
    switches = [event for event in run.events if event.before != event.after]
    modes = [int(run.modes[0]) if not switches else switches[0].before]
    return modes + [event.after for event in switches], [event.time for event in switches]
