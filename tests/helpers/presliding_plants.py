"""A mass on a spring in a contact whose bristles bend, solved as differential equations."""

import numpy as np
from scipy.integrate import solve_ivp
from sklearn.utils import Bunch

STEP, FRICTION, DISTANCE = 0.02, 2.0, 0.05


def dahl(w, v):
    return (v - abs(v) * w) / DISTANCE


def lugre(w, v, excess=0.8, slow=0.3):
    return (v - abs(v) * w / (1.0 + excess * np.exp(-((v / slow) ** 2)))) / DISTANCE


def bouc_wen(w, v, exponent=2.0, shape=0.5):
    return (v - abs(w) ** exponent * (shape * abs(v) * np.sign(w) + (1 - shape) * v)) / DISTANCE


def recorded(contact, seed, n_trajectories=8, n_samples=250, noise=0.02, micro_damping=0.0):
    """``v' = -20 x - v + u - friction * w - micro_damping * distance * w'``, states x and v."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(n_samples)
    rows, velocities = [], []
    for _ in range(n_trajectories):
        frequencies, phases = rng.uniform(0.5, 8.0, 6), rng.uniform(0.0, 2.0 * np.pi, 6)
        push = 6.0 * np.sin(np.outer(t, frequencies) + phases).sum(axis=1) / np.sqrt(3.0)

        def field(time, y, push=push):
            x, v, w = y
            bent = contact(w, v)
            force = FRICTION * w + micro_damping * DISTANCE * bent
            u = np.interp(time, t, push)
            return [v, -20.0 * x - v + u - force, bent]

        start = [rng.uniform(-0.3, 0.3), 0.0, 0.0]
        done = solve_ivp(field, (0.0, t[-1]), start, t_eval=t, max_step=STEP, rtol=1e-6)
        motion = np.array([field(*now) for now in zip(t, done.y.T, strict=True)])
        rows.append(np.column_stack([done.y[:2].T, push]))
        velocities.append(motion[:, :2])
    X, clean = np.concatenate(rows), np.concatenate(velocities)
    Xdot = clean + noise * clean.std(axis=0) * rng.standard_normal(clean.shape)
    groups = np.repeat(np.arange(n_trajectories), n_samples)
    return Bunch(X=X, Xdot=Xdot, t=np.tile(t, n_trajectories), groups=groups)
