"""Trajectories of random switching systems of two affine modes, without any noise.

Every step is the exact flow of one mode, so that the difference quotient is an affine function of
the state in each mode: the right partition leaves rounding errors, and any other is a wrong basin.
"""

import numpy as np
from scipy.linalg import expm

N_STEPS, STEP = 2000, 0.01
# Both modes have at least this many rows.
FEWEST = 60


def simulated(flows, targets, line, offset, start):
    """States, difference quotients and modes of one trajectory; mode 1 is above the line."""
    states, modes = np.empty((N_STEPS + 1, 2)), np.empty(N_STEPS, dtype=int)
    states[0] = start
    for k in range(N_STEPS):
        mode = modes[k] = int(states[k] @ line > offset)
        states[k + 1] = targets[mode] + flows[mode] @ (states[k] - targets[mode])
    return states[:-1], np.diff(states, axis=0) / STEP, modes


def opposite_targets():
    """Two modes with the same rates, one for each state, towards opposite targets."""
    flow = np.diag(np.exp([-0.02, -0.01]))
    targets = np.array([[-0.7, 0.7], [0.7, -0.7]])
    return simulated((flow, flow), targets, np.array([0.714286, 1.0]), 0.0, [0.024, -0.041])


def random_system(seed):
    """A random system that visits both modes: nodes or spirals, crossing, sliding or rare."""
    rng = np.random.default_rng(seed)
    while True:
        kind = rng.integers(4)
        line = rng.normal(size=2)
        line /= np.linalg.norm(line)
        offset = 0.0 if rng.random() < 0.6 else 0.1 * rng.normal()
        targets, laws = _laws(kind, rng)
        flows = [expm(law * STEP) for law in laws]
        start = rng.normal(size=2) * rng.choice([0.05, 0.5, 1.0])
        states, velocities, modes = simulated(flows, targets, line, offset, start)
        if np.bincount(modes, minlength=2).min() >= FEWEST:
            return states, velocities, modes


def _laws(kind, rng):
    """Targets and linear parts: equal nodes, one rate a mode, one a mode and state, spirals."""
    if kind == 0:
        target = rng.normal(size=2)
        return np.array([target, -target]), [np.diag(-rng.uniform(0.3, 3, 2))] * 2
    targets = rng.normal(size=(2, 2))
    if kind == 1:
        return targets, [-np.eye(2) * rng.uniform(0.3, 3) for _ in range(2)]
    if kind == 2:
        return targets, [np.diag(-rng.uniform(0.2, 3, 2)) for _ in range(2)]
    damping, speed = rng.uniform(0, 0.6, 2), rng.uniform(0.5, 4, 2)
    spirals = [np.array([[-d, w], [-w, -d]]) for d, w in zip(damping, speed, strict=True)]
    return 0.5 * targets, spirals
