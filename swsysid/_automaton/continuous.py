"""Rollouts of an automaton in continuous time: flow in a mode, take a transition, jump."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._automaton.parts import AutomatonParts
from swsysid._automaton.transitions import Transition
from swsysid._automaton.watch import GuardWatch
from swsysid._results import Array, Trajectory
from swsysid._simulation.events import Flow, Piece
from swsysid._simulation.inputs import Options, Signal, Stretch
from swsysid._simulation.system import GuardedLaws


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
    """State of one rollout: beside the state and the mode, the guards that lead out of it."""

    def __init__(self, automaton: AutomatonParts, mode: int, x0: Array, t: Array, options: Options):
        scales = options.scales(automaton.extent, x0)
        super().__init__(GuardedLaws(automaton, scales), x0, t, options)
        self.mode = mode
        self.watch = GuardWatch(automaton.transitions, mode, x0, self.time)

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
            taken = self.watch.first(piece, len(self.x))
            if taken is not None:
                self.advance(piece, taken[0])
                self._take(taken[1], signal)
                self._settle(signal)
                return
            self.advance(piece, piece.stop)

    def advance(self, piece: Piece, until: float) -> None:
        before = self.x
        super().advance(piece, until)
        self.watch.passed(before, self.x)

    def _settle(self, signal: Signal) -> None:
        """Take the transitions that are due at the present time, one after the other."""
        while (due := self.watch.due(self.x, self.time, signal)) is not None:
            self._take(due, signal)

    def _take(self, taken: Transition, signal: Signal) -> None:
        """Switch, and let the state jump."""
        before = self._velocity(signal)
        self.record_event(taken.target, taken.kind)
        self.mode = taken.target
        self.land(taken.landing(self.x))
        self._watch(signal, before)

    def _watch(self, signal: Signal, before: Array) -> None:
        velocities = before, self._velocity(signal)
        self.watch.enter(self.mode, self.time, self.x, signal, velocities)

    def _velocity(self, signal: Signal) -> Array:
        return self.system.velocity(self.x, signal(self.time), self.mode)
