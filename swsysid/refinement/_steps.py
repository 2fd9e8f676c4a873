r"""Fixed steps of Runge and Kutta for many rows at once, cut where a mode changes.

A row takes its step in the mode in which it begins. Where the mode at the end is another one, the
step is cut where the old mode's lead over the new one vanishes, and its rest is taken in the new
mode, so that a switch costs no order. There are two ways to find the cut: `cross_exactly` to the
last digits, for data; `cross_smoothly` by one interpolation, which makes the end of the step a
smooth function of the parameters, as least squares needs it, and lets the state slide.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from swsysid._results import Array
from swsysid._simulation.stepping import runge_kutta
from swsysid.refinement._settings import SETTINGS
from swsysid.refinement._system import Rows, RowSystem


@dataclass(frozen=True)
class Crossing:
    """Steps in the course of which the mode `old` gives way to `new`.

    The inputs go from `u` to ``u + change``; `end` is where the whole step leads in the old mode.
    """

    system: RowSystem
    old: Rows
    new: Rows
    x: Array
    end: Array
    u: Array
    change: Array
    step: Array

    def until(self, cut: Array) -> tuple[Array, Array]:
        """States and inputs after the time `cut` in the old mode."""
        share = cut / self.step * self.change
        return _step(self.system, self.x, self.u, share, cut, self.old), self.u + share

    def beyond(self, cut: Array, x: Array, u: Array) -> Array:
        """The end of the step, from where it was cut."""
        return _step(self.system, x, u, self.u + self.change - u, self.step - cut, self.new)

    def lead(self, x: Array, u: Array) -> Array:
        """Positive while the old mode goes on."""
        return self.system.lead(self.old, self.new, x, u)


def switched_step(
    system: RowSystem,
    x: Array,
    u: Array,
    change: Array,
    step: Array,
    modes: Rows,
    cross: Callable[[Crossing], Array],
) -> tuple[Array, Rows]:
    """States and modes of all rows after steps (n_rows, 1), each cut where its mode changes."""
    end = _step(system, x, u, change, step, modes)
    after = system.modes(end, u + change)
    rows = np.flatnonzero(after != modes)
    if len(rows):
        part, cut = system.part(rows), [array[rows] for array in (x, end, u, change, step)]
        end[rows] = cross(Crossing(part, modes[rows], after[rows], *cut))
        after[rows] = part.modes(end[rows], (u + change)[rows])
    return end, after


def cross_exactly(crossing: Crossing) -> Array:
    """End of a step that is cut where regula falsi with the Illinois rule finds the switch."""
    early, late = np.zeros_like(crossing.step), crossing.step
    at_early = crossing.lead(crossing.x, crossing.u)
    at_late = crossing.lead(*crossing.until(late))
    for _ in range(SETTINGS.n_false_positions):
        cut = late - at_late * (late - early) / (at_late - at_early)
        at_cut = crossing.lead(*crossing.until(cut))
        passed = at_cut <= 0
        # the end that stays counts half, so that it is left soon
        at_early = np.where(passed, at_early / 2, at_cut)
        early = np.where(passed, early, cut)
        at_late = np.where(passed, at_cut, at_late / 2)
        late = np.where(passed, cut, late)
    return crossing.beyond(late, *crossing.until(late))


def cross_smoothly(crossing: Crossing) -> Array:
    r"""End of a step that is cut at the zero of a parabola through three leads.

    Where the rest of the step leads straight back, both fields point at the surface. The state
    slides: the step ends at the convex combination of the steps in the two modes that lies on the
    surface, the first order of Filippov's solution.
    """
    step, end_u = crossing.step, crossing.u + crossing.change
    first = np.maximum(crossing.lead(crossing.x, crossing.u), 0.0)
    last = crossing.lead(crossing.end, end_u)
    share = _share(first, -last)
    share = _root(first, crossing.lead(*crossing.until(share * step)), last, share)
    beyond = crossing.beyond(share * step, *crossing.until(share * step))
    back = crossing.lead(beyond, end_u)
    weight = _share(back, -last)
    return np.where(back > 0.0, (1.0 - weight) * beyond + weight * crossing.end, beyond)


def _step(system: RowSystem, x: Array, u: Array, change: Array, step: Array, modes: Rows) -> Array:
    field, inputs = system.field(modes), {0.0: u, 0.5: u + 0.5 * change, 1.0: u + change}
    return runge_kutta(lambda x, part: field(x, inputs[part]), x, step)


def _share(first: Array, second: Array) -> Array:
    """Part of the first in the sum of two that are not negative; a half where both vanish."""
    total = first + second
    return np.divide(first, total, out=np.full_like(total, 0.5), where=total > 0.0)


def _root(start: Array, middle: Array, end: Array, share: Array) -> Array:
    """Zero of the parabola through the leads at 0, `share` and 1, on [0, 1]."""
    inner = share * (share - 1.0)
    chord = start + (end - start) * share
    bend = np.divide(middle - chord, inner, out=np.zeros_like(inner), where=inner != 0.0)
    slope = end - start - bend
    # start + slope a + bend a^2 = 0, the root that is stable where the bend vanishes
    lower = np.sqrt(np.maximum(slope**2 - 4.0 * bend * start, 0.0)) - slope
    root = np.divide(2.0 * start, lower, out=share.copy(), where=lower > 0.0)
    return np.clip(root, 0.0, 1.0)
