r"""Where every interval leads from its node, and how that changes with all unknowns.

The intervals of one mode are integrated together, in chunks that stay in the cache: one pass over
the data. Those with a switch go on in the old mode to the instant and in the new one from there;
the sensitivity to the instant is the difference of the two velocities, carried to the end.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.guards import Crossings
from swsysid._stays.laws import Laws, products
from swsysid._stays.nodes import Nodes, Rows
from swsysid._stays.settings import LIMITS


class Legs(NamedTuple):
    """Intervals, the states at their ends, and derivatives of these, rows last."""

    rows: Rows  # numbers of the intervals
    ends: Array  # (n_rows, n_states)
    by_state: Array  # (n_states, n_states, n_rows): at the node where it begins
    columns: NDArray[np.intp]  # of the free coefficients of laws and surfaces
    by_law: Array  # (n_states, n_columns, n_rows): by these


class Switching(NamedTuple):
    """The intervals with a switch, in the order of the instants."""

    legs: Legs
    by_instant: Array  # (n_switches, n_states)
    crossings: Crossings


def steady_legs(laws: Laws, nodes: Nodes, states: Array) -> Iterator[Legs]:
    """Intervals without a switch, those of one mode after the other."""
    steady = nodes.switch < 0
    for mode in np.unique(nodes.old[steady]):
        rows = np.flatnonzero(steady & (nodes.old == mode))
        for chunk in np.array_split(rows, max(1, round(len(rows) / LIMITS.chunk))):
            yield _steady(laws, int(mode), nodes, chunk, states)


def _steady(laws: Laws, mode: int, nodes: Nodes, rows: Rows, states: Array) -> Legs:
    first = nodes.begins[rows]
    x, u, after, steps = states[first], nodes.u[first], nodes.u[first + 1], nodes.steps[rows]
    columns = laws.columns_of(mode)
    if nodes.recordings.first_step == 1.0:
        return Legs(rows, *_in_order(laws.flow(mode, x, u, after, steps), columns))
    middle = 0.5 * (u + after)
    x, by_state, by_law = laws.flow(mode, x, u, middle, 0.5 * steps)
    x, further, added = laws.flow(mode, x, middle, after, 0.5 * steps)
    both = x, products(further, by_state), products(further, by_law) + added
    return Legs(rows, *_in_order(both, columns))


def _in_order(flown: tuple[Array, Array, Array], columns: NDArray[np.intp]) -> tuple:
    x, by_state, by_law = flown
    return x, by_state, columns, by_law


def switching(laws: Laws, nodes: Nodes, states: Array) -> Switching:
    """Intervals with a switch, and what is so at their instants."""
    rows = nodes.at
    first, n_states = nodes.begins[rows], states.shape[1]
    u, after, steps = nodes.u[first], nodes.u[first + 1], nodes.steps[rows]
    share = nodes.shares()[rows]
    middle = u + share[:, None] * (after - u)
    old, new = nodes.old[rows], nodes.new[rows]
    Z = np.zeros((len(rows), n_states, n_states + laws.n_free + 1))
    Z[:, np.arange(n_states), np.arange(n_states)] = 1.0
    x, Z = laws.varied_step(old, states[first], Z, u, middle, share * steps)
    rate = (after - u) / steps[:, None]
    before = laws.velocities(old, x, middle, rate)
    columns, rates = np.hstack([x, middle]), np.hstack([before, rate])
    crossings = Crossings(*laws.sides(old, new), columns, rates, Z.copy())
    Z[:, :, -1] = before - laws.velocities(new, x, middle, rate)
    x, Z = laws.varied_step(new, x, Z, middle, after, (1.0 - share) * steps)
    by_state, by_law, by_instant = np.split(Z, [n_states, n_states + laws.n_free], axis=2)
    every = np.arange(laws.n_free)
    by_state, by_law = (part.transpose(1, 2, 0) for part in (by_state, by_law))
    return Switching(Legs(rows, x, by_state, every, by_law), by_instant[:, :, 0], crossings)


def ends_of(laws: Laws, nodes: Nodes, states: Array, rows: Rows | None = None) -> Array:
    """Where intervals lead, all by default, (n_intervals, n_states), without derivatives."""
    rows = np.arange(len(nodes.begins)) if rows is None else rows
    first, share, steps = nodes.begins[rows], nodes.shares()[rows], nodes.steps[rows]
    u, after = nodes.u[first], nodes.u[first + 1]
    middle = u + share[:, None] * (after - u)
    x = laws.step(nodes.old[rows], states[first], u, middle, share * steps)
    if (on := np.flatnonzero(share < 1.0)).size:
        left = (1.0 - share[on]) * steps[on]
        x[on] = laws.step(nodes.new[rows[on]], x[on], middle[on], after[on], left)
    return x


def crossings_of(laws: Laws, nodes: Nodes, states: Array) -> Crossings:
    """Where recordings switch, in the order of the instants."""
    rows = nodes.at
    first = nodes.begins[rows]
    u, after, steps = nodes.u[first], nodes.u[first + 1], nodes.steps[rows]
    share = nodes.shares()[rows]
    middle = u + share[:, None] * (after - u)
    old, rate = nodes.old[rows], (after - u) / steps[:, None]
    x = laws.step(old, states[first], u, middle, share * steps)
    rates = np.hstack([laws.velocities(old, x, middle, rate), rate])
    return Crossings(*laws.sides(old, nodes.new[rows]), np.hstack([x, middle]), rates, None)
