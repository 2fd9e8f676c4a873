"""Campaigns: runs of a plant with mechanisms in it, by Runge-Kutta's steps between the samples.

How large an effect is counts relative to the velocity it acts in, on the plant's reference run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np
from numpy.random import RandomState

from swsysid._results import Array
from swsysid._simulation.stepping import runge_kutta
from swsysid.datasets._undeclared.records import Drive, Equation, Mechanism, Modes, Plant, Terms

# A campaign.
_N_SIGNALS = 3  # logged channels
_N_SINES = 6  # of a multisine
# How large effects are made.
_REFERENCE = (250, 20)  # times and trajectories of the run that sizes are relative to
_SHARE = (0.2, 0.3)  # of the velocity's standard deviation, for magnitude 1
_SLOW = 1.4  # share of effects of memory, relative to others: these should last some samples
_SHORTEST = 2  # samples of a delay or a time constant
_LONGEST = 15
_N_BISECTIONS = 16


@dataclass(frozen=True)
class Run:
    """Histories at the samples, times first: shapes (n_times, n_trajectories, ...)."""

    u: Array
    signals: Array
    x: Array
    recorded: Array  # the states as the sensors give them
    modes: Modes
    structure: Array  # features of the true law
    velocities: Array


@cache
def reference_run(plant: Plant) -> Run:
    """A run of a plant without effects, the same for every seed: what sizes are relative to."""
    return campaign(plant, (), np.zeros(_REFERENCE), np.random.RandomState(0))


def campaign(plant: Plant, mechanisms: Sequence[Mechanism], t: Array, rng) -> Run:
    """Trajectories of the plant at the times t (n_times, n_trajectories), randomly excited.

    Inputs and signals are linear between samples. The mode is that of the state at the begin
    of each substep.
    """
    u = _excitation(plant.drive, t.shape, rng)
    signals = np.stack([_multisine(plant.drive, t.shape, rng) for _ in range(_N_SIGNALS)], axis=-1)
    law = _TrueLaw(plant, mechanisms)
    n_parts = 1 if plant.discrete else 2 * plant.substeps  # half substeps, for Runge-Kutta
    fine_u, fine_t, fine_signals = (_refined(values, n_parts) for values in (u, t, signals))
    forces = law.received(fine_u, plant.time_step / n_parts)
    everyone, length = np.arange(u.shape[1]), plant.time_step / plant.substeps
    x = plant.rest + plant.start * rng.uniform(-1, 1, (u.shape[1], plant.n_states))
    modes = law.overruled(plant.modes(x), x)
    states, labels = [x], [modes]
    for step in range((len(u) - 1) * plant.substeps):

        def velocity(x: Array, part: float, step=step, theta=law.coef[modes], modes=modes) -> Array:
            place = step if plant.discrete else 2 * step + int(2 * part)
            moment = fine_u[place], fine_t[place], fine_signals[place]
            features = law.features(x, forces[modes, place, everyone], moment)
            return np.matmul(theta, features[..., np.newaxis])[..., 0]

        x = velocity(x, 0.0) if plant.discrete else runge_kutta(velocity, x, length)
        x, modes = law.land(x, modes)
        states.append(x)
        labels.append(modes)
    recorded = np.array(states)
    for mechanism in law.mechanisms:
        recorded = mechanism.record(recorded, length)
    samples = slice(None, None, plant.substeps)
    x, modes = np.array(states[samples]), np.array(labels[samples])
    rows, columns = np.indices(modes.shape)
    structure = law.features(x, forces[:, ::n_parts][modes, rows, columns], (u, t, signals))
    velocities = np.einsum("nksf,nkf->nks", law.coef[modes], structure)
    # a feature is zero where it does not act
    for mechanism, first in zip(law.mechanisms, law.first, strict=False):
        if mechanism.mode is not None:
            own = slice(first, first + len(mechanism.functions))
            structure[..., own] *= (modes == mechanism.mode)[..., np.newaxis]
    return Run(u, signals, x, recorded[samples], modes, structure, velocities)


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
        received = np.array([u] * len(self.coef))
        for mode, mechanism in product(range(len(self.coef)), self.mechanisms):
            if mechanism.mode in (None, mode):
                received[mode] = mechanism.actuate(received[mode], step)
        return received

    def features(self, x: Array, received: Array, moment) -> Array:
        """Features of the true law, shape (..., n_features)."""
        u, t, signals = moment
        columns = self.plant.features(x, received)
        for mechanism in self.mechanisms:
            columns.extend(function(x, u, t, signals) for function in mechanism.functions)
        return np.stack(np.broadcast_arrays(*columns), axis=-1)

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


def _excitation(drive: Drive, shape: tuple[int, ...], rng) -> Array:
    """Inputs, shape (n_times, n_trajectories)."""
    waves = _multisine(drive, shape, rng)
    changes = rng.uniform(size=shape) < 1 / drive.hold
    levels = rng.uniform(-np.sqrt(3), np.sqrt(3), (shape[0] + 1, shape[1]))
    steps = np.take_along_axis(levels, np.cumsum(changes, axis=0), axis=0)
    values = drive.centre + drive.size * (0.6 * waves + 0.8 * steps)
    return np.clip(values, *drive.limits)


def _multisine(drive: Drive, shape: tuple[int, ...], rng) -> Array:
    """Sines of periods in a band, random phases; variance 1."""
    each = (1, shape[1], _N_SINES)
    slow, fast = 2 * np.pi / drive.periods[1], 2 * np.pi / drive.periods[0]
    frequencies = np.exp(rng.uniform(np.log(slow), np.log(fast), each))
    phases = rng.uniform(0, 2 * np.pi, each)
    times = np.arange(shape[0])[:, np.newaxis, np.newaxis]
    return np.sin(frequencies * times + phases).sum(axis=2) * np.sqrt(2 / _N_SINES)


@dataclass(frozen=True)
class Planted:
    """A mechanism, and what is said about it."""

    mechanism: Mechanism
    channel: int | None
    parameters: Mapping[str, object]


class Sizing:
    """What the makers of effects ask: the plant, a source of chance, and how large is right.

    `duration` is the time from the first sample to the last, in s.
    """

    def __init__(
        self,
        plant: Plant,
        rng: RandomState,
        magnitude: float,
        target: int,
        mode: int | None,
        duration: float,
    ):
        self.plant, self.rng, self.reference = plant, rng, reference_run(plant)
        self.magnitude, self.target, self.mode, self.duration = magnitude, target, mode, duration
        self.share = magnitude * rng.uniform(*_SHARE)
        self.scale = self.reference.velocities.std(axis=(0, 1))
        self.largest_input = float(np.abs(self.reference.u).max())
        modes = self.reference.modes
        self.rows = np.full(modes.shape, True) if mode is None else modes == mode

    @property
    def equation(self) -> Equation:
        """Columns that the target's effects are functions of."""
        return self.plant.equations[self.target]

    def spread(self, column: int) -> float:
        """Standard deviation of a state."""
        return float(self.reference.x[..., column].std())

    def sign(self) -> float:
        """Either sign, unless the plant bears only one."""
        drawn = float(self.rng.choice([-1.0, 1.0]))
        return self.plant.sign or drawn

    def terms(
        self, functions: Sequence[Callable[..., Array]], weights: Sequence[float]
    ) -> tuple[Terms, float]:
        """Terms of the right size together; and the factor on the weights."""
        done = self.reference
        t = np.linspace(0.0, self.duration, done.u.size).reshape(done.u.shape[::-1]).T
        values = np.zeros_like(t)
        for function, weight in zip(functions, weights, strict=True):
            values += weight * function(done.x, done.u, t, done.signals)
        size = np.sqrt(np.mean(values[self.rows] ** 2))
        factor = float(self.share * self.scale[self.target] / size)
        mechanism = Terms(
            mode=self.mode,
            target=self.target,
            functions=tuple(functions),
            coefficients=tuple(factor * weight for weight in weights),
        )
        return mechanism, factor

    def solved(
        self, make: Callable[[float], Planted], upper: float, share: float | None = None
    ) -> float:
        """Parameter in (0, upper] for which an effect has the right size, or the upper end."""
        share = self.share if share is None else share
        if self._size(make(upper).mechanism) <= share:
            return upper
        low, high = 0.0, upper
        for _ in range(_N_BISECTIONS):
            middle = (low + high) / 2
            small = self._size(make(middle).mechanism) < share
            low, high = (middle, high) if small else (low, middle)
        return high

    def solved_time(self, make: Callable[[float], Planted], whole: bool) -> float:
        """Delay or time constant for which an effect has the right size; `whole` samples or not."""
        step = self.plant.time_step
        time = self.solved(make, _LONGEST * step, _SLOW * self.share)
        time = max(time, _SHORTEST * step)
        return step * round(time / step) if whole else time

    def _size(self, mechanism: Mechanism) -> float:
        """Change of the velocities of the reference run by a mechanism, in units of their size."""
        done, plant = self.reference, self.plant
        u = mechanism.actuate(done.u, plant.time_step)
        x = mechanism.record(done.x, plant.time_step)
        modes = done.modes
        if mechanism.half_width:
            kept = [modes[0]]
            for now in done.x[1:]:
                kept.append(plant.modes(now, kept[-1], mechanism.half_width))
            modes = np.array(kept)
        change = plant.velocities(x, u, modes) - done.velocities
        sizes = np.sqrt(np.mean(change[self.rows] ** 2, axis=0))
        return float(np.max(sizes / self.scale))
