r"""Laws that jump where a state passes a level, as dry friction does where a velocity is zero.

An interval in which the state passes its level is parted there. With the velocities
:math:`f^-, f^+` before and after, and :math:`e` the state that passes, a variation becomes

.. math:: \delta x^+ = \Big(I + \frac{(f^+ - f^-) e^\top}{e^\top f^-}\Big) \delta x^- ,

so that where an interval leads is continuous in its node and has slopes. Where both laws lead to
the level the state sticks to it: its own velocity is zero there, and the others go on, until a law
leads away. An interval may have several such events, one after the other.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from swsysid._results import Array
from swsysid._stays.laws import Laws, Modes, Shape, chained
from swsysid._stays.nodes import Rows

# turns of instants at which a law breaks, of cubics that begin them; and by how much of the
# velocity of a state that passes others may change, where a level is grazed
_TURNS_OF_BREAKS = 2
_TURNS_OF_ROOTS = 12
_STEEPEST = 20.0
# of a step: what passes and sticks may be let go, and what goes may come back
_MOST_EVENTS = 3


# states, and if they are asked for, derivatives by those before and by coefficients
Flow = tuple[Array, ...]


class Break(NamedTuple):
    """A level of a state at which a law jumps."""

    state: int
    level: float


@dataclass(frozen=True)
class BreakingLaws(Laws):
    """Laws of one mode whose features have a column more for every break: the side that counts.

    Beside the inputs stand 1 where the state counts as above its level and -1 where as below.
    """

    breaks: tuple[Break, ...] = ()

    def step(self, modes: Modes, x: Array, u: Array, after: Array, duration: Array) -> Array:
        steps = Steps(x, u, after, duration)
        return self._flow(self._sides(x), steps, varied=False)[0]

    def flow(
        self, mode: int, x: Array, u: Array, after: Array, duration: Array
    ) -> tuple[Array, Array, Array]:
        steps = Steps(x, u, after, duration)
        ends, by_state, by_law = self._flow(self._sides(x), steps, varied=True)
        return ends, by_state, by_law

    def _sides(self, x: Array) -> Array:
        columns = [np.where(x[:, state] > level, 1.0, -1.0) for state, level in self.breaks]
        return np.column_stack(columns)

    def _flow(self, sides: Array, steps: Steps, varied: bool, events: int = _MOST_EVENTS) -> Flow:
        """Flow of rows that begin on some sides, with so many events in a step."""
        flow = self.on(sides, steps, varied)
        parted = np.zeros(len(sides), dtype=bool)
        for number in range(len(self.breaks) if events else 0):
            rows, shares = self._passing(number, sides, steps, flow[0])
            rows, shares = rows[~parted[rows]], shares[~parted[rows]]
            if rows.size:
                parted[rows] = True
                some = steps.some(rows)
                own = self._through(number, sides[rows], some, shares, varied, events - 1)
                _put(flow, rows, own)
        return flow

    def _passing(self, number: int, sides: Array, steps: Steps, ends: Array) -> tuple[Rows, Array]:
        """Rows that pass a break, and in which share of their step; `ends` are without it.

        A step may begin at the level, or pass it at once, and end before it, driven there by an
        input that goes on: what was at rest would leave without having been held.
        """
        state, level = self.breaks[number]
        x, u, after, duration = steps
        side, before, behind = sides[:, number], x[:, state] - level, ends[:, state] - level
        beyond = behind * side < 0.0
        rows = np.flatnonzero(beyond | (np.abs(before) <= np.abs(behind - before)))
        rates = self._rates((sides[rows], x[rows], u[rows]), (sides[rows], ends[rows], after[rows]))
        first, last = (duration[rows] * one[:, state] for one in rates)
        side, before, behind, beyond = side[rows], before[rows], behind[rows], beyond[rows]
        share = _root(side, before, behind, first, last)
        dips = ~beyond & (first * side < 0.0)
        share[dips] = np.clip(_ratio(-before, first)[dips], 0.0, 1.0)
        some = beyond | dips
        return rows[some], share[some]

    def on(self, sides: Array, steps: Steps, varied: bool) -> Flow:
        """Flow of the law as it is on some sides."""
        x, u, after, duration = steps
        u, after = np.hstack([u, sides]), np.hstack([after, sides])
        if varied:
            return super().flow(0, x, u, after, duration)
        return (super().step(np.zeros(len(x), dtype=np.intp), x, u, after, duration),)

    def _rates(self, *rows: tuple[Array, Array, Array]) -> list[Array]:
        """Rates of rows of sides, states and inputs, of each of several such, asked at once."""
        sides, x, u = (np.concatenate(own) for own in zip(*rows, strict=True))
        rates = self.velocities(np.zeros(len(x), dtype=np.intp), x, np.hstack([u, sides]))
        return np.split(rates, len(rows))

    def _through(
        self, number: int, sides: Array, steps: Steps, share: Array, varied: bool, events: int
    ) -> Flow:
        """Flow of rows that pass a break, in about some share of their steps."""
        (state, level), (x, u, after, duration) = self.breaks[number], steps
        beyond = _beyond(sides, number)
        for turn in range(_TURNS_OF_BREAKS):
            middle = u + share[:, None] * (after - u)
            is_last = turn + 1 == _TURNS_OF_BREAKS
            at, *by = self.on(sides, Steps(x, u, middle, share * duration), varied and is_last)
            if not is_last:
                (before,) = self._rates((sides, at, middle))
                move = _ratio(at[:, state] - level, before[:, state] * duration)
                share = np.clip(share - move, 0.0, 1.0)
        at[:, state] = level
        before, behind = self._rates((sides, at, middle), (beyond, at, middle))
        sticks = behind[:, state] * beyond[:, number] <= 0.0
        behind[sticks, state] = 0.0
        jump = _ratio(behind - before, before[:, [state]]).T
        there = at, *(one + one[:, [state]] * jump for one in by)
        rest = Steps(at, middle, after, (1.0 - share) * duration)
        onward = tuple(np.empty_like(one) for one in there)
        for rows, own, further in (
            (np.flatnonzero(~sticks), beyond, self._flow),
            (np.flatnonzero(sticks), sides, partial(self._until_let_go, number)),
        ):
            if rows.size:
                _put(onward, rows, further(own[rows], rest.some(rows), varied, events))
        return _joined(there, onward)

    def _until_let_go(
        self, number: int, sides: Array, steps: Steps, varied: bool, events: int
    ) -> Flow:
        """Flow of rows that stick, until a law leads away within their step.

        They leave with a velocity of zero, so that by when they do nothing changes at once.
        """
        state, (x, u, after, duration) = self.breaks[number].state, steps
        flow = self._held(number, sides, steps, varied)
        beyond = _beyond(sides, number)
        places = (x, u), (flow[0], after)
        rates = self._rates(*((own, *place) for place in places for own in (sides, beyond)))
        away = [sides[:, number] * one[:, state] for one in rates]
        back = away[2] > 0.0
        rows = np.flatnonzero(back | (away[3] < 0.0))
        if not rows.size:
            return flow
        first = np.where(back, away[0], away[1])[rows]
        last = np.where(back, away[2], away[3])[rows]
        share = np.clip(_ratio(first, first - last), 0.0, 1.0)
        _, u, after, duration = steps.some(rows)
        middle = u + share[:, None] * (after - u)
        goes = np.where(back[:, None], sides, beyond)[rows]
        held = self._held(number, goes, Steps(x[rows], u, middle, share * duration), varied)
        later = Steps(held[0], middle, after, (1.0 - share) * duration)
        _put(flow, rows, _joined(held, self._flow(goes, later, varied, events)))
        return flow

    def _held(self, number: int, sides: Array, steps: Steps, varied: bool) -> Flow:
        """Flow while rows stick to a level: their own rate is zero, the others go on."""
        state = self.breaks[number].state
        stopped = replace(self, shapes=(*self.shapes, Shape(state, _stopped, ())))
        flow = stopped.on(sides, steps, varied)
        for by_state in flow[1:2]:
            by_state[state] = 0.0
        return flow


class Steps(NamedTuple):
    """Steps of rows: states, inputs before and after, durations."""

    x: Array
    u: Array
    after: Array
    duration: Array

    def some(self, rows: Rows) -> Steps:
        """Those of some of the rows."""
        return Steps(*(one[rows] for one in self))


def _beyond(sides: Array, number: int) -> Array:
    """The same sides but for the other one of a break."""
    beyond = sides.copy()
    beyond[:, number] *= -1.0
    return beyond


def _put(flow: Flow, rows: Rows, own: Flow) -> None:
    """Another flow of some of the rows."""
    flow[0][rows] = own[0]
    for whole, part in zip(flow[1:], own[1:], strict=True):
        whole[:, :, rows] = part


def _joined(first: Flow, second: Flow) -> Flow:
    """One flow after another."""
    if len(first) == 1:
        return (second[0],)
    (_, by_state, by_law), (ends, by_at, added) = first, second
    return ends, chained(by_state, by_at), chained(by_law, by_at) + added


def _root(
    side: Array, before: Array, after: Array, slope_before: Array, slope_after: Array
) -> Array:
    """Where in a step a cubic with these values and slopes at its ends leaves a side of zero."""
    share = np.full_like(before, 0.5)
    low, high = np.zeros_like(share), np.ones_like(share)
    for _ in range(_TURNS_OF_ROOTS):
        s = share
        value = (
            before * (1.0 + 2.0 * s) * (1.0 - s) ** 2 + slope_before * s * (1.0 - s) ** 2
            + after * s**2 * (3.0 - 2.0 * s) + slope_after * s**2 * (s - 1.0)
        )  # fmt: skip
        same = value * side > 0.0
        low, high = np.where(same, s, low), np.where(same, high, s)
        share = 0.5 * (low + high)
    return share


def _stopped(rates: Array, states: Array) -> tuple[Array, Array]:
    """Rates of a state that sticks, and their slopes by what they would be."""
    return np.zeros_like(rates), np.zeros_like(rates)


def _ratio(over: Array, under: Array) -> Array:
    """A quotient that is no larger than a limit: where a level is grazed it has none."""
    most = _STEEPEST
    quotient = np.divide(
        over, under, out=np.zeros(np.broadcast_shapes(over.shape, under.shape)), where=under != 0.0
    )
    return np.clip(quotient, -most, most)
