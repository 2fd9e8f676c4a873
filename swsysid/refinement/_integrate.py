r"""Batched rollouts of a switching system with fixed steps.

A step of the classical fourth-order Runge-Kutta method is taken in the mode in which it begins.
Where the mode at its end is another one, the fraction :math:`\alpha` of the step after which the
decisions of the two modes are equal is found by interpolation, the step is cut there, and its
rest is taken in the new mode. The end of the step is then a smooth function of the parameters (a
mode that is decided at each stage would make it jump), which is what least squares needs.

Where the rest of the step leads straight back, both fields point at the surface. The state slides:
its rest is the convex combination of the steps in the two modes that ends on the surface, the
first order of Filippov's solution.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid.refinement._system import Maps, ParameterSets, RowSystem

__all__ = ["Stretch", "rollout", "substeps_for"]

# A step times the fastest rate of the model: the error of a Runge-Kutta step is its fifth power
# over 120, 3e-6.
STEP_RATE = 0.2
MOST_SUBSTEPS = 50


class Stretch:
    """Times and inputs along which many rows are integrated together.

    Parameters
    ----------
    steps : ndarray of shape (n_steps, n_rows)
        Durations; a row with steps of zero has reached its end.
    inputs : ndarray of shape (n_steps + 1, n_rows, n_inputs)
    linear : bool
        Inputs are linear between samples, else held.
    substeps : int
        Runge-Kutta steps between two samples.
    """

    def __init__(self, steps: Array, inputs: Array, linear: bool, substeps: int):
        self.steps, self.inputs = steps, inputs
        self.linear, self.substeps = linear, substeps


def rollout(
    maps: Maps, sets: ParameterSets, stretch: Stretch, starts: Array, bound: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """States of every owner on every row of a stretch, and whether they stayed bounded.

    Parameters
    ----------
    maps, sets
        The system and its parameters; the owners share the stretch.
    stretch : Stretch
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
    states = np.empty((len(stretch.steps) + 1, *starts.shape))
    states[0], bounded = starts, np.ones(len(x), dtype=bool)
    modes = None
    with np.errstate(all="ignore"):  # a diverging trial is bounded below, not a warning
        for k, durations in enumerate(stretch.steps):
            u, after = stretch.inputs[k], stretch.inputs[k + 1]
            change = after - u if stretch.linear else np.zeros_like(u)
            u, change = np.tile(u, (n_owners, 1)), np.tile(change, (n_owners, 1))
            moving = np.tile(durations, n_owners)[:, None]
            x, modes = _advance(system, x, u, change, moving, stretch.substeps, modes)
            escaped = ~(np.abs(x) <= bound).all(axis=1)
            if escaped.any():
                bounded &= ~escaped
                x = np.clip(np.where(np.isnan(x), bound, x), -bound, bound)
            states[k + 1] = x.reshape(starts.shape)
    return states, bounded.reshape(n_owners, n_rows)


def _advance(system: RowSystem, x, u, change, duration, substeps, modes):
    """From one sample to the next."""
    if modes is None or u.shape[1]:  # a jump of the inputs may have changed the mode
        modes = system.modes(x, u)
    if system.maps.discrete_time:
        following = np.where(duration > 0.0, system.field(modes)(x, u), x)
        return following, None
    change, step = change / substeps, duration / substeps
    for k in range(substeps):
        x, modes = _step(system, x, u + k * change, change, step, modes)
    return x, modes


def _step(system: RowSystem, x, u, change, step, modes):
    """One step, cut where the mode changes."""
    end = _runge_kutta(system.field(modes), x, u, change, step)
    if system.maps.n_modes == 1:
        return end, modes
    after = system.modes(end, u + change)
    crossed = np.flatnonzero(after != modes)
    if len(crossed):
        part = system.part(crossed)
        pair = modes[crossed], after[crossed]
        cut = [array[crossed] for array in (x, end, u, change, step)]
        end[crossed] = _cross(part, pair, *cut)
        after[crossed] = part.modes(end[crossed], (u + change)[crossed])
    return end, after


