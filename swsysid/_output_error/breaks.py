r"""Laws that jump where a state passes a level, as dry friction does where a velocity is zero.

An interval in which the state passes its level is parted there. With the velocities
:math:`f^-, f^+` before and after, and :math:`e` the state that passes, a variation becomes

.. math:: \delta x^+ = \Big(I + \frac{(f^+ - f^-) e^\top}{e^\top f^-}\Big) \delta x^- ,

so that where an interval leads is continuous in its node and has slopes. Where both laws lead to
the level the state sticks to it: its own velocity is zero there, and the others go on.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._stays.laws import Laws, Modes, Shape, chained
from swsysid._stays.nodes import Rows

# turns of instants at which a law breaks, of cubics that begin them; and by how much of the
# velocity of a state that passes others may change, where a level is grazed
_TURNS_OF_BREAKS = 2
_TURNS_OF_ROOTS = 12
_STEEPEST = 20.0


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
        return self._flow(Steps(x, u, after, duration), varied=False)[0]

    def flow(
        self, mode: int, x: Array, u: Array, after: Array, duration: Array
    ) -> tuple[Array, Array, Array]:
        ends, by_state, by_law = self._flow(Steps(x, u, after, duration), varied=True)
        return ends, by_state, by_law

    def _flow(self, steps: Steps, varied: bool) -> Flow:
        columns = [np.where(steps.x[:, state] > level, 1.0, -1.0) for state, level in self.breaks]
        sides = np.column_stack(columns)
        flow = self.on(sides, steps, varied)
        parted = np.zeros(len(sides), dtype=bool)
        for number, (state, level) in enumerate(self.breaks):
            beyond = (flow[0][:, state] - level) * sides[:, number] < 0.0
            rows = np.flatnonzero(beyond & ~parted)
            if rows.size:
                parted[rows] = True
                _put(
                    flow,
                    rows,
                    self._through(number, sides[rows], steps.some(rows), flow[0][rows], varied),
                )
        return flow

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

    def _through(self, number: int, sides: Array, steps: Steps, ends: Array, varied: bool) -> Flow:
        """Flow of rows that pass a break; `ends` is where they would be without it."""
        (state, level), (x, u, after, duration) = self.breaks[number], steps
        rates = self._rates((sides, x, u), (sides, ends, after))
        share = _root(
            x[:, state] - level,
            ends[:, state] - level,
            *(duration * one[:, state] for one in rates),
        )
        beyond = sides.copy()
        beyond[:, number] *= -1.0
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
        rest = Steps(at, middle, after, (1.0 - share) * duration)
        last, *further = self._holding(number, sticks).on(beyond, rest, varied)
        if not varied:
            return (last,)
        jump = _ratio(behind - before, before[:, [state]]).T
        by_state, by_law = (one + one[:, [state]] * jump for one in by)
        by_at, added = further
        by_at[state][:, sticks] = 0.0
        return last, chained(by_state, by_at), chained(by_law, by_at) + added

    def _holding(self, number: int, sticks: NDArray[np.bool_]) -> BreakingLaws:
        """The same while some rows stick to a level: their own rate is zero, the others go on."""
        if not sticks.any():
            return self
        held = Shape(self.breaks[number].state, _stopped, (sticks,))
        return replace(self, shapes=(*self.shapes, held))


class Steps(NamedTuple):
    """Steps of rows: states, inputs before and after, durations."""

    x: Array
    u: Array
    after: Array
    duration: Array

    def some(self, rows: Rows) -> Steps:
        """Those of some of the rows."""
        return Steps(*(one[rows] for one in self))


def _put(flow: Flow, rows: Rows, own: Flow) -> None:
    """Another flow of some of the rows."""
    flow[0][rows] = own[0]
    for whole, part in zip(flow[1:], own[1:], strict=True):
        whole[:, :, rows] = part


def _root(before: Array, after: Array, slope_before: Array, slope_after: Array) -> Array:
    """Where in a step a cubic with these values and slopes at its ends passes zero."""
    share = before / (before - after)
    low, high = np.zeros_like(share), np.ones_like(share)
    for _ in range(_TURNS_OF_ROOTS):
        s = share
        value = (
            before * (1.0 + 2.0 * s) * (1.0 - s) ** 2 + slope_before * s * (1.0 - s) ** 2
            + after * s**2 * (3.0 - 2.0 * s) + slope_after * s**2 * (s - 1.0)
        )  # fmt: skip
        same = value * before > 0.0
        low, high = np.where(same, s, low), np.where(same, high, s)
        share = 0.5 * (low + high)
    return share


def _stopped(rates: Array, states: Array, sticks: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Rates of a state, zero of rows that stick, and their slopes by what they would be."""
    return np.where(sticks, 0.0, rates), np.where(sticks, 0.0, 1.0)


def _ratio(over: Array, under: Array) -> Array:
    """A quotient that is no larger than a limit: where a level is grazed it has none."""
    most = _STEEPEST
    quotient = np.divide(
        over, under, out=np.zeros(np.broadcast_shapes(over.shape, under.shape)), where=under != 0.0
    )
    return np.clip(quotient, -most, most)
