"""Switched systems with memory in discrete time, stepped by hand: recordings and their truth."""

from dataclasses import dataclass

import numpy as np

from swsysid._data.recordings import Record


@dataclass
class Planted:
    """Recordings, the mode of every sample, and the true laws on linear features with constant."""

    recordings: list
    modes: list
    coef: np.ndarray  # (n_modes, n_states, n_features)


def stepped(law, mode_of, starts, inputs, rng, noise=0.0, reset=None):
    """Recordings of ``law(mode, x, u)`` with ``mode_of(mode, x, u, dwell)``, x and u newest first.

    `starts` are (lags + 1, n_states), oldest first; `inputs` (n_samples, n_inputs); `reset(old,
    new, x)` changes the newest state. `noise` is a share of the standard deviation of each state.
    """
    recordings, modes = [], []
    for start, u in zip(starts, inputs, strict=True):
        x, mode, dwell, told = [*np.atleast_2d(start)], 0, 0, []
        lags = len(x) - 1
        told = [0] * lags
        for k in range(lags, len(u)):
            past = np.array(x[k - lags : k + 1])[::-1], u[k - lags : k + 1][::-1]
            new = mode_of(mode, *past, dwell)
            dwell = dwell + 1 if new == mode else 0
            if new != mode and reset is not None:
                x[k] = reset(mode, new, x[k])
                past[0][0] = x[k]
            mode = new
            told.append(mode)
            x.append(np.atleast_1d(law(mode, *past)))
        x = np.array(x[: len(u)])
        recordings.append(x)
        modes.append(np.array(told))
    spread = np.concatenate(recordings).std(axis=0)
    noisy = [x + noise * spread * rng.standard_normal(x.shape) for x in recordings]
    recordings = [Record(np.arange(len(u)) * 1.0, x, u) for x, u in zip(noisy, inputs, strict=True)]
    return recordings, modes


