"""Records of systems that are declared completely, with residuals as they really are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from swsysid import SwitchingSystemRegressor
from swsysid.datasets import make_undeclared
from swsysid.differentiation import differentiate

__all__ = [
    "DISTURBED",
    "NULLS",
    "Record",
    "clean_record",
    "noisy_states",
    "null_record",
    "random_numbers",
]

Array = np.ndarray
# Of the noise, relative to the spread of each velocity; the library's own benchmark has 0.02.
NOISE = 0.05
# Of the states' noise where they are differentiated, relative to their spread.
STATE_NOISE = 0.01
# Levels of a quantised sensor over its range: seven bits.
LEVELS = 128
# Share of the samples that a sensor clips.
CLIPPED = 0.01
# Plants and sizes that take turns; two_mass costs as much as all of them.
SYSTEMS = ("oscillator", "pendulum", "tanks")
SIZES = ((400, 4), (800, 8), (1000, 1), (2000, 8))


@dataclass(frozen=True)
class Record:
    """What a search is given."""

    estimator: object
    X: Array
    Xdot: Array
    t: Array
    groups: Array
    n_states: int


def _with_noise(record: Record, noise: Array, relative: float = NOISE) -> Record:
    return replace(record, Xdot=record.Xdot + relative * record.Xdot.std(axis=0) * noise)


def correlated(record: Record, rng: np.random.Generator, memory: float) -> Array:
    """Autoregressive noise of unit variance in each trajectory."""
    noise = np.empty_like(record.Xdot)
    for label in np.unique(record.groups):
        rows = record.groups == label
        start = rng.standard_normal((1, noise.shape[1]))
        steps = np.sqrt(1.0 - memory**2) * rng.standard_normal((rows.sum(), noise.shape[1]))
        noise[rows] = lfilter([1.0], [1.0, -memory], steps, axis=0, zi=memory * start)[0]
    return noise


def _autoregressive(memory: float) -> Callable[[Record, np.random.Generator], Record]:
    def noisy(record: Record, rng: np.random.Generator) -> Record:
        return _with_noise(record, correlated(record, rng, memory))

    return noisy


def _white(record: Record, rng: np.random.Generator) -> Record:
    return _with_noise(record, rng.standard_normal(record.Xdot.shape))


def _multiplicative(record: Record, rng: np.random.Generator) -> Record:
    sizes = np.abs(record.Xdot) / record.Xdot.std(axis=0)
    return _with_noise(record, sizes * rng.standard_normal(record.Xdot.shape))


def _slow_disturbance(record: Record, rng: np.random.Generator) -> Record:
    """One that wanders through each trajectory about twice, beside white noise."""
    longest = np.bincount(record.groups).max()
    slow = _with_noise(record, correlated(record, rng, float(np.exp(-2.0 / longest))))
    return _with_noise(slow, rng.standard_normal(record.Xdot.shape), 0.4 * NOISE)


def noisy_states(record: Record, rng: np.random.Generator) -> tuple[Array, Array]:
    """Measured states of a record, and its inputs."""
    x, u = np.split(record.X, [record.n_states], axis=1)
    return x + STATE_NOISE * x.std(axis=0) * rng.standard_normal(x.shape), u


def _differentiated(record: Record, rng: np.random.Generator) -> Record:
    x, u = noisy_states(record, rng)
    rows = differentiate(x, record.t, record.groups, inputs=u if u.shape[1] else None)
    return replace(record, X=rows.X, Xdot=rows.Xdot, t=rows.t, groups=rows.groups)


def _quantised(record: Record, rng: np.random.Generator) -> Record:
    """States and velocities through converters of a few bits, beside a little white noise."""
    noisy = _with_noise(record, rng.standard_normal(record.Xdot.shape), 0.2 * NOISE)
    X = record.X.copy()
    X[:, : record.n_states] = _rounded(X[:, : record.n_states])
    return replace(noisy, X=X, Xdot=_rounded(noisy.Xdot))


def _rounded(values: Array) -> Array:
    step = np.ptp(values, axis=0) / LEVELS
    return step * np.round(values / step)


def _clipped(record: Record, rng: np.random.Generator) -> Record:
    """Velocity sensors at the end of their range in a few samples, beside white noise."""
    noisy = _white(record, rng)
    limit = np.quantile(np.abs(noisy.Xdot), 1.0 - CLIPPED, axis=0)
    return replace(noisy, Xdot=np.clip(noisy.Xdot, -limit, limit))


def _closed_loop(n_samples: int, n_trajectories: int, rng: np.random.Generator) -> Record:
    """A mass on a spring under a controller, with a force that nobody measured acting on it."""
    step, count = 0.02, n_samples // n_trajectories
    runs = []
    for number in range(n_trajectories):
        t = step * (np.arange(count) + (count + 50) * number)
        wanted = np.sin(0.9 * t + rng.uniform(0, 6)) + 0.6 * np.sin(2.3 * t + rng.uniform(0, 6))
        force = 0.2 * lfilter([np.sqrt(1 - 0.9**2)], [1.0, -0.9], rng.standard_normal(count))
        x, v = rng.standard_normal(2)
        rows = []
        for now in range(count):
            u = 6.0 * (wanted[now] - x) - 1.5 * v + 0.05 * rng.standard_normal()
            pull = -2.0 * x - 0.4 * v + u + force[now]
            rows.append((x, v, u, v, pull))
            x, v = x + step * v, v + step * pull
        runs.append(np.column_stack([rows, t, np.full(count, number)]))
    X, Xdot, t, groups = np.split(np.vstack(runs), [3, 5, 6], axis=1)
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    Xdot[:, 0] += 0.01 * rng.standard_normal(len(Xdot))
    return Record(declared, X, Xdot, t[:, 0], groups[:, 0].astype(int), 2)


NULLS: dict[str, Callable[[Record, np.random.Generator], Record] | None] = {
    "white": _white,
    "ar 0.5": _autoregressive(0.5),
    "ar 0.9": _autoregressive(0.9),
    "ar 0.98": _autoregressive(0.98),
    "multiplicative": _multiplicative,
    "slow disturbance": _slow_disturbance,
    "differentiated": _differentiated,
    "quantised": _quantised,
    "clipped": _clipped,
    "closed loop": None,
}
# Those whose noise is a force that is forgotten over many samples: to say so is right.
DISTURBED = frozenset({"ar 0.9", "ar 0.98", "slow disturbance", "closed loop"})


def clean_record(seed: int) -> Record:
    """A record without noise; plants and sizes take turns with the seed."""
    n_samples, n_trajectories = SIZES[seed % len(SIZES)]
    data = make_undeclared(
        None,
        system=SYSTEMS[seed % len(SYSTEMS)],
        n_samples=n_samples,
        n_trajectories=n_trajectories,
        noise=0.0,
        random_state=seed,
    )
    return Record(data.estimator, data.X, data.Xdot, data.t, data.groups, data.Xdot.shape[1])


def null_record(kind: str, seed: int) -> Record:
    """A record with nothing missing, of the size whose turn it is."""
    rng, noisy = random_numbers(seed), NULLS[kind]
    if noisy is None:
        return _closed_loop(*SIZES[seed % len(SIZES)], rng)
    return noisy(clean_record(seed), rng)


def random_numbers(seed: int) -> np.random.Generator:
    """Those of the noise of a record."""
    return np.random.default_rng([1600, seed])
