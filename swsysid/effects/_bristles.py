"""Friction with a hidden state: the bristles of a contact bend before it slides.

Their state w is computed from the measured velocity, as a share of the force of sliding: it is near
-1 or 1 where the contact slides, and follows the position, as a spring does, after the motion has
turned round. Between two samples it is linear, and a path that turns is two pieces.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import N_LEVELS, Parameter, Place, figure, quantile_levels
from swsysid.effects._friction import OfAVelocity
from swsysid.effects._memory import followed_from

_FORGOTTEN = 40.0  # presliding distances after which a contact has forgotten its past
_END = 9.0  # of atanh(w): there a contact slides, but for the eighth digit of w
_N_PLACES = 1801  # of a table up to there


class _Presliding(OfAVelocity):
    terms: ClassVar[tuple[str, ...]] = ("friction",)
    needs = frozenset({"order"})
    name: ClassVar[str]  # of the model, in an equation

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        """Distances from what the contact moves in a few samples to what it moves at a time."""
        return (Parameter("distance", self._distances(records, place), "{channel} {time}"),)

    def state(self, theta: Sequence[float], t: Array, velocity: Array) -> Array:
        """Hidden state along one trajectory."""
        raise NotImplementedError

    def _distances(self, records: Records, place: Place) -> Array:
        """From a fraction of a step of the position to what it moves between two turns."""
        assert records.t is not None
        velocity, t = self.values(records, place), records.t
        ways = [
            np.abs(_moves(t[rows], velocity[rows])).sum(axis=1) for rows in records.trajectories
        ]
        moves = np.concatenate(ways)
        usual = float(np.median(moves[moves > 0.0])) if (moves > 0.0).any() else 1.0
        return np.geomspace(0.02 * usual, 64.0 * usual, N_LEVELS)

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        velocity = self.values(records, place)
        return -records.along(partial(self.state, theta), velocity)[:, None]

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        """Such as ``-dahl(v, 0.02)``."""
        arguments = ", ".join([label, *map(figure, theta)])
        return (f"-{self.name}({arguments})",)

    def physical(self, theta: Mapping[str, float], coef: Mapping[str, float]) -> dict[str, float]:
        """With the stiffness of the bristles."""
        return {**theta, **coef, "stiffness": coef["friction"] / theta["distance"]}

    def shortened(self, records: Records, place: Place, *theta: float) -> Records:
        # a contact forgets with the distance that it slides
        assert records.t is not None
        moved = np.abs(_moves(records.t, self.values(records, place))).sum(axis=1)
        left = np.cumsum(moved[::-1])[::-1]
        first = int(np.sum(left > _FORGOTTEN * theta[0]))
        return records.take(np.arange(first, len(records)))


class DahlFriction(_Presliding):
    """``-friction * w`` with ``distance * w' = v - |v| w``: dry friction of elastic bristles.

    Parameters
    ----------
    velocities : list of str or int, default=None
        Channels that are velocities, as `CoulombFriction` has them.
    positions : list of str or int, default=None
        Channels that are positions, as `CoulombFriction` has them.
    in_motions : bool, default=True
        False for the laws of forces alone: a force that is measured shows the hysteresis of the
        bristles, a motion hardly tells it from that of dry friction.
    """

    kind = "dahl_friction"
    name = "dahl"
    meaning = "dry friction opposes {channel} and builds up over a distance (Dahl): hysteresis"

    def __init__(
        self,
        velocities: Sequence[int | str] | None = None,
        positions: Sequence[int | str] | None = None,
        in_motions: bool = True,
    ):
        super().__init__(velocities, positions)
        self.in_motions = in_motions

    def places(self, records: Records) -> Sequence[Place]:
        return super().places(records) if self.in_motions or records.static else []

    def state(self, theta: Sequence[float], t: Array, velocity: Array) -> Array:
        moves = _moves(t, velocity)
        return _relaxed(moves, np.sign(moves), theta[0], float(np.sign(velocity[0])))


class LuGreFriction(_Presliding):
    """``-(friction * w + micro_damping * z')``, w as in Dahl's model with a Stribeck effect.

    The bristles bend by ``z = distance * w``, with ``z' = v - |v| w / g(v)`` and
    ``g(v) = 1 + excess * exp(-(v / velocity)**2)``.
    """

    kind = "lugre_friction"
    name = "lugre"
    meaning = "dry friction opposes {channel}, builds up over a distance and is larger at low speed"
    terms = ("friction", "micro_damping")

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        speeds = np.abs(self.values(records, place))
        slow = quantile_levels(speeds[speeds > 0.0], 0.1, 0.6, 5) if speeds.any() else np.empty(0)
        return (
            Parameter("distance", self._distances(records, place)[::3], "{channel} {time}"),
            Parameter("velocity", slow, "{channel}"),
            Parameter("excess", np.array([0.1, 0.3, 0.6, 1.0, 1.5, 2.0])),
        )

    def plausible(self, coef: Array) -> bool:
        """It opposes the motion; the damping of the bristles is small and may seem negative."""
        return super().plausible(coef[:1])

    def state(self, theta: Sequence[float], t: Array, velocity: Array) -> Array:
        moves = _moves(t, velocity)
        # each piece has the mean velocity of its ends, one of which is zero where the path turns
        middle = 0.5 * (velocity[1:] + velocity[:-1])[:, None]
        ends = 0.5 * np.column_stack([velocity[:-1], velocity[1:]])
        turned = moves[:, 1:] != 0.0
        held = self._held(theta, np.where(turned, ends, middle))
        start = np.sign(velocity[0]) * self._held(theta, velocity[0])
        return _relaxed(moves, np.sign(moves) * held, theta[0] * held, float(start))

    def columns(self, records: Records, place: Place, *theta: float) -> Array:
        bent, velocity = super().columns(records, place, *theta)[:, 0], self.values(records, place)
        rate = velocity + np.abs(velocity) * bent / self._held(theta, velocity)
        return np.column_stack([bent, -rate])

    def column_names(self, label: str, *theta: float) -> tuple[str, ...]:
        bent = super().column_names(label, *theta)[0]
        return (bent, bent.replace(self.name, f"{self.name}_rate", 1))

    def _held(self, theta: Sequence[float], velocity: Array) -> Array:
        """Force of sliding at a velocity, as a share of that at a large one."""
        return 1.0 + theta[2] * np.exp(-((velocity / theta[1]) ** 2))


class BoucWen(_Presliding):
    """``-friction * w``, ``distance * w' = v - |w|**exponent (shape |v| sign(w) + (1 - shape) v)``.

    With exponent 1 and shape 1 it is Dahl's model; a larger exponent turns from spring to sliding
    more sharply, and with shape 1/2 the contact unloads as a linear spring.
    """

    kind = "bouc_wen"
    name = "bouc_wen"
    meaning = "a force with hysteresis in the motion opposes {channel} (Bouc-Wen)"

    def parameters(self, records: Records, place: Place) -> tuple[Parameter, ...]:
        return (
            Parameter("distance", self._distances(records, place)[::2], "{channel} {time}"),
            Parameter("exponent", np.array([1.0, 1.5, 2.0, 3.0])),
            Parameter("shape", np.array([0.5, 0.75, 1.0])),
        )

    def state(self, theta: Sequence[float], t: Array, velocity: Array) -> Array:
        distance, exponent, shape = theta
        ways = _ways_up(exponent, shape).tolist()
        here = float(np.sign(velocity[0])) * _END
        places = [here]
        for pair in (_moves(t, velocity) / distance).tolist():
            for move in pair:
                if move > 0.0:
                    here = _moved_up(ways, here, move)
                elif move < 0.0:  # downwards the model is its own mirror image
                    here = -_moved_up(ways, -here, -move)
            places.append(here)
        return np.tanh(places)


# Bouc and Wen's state is w = tanh(s): then w = 1, where the contact slides, lies far away, and the
# way that a contact moves upwards until it is at s is one smooth table for each pair of parameters.


def _ways_up(exponent: float, shape: float) -> Array:
    """Presliding distances from -1 upwards to each of the places."""
    places = np.linspace(-_END, _END, _N_PLACES)
    state = np.tanh(places)
    rate = 1.0 - np.abs(state) ** exponent * (shape * np.sign(state) + 1.0 - shape)
    slowness = (1.0 - state**2) / rate
    between = 0.5 * (slowness[1:] + slowness[:-1]) * np.diff(places)
    return np.concatenate([[0.0], np.cumsum(between)])


def _moved_up(ways: list[float], here: float, move: float) -> float:
    """Place after a move upwards."""
    last = len(ways) - 1
    number = (here + _END) * last / (2.0 * _END)
    below = min(int(number), last - 1)
    way = ways[below] + (number - below) * (ways[below + 1] - ways[below]) + move
    if way >= ways[-1]:
        return _END
    below = bisect_right(ways, way) - 1
    number = below + (way - ways[below]) / (ways[below + 1] - ways[below])
    return number * 2.0 * _END / last - _END


def _moves(t: Array, velocity: Array) -> Array:
    """Ways along one trajectory between neighbouring samples, in two pieces where they turn."""
    steps, before, after = np.diff(t), velocity[:-1], velocity[1:]
    turned = before * after < 0.0
    whole = 0.5 * steps * (before + after)
    until = np.where(turned, before / np.where(turned, before - after, 1.0), 0.0)
    first = np.where(turned, 0.5 * steps * until * before, whole)
    return np.column_stack([first, np.where(turned, whole - first, 0.0)])


def _relaxed(moves: Array, goals: Array, distance: float | Array, start: float) -> Array:
    """State that tends to the goal of each piece with the distance, at the samples."""
    kept = np.exp(-np.abs(moves) / distance)
    states = followed_from(start, kept.ravel(), ((1.0 - kept) * goals).ravel())
    return states[::2]
