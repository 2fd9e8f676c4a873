"""Planted systems of some thousand rows, and fits that take these for many."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from swsysid import SwitchingSystemRegressor

A = np.array([[[0.0, 1.0], [-1.0, -0.1]], [[0.0, 1.0], [-1.0, -0.5]]])
B = np.array([[[1.0, 0.0], [0.0, 1.0]], [[-2.0, 1.0], [0.0, -1.0]], [[0.0, -3.0], [2.0, 0.0]]])


def oscillator(n_samples=4000, noise=0.05, seed=0, guard=0.3):
    """States of a damped oscillator, velocities, and modes: which side of the guard they are on."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-3, 3, (n_samples, 2))
    modes = (X[:, 0] <= guard).astype(int)
    Xdot = np.einsum("ikl,il->ik", A[modes], X) + noise * rng.standard_normal(X.shape)
    return X, Xdot, modes


def three_stripes(n_samples=4000, noise=0.05, seed=0):
    """The same of three modes side by side."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-1, 1, (n_samples, 2))
    modes = np.digitize(X[:, 0], [-0.2, 0.5])
    Xdot = np.einsum("ikl,il->ik", B[modes], X) + noise * rng.standard_normal(X.shape)
    return X, Xdot, modes


def take_for_many(monkeypatch, whole=1500, sampled=800, **others):
    """From now on more than `whole` rows are identified on a sample of `sampled`."""
    settings = replace(SwitchingSystemRegressor.settings, whole=whole, sampled=sampled, **others)
    monkeypatch.setattr(SwitchingSystemRegressor, "settings", settings)


def fitted(X, Xdot, *, sample_weight=None, groups=None, **parameters):
    model = SwitchingSystemRegressor(**{"random_state": 0} | parameters)
    return model.fit(X, Xdot, sample_weight, groups=groups)


def cut(array, *ends):
    """An array as a list of blocks."""
    return np.split(array, ends)


class Lazily(Sequence):
    """Blocks that are made when they are asked for."""

    def __init__(self, array, size):
        self.array, self.size = array, size

    def __len__(self):
        return -(-len(self.array) // self.size)

    def __getitem__(self, index):
        if not 0 <= index < len(self):
            raise IndexError(index)
        return self.array[index * self.size : (index + 1) * self.size].copy()
