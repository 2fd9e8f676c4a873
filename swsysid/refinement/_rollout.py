"""Batched rollouts of a switching system with fixed steps, smooth in the parameters."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._simulation.fixed_steps import cross_smoothly, switched_step
from swsysid.refinement._settings import SETTINGS, Settings
from swsysid.refinement._system import Maps, ParameterSets, RowSystem

__all__ = ["Grid", "rollout", "substeps_for"]


@dataclass(frozen=True)
class Grid:
    """Times and inputs along which many rows are integrated together.

    Attributes
    ----------
    steps : ndarray of shape (n_steps, n_rows)
        Durations; a row with steps of zero has reached its end.
    inputs : ndarray of shape (n_steps + 1, n_rows, n_inputs)
    linear : bool
        Inputs are linear between samples, else held.
    substeps : int
        Runge-Kutta steps between two samples.
    """

    steps: Array
    inputs: Array
    linear: bool
    substeps: int


def rollout(
    maps: Maps, sets: ParameterSets, grid: Grid, starts: Array, bound: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """States of every owner on every row of a grid, and whether they stayed bounded.

    Parameters
    ----------
    maps, sets
        The system and its parameters; the owners share the grid.
    grid : Grid
    starts : ndarray of shape (n_owners, n_rows, n_states)
    bound : ndarray of shape (n_states,)
        Magnitude at which a diverging state is held.

    Returns
    -------
    states : ndarray of shape (n_steps + 1, n_owners, n_rows, n_states)
    bounded : ndarray of shape (n_owners, n_rows), bool
    """
    n_owners, n_rows, n_states = starts.shape
    system = RowSystem(maps, sets, np.repeat(np.arange(n_owners), n_rows))
    x = starts.reshape(-1, n_states)
    states = np.empty((len(grid.steps) + 1, *starts.shape))
    states[0], bounded = starts, np.ones(len(x), dtype=bool)
    modes = None
    with np.errstate(all="ignore"):  # a diverging trial is bounded below, not a warning
        for k, durations in enumerate(grid.steps):
            u = grid.inputs[k]
            change = grid.inputs[k + 1] - u if grid.linear else np.zeros_like(u)
            u, change = np.tile(u, (n_owners, 1)), np.tile(change, (n_owners, 1))
            duration = np.tile(durations, n_owners)[:, None]
            if modes is None or u.shape[1]:  # a jump of the inputs may have changed the mode
                modes = system.modes(x, u)
            if maps.discrete_time:
                x, modes = np.where(duration > 0.0, system.field(modes)(x, u), x), None
            else:
                change, step = change / grid.substeps, duration / grid.substeps
                for _ in range(grid.substeps):
                    x, modes = switched_step(system, x, u, change, step, modes, cross_smoothly)
                    u = u + change
            escaped = ~(np.abs(x) <= bound).all(axis=1)
            if escaped.any():
                bounded &= ~escaped
                x = np.clip(np.where(np.isnan(x), bound, x), -bound, bound)
            states[k + 1] = x.reshape(starts.shape)
    return states, bounded.reshape(n_owners, n_rows)


def substeps_for(
    maps: Maps,
    sets: ParameterSets,
    x: Array,
    u: Array,
    duration: float,
    settings: Settings = SETTINGS,
) -> int:
    """Runge-Kutta steps between samples that the fastest rate of the model asks for.

    The rate is the spectral radius of the field's Jacobian that nine of ten points stay below, in
    the fastest mode; a root or a kink may make it infinite at a few.
    """
    if maps.discrete_time:
        return 1
    system = RowSystem(maps, sets, np.zeros(len(x), dtype=np.intp))
    size = np.maximum(np.abs(x).max(axis=0), 1e-12)
    moves = np.diag(1e-5 * size)
    rate = 0.0
    for mode in range(maps.n_modes):
        field = system.field(np.full(len(x), mode))
        slopes = [(field(x + move, u) - field(x, u)) / 1e-5 / size for move in moves]
        radius = np.abs(np.linalg.eigvals(np.nan_to_num(np.stack(slopes, axis=2)))).max(axis=1)
        rate = max(rate, float(np.quantile(radius, 0.9)))
    return int(np.clip(np.ceil(duration * rate / settings.step_rate), 1, settings.most_substeps))
