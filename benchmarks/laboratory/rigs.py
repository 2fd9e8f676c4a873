"""Five rigs as they are measured, with physical parameters drawn by chance.

Nothing of the library was set on them. What a motion does is integrated with steps a fiftieth of a
sample long; dry friction takes as much of a velocity as it can, and no more (Karnopp 1985), so that
a rig sticks as real ones do. Positions are read by encoders, with steps; rates and temperatures by
sensors with white noise. No velocities are given to a search.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from swsysid import FunctionLibrary, SwitchingSystemRegressor
from swsysid.effects import (
    AsymmetricFriction,
    CoulombFriction,
    DeadZone,
    ExtraMode,
    LoadFriction,
    StribeckFriction,
    TimeInterval,
    UnmeasuredDisturbance,
)

__all__ = ["RIGS", "Rig", "Run"]

Array = np.ndarray
Rng = np.random.Generator
# Steps of the integration in a sample.
FINE = 50
N_RUNS, N_FRESH = 8, 4
# Noise of a rate or a temperature, relative to its spread; steps of an encoder over its range.
NOISES, COUNTS = (0.003, 0.015), (1000, 8000)


@dataclass(frozen=True)
class Run:
    """One recording: times, states and inputs."""

    t: Array
    x: Array
    u: Array


@dataclass(frozen=True)
class Rig:
    """What a search is given, what it lacks, and recordings of the same rig that nothing has seen.

    An answer is right if the first effect is one of `kinds` in the law of `target`, or a function
    without a name of the channel `channel`; where `is_event`, also if the report says that another
    law acts rarely, or for some time.
    """

    name: str
    lacks: str
    estimator: SwitchingSystemRegressor
    runs: list[Run]
    fresh: list[Run]  # without noise
    kinds: tuple[str, ...]
    target: int
    channel: int | None = None
    is_event: bool = False


@dataclass(frozen=True)
class _Motion:
    """A position and a rate that dry friction may hold."""

    pull: Callable[[float, float, Array], float]
    friction: Callable[[Array], float]
    step: float

    def run(self, start: tuple[float, float], inputs: Array) -> Array:
        """States at the samples of inputs, which are linear in between."""
        q, v = start
        states, fine = [], self.step / FINE
        for now, then in zip(inputs, [*inputs[1:], inputs[-1]], strict=True):
            states.append((q, v))
            for part in range(FINE):
                u = now + (then - now) * part / FINE
                free = v + fine * self.pull(q, v, u)
                v = float(np.sign(free)) * max(abs(free) - fine * self.friction(u), 0.0)
                q += fine * v
        return np.array(states)


@dataclass(frozen=True)
class _Drive:
    """A sum of three sines of any phase, the same for a rig in all its recordings but for these."""

    size: float
    rates: tuple[float, ...] = field(default=(0.9, 2.3, 5.1))

    def along(self, t: Array, rng: Rng) -> Array:
        phases = rng.uniform(0.0, 2.0 * np.pi, len(self.rates))
        waves = [np.sin(rate * t + phase) for rate, phase in zip(self.rates, phases, strict=True)]
        return self.size * rng.uniform(0.5, 1.2) * np.sum(waves, axis=0)


def _about(rng: Rng, *values: float) -> list[float]:
    """Values within a third of the usual ones."""
    factors = np.exp(rng.uniform(-np.log(4 / 3), np.log(4 / 3), len(values)))
    return (np.array(values) * factors).tolist()


def _between(rng: Rng, limits: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(*np.log(limits))))


def _measured(runs: list[Run], rng: Rng, positions: tuple[int, ...] = (0,)) -> list[Run]:
    """The runs as sensors see them: positions in steps, all others with white noise."""
    every = np.vstack([run.x for run in runs])
    noise, counts = _between(rng, NOISES), _between(rng, COUNTS)
    spread, steps = every.std(axis=0), np.ptp(every, axis=0) / counts
    seen = []
    for run in runs:
        x = run.x + noise * spread * rng.standard_normal(run.x.shape)
        for place in positions:
            x[:, place] = steps[place] * np.round(run.x[:, place] / steps[place])
        seen.append(Run(run.t, x, run.u))
    return seen


def _of(name: str, lacks: str, library, runs: list[Run], rng: Rng, positions=(0,), **answer) -> Rig:
    estimator = SwitchingSystemRegressor(1, feature_library=library, random_state=0)
    kept, fresh = runs[:N_RUNS], runs[N_RUNS:]
    return Rig(name, lacks, estimator, _measured(kept, rng, positions), fresh, **answer)


def _pendulum(rng: Rng) -> Rig:
    """Released at eight angles, it swings until it rests."""
    gravity, damping, friction = _about(rng, 30.0, 0.12, 0.8)
    motion = _Motion(
        lambda q, v, u: -gravity * np.sin(q) - damping * v, lambda u: friction, 1.0 / 100.0
    )
    t = motion.step * np.arange(500)
    runs = []
    for _ in range(N_RUNS + N_FRESH):
        start = float(rng.uniform(0.5, 2.3) * rng.choice([-1.0, 1.0]))
        runs.append(Run(t, motion.run((start, 0.0), np.zeros((len(t), 1))), np.empty((500, 0))))
    library = FunctionLibrary([_sine_of_first, _second], names=["sin({0})", "{1}"])
    answer = {"kinds": (CoulombFriction.kind,), "target": 1, "channel": 1}
    return _of("pendulum", "dry friction", library, runs, rng, **answer)


def _sine_of_first(q: Array, v: Array) -> Array:
    return np.sin(q)


def _second(q: Array, v: Array) -> Array:
    return v


def _servo(rng: Rng) -> Rig:
    """A joint whose bearing carries a load that is measured, and that sticks at low torque."""
    gain, damping, friction = _about(rng, 2.0, 0.5, 0.6)
    motion = _Motion(
        lambda q, v, u: gain * u[0] - damping * v, lambda u: friction * u[1], 1.0 / 50.0
    )
    t, drive, runs = motion.step * np.arange(400), _Drive(0.9), []
    for _ in range(N_RUNS + N_FRESH):
        load = rng.uniform(0.4, 2.0) + 0.3 * np.sin(rng.uniform(0.3, 1.2) * t)
        u = np.column_stack([drive.along(t, rng), load])
        runs.append(Run(t, motion.run((0.0, 0.0), u), u))
    kinds = (CoulombFriction, LoadFriction, StribeckFriction, AsymmetricFriction)
    answer = {"kinds": tuple(one.kind for one in kinds), "target": 1, "channel": 1}
    return _of("servo", "friction in proportion to a load", None, runs, rng, **answer)


def _motor(rng: Rng) -> Rig:
    """A small motor with an amplifier that has a dead zone."""
    gain, damping, zone = _about(rng, 4.0, 1.5, 0.5)
    motion = _Motion(
        lambda q, v, u: gain * (u[0] - np.clip(u[0], -zone, zone)) - damping * v,
        lambda u: 0.0,
        1.0 / 50.0,
    )
    t, drive, runs = motion.step * np.arange(400), _Drive(0.8), []
    for _ in range(N_RUNS + N_FRESH):
        u = drive.along(t, rng)[:, None]
        runs.append(Run(t, motion.run((0.0, 0.0), u), u))
    answer = {"kinds": (DeadZone.kind,), "target": 1, "channel": 2}
    return _of("motor", "a dead zone of the amplifier", None, runs, rng, **answer)


def _cart(rng: Rng) -> Rig:
    """A cart between springs on a rail with dry friction."""
    stiffness, damping, friction = _about(rng, 6.0, 0.4, 0.7)
    motion = _Motion(
        lambda q, v, u: u[0] - stiffness * q - damping * v, lambda u: friction, 1.0 / 50.0
    )
    t, drive, runs = motion.step * np.arange(400), _Drive(2.0), []
    for _ in range(N_RUNS + N_FRESH):
        u = drive.along(t, rng)[:, None]
        runs.append(Run(t, motion.run(tuple(rng.uniform(-1.0, 1.0, 2)), u), u))
    answer = {"kinds": (CoulombFriction.kind,), "target": 1, "channel": 1}
    return _of("cart", "dry friction", None, runs, rng, **answer)


def _box(rng: Rng) -> Rig:
    """A box and its heater, in K above the room; a hand opens the lid in two recordings."""
    passed, back, loss, power, opened = _about(rng, 0.02, 0.03, 0.004, 0.6, 0.05)
    step, n_samples, runs = 2.0, 400, []
    t = step * np.arange(n_samples)
    for number in range(N_RUNS + N_FRESH):
        heating = (np.sin(rng.uniform(0.006, 0.02) * t + rng.uniform(0.0, 6.0)) > 0.0).astype(float)
        heating *= rng.uniform(0.6, 1.4)
        begin, lasts = rng.integers(100, 300), rng.integers(15, 50)
        is_open = np.zeros(n_samples, dtype=bool)
        if number in (1, 4):
            is_open[begin : begin + lasts] = True
        T, H = rng.uniform(2.0, 10.0, 2)
        states, fine = [], step / FINE
        for u, lid in zip(heating, is_open, strict=True):
            states.append((T, H))
            for _ in range(FINE):
                lost = loss + (opened if lid else 0.0)
                T, H = (
                    T + fine * (passed * (H - T) - lost * T),
                    H + fine * (power * u - back * (H - T)),
                )
        runs.append(Run(t, np.array(states), heating[:, None]))
    kinds = (TimeInterval.kind, ExtraMode.kind, UnmeasuredDisturbance.kind)
    answer = {"kinds": kinds, "target": 0, "is_event": True}
    return _of("box", "a lid opened by hand", None, runs, rng, positions=(), **answer)


RIGS: dict[str, Callable[[Rng], Rig]] = {
    "pendulum": _pendulum,
    "servo": _servo,
    "motor": _motor,
    "cart": _cart,
    "box": _box,
}
