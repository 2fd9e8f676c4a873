"""The guards of the mode that a rollout is in: which of them is due, or will be first."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swsysid._automaton.crossings import GuardColumns, Watched, first_rise
from swsysid._automaton.settings import SETTINGS
from swsysid._automaton.transitions import Transition
from swsysid._results import Array
from swsysid._simulation.events import Piece
from swsysid._simulation.inputs import Signal


class GuardWatch:
    """The transitions out of the present mode, since it was entered."""

    def __init__(self, transitions: Sequence[Transition], mode: int, x0: Array, time: float):
        self.transitions, self.mode, self.entered = tuple(transitions), mode, time
        self.sizes = np.abs(x0)  # of the states in the last step
        self.watched: list[Watched] = []

    def enter(
        self, mode: int, time: float, x: Array, signal: Signal, velocities: tuple[Array, Array]
    ) -> None:
        """Look at the guards of a mode that is entered; velocities are those before and after.

        A guard that is zero within rounding is armed if it rises along the law of the mode.
        """
        self.mode, self.entered = mode, time
        columns, (before, after) = self._columns(x, time, signal), velocities
        # over a unit of time: inputs are linear
        inputs = signal(time + 1.0) - signal(time)
        rates = np.concatenate([after, inputs, (1.0, 1.0)])
        speeds = np.maximum(np.abs(before), np.abs(after))
        errors = self._errors(columns, x, time, speeds)
        unit = SETTINGS.roundings * np.finfo(float).eps
        self.watched = []
        for transition in self.transitions:
            if transition.source != mode:
                continue
            guard, slopes = transition.guard, transition.guard.gradient(columns)
            value, changes = guard.at(columns), slopes * rates
            band = float(np.abs(slopes) @ errors + unit * np.abs(guard.terms(columns)).sum())
            rises = value <= band and changes.sum() > unit * np.abs(changes).sum()
            self.watched.append(Watched(transition, bool(value < -band or rises), band))

    def due(self, x: Array, time: float, signal: Signal) -> Transition | None:
        """The first transition that is taken at a state."""
        columns = self._columns(x, time, signal)
        for one in self.watched:
            # inputs that are held jump to a value: there is no rise that would pass by zero
            if one.fires(one.transition.guard.at(columns), slack=one.band):
                return one.transition
        return None

    def first(self, piece: Piece, n_states: int) -> tuple[float, Transition] | None:
        """The first transition along a step of the integrator, and when it is taken."""
        columns = GuardColumns(piece, self.entered)
        rises = [first_rise(one, columns, n_states) for one in self.watched]
        times = [time for time in rises if time is not None]
        if not times:
            return None
        return min(times), self.watched[rises.index(min(times))].transition

    def passed(self, before: Array, after: Array) -> None:
        """Take note of the states at both ends of a step."""
        self.sizes = np.maximum(np.abs(before), np.abs(after))

    def _errors(self, columns: Array, x: Array, time: float, speeds: Array) -> Array:
        """Rounding of the columns of guards at an instant that was located to the last digit."""
        unit, instant = SETTINGS.roundings * np.finfo(float).eps, 4.0 * np.spacing(abs(time))
        errors = unit * np.abs(columns)
        errors[: len(x)] = unit * np.maximum(self.sizes, np.abs(x)) + instant * speeds
        errors[-2:] = instant
        return errors

    def _columns(self, x: Array, time: float, signal: Signal) -> Array:
        return np.concatenate([x, signal(time), (time - self.entered, time)])
