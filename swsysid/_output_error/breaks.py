r"""Laws that jump where a state passes a level, as dry friction does where a velocity is zero.

An interval in which the state passes its level is parted there. With the velocities
:math:`f^-, f^+` before and after, and :math:`e` the state that passes, a variation becomes

.. math:: \delta x^+ = \Big(I + \frac{(f^+ - f^-) e^\top}{e^\top f^-}\Big) \delta x^- ,

so that where an interval leads is continuous in its node and has slopes. Where both laws lead to
the level the state sticks to it: its own velocity is zero there, and the others go on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from swsysid._output_error.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.laws import Bound, Laws, Modes, Shape, chained
from swsysid._stays.nodes import Rows

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
        flow = self._on(sides, steps, varied)
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

    def _on(self, sides: Array, steps: Steps, varied: bool) -> Flow:
        """Flow of the law as it is on some sides."""
        x, u, after, duration = steps
        u, after = np.hstack([u, sides]), np.hstack([after, sides])
        if varied:
            return super().flow(0, x, u, after, duration)
        return (super().step(np.zeros(len(x), dtype=np.intp), x, u, after, duration),)

    def _rates(self, sides: Array, x: Array, u: Array) -> Array:
        return self.velocities(np.zeros(len(x), dtype=np.intp), x, np.hstack([u, sides]))

    def _through(self, number: int, sides: Array, steps: Steps, ends: Array, varied: bool) -> Flow:
        """Flow of rows that pass a break; `ends` is where they would be without it."""
        (state, level), (x, u, after, duration) = self.breaks[number], steps
        rates = [self._rates(sides, *pair)[:, state] for pair in ((x, u), (ends, after))]
        share = _root(
            x[:, state] - level, ends[:, state] - level, *(duration * one for one in rates)
        )
        for turn in range(SETTINGS.turns_of_breaks):
            middle = u + share[:, None] * (after - u)
            is_last = turn + 1 == SETTINGS.turns_of_breaks
            at, *by = self._on(sides, Steps(x, u, middle, share * duration), varied and is_last)
            before = self._rates(sides, at, middle)
            if not is_last:
                move = _ratio(at[:, state] - level, before[:, state] * duration)
                share = np.clip(share - move, 0.0, 1.0)
        at[:, state] = level
        beyond = sides.copy()
        beyond[:, number] *= -1.0
        behind = self._rates(beyond, at, middle)
        sticks = behind[:, state] * beyond[:, number] <= 0.0
        behind[sticks, state] = 0.0
        rest = Steps(at, middle, after, (1.0 - share) * duration)
        last, *further = self._on(beyond, rest, varied)
        rows = np.flatnonzero(sticks)
        if rows.size:
            _put((last, *further), rows, self._held(number, beyond[rows], rest.some(rows), varied))
        if not varied:
            return (last,)
        jump = _ratio(behind - before, before[:, [state]]).T
        by_state, by_law = (one + one[:, [state]] * jump for one in by)
        by_at, added = further
        return last, chained(by_state, by_at), chained(by_law, by_at) + added

    def _held(self, number: int, sides: Array, steps: Steps, varied: bool) -> Flow:
        """Flow of the other states, while one sticks to its level."""
        (state, level), (x, u, after, duration) = self.breaks[number], steps
        n_states, n_rows = self.coef.shape[1], len(x)
        others = np.delete(np.arange(n_states), state)
        by = np.zeros((n_states, n_states, n_rows)), np.zeros((self.n_free, n_states, n_rows))
        flow = x.copy(), *by[: 2 * varied]
        if not others.size:
            return flow

        def features(columns: Array) -> Array:
            return self.features(np.insert(columns, state, level, axis=1))

        coef, spread, free = self.coef[:, others], self.spread[others], self.free[:, others]
        at = {int(old): new for new, old in enumerate(others)}
        shapes = tuple(Shape(at[one.state], *one[1:]) for one in self.shapes if one.state in at)
        bounds = tuple(Bound(at[one.state], *one[1:]) for one in self.bounds if one.state in at)
        laws = Laws(coef, features, spread, free, shapes=shapes, bounds=bounds)
        u, after = np.hstack([u, sides]), np.hstack([after, sides])
        if not varied:
            modes = np.zeros(n_rows, dtype=np.intp)
            flow[0][:, others] = laws.step(modes, x[:, others], u, after, duration)
            return flow
        flow[0][:, others], by_state, by_law = laws.flow(0, x[:, others], u, after, duration)
        flow[1][np.ix_(others, others)] = by_state
        flow[2][np.ix_(np.flatnonzero(self.places[1] != state), others)] = by_law
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


def _put(flow: Flow, rows: Rows, own: Flow) -> None:
    """Another flow of some of the rows."""
    flow[0][rows] = own[0]
    for whole, part in zip(flow[1:], own[1:], strict=True):
        whole[:, :, rows] = part


def _root(before: Array, after: Array, slope_before: Array, slope_after: Array) -> Array:
    """Where in a step a cubic with these values and slopes at its ends passes zero."""
    share = before / (before - after)
    low, high = np.zeros_like(share), np.ones_like(share)
    for _ in range(SETTINGS.turns_of_roots):
        s = share
        value = (
            before * (1.0 + 2.0 * s) * (1.0 - s) ** 2 + slope_before * s * (1.0 - s) ** 2
            + after * s**2 * (3.0 - 2.0 * s) + slope_after * s**2 * (s - 1.0)
        )  # fmt: skip
        same = value * before > 0.0
        low, high = np.where(same, s, low), np.where(same, high, s)
        share = 0.5 * (low + high)
    return share


def _ratio(over: Array, under: Array) -> Array:
    """A quotient that is no larger than a limit: where a level is grazed it has none."""
    most = SETTINGS.steepest
    quotient = np.divide(
        over, under, out=np.zeros(np.broadcast_shapes(over.shape, under.shape)), where=under != 0.0
    )
    return np.clip(quotient, -most, most)
