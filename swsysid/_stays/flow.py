r"""Where every interval leads from its node, and how that changes with all unknowns.

The intervals of one mode are integrated together, in chunks that stay in the cache: one pass over
the data. Those with a switch go on in the old mode to the instant and in the new one from there;
the sensitivity to the instant is the difference of the two velocities, carried to the end.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.guards import Crossings
from swsysid._stays.laws import Laws, Modes, chained, slope_of
from swsysid._stays.nodes import Nodes, Rows
from swsysid._stays.resets import Resets

_CHUNK = 8192  # intervals that are worked at once, so that they stay in the cache


class Legs(NamedTuple):
    """Intervals, the states at their ends, and derivatives of these, rows last.

    Each derivative is that by the first index of the second one.
    """

    rows: Rows  # numbers of the intervals
    ends: Array  # (n_rows, n_states)
    by_state: Array  # (n_states, n_states, n_rows or 1): at the node where it begins
    columns: NDArray[np.intp]  # of the free coefficients of laws, surfaces and resets
    by_law: Array  # (n_columns, n_states, n_rows): by these
    n_joined: int = 1  # so many follow each other, the first ones of all segments first


class Switching(NamedTuple):
    """The intervals with a switch, in the order of the instants, and those where an input steps."""

    legs: Legs
    by_instant: Array  # (n_switches + n_stepping, n_states)
    crossings: Callable[[], Crossings]  # of the switches, where a surface asks for them


def steady_legs(laws: Laws, nodes: Nodes, states: Array) -> Iterator[Legs]:
    """Intervals without a switch, those of one mode after the other."""
    for mode in dict.fromkeys(mode for mode, _ in nodes.segments):
        waiting: list[Rows] = []
        for rows in (rows for own, rows in nodes.segments if own == mode):
            for chunk in np.array_split(rows, max(1, round(rows.size / _CHUNK)), axis=1):
                if sum(one.size for one in (*waiting, chunk)) > _CHUNK:
                    yield from _steady(laws, mode, nodes, waiting, states)
                    waiting = []
                waiting.append(chunk)
        yield from _steady(laws, mode, nodes, waiting, states)


def joined_legs(parts: Iterable[Legs]) -> Legs:
    """Legs of one mode, chunk by chunk, as one."""
    listed = list(parts)
    rows, ends = (
        np.concatenate([getattr(one, name) for one in listed]) for name in ("rows", "ends")
    )
    by_state = np.concatenate(
        [np.broadcast_to(one.by_state, (*one.by_state.shape[:2], len(one.rows))) for one in listed],
        axis=2,
    )
    by_law = np.concatenate([one.by_law for one in listed], axis=2)
    return Legs(rows, ends, by_state, listed[0].columns, by_law)


def _steady(
    laws: Laws, mode: int, nodes: Nodes, segments: list[Rows], states: Array
) -> Iterator[Legs]:
    """Segments of one mode, all of their intervals flown at once."""
    if not segments:
        return
    rows = np.concatenate([one.ravel() for one in segments])
    first = nodes.begins[rows]
    x, u, after, steps = states[first], nodes.u[first], nodes.after[first], nodes.steps[rows]
    if nodes.recordings.first_step == 1.0:
        x, by_state, by_law = laws.flow(mode, x, u, after, steps)
    else:
        middle = 0.5 * (u + after)
        x, by_state, by_law = laws.flow(mode, x, u, middle, 0.5 * steps)
        x, further, added = laws.flow(mode, x, middle, after, 0.5 * steps)
        by_state, by_law = chained(by_state, further), chained(by_law, further) + added
    columns, end = laws.columns_of(mode), 0
    for one in segments:
        own = slice(end, end + one.size)
        end = own.stop
        of_states = by_state if by_state.shape[2] == 1 else by_state[:, :, own]
        yield Legs(rows[own], x[own], of_states, columns, by_law[:, :, own], len(one))


def switching(
    laws: Laws,
    nodes: Nodes,
    states: Array,
    resets: Resets | None = None,
    first_of_resets: int = 0,
) -> Switching:
    """Intervals with a switch, and what is so at their instants.

    Where an input steps that is a switch to the same mode with another input. The coefficients of
    resets are unknowns from a number on.
    """
    rows, n_states = nodes.intervals_of_instants, states.shape[1]
    at = _Parts.of(nodes, states, rows)
    Z = np.zeros((len(rows), n_states, n_states + laws.n_free))
    Z[:, np.arange(n_states), np.arange(n_states)] = 1.0
    x, Z = laws.varied_step(at.old, at.x, Z, at.u, at.middle, at.share * at.steps)
    rate = slope_of(at.u, at.after, at.steps)
    crossings = partial(_crossings, laws, nodes, at, x, Z)
    moving = laws.velocities(at.old, x, at.before, rate)[:, :, None]
    if resets is not None:
        taken = np.append(nodes.transitions, np.full(len(nodes.stepping), -1))
        Z = resets.varied(taken, x, np.concatenate([moving, Z], axis=2))
        x, (moving, Z) = resets.landed(taken, x), np.split(Z, [1], axis=2)
    moving = moving - laws.velocities(at.new, x, at.middle, rate)[:, :, None]
    Z = np.concatenate([Z, moving], axis=2)
    x, Z = laws.varied_step(at.new, x, Z, at.middle, at.after, (1.0 - at.share) * at.steps)
    by_state, by_shared, by_instant = np.split(Z.transpose(2, 1, 0), [n_states, -1])
    columns = np.arange(laws.n_free)
    if resets is not None:
        columns = np.append(columns, first_of_resets + np.arange(resets.n_free))
    legs = Legs(rows, x, by_state, columns, by_shared)
    return Switching(legs, by_instant[0].T, crossings)


def ends_of(
    laws: Laws,
    nodes: Nodes,
    states: Array,
    rows: Rows | None = None,
    resets: Resets | None = None,
) -> Array:
    """Where intervals lead, all by default, (n_intervals, n_states), without derivatives."""
    rows = np.arange(len(nodes.begins)) if rows is None else rows
    at = _Parts.of(nodes, states, rows)
    x = laws.step(at.old, at.x, at.u, at.middle, at.share * at.steps)
    if (on := np.flatnonzero(at.share < 1.0)).size:
        if resets is not None:
            jumping = on[nodes.switch[rows[on]] >= 0]
            transitions = nodes.transitions[nodes.switch[rows[jumping]]]
            x[jumping] = resets.landed(transitions, x[jumping])
        left = (1.0 - at.share[on]) * at.steps[on]
        x[on] = laws.step(at.new[on], x[on], at.middle[on], at.after[on], left)
    return x


def crossings_of(laws: Laws, nodes: Nodes, states: Array) -> Crossings:
    """Where recordings switch, in the order of the instants."""
    at = _Parts.of(nodes, states, nodes.at)
    x = laws.step(at.old, at.x, at.u, at.middle, at.share * at.steps)
    return _crossings(laws, nodes, at, x, None)


def _crossings(laws: Laws, nodes: Nodes, at: _Parts, x: Array, varied: Array | None) -> Crossings:
    """Those of the first of some intervals, in which modes switch."""
    n, rate = len(nodes.at), slope_of(at.u, at.after, at.steps)
    clocks = np.column_stack([nodes.instants - nodes.entered, nodes.instants])
    velocities = laws.velocities(at.old, x, at.middle, rate)
    columns = np.hstack([x[:n], at.middle[:n], clocks])
    rates = np.hstack([velocities[:n], rate[:n], np.ones(clocks.shape)])
    steps, inputs = nodes.in_steps, slice(x.shape[1], -clocks.shape[1])
    before, after = (nodes.u[own[steps]] for own in nodes.moments)
    columns[steps, inputs], rates[steps] = 0.5 * (before + after), 0.0
    rates[steps, inputs] = (after - before) / nodes.recordings.interval
    sides = laws.sides(at.old[:n], at.new[:n])
    varied = None if varied is None else varied[:n]
    return Crossings(*sides, nodes.told_by, columns, rates, steps, varied)


class _Parts(NamedTuple):
    """Intervals, each parted at its switch or after its first step, or behind a step of inputs."""

    x: Array  # states where they begin
    u: Array  # inputs there, where they are parted, that before they step, and where they end
    middle: Array
    before: Array
    after: Array
    old: Modes
    new: Modes
    share: Array  # of the first part
    steps: Array

    @classmethod
    def of(cls, nodes: Nodes, states: Array, rows: Rows) -> _Parts:
        """Some intervals from given states of the nodes."""
        first, share = nodes.begins[rows], nodes.shares()[rows]
        u, after = nodes.u[first], nodes.after[first]
        middle = u + share[:, None] * (after - u)
        old, before = nodes.old[rows], middle
        if len(nodes.stepping):
            own = np.flatnonzero(np.isin(rows, nodes.stepping))
            left, before = nodes.before_steps(first[own]), middle.copy()
            old[own], before[own] = nodes.modes[left], nodes.u[left]
        return cls(
            states[first], u, middle, before, after, old, nodes.new[rows], share, nodes.steps[rows]
        )