def _runge_kutta(field, x, u, change, step):
    middle, half = u + 0.5 * change, 0.5 * step
    k1 = field(x, u)
    k2 = field(x + half * k1, middle)
    k3 = field(x + half * k2, middle)
    k4 = field(x + step * k3, u + change)
    return x + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


def _cross(system: RowSystem, pair, x, end, u, change, step):
    """End of a step in the course of which the first mode of a pair gives way to the second."""
    rows = np.arange(len(x))

    def lead(x, u):
        """By how much the decision of the old mode exceeds that of the new one."""
        decided = system.decisions(x, u)
        return (decided[rows, pair[0]] - decided[rows, pair[1]])[:, None]

    old, new = (system.field(modes) for modes in pair)
    start_lead, end_lead = np.maximum(lead(x, u), 0.0), lead(end, u + change)
    fraction = _share(start_lead, -end_lead)
    at = _runge_kutta(old, x, u, fraction * change, fraction * step)
    fraction = _root(start_lead, lead(at, u + fraction * change), end_lead, fraction)
    at, at_u = _runge_kutta(old, x, u, fraction * change, fraction * step), u + fraction * change
    rest = 1.0 - fraction
    beyond = _runge_kutta(new, at, at_u, rest * change, rest * step)
    # Back on the old side: neither field leads away, and the step ends between the two.
    back_lead = lead(beyond, u + change)
    share = _share(back_lead, -end_lead)
    return np.where(back_lead > 0.0, (1.0 - share) * beyond + share * end, beyond)


def _share(first: Array, second: Array) -> Array:
    """Part of the first in the sum of two that are not negative; a half where both vanish."""
    total = first + second
    return np.where(total > 0.0, first / np.where(total > 0.0, total, 1.0), 0.5)


def _root(start: Array, middle: Array, end: Array, fraction: Array) -> Array:
    """Zero of the parabola through the leads at 0, `fraction` and 1, on [0, 1]."""
    inner = fraction * (fraction - 1.0)
    chord = start + (end - start) * fraction
    curvature = np.where(inner != 0.0, (middle - chord) / np.where(inner != 0.0, inner, 1.0), 0.0)
    slope = end - start - curvature
    # start + slope a + curvature a^2 = 0, the root that is stable where the curvature vanishes
    disc = np.sqrt(np.maximum(slope**2 - 4.0 * curvature * start, 0.0))
    lower = -slope + disc
    root = np.where(lower > 0.0, 2.0 * start / np.where(lower > 0.0, lower, 1.0), fraction)
    return np.clip(root, 0.0, 1.0)


def substeps_for(maps: Maps, sets: ParameterSets, x: Array, u: Array, duration: float) -> int:
    """Runge-Kutta steps between samples that the fastest rate of the model asks for.

    The rate is the spectral radius of the field's Jacobian that nine of ten points stay below, in
    the fastest mode; a root or a kink may make it infinite at a few.
    """
    if maps.discrete_time:
        return 1
    system = RowSystem(maps, sets, np.zeros(len(x), dtype=np.intp))
    size = np.maximum(np.abs(x).max(axis=0), 1e-12)
    rate = 0.0
    for mode in range(maps.n_modes):
        field = system.field(np.full(len(x), mode))
        base = field(x, u)
        columns = []
        for state, scale in enumerate(size):
            moved = x.copy()
            moved[:, state] += 1e-5 * scale
            columns.append((field(moved, u) - base) / 1e-5 / size)
        jacobian = np.nan_to_num(np.stack(columns, axis=2))
        radius = np.abs(np.linalg.eigvals(jacobian)).max(axis=1)
        rate = max(rate, float(np.quantile(radius, 0.9)))
    return int(np.clip(np.ceil(duration * rate / STEP_RATE), 1, MOST_SUBSTEPS))
