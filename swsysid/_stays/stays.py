"""Stays: between two switches a recording is in one mode."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array


@dataclass(frozen=True)
class Stays:
    """The modes through which one recording goes, and when it leaves them."""

    modes: NDArray[np.intp]  # (n_stays,), neighbours different
    instants: Array  # (n_stays - 1,): when each stay but the last one ends, increasing

    @property
    def transitions(self) -> NDArray[np.intp]:
        """Number of the transition at each instant, -1 where it has none."""
        return np.full(len(self.instants), -1)

    @property
    def told_by(self) -> NDArray[np.intp]:
        """Number of the transition whose guard tells each instant, -1 for none."""
        return np.full(len(self.instants), -1)

    @property
    def bounds(self) -> Array:
        """Times between which each instant must stay, (n_stays - 1, 2)."""
        return np.tile([-np.inf, np.inf], (len(self.instants), 1))

    def names(self, t: Array) -> NDArray[np.intp]:
        """What tells a stay from its neighbours, at any times: its mode."""
        return self.at(t)

    @classmethod
    def of_intervals(cls, modes: NDArray[np.intp], t: Array) -> Stays:
        """Stays from the mode at the end of every interval between two samples."""
        first = np.flatnonzero(np.diff(modes)) + 1
        middles = 0.5 * (t[first] + t[first + 1])
        return cls(modes[np.concatenate([[0], first])], middles)

    def at(self, t: Array) -> NDArray[np.intp]:
        """Mode at any times; at an instant the old one."""
        return self.modes[np.searchsorted(self.instants, t)]

    def between(self, t: Array) -> NDArray[np.intp]:
        """Mode in the middle between every two times."""
        return self.at(0.5 * (t[1:] + t[:-1]))

    def only(self, modes: NDArray[np.intp]) -> Stays:
        """Without stays in other modes than some, which are called 0, 1, ... from now on."""
        kept = np.isin(self.modes, modes)
        names = np.searchsorted(modes, self.modes[kept])
        begins = np.append(-np.inf, self.instants)[kept]
        new = np.append(True, np.diff(names) != 0)
        if not kept.any():
            return Stays(np.zeros(1, dtype=np.intp), np.zeros(0))
        return Stays(names[new], begins[new][1:])

    def told(self, stay: int, mode: int) -> Stays:
        """The same with one of the stays in another mode; in that of a neighbour they are one."""
        modes = self.modes.copy()
        modes[stay] = mode
        new = np.append(True, np.diff(modes) != 0)
        return Stays(modes[new], self.instants[new[1:]])

    def inside(self, t: Array) -> Stays:
        """Those from the first to the last of some times."""
        first, last = np.searchsorted(self.instants, t[[0, -1]])
        return Stays(self.modes[first : last + 1], self.instants[first:last])

    def within(self, t: Array) -> Stays:
        """The same stays, at most one switch between two of the times."""
        return self.moved(self.instants, t)

    def moved(self, instants: Array, t: Array) -> Stays:
        """The same stays with other instants, at most one between two samples.

        A stay that no longer reaches from one sample to the next is gone.
        """
        inside = np.clip(instants, t[0], np.nextafter(t[-1], t[0]))
        if (np.diff(np.searchsorted(t, inside, side="right")) > 0).all():
            return replace(self, instants=inside)
        order = np.argsort(inside, kind="stable")
        cells = np.searchsorted(t, inside[order], side="right") - 1
        last = np.diff(np.append(cells, len(t))) > 0  # of the switches of one cell the last one
        entered = self.modes[1:][order][last]
        modes, kept = [int(self.modes[0])], []
        for mode, instant in zip(entered, inside[order][last], strict=True):
            if mode != modes[-1]:
                modes.append(int(mode))
                kept.append(instant)
        return Stays(np.array(modes, dtype=np.intp), np.array(kept))
