"""Runs of a plant with mechanisms in it: inputs, the true law, Runge-Kutta on substeps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from swsysid._results import Array
from swsysid.datasets._undeclared.mechanisms import Mechanism
from swsysid.datasets._undeclared.plants import PLANTS
from swsysid.datasets._undeclared.records import Drive, Plant

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
    modes: np.ndarray
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
    advance = _map if plant.discrete else _runge_kutta
    n_steps = (len(u) - 1) * plant.substeps
    x, modes = x0, law.first_modes(x0)
    states, labels = [x], [modes]
    for step in range(n_steps):
        theta = law.coef[modes]

        def velocity(x, part, theta=theta, modes=modes):
            return law.velocity(theta, x, forces[modes, part, law.everyone], moments[part])

        x = advance(velocity, x, step, plant.time_step / plant.substeps)
        x, modes = law.land(x, modes)
        states.append(x)
        labels.append(modes)
    return _at_samples(law, np.array(states), np.array(labels), forces, (u, t, signals))


def _at_samples(law: _TrueLaw, fine: Array, labels, forces, channels) -> Run:
    plant, (u, t, signals) = law.plant, channels
    x, modes = fine[:: plant.substeps], labels[:: plant.substeps]
    received = forces[:, :: 1 if plant.discrete else 2 * plant.substeps]
    rows, columns = np.indices(modes.shape)
    structure = law.features(x, received[modes, rows, columns], (u, t, signals))
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
        n_declared = plant.coef.shape[2]
        n_own = [mechanism.n_columns for mechanism in mechanisms]
        coef = np.pad(plant.coef, [(0, 0), (0, 0), (0, sum(n_own))])
        first = n_declared + np.concatenate([[0], np.cumsum(n_own)]).astype(int)
        # modes of their own first: a term that acts in all modes acts in these too
        for place in np.argsort(n_own, kind="stable"):
            coef = mechanisms[place].extend(coef, first[place])
        self.coef = coef
        self.everyone = np.arange(0)

    def received(self, u: Array, step: float) -> Array:
        """Input that the plant receives in each mode, (n_modes, n_times, n_trajectories)."""
        self.everyone = np.arange(u.shape[1])
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
            columns.extend(mechanism.columns(x, u, t, signals))
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

    def velocity(self, theta: Array, x: Array, received: Array, moment) -> Array:
        """Velocity of every trajectory, shape (n_trajectories, n_states)."""
        return np.matmul(theta, self.features(x, received, moment)[..., np.newaxis])[..., 0]

    def masked(self, structure: Array, modes) -> Array:
        """Features, zero where they do not act."""
        structure, first = structure.copy(), self.plant.coef.shape[2]
        for mechanism in self.mechanisms:
            last = first + mechanism.n_columns
            if mechanism.mode is not None:
                structure[..., first:last] *= (modes == mechanism.mode)[..., np.newaxis]
            first = last
        return structure

    def first_modes(self, x: Array):
        """Modes without a past."""
        return self._overruled(self.plant.modes(x), x)

    def land(self, x: Array, before):
        """States and modes after a step, its jumps included."""
        # an extra mode lies inside a declared one, and the guard remembers that one
        declared = np.where(before < self.plant.n_modes, before, self.plant.region.base)
        after = self.plant.modes(x, declared, self.half_width)
        for mechanism in self.mechanisms:
            x = mechanism.land(x, declared, after)
        return x, self._overruled(self.plant.modes(x, after, self.half_width), x)

    def _overruled(self, modes, x: Array):
        for mechanism in self.mechanisms:
            modes = mechanism.overrule(modes, x, self.plant.n_modes)
        return modes


def _runge_kutta(velocity, x: Array, step: int, length: float) -> Array:
    begin = 2 * step
    first = velocity(x, begin)
    second = velocity(x + length / 2 * first, begin + 1)
    third = velocity(x + length / 2 * second, begin + 1)
    fourth = velocity(x + length * third, begin + 2)
    return x + length / 6 * (first + 2 * (second + third) + fourth)


def _map(velocity, x: Array, step: int, length: float) -> Array:
    return velocity(x, step)


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
    modes: np.ndarray
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
