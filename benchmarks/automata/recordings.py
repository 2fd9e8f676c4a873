"""Recordings of a plant: noise on the measured states, and what was true."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchmarks.automata.plant import Array, Plant, Start
from benchmarks.automata.truth import Run, run

__all__ = ["HELD_OUT", "Campaign", "Scenario", "record"]

HELD_OUT = 10_000  # added to the seed of the recordings that nobody has seen


@dataclass(frozen=True)
class Scenario:
    """How a plant is measured.

    Attributes
    ----------
    noise : float
        Standard deviation of white noise, as a fraction of the spread of each state.
    n_recordings, n_samples : int
        Of the training set, and samples of each recording.
    """

    noise: float = 0.0
    n_recordings: int = 8
    n_samples: int = 400

    @property
    def told(self) -> str:
        """The scenario in words."""
        noise = f"{100 * self.noise:g} % noise" if self.noise else "clean"
        return f"{noise}, {self.n_recordings} recordings of {self.n_samples} samples"


@dataclass(frozen=True)
class Campaign:
    """All recordings of one scenario.

    Attributes
    ----------
    runs : list of Run
        What happened.
    starts : list of Start
    given : list of ndarray or None
        The inputs of each recording.
    noise : ndarray of shape (n_rows, n_states)
        On the rows of all recordings, one after the other.
    """

    runs: list[Run]
    starts: list[Start]
    given: list[Array | None]
    noise: Array

    @cached_property
    def t(self) -> Array:
        """Times of all rows."""
        return np.concatenate([one.t for one in self.runs])

    @cached_property
    def states(self) -> Array:
        """States of all rows, without noise."""
        return np.concatenate([one.x for one in self.runs])

    @cached_property
    def x(self) -> Array:
        """States of all rows, as measured."""
        return self.states + self.noise

    @cached_property
    def inputs(self) -> Array | None:
        """Inputs of all rows."""
        told = [one for one in self.given if one is not None]
        return np.concatenate(told) if told else None

    @cached_property
    def groups(self) -> NDArray[np.intp]:
        """Recording of every row."""
        return np.repeat(np.arange(len(self.runs)), [len(one.t) for one in self.runs])

    @cached_property
    def modes(self) -> NDArray[np.intp]:
        """True mode of every row."""
        return np.concatenate([one.modes for one in self.runs])

    @property
    def instants(self) -> list[Array]:
        """When each recording switches or jumps."""
        return [np.array([crossing.time for crossing in one.crossings]) for one in self.runs]


def record(plant: Plant, scenario: Scenario, seed: int) -> Campaign:
    """Run a plant with events located, and add noise to its states.

    What happens depends on the seed and the numbers of recordings and samples, not on the noise.
    """
    rng = np.random.default_rng([seed, 0])
    runs, starts, given = [], [], []
    for number in range(scenario.n_recordings):
        start = plant.start(rng, number)
        steps = np.arange(scenario.n_samples)
        t = start.time + plant.dt * steps
        inputs = None
        if plant.inputs is not None:
            knots = np.arange(0, scenario.n_samples + plant.knot, plant.knot)
            values = plant.inputs(rng, start.time + plant.dt * knots)
            inputs = np.column_stack([np.interp(steps, knots, column) for column in values.T])
        runs.append(run(plant, start, t, inputs))
        starts.append(start)
        given.append(inputs)
    states = np.concatenate([one.x for one in runs])
    white = np.random.default_rng([seed, 1]).standard_normal(states.shape)
    return Campaign(runs, starts, given, scenario.noise * states.std(axis=0) * white)
