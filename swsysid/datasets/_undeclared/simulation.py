"""Runs of a plant with mechanisms in it: inputs, the true law, Runge-Kutta on substeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from swsysid._results import Array
from swsysid._simulation.fixed_steps import runge_kutta
from swsysid.datasets._undeclared.mechanisms import Mechanism
from swsysid.datasets._undeclared.plants import PLANTS
from swsysid.datasets._undeclared.records import Drive, Modes, Plant

__all__ = ["Reference", "Run", "excite", "reference_run", "run", "signal_channels", "start"]

_N_SIGNALS = 3
_N_SINES = 6


@dataclass(frozen=True)
class Run:
    """Histories at the samples, times first: shapes (n_times, n_trajectories, ...).

    `recorded` are the states as the sensors give them, `structure` the features of the true
    law, `velocities` its values.
    """

    x: Array
    recorded: Array
    modes: Modes
    structure: Array
    velocities: Array


def run(plant: Plant, mechanisms: Sequence[Mechanism], x0: Array, u: Array, t, signals) -> Run:
    """Trajectories of the plant from x0 (n_trajectories, n_states) at the rows of `u`.

    Inputs and signals are linear between samples. The mode is that of the state at the begin
    of each substep.
    """
    law = _TrueLaw(plant, mechanisms)
    n_parts = 1 if plant.discrete else 2 * plant.substeps  # half substeps, for Runge-Kutta
    forces = law.received(_refined(u, n_parts), plant.time_step / n_parts)
    moments = list(
        zip(_refined(u, n_parts), _refined(t, n_parts), _refined(signals, n_parts), strict=True)
    )
    everyone, length = np.arange(u.shape[1]), plant.time_step / plant.substeps
    states, labels = [x0], [law.overruled(plant.modes(x0), x0)]
    for step in range((len(u) - 1) * plant.substeps):
        x, modes = states[-1], labels[-1]
        theta = law.coef[modes]

        def velocity(x: Array, part: float, step=step, theta=theta, modes=modes) -> Array:
            place = step if plant.discrete else 2 * step + int(2 * part)
            features = law.features(x, forces[modes, place, everyone], moments[place])
            return np.matmul(theta, features[..., np.newaxis])[..., 0]

        x = velocity(x, 0.0) if plant.discrete else runge_kutta(velocity, x, length)
        x, modes = law.land(x, modes)
        states.append(x)
        labels.append(modes)
    return _at_samples(law, np.array(states), np.array(labels), forces, (u, t, signals))


def _at_samples(law: _TrueLaw, fine: Array, labels: Modes, forces: Array, channels) -> Run:
    plant = law.plant
    x, modes = fine[:: plant.substeps], labels[:: plant.substeps]
    received = forces[:, :: 1 if plant.discrete else 2 * plant.substeps]
    rows, columns = np.indices(modes.shape)
    structure = law.features(x, received[modes, rows, columns], channels)
    velocities = np.einsum("nksf,nkf->nks", law.coef[modes], structure)
    recorded = fine
    for mechanism in law.mechanisms:
        recorded = mechanism.record(recorded, plant.time_step / plant.substeps)
    return Run(x, recorded[:: plant.substeps], modes, law.masked(structure, modes), velocities)


class _TrueLaw:
    """coef[mode] @ features, the mechanisms included, for all trajectories at once."""

    def __init__(self, plant: Plant, mechanisms: Sequence[Mechanism]):
        self.plant, self.mechanisms = plant, tuple(mechanisms)
        self.half_width = sum(mechanism.half_width for mechanism in mechanisms)
        n_own = [len(mechanism.functions) for mechanism in mechanisms]
        self.first = plant.coef.shape[2] + np.concatenate([[0], np.cumsum(n_own)]).astype(int)
        self.coef = np.pad(plant.coef, [(0, 0), (0, 0), (0, sum(n_own))])
        # modes of their own first: a term that acts in all modes acts in these too
        for place in np.argsort(n_own, kind="stable"):
            self.coef = mechanisms[place].extend(self.coef, self.first[place])

    def received(self, u: Array, step: float) -> Array:
        """Input that the plant receives in each mode, (n_modes, n_times, n_trajectories)."""
        received = []
        for mode in range(len(self.coef)):
            force = u
            for mechanism in self.mechanisms:
                if mechanism.mode in (None, mode):
                    force = mechanism.actuate(force, step)
            received.append(force)
        return np.array(received)

    def features(self, x: Array, received: Array, moment) -> Array:
        """Features of the true law, shape (..., n_features)."""
        u, t, signals = moment
        columns = self.plant.features(x, received)
        for mechanism in self.mechanisms:
            columns.extend(function(x, u, t, signals) for function in mechanism.functions)
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    def masked(self, structure: Array, modes: Modes) -> Array:
        """Features, zero where they do not act."""
        structure = structure.copy()
        for mechanism, first in zip(self.mechanisms, self.first, strict=False):
            if mechanism.mode is not None:
                own = slice(first, first + len(mechanism.functions))
                structure[..., own] *= (modes == mechanism.mode)[..., np.newaxis]
        return structure

    def land(self, x: Array, before: Modes) -> tuple[Array, Modes]:
        """States and modes after a step, its jumps included."""
        # an extra mode lies inside a declared one, and the guard remembers that one
        declared = np.where(before < self.plant.n_modes, before, self.plant.region.base)
        after = self.plant.modes(x, declared, self.half_width)
        for mechanism in self.mechanisms:
            x = mechanism.land(x, declared, after)
        return x, self.overruled(self.plant.modes(x, after, self.half_width), x)

    def overruled(self, modes: Modes, x: Array) -> Modes:
        """Modes with those of the mechanisms."""
        for mechanism in self.mechanisms:
            modes = mechanism.overrule(modes, x, self.plant.n_modes)
        return modes


def _refined(values: Array, n_parts: int) -> Array:
    """Linear between rows: n_parts pieces for each interval."""
    if n_parts == 1:
        return values
    part = (np.arange(n_parts) / n_parts).reshape(1, -1, *[1] * (values.ndim - 1))
    inside = values[:-1, np.newaxis] * (1 - part) + values[1:, np.newaxis] * part
    return np.concatenate([inside.reshape(-1, *values.shape[1:]), values[-1:]])


# -- inputs ------------------------------------------------------------------------------------


def start(plant: Plant, n_trajectories: int, rng) -> Array:
    """Initial states."""
    return plant.rest + plant.start * rng.uniform(-1, 1, (n_trajectories, plant.n_states))


def excite(drive: Drive, shape: tuple[int, ...], rng) -> Array:
    """Inputs, shape (n_times, n_trajectories)."""
    waves = _multisine(drive.periods, shape, rng)
    changes = rng.uniform(size=shape) < 1 / drive.hold
    levels = rng.uniform(-np.sqrt(3), np.sqrt(3), (shape[0] + 1, shape[1]))
    steps = np.take_along_axis(levels, np.cumsum(changes, axis=0), axis=0)
    values = drive.centre + drive.size * (0.6 * waves + 0.8 * steps)
    return np.clip(values, *drive.limits)


def signal_channels(drive: Drive, shape: tuple[int, ...], rng) -> Array:
    """Logged channels of variance 1, shape (n_times, n_trajectories, n_signals)."""
    return np.stack([_multisine(drive.periods, shape, rng) for _ in range(_N_SIGNALS)], axis=-1)


def _multisine(periods, shape: tuple[int, ...], rng) -> Array:
    """Sines of periods in a band (in samples), random phases; variance 1."""
    each = (1, shape[1], _N_SINES)
    slow, fast = 2 * np.pi / periods[1], 2 * np.pi / periods[0]
    frequencies = np.exp(rng.uniform(np.log(slow), np.log(fast), each))
    phases = rng.uniform(0, 2 * np.pi, each)
    times = np.arange(shape[0])[:, np.newaxis, np.newaxis]
    return np.sin(frequencies * times + phases).sum(axis=2) * np.sqrt(2 / _N_SINES)


# -- the run that sizes are taken from ---------------------------------------------------------


@dataclass(frozen=True)
class Reference:
    """A run of the plant without effects, the same for every seed: what sizes are relative to.

    Shapes are those of `Run`; `scale` (n_states,) holds the standard deviations of velocities.
    """

    plant: Plant
    x: Array
    u: Array
    signals: Array
    modes: Modes
    velocities: Array
    scale: Array


@cache
def reference_run(name: str) -> Reference:
    """The reference run of a plant."""
    plant, rng = PLANTS[name], np.random.RandomState(0)
    shape = (250, 20)
    u = excite(plant.drive, shape, rng)
    signals = signal_channels(plant.drive, shape, rng)
    done = run(plant, (), start(plant, shape[1], rng), u, np.zeros_like(u), signals)
    scale = done.velocities.std(axis=(0, 1))
    return Reference(plant, done.x, u, signals, done.modes, done.velocities, scale)
