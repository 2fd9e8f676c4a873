"""Rollouts of an automaton in continuous time: flow in a mode, take a transition, jump."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._automaton.crossings import GuardColumns, Watched, first_rise
from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.settings import SETTINGS
from swsysid._results import Array, Status, Trajectory
from swsysid._simulation.events import Piece
from swsysid._simulation.flow import Flow
from swsysid._simulation.inputs import Options, Signal, Stretch
from swsysid._simulation.system import GuardedLaws, SimulationEnded


def follow(
    automaton: AutomatonParts,
    mode: int,
    x0: Array,
    t: Array,
    pieces: Sequence[Stretch],
    options: Options,
) -> Trajectory:
    """Roll an automaton out from a mode and a state along inputs that are known piece by piece."""
    return _Rollout(automaton, mode, x0, t, options).run(pieces)


class _Rollout(Flow):
    """State of one rollout: beside the state and the mode, when that was entered."""

    def __init__(self, automaton: AutomatonParts, mode: int, x0: Array, t: Array, options: Options):
        super().__init__(GuardedLaws(automaton, options.state_bound), x0, t, options)
        self.transitions = automaton.transitions
        self.mode, self.entered = mode, self.time
        self.sizes = np.abs(x0)  # of the states in the last step
        self.watched: list[Watched] = []

    def enter(self, signal: Signal) -> None:
        if not self.done.modes:
            self.done.modes.append(self.mode)
            self._watch(signal, np.zeros_like(self.x))
        self._settle(signal)

    def go_on(self, end: float, signal: Signal) -> None:
        mode = self.mode

        def field(time, x):
            return self.system.velocity(x, signal(time), mode)

        for piece in self.steps(field, end, signal):
            columns = GuardColumns(piece, self.entered)
            rises = [first_rise(one, columns, len(self.x)) for one in self.watched]
            times = [time for time in rises if time is not None]
            if times:
                self.advance(piece, min(times))
                self._take(self.watched[rises.index(min(times))], signal)
                self._settle(signal)
                return
            self.advance(piece, piece.stop)

    def advance(self, piece: Piece, until: float) -> None:
        before = np.abs(self.x)
        super().advance(piece, until)
        self.sizes = np.maximum(before, np.abs(self.x))

    def _settle(self, signal: Signal) -> None:
        """Take the transitions that are due at the present time, one after the other."""
        while due := self._due(signal):
            self._take(due, signal)

    def _due(self, signal: Signal) -> Watched | None:
        columns = self._columns(signal)
        for one in self.watched:
            # inputs that are held jump to a value: there is no rise that would pass by zero
            if one.fires(one.transition.guard.at(columns), slack=one.band):
                return one
        return None

    def _take(self, taken: Watched, signal: Signal) -> None:
        """Switch, and let the state jump."""
        transition, before = taken.transition, self._velocity(signal)
        kind = "transition" if transition.reset is None else "jump"
        self.record_event(transition.target, kind)
        if transition.reset is not None:
            self.x = transition.reset.applied(self.x)
            if not self.system.within(self.x):
                raise SimulationEnded(Status.STATE_LIMIT)
        self.mode, self.entered = transition.target, self.time
        if self.done.t[len(self.done.states) - 1] == self.time:
            self.done.states[-1], self.done.modes[-1] = self.x, self.mode
        self._watch(signal, before)

    def _watch(self, signal: Signal, before: Array) -> None:
        """Look at the guards of the mode just entered; `before` is the velocity until then.

        A guard that is zero within rounding is armed if it rises along the law of the mode.
        """
        columns, velocity = self._columns(signal), self._velocity(signal)
        # over a unit of time: inputs are linear
        inputs = signal(self.time + 1.0) - signal(self.time)
        rates = np.concatenate([velocity, inputs, (1.0, 1.0)])
        errors = self._errors(columns, np.maximum(np.abs(before), np.abs(velocity)))
        unit = SETTINGS.roundings * np.finfo(float).eps
        self.watched = []
        for transition in self.transitions:
            if transition.source != self.mode:
                continue
            guard, slopes = transition.guard, transition.guard.gradient(columns)
            value, changes = guard.at(columns), slopes * rates
            band = float(np.abs(slopes) @ errors + unit * np.abs(guard.terms(columns)).sum())
            rises = value <= band and changes.sum() > unit * np.abs(changes).sum()
            self.watched.append(Watched(transition, bool(value < -band or rises), band))

    def _errors(self, columns: Array, speeds: Array) -> Array:
        """Rounding of the columns of guards at an instant that was located to the last digit."""
        unit, instant = SETTINGS.roundings * np.finfo(float).eps, 4.0 * np.spacing(abs(self.time))
        errors = unit * np.abs(columns)
        errors[: len(self.x)] = unit * np.maximum(self.sizes, np.abs(self.x)) + instant * speeds
        errors[-2:] = instant
        return errors

    def _columns(self, signal: Signal) -> Array:
        clocks = (self.time - self.entered, self.time)
        return np.concatenate([self.x, signal(self.time), clocks])

    def _velocity(self, signal: Signal) -> Array:
        return self.system.velocity(self.x, signal(self.time), self.mode)
