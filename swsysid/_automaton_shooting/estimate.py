"""What is estimated, and what follows from it: states, landings, misses of guards."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton_shooting.courses import Grid, Legs
from swsysid._automaton_shooting.parameters import GuardUnknowns, ResetUnknowns
from swsysid._automaton_shooting.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.laws import Laws
from swsysid._stays.settings import LIMITS


@dataclass(frozen=True)
class Flown:
    """All legs rolled out."""

    grid: Grid
    states: Array  # (n_times, n_legs, n_states)
    # (n_times, n_legs, n_states, n_states + n_free + 1): by the state at the beginning of the leg,
    # the laws, and the time at which it begins
    varied: Array | None


@dataclass(frozen=True)
class JointEstimate:
    """Laws, guards, resets, the states at the starts of all legs, and the instants of switches."""

    laws: Laws
    guards: GuardUnknowns
    resets: ResetUnknowns
    legs: Legs
    starts: Array  # (n_legs, n_states)
    instants: Array  # (n_switches,)
    interval: float  # between two samples
    substeps: int  # of the integration, between two samples

    @property
    def n_shared(self) -> int:
        """Number of unknowns of the automaton: of its laws, its guards and its resets."""
        return self.laws.n_free + self.guards.n_free + self.resets.n_free

    @property
    def n_unknowns(self) -> int:
        """Number of all unknowns."""
        return self.n_shared + self.starts.size + len(self.instants)

    @property
    def freedom(self) -> float:
        """Part of the measured values that the unknowns of the rollouts do not take up."""
        starts = len(self.legs.courses) * self.starts.shape[1]
        taken = self.n_shared + starts + int((~self.legs.guarded).sum())
        n_values = sum(int(np.isfinite(one.record.y).sum()) for one in self.legs.courses)
        return max(SETTINGS.least_freedom, 1.0 - taken / max(1, n_values))

    @property
    def left(self) -> Array:
        """Standard deviations of what the rollouts leave of the measurements, (n_states,)."""
        done = self.plainly_flown
        squares = np.square(done.grid.y - done.states)
        return np.asarray(np.sqrt(np.nanmean(squares, axis=(0, 1)) / self.freedom))

    @property
    def hold(self) -> Array:
        """What holds instants where they are: half a nat for an interval."""
        hold = np.zeros(self.n_unknowns)
        hold[self.n_unknowns - len(self.instants) :] = self.interval**-2.0
        return hold

    def known(self) -> JointEstimate:
        """The same automaton with nothing of it free."""
        guards = replace(self.guards, free=tuple(np.zeros_like(own) for own in self.guards.free))
        resets = replace(self.resets, free=np.zeros_like(self.resets.free))
        return replace(self, laws=self.laws.known(), guards=guards, resets=resets)

    def with_courses_of(self, other: JointEstimate) -> JointEstimate:
        """The same unknowns of the automaton, with starts and instants of another estimate."""
        return replace(self, starts=other.starts, instants=other.instants)

    def moved(self, step: Array) -> JointEstimate:
        """Another estimate: laws, guards, resets, starts, instants, in this order."""
        sizes = self.laws.n_free, self.guards.n_free, self.resets.n_free, self.starts.size
        of_laws, of_guards, of_resets, of_starts, of_instants = np.split(step, np.cumsum(sizes))
        coef = self.laws.coef.copy()
        coef[self.laws.places] += of_laws
        farthest = LIMITS.farthest_move * self.interval
        return replace(
            self,
            laws=replace(self.laws, coef=coef),
            guards=self.guards.moved(of_guards),
            resets=self.resets.moved(of_resets),
            starts=self.starts + of_starts.reshape(self.starts.shape),
            instants=np.clip(
                self.instants + np.clip(of_instants, -farthest, farthest), *self.legs.between.T
            ),
        )

    @cached_property
    def is_in_order(self) -> bool:
        """True if every leg ends after it begins."""
        begin, end = self.legs.times(self.instants)
        return bool((begin < end).all())

    @cached_property
    def plainly_flown(self) -> Flown:
        """The legs rolled out, without sensitivities."""
        return self.flown(varied=False)

    def flown(self, *, varied: bool = True) -> Flown:
        """The legs rolled out from their starts."""
        laws, legs = self.laws, self.legs
        grid = Grid.of(legs, self.instants)
        x, n_states = self.starts, self.starts.shape[1]
        Z = np.zeros((len(legs), n_states, n_states + laws.n_free))
        Z[:, np.arange(n_states), np.arange(n_states)] = 1.0
        bound = LIMITS.diverged * laws.spread
        step = laws.varied_step if varied else laws.plain_step
        states, sensitivities = [x], [Z]
        for k, durations in enumerate(np.diff(grid.times, axis=0) / self.substeps):
            u, change = grid.u[k], (grid.u[k + 1] - grid.u[k]) / self.substeps
            on = np.flatnonzero(durations > 0.0)
            x, Z = x.copy(), Z.copy() if varied else Z
            for part in range(self.substeps):
                before = (u + part * change)[on]
                own = Z[on] if varied else Z
                moved, own = step(
                    legs.modes[on], x[on], own, before, before + change[on], durations[on]
                )
                x[on] = np.clip(np.nan_to_num(moved, nan=np.inf), -bound, bound)
                if varied:
                    Z[on] = own
            states.append(x)
            sensitivities.append(Z)
        if not varied:
            return Flown(grid, np.array(states), None)
        by_known = np.array(sensitivities)
        first = laws.velocities(legs.modes, self.starts, grid.u[0])
        by_begin = -np.einsum("tkxs,ks->tkx", by_known[..., :n_states], first)
        every = np.concatenate([by_known, by_begin[..., None]], axis=3)
        every[0, :, :, -1] = 0.0
        return Flown(grid, np.array(states), every)

    def columns(self, times: Array, x: Array, u: Array, legs: NDArray[np.intp]) -> Array:
        """Columns of guards at some times of legs: dwell is NaN where it is not known."""
        entered_by = self.legs.entered_by[legs]
        known = np.append(self.instants, np.nan)[entered_by]
        entered = np.where(entered_by >= 0, known, np.nan)
        return np.column_stack([x, u, times - entered, times])

    @cached_property
    def ending(self) -> NDArray[np.intp]:
        """The leg at whose end each switch happens."""
        legs = np.flatnonzero(self.legs.ended_by >= 0)
        return legs[np.argsort(self.legs.ended_by[legs])]

    def crossed(self, done: Flown) -> tuple[Array, Array]:
        """Columns of guards at the switches and their rates, (n_switches, n_columns)."""
        legs, grid = self.ending, done.grid
        x, u, times = done.states[-1, legs], grid.u[-1, legs], grid.times[-1, legs]
        rates = np.hstack(
            [
                self.laws.velocities(self.legs.modes[legs], x, u),
                grid.rates[legs],
                np.ones((len(legs), 2)),
            ]
        )
        return self.columns(times, x, u, legs), rates

    def beyond(self, sources: NDArray[np.intp]) -> int:
        """Number of samples at which a guard that leads out of their mode has risen already.

        `sources` are the modes out of which the transitions lead.
        """
        done = self.plainly_flown
        at, legs = np.nonzero(np.isfinite(done.grid.y).any(axis=2))
        x, u = done.states[at, legs], done.grid.u[at, legs]
        columns = self.columns(done.grid.times[at, legs], x, u, legs)
        modes, count = self.legs.modes[legs], 0
        crossed, rates = self.crossed(done)
        for transition in range(len(sources)):
            taken = np.flatnonzero((self.legs.transitions == transition) & self.legs.guarded)
            own = np.flatnonzero(modes == sources[transition])
            if not taken.size or not own.size:
                continue
            which = np.full(len(taken), transition)
            _, slopes, _ = self.guards.values(which, crossed[taken])
            rise = np.abs(np.nanmedian(np.einsum("kc,kc->k", slopes, rates[taken])))
            values, _, _ = self.guards.values(np.full(len(own), transition), columns[own])
            count += int((values > SETTINGS.beyond * self.interval * rise).sum())
        return count
