r"""When a state jumps: where the flows before and after it, guard and reset agree best.

Between the samples around a jump the old law is followed forwards and the new one backwards. For an
instant :math:`\tau_k` of each switch guard and reset are found as they are for known instants; with
these, the instants move to where :math:`\big(f(c_k) / \rho \sigma_f\big)^2 + \sum_c \big((x^+_c -
R_c(x^-)) / \sigma_c\big)^2` is least, and so on in turns. It begins where components of the state
that may go on do so, and every choice of these is tried.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_search.conditions import Exits
from swsysid._automaton_search.crossed import Crossed, GuardTerms
from swsysid._automaton_search.found import FoundGuard, FoundReset, FoundTransition
from swsysid._automaton_search.guards import Solved, best_guard, blurred_by
from swsysid._automaton_search.margins import Sides, guard_with_margin
from swsysid._automaton_search.resets import best_reset
from swsysid._automaton_search.settings import SETTINGS
from swsysid._automaton_search.switches import Switches, Visits
from swsysid._journal import step
from swsysid._results import Array
from swsysid._stays.laws import Laws
from swsysid._ties import least_of

# Turns; times between two samples; parts of these once an instant is known nearly, and where
# nothing but the guard tells it; intervals by which a guard is missed anyway.
_TURNS_OF_INSTANTS, _GRID = 30, 33
_CLOSER, _NEARBY = (0.1, 0.01), 0.5
_MISSED = 0.01


@dataclass(frozen=True)
class GuardContext:
    """What transitions are found from, beside their switches."""

    visits: Visits
    laws: Laws
    noise: Array  # (n_states,)
    interval: float
    terms: GuardTerms
    n_positions: int = 0  # of the states, the first: a speed jumps, and they go on
    # a memory: a clock that begins elsewhere leaves guards without it what they are
    solved: Solved = field(default_factory=dict)

    def crossed(self, switches: Switches) -> Crossed:
        """What the guard of switches is known by, these at their present instants.

        It is below zero at the samples of their mode, and above it where steps end.
        """
        (columns, rates), visits = switches.before(self.laws), self.visits
        own = visits.modes == switches.source[0]
        ends, ended = columns + 0.5 * self.interval * rates, switches.in_steps
        # where steps alone tell it, what is held from one to the next says the same
        shares = visits.shares[own] if ended.all() else np.ones(own.sum())
        return Crossed(
            self.terms.seen(columns),
            rates,
            switches.errors,
            switches.ramps(self.interval),
            self.terms.seen(np.vstack([visits.columns[own], ends[ended]])),
            np.vstack([visits.rates[own], rates[ended]]),
            np.repeat([-1.0, 1.0], [own.sum(), ended.sum()]),
            np.append(shares, np.ones(ended.sum())),
            np.append(visits.stays[own], visits.stays.max(initial=0) + 1 + np.flatnonzero(ended)),
            self.interval,
        )

    def guard(self, switches: Switches, some: NDArray[np.intp] | None = None) -> FoundGuard | None:
        """The guard of switches at their present instants, of some columns or of any."""
        return best_guard(self.crossed(switches), self.terms.degree, some, self.solved)

    def asked(self, switches: Switches) -> FoundGuard | None:
        """The guard of switches where it is asked at samples, they lie on these and go on there.

        It has risen by one sample of the stay, and not by the one before.
        """
        source, interval = switches.source[0], self.interval
        own = self.visits.asked(interval) & (self.visits.modes == source)
        before = replace(switches, times=switches.times - interval)
        last, reached = (self.terms.seen(one.before(self.laws)[0]) for one in (before, switches))
        sides = Sides(self.terms.seen(self.visits.columns[own]), reached, last, reached)
        found = guard_with_margin(sides, self.terms.degree)
        return None if found is None else found.in_time(interval)

    def exits(self, source: int, found: Sequence[Settled]) -> Exits:
        """The stays in a mode, without samples that may be before or after them.

        And the states at which they are left.
        """
        visits, inside = self.visits, self.visits.modes == source
        blurred = np.zeros((2, visits.stays.max(initial=0) + 2))  # where stays end and begin
        for one in found:
            blurred[:, one.switches.stay] = self._later(one)
        ends, begins = blurred[0, visits.stays], blurred[1, visits.stays - 1]
        inside &= (visits.left > ends) & ~(visits.columns[:, -2] < begins)
        ways = [one for one in found if one.pair[0] == source]
        left = np.concatenate([one.switches.stay for one in ways])
        targets = np.concatenate([one.switches.target for one in ways])
        reached = np.vstack([self.reached(one) for one in ways])
        rows = self.terms.seen(visits.columns)
        return Exits.of(rows[inside], visits.stays[inside], left, reached, targets)

    def reached(self, way: Settled) -> Array:
        """Columns at which its guard has surely risen; at samples where it is asked there."""
        after = 0.0 if way.asked_at_samples else self._later(way)
        later = replace(way.switches, times=way.switches.times + after)
        return self.terms.seen(later.before(self.laws)[0])

    def _later(self, way: Settled) -> Array | float:
        """Times after its instants at which these have surely been, no less than half a sample."""
        half = 0.5 * self.interval
        sure = SETTINGS.far_miss * way.switches.errors
        return half if way.asked_at_samples else np.maximum(half, sure)

    @property
    def errors(self) -> Array:
        """What a state at the end of a stay is off by, about."""
        return SETTINGS.end_of_stay * self.noise


@dataclass(frozen=True)
class Settled:
    """The switches of one transition at their best instants, with its guard and reset."""

    switches: Switches
    guard: FoundGuard | None
    reset: FoundReset | None
    cost: float = 0.0
    asked_at_samples: bool = False  # so that the instant is known to an interval

    @property
    def pair(self) -> tuple[int, int]:
        """Source and target."""
        return int(self.switches.source[0]), int(self.switches.target[0])

    def take(self, rows: NDArray[np.bool_], guard: FoundGuard) -> Settled:
        """Some of its switches, with a guard of their own."""
        reset = None if self.reset is None else self.reset.take(rows)
        return replace(self, switches=self.switches.take(rows), guard=guard, reset=reset)

    @property
    def transition(self) -> FoundTransition:
        """The transition."""
        own = self.switches
        return FoundTransition(
            *self.pair, own.recording, own.times, self.guard, self.reset,
            asked_at_samples=self.asked_at_samples,
        )  # fmt: skip


@step
def settled(switches: Switches, context: GuardContext) -> Settled:
    """What the transition of some switches is, and when they happened."""
    if not switches.jumped.any():
        return Settled(switches, context.guard(switches), None)
    flows = _Flows.of(switches, context.laws)
    sets = _may_go_on(flows, context)
    context = replace(context, noise=flows.blurred(max(sets, key=len), context))
    tried = [_settled(flows, held, context) for held in sets]
    return least_of(tried, lambda one: one.cost)


@dataclass(frozen=True)
class _Flows:
    """Both flows at times between the samples around each switch."""

    switches: Switches
    times: Array  # (n_times, n_switches)
    columns: Array  # (n_times, n_switches, n_columns)
    after: Array  # (n_times, n_switches, n_states)

    @classmethod
    def of(cls, switches: Switches, laws: Laws, part: float = 1.0) -> _Flows:
        """The flows of some switches, in a part of the possible time around their instants."""
        possible = np.ptp(switches.known, axis=1)
        first = np.clip(
            switches.times - 0.5 * part * possible,
            switches.known[:, 0],
            switches.known[:, 1] - part * possible,
        )
        times = first + np.linspace(0.0, part, _GRID)[:, None] * possible
        every = switches.take(np.tile(np.arange(len(switches)), len(times))).moved(times.ravel())
        columns, after = every.before(laws)[0], every.after(laws)
        return cls(
            switches, times, columns.reshape(*times.shape, -1), after.reshape(*times.shape, -1)
        )

    @property
    def gaps(self) -> Array:
        """By what the states do not meet, (n_times, n_switches, n_states)."""
        return np.asarray(self.after - self.columns[:, :, : self.after.shape[2]])

    def blurred(self, held: NDArray[np.intp], context: GuardContext) -> Array:
        """Noise of the states where the instants are as uncertain as components that go on."""
        steps = np.diff(self.times, axis=0)[:, :, None]
        if not len(held) or not (steps > 0.0).all():
            return context.noise
        n_states = self.after.shape[2]
        before, after, gaps = (
            np.median(np.abs(np.diff(one, axis=0) / steps), axis=(0, 1))
            for one in (self.columns[:, :, :n_states], self.after, self.gaps)
        )
        uncertain = (context.noise[held] / np.maximum(gaps[held], np.finfo(float).tiny)).min()
        return np.asarray(np.maximum(context.noise, (before + after) * uncertain))

    def where(self, held: NDArray[np.intp], context: GuardContext) -> Switches:
        """The switches where some components meet; as they are for none."""
        gaps = self.gaps[:, :, held] / context.errors[held]
        return self.lowest(np.square(gaps).sum(axis=2)) if len(held) else self.switches

    def agreeing(self, found: Settled, held: NDArray[np.intp], context: GuardContext) -> Switches:
        """The switches where guard and reset are missed least."""
        guard, reset = found.guard, found.reset
        assert reset is not None, "only jumps have instants to be found"
        n_states = self.after.shape[2]
        landed = self.columns[:, :, :n_states] @ reset.reset.matrix.T + reset.reset.offset
        sizes = np.maximum(reset.sizes, context.errors)
        sizes[held] = context.errors[held]
        cost = np.square((self.after - landed) / sizes).sum(axis=2)
        if guard is not None:
            size = max(guard.usual_miss, SETTINGS.instant * context.interval)
            flat = self.columns.reshape(-1, self.columns.shape[2])
            value = guard.guard.values(flat).reshape(cost.shape)
            risen, lasted = (np.gradient(one, axis=0) for one in (value, self.times))
            # instants of events are known, and times around them all but the same
            rate = np.divide(risen, lasted, out=np.zeros_like(risen), where=lasted > 0.0)
            missed = value / np.where(rate == 0.0, np.inf, rate) / size
            cost = cost + np.nan_to_num(np.square(missed))
        return self.lowest(cost)

    def lowest(self, cost: Array) -> Switches:
        """The switches at times of the least cost, between those of the grid by a parabola."""
        every = np.arange(self.times.shape[1])
        lowest = cost.argmin(axis=0)
        best = np.clip(lowest, 1, len(self.times) - 2)
        before, middle, after = (cost[best + k, every] for k in (-1, 0, 1))
        bend = before - 2.0 * middle + after
        vertex = 0.5 * (before - after) / np.where(bend > 0.0, bend, np.inf)
        shift = np.where(lowest == best, np.clip(vertex, -1.0, 1.0), lowest - best)
        return self.switches.moved(
            self.times[best, every] + shift * np.diff(self.times[:2], axis=0)[0]
        )


def _may_go_on(flows: _Flows, context: GuardContext) -> list[NDArray[np.intp]]:
    """Sets of components that go on in most switches at some instant: all, each one, none."""
    gaps = flows.gaps
    nearest = np.abs(gaps).min(axis=0)
    steps = np.abs(np.diff(gaps, axis=0)).max(axis=0)
    share = (nearest <= steps + SETTINGS.beyond_noise * context.errors).mean(axis=0)
    some = np.flatnonzero(share > 0.5)
    sets = {(), tuple(some.tolist()), *combinations(some.tolist(), 1)}
    positions = set(range(context.n_positions)) & set(some.tolist())
    sets = {one for one in sets if positions <= set(one)}
    return [np.array(one, dtype=np.intp) for one in sorted(sets)]


def _settled(flows: _Flows, held: NDArray[np.intp], context: GuardContext) -> Settled:
    """Instants, guard and reset in turns, some components of the state held to go on."""
    n_states, laws = len(context.noise), context.laws
    switches = flows.where(held, context)
    for part in _CLOSER:
        flows = _Flows.of(switches, laws, part)
        switches = flows.where(held, context)
    found = Settled(switches, None, None, np.inf)
    some: NDArray[np.intp] | None = None  # columns of the guard; all are asked at first and last
    for _ in range(_TURNS_OF_INSTANTS):
        columns, _ = switches.before(laws)
        reset = best_reset(columns[:, :n_states], switches.after(laws), context.errors, held)
        guard = context.guard(switches, some)
        cost = reset.cost + (0.0 if guard is None else _cost_of(guard, switches, context))
        trial = Settled(switches, guard, reset, cost)
        if cost < found.cost:
            found = trial
        if not len(held):
            flows = _Flows.of(switches, laws, _NEARBY)
        moved = flows.agreeing(trial, held, context)
        at_rest = np.abs(moved.times - switches.times).max() < SETTINGS.instant * context.interval
        if at_rest and some is None:
            break
        some = None if at_rest or guard is None else guard.some
        switches = moved
    return found


def _cost_of(guard: FoundGuard, switches: Switches, context: GuardContext) -> float:
    """The logarithm of what the instants miss the guard by, no less than by errors of states."""
    blurred = np.nanmedian(blurred_by(guard.guard, *switches.before(context.laws), context.errors))
    missed = max(guard.usual_miss, float(blurred), _MISSED * context.interval)
    return float(np.isfinite(guard.misses).sum() * np.log(missed / context.interval))