def switched_arx(seed, n_modes, lags, n_states=1, n_inputs=1, n_recordings=6, n=400, noise=0.0):
    """Random stable laws that differ, modes that stay for ten to sixty samples."""
    rng = np.random.default_rng(seed)
    coef = np.array([_stable_law(rng, lags, n_states, n_inputs) for _ in range(n_modes)])
    plans = [_plan(rng, n_modes, n) for _ in range(n_recordings)]
    recordings, modes = [], []
    for plan in plans:
        u = np.repeat(rng.standard_normal((n // 2 + 1, n_inputs)), 2, axis=0)[:n]
        x = [*rng.standard_normal((lags + 1, n_states))]
        for k in range(lags, n - 1):
            columns = [series[k - lag] for series in (x, u) for lag in range(lags + 1)]
            x.append(coef[plan[k]] @ np.concatenate([[1.0], *columns]))
        recordings.append((np.array(x), u))
        modes.append(plan)
    spread = np.concatenate([x for x, _ in recordings]).std(axis=0)
    noisy = [
        Record(np.arange(n) * 1.0, x + noise * spread * rng.standard_normal(x.shape), u)
        for x, u in recordings
    ]
    return Planted(noisy, modes, coef)


def _plan(rng, n_modes, n):
    plan, mode = [], int(rng.integers(n_modes))
    while len(plan) < n:
        plan += [mode] * int(rng.integers(10, 60))
        mode = (mode + int(rng.integers(1, max(2, n_modes)))) % n_modes
    return np.array(plan[:n])


def _stable_law(rng, lags, n_states, n_inputs):
    """Constant, lagged states, lagged inputs; poles between .3 and .9 in size."""
    blocks = np.zeros((lags + 1, n_states, n_states))
    for state in range(n_states):
        poles = rng.uniform(0.3, 0.9, (lags + 1) // 2) * np.exp(
            1j * rng.uniform(0.2, 2.0, (lags + 1) // 2)
        )
        poles = np.concatenate([poles, poles.conj(), rng.uniform(0.3, 0.9, (lags + 1) % 2)])
        blocks[:, state, state] = -np.poly(poles).real[1:]
    blocks += 0.05 * rng.standard_normal(blocks.shape) * (n_states > 1)
    gains = rng.uniform(-1.0, 1.0, (n_states, n_inputs * (lags + 1)))
    constant = rng.uniform(-1.0, 1.0, (n_states, 1))
    return np.hstack([constant, *blocks, gains])


def thermostat(noise=0.0, seed=0):
    """A temperature that is heated from 19 degrees on and cools from 22 on: hysteresis."""
    rng = np.random.default_rng(seed)

    def switched(mode, x, u, dwell):
        return 1 if x[0, 0] <= 19.0 else 0 if x[0, 0] >= 22.0 else mode

    recordings, modes = stepped(
        lambda mode, x, u: 0.97 * x[0] + 0.03 * (27.0 if mode else 15.0),
        switched,
        rng.uniform(18.0, 23.0, (4, 1, 1)),
        [np.empty((400, 0))] * 4,
        rng,
        noise,
    )
    return Planted(recordings, modes, np.array([[[0.45, 0.97]], [[0.81, 0.97]]]))


def narx_of_order_2(noise=0.0, seed=0):
    """Two quadratic laws of two outputs and an input that switch with hysteresis."""
    rng = np.random.default_rng(seed)

    def law(mode, x, u):
        if mode:
            return 0.6 * x[0] - 0.3 * x[1] * x[0] + 0.8 * u[1] - 0.2
        return 1.2 * x[0] - 0.5 * x[1] - 0.05 * x[0] ** 2 + 0.25 * u[0]

    coef = np.zeros((2, 1, 15))  # 1 x y u v xx xy xu xv yy yu yv uu uv vv
    coef[0, 0, [1, 2, 5, 3]] = 1.2, -0.5, -0.05, 0.25
    coef[1, 0, [1, 6, 4, 0]] = 0.6, -0.3, 0.8, -0.2
    recordings, modes = _driven(law, 0.5, -0.5, 2, rng, noise)
    return Planted(recordings, modes, coef)


def narx_of_order_3(noise=0.0, seed=0):
    """Two laws of three outputs and inputs, one with a product, that switch with hysteresis."""
    rng = np.random.default_rng(seed)

    def law(mode, x, u):
        if mode:
            return 0.5 * x[0] + 0.3 * x[2] - 0.6 * u[2] + 0.3 - 0.5 * x[0] * u[0]
        return 1.1 * x[0] - 0.5 * x[1] + 0.2 * x[2] + 0.5 * u[0]

    coef = np.zeros((2, 1, 28))  # 1 x y z u v w, then products in this order
    coef[0, 0, [1, 2, 3, 4]] = 1.1, -0.5, 0.2, 0.5
    coef[1, 0, [1, 3, 6, 0, 10]] = 0.5, 0.3, -0.6, 0.3, -0.5
    recordings, modes = _driven(law, 0.5, -0.3, 3, rng, noise)
    return Planted(recordings, modes, coef)


def _driven(law, upper, lower, order, rng, noise):
    def switched(mode, x, u, dwell):
        return 1 if x[0, 0] >= upper else 0 if x[0, 0] <= lower else mode

    inputs = [np.repeat(rng.uniform(-1.0, 1.0, (125, 1)), 4, axis=0) for _ in range(5)]
    return stepped(law, switched, rng.uniform(-0.4, 0.4, (5, order, 1)), inputs, rng, noise)


def ball(noise=0.0, seed=0, height_only=False):
    """A ball that loses a fifth of its speed when it bounces: one law, and jumps of the state."""
    rng = np.random.default_rng(seed)
    step, recordings, modes = 0.02, [], []
    for _ in range(4):
        x = [rng.uniform([0.5, -1.0], [2.0, 1.0])]
        for _ in range(299):
            height, speed = x[-1]
            height, speed = height + step * speed - 4.9 * step**2, speed - 9.8 * step
            bounces = height < 0.0 and speed < 0.0
            x.append(np.array([-height, -0.8 * speed] if bounces else [height, speed]))
        recordings.append(np.array(x))
        modes.append(np.zeros(300, dtype=int))
    spread = np.concatenate(recordings).std(axis=0)
    shown = slice(0, 1) if height_only else slice(None)
    noisy = [(x + noise * spread * rng.standard_normal(x.shape))[:, shown] for x in recordings]
    coef = [[[-9.8 * step**2, 2.0, -1.0]]] if height_only else [
        [[-4.9 * step**2, 1.0, step], [-9.8 * step, 0.0, 1.0]]
    ]  # fmt: skip
    return Planted(
        [Record(np.arange(300.0), x, np.empty((300, 0))) for x in noisy], modes, np.array(coef)
    )


def relay(noise=0.0, seed=0):
    """An oscillator that a relay drives towards its input: the laws differ in a constant."""
    rng = np.random.default_rng(seed)

    def switched(mode, x, u, dwell):
        off = x[0, 0] - u[0, 0]
        return 1 if off >= 0.3 else 0 if off <= -0.3 else mode

    recordings, modes = stepped(
        lambda mode, x, u: 1.5 * x[0] - 0.7 * x[1] + (-0.25 if mode else 0.25),
        switched,
        rng.uniform(-0.2, 0.2, (6, 2, 1)),
        np.repeat(rng.uniform(-0.4, 0.4, (6, 40, 1)), 10, axis=1),
        rng,
        noise,
    )
    coef = [[[0.25, 1.5, -0.7, 0.0, 0.0]], [[-0.25, 1.5, -0.7, 0.0, 0.0]]]
    return Planted(recordings, modes, np.array(coef))


def bent(noise=0.0, seed=0):
    """A continuous map of a state and an input that is bent where their sum is zero."""
    rng = np.random.default_rng(seed)
    recordings, modes = stepped(
        lambda mode, x, u: 0.3 * x[0] - 0.1 * u[0] if mode else 0.8 * x[0] + 0.4 * u[0],
        lambda mode, x, u, dwell: int(x[0, 0] + u[0, 0] >= 0.0),
        rng.uniform(-1.0, 1.0, (6, 1, 1)),
        rng.uniform(-2.0, 2.0, (6, 300, 1)),
        rng,
        noise,
    )
    return Planted(recordings, modes, np.array([[[0.0, 0.8, 0.4]], [[0.0, 0.3, -0.1]]]))
