"""Switched systems with memory in discrete time, stepped by hand: recordings and their truth."""

from dataclasses import dataclass

import numpy as np

from swsysid.refinement._trajectories import Record


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
