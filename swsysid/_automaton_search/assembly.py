"""An automaton from what was found of its stays and transitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.first_modes import FirstModes
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.transitions import Transition
from swsysid._automaton_search.found import FoundTransition, Told
from swsysid._automaton_search.settings import SETTINGS
from swsysid._data.features import FeatureMap
from swsysid._results import Array


@dataclass(frozen=True)
class TransitionVerdict:
    """How well a guard tells when a transition is taken.

    Attributes
    ----------
    source, target : int
    support : int
        Switches of the recordings.
    explained : float
        Part of them at which the guard is zero within two samples, of those that it is known at:
        a clock is not where a recording begins.
    miss : float
        Root mean square of the time by which it is not, in the unit of time.
    """

    source: int
    target: int
    support: int
    explained: float
    miss: float

    @property
    def is_told(self) -> bool:
        """True if the guard explains nearly all switches."""
        return self.explained >= SETTINGS.told_by_guard

    def advice(self) -> str:
        """One sentence on a transition that no guard explains."""
        return (
            f"The switches from mode {self.source} to mode {self.target} happen where nothing in "
            f"the recordings tells: the best guard explains {self.explained:.0%} of "
            f"{self.support} and is off by {self.miss:.3g} in time; record the signal that "
            "triggers them and give it as an input, or raise guard_degree."
        )


def order_of_modes(modes: Sequence[NDArray[np.intp]], n_modes: int) -> NDArray[np.intp]:
    """Modes from the most populated one to the least."""
    counts = np.bincount(np.concatenate(modes), minlength=n_modes)
    return np.argsort(-counts, kind="stable")


def automaton_of(
    coef: Array,
    feature_map: FeatureMap,
    found: Sequence[FoundTransition],
    first_modes: FirstModes,
    order: NDArray[np.intp],
    *,
    discrete_time: bool = False,
    lags: int = 0,
) -> HybridAutomaton:
    """The automaton whose mode k is the mode ``order[k]`` that was found."""
    names = np.argsort(order)
    transitions = [
        Transition(
            int(names[one.source]),
            int(names[one.target]),
            one.guard.guard,
            one.reset.reset if one.jumps and one.reset is not None else None,
            len(one),
        )
        for one in found
        if one.guard is not None
    ]
    transitions.sort(key=lambda one: (one.source, one.target))
    named = FirstModes(first_modes.states, names[first_modes.modes])
    return HybridAutomaton(coef[order], feature_map, tuple(transitions), discrete_time, lags, named)


@dataclass(frozen=True)
class Assembled:
    """An automaton, and the mode that was found as each of its modes."""

    automaton: HybridAutomaton
    order: NDArray[np.intp]


def assembled(told: Told, feature_map: FeatureMap) -> Assembled:
    """The automaton in continuous time of what is told."""
    modes = [filled(own) for own in told.modes]
    order = order_of_modes(modes, len(told.coef))
    first_modes = first_modes_of(told.states, modes)
    return Assembled(automaton_of(told.coef, feature_map, told.real, first_modes, order), order)


def filled(modes: NDArray[np.intp]) -> NDArray[np.intp]:
    """Modes of all samples: those in no piece have that of the nearest before, or after."""
    known = np.flatnonzero(modes >= 0)
    if not len(known):
        return np.zeros_like(modes)
    last = np.maximum(np.searchsorted(known, np.arange(len(modes)), side="right") - 1, 0)
    return modes[known[last]]


def first_modes_of(states: Sequence[Array], modes: Sequence[NDArray[np.intp]]) -> FirstModes:
    """Some samples with their modes, the first ones of all recordings among them."""
    rows, labels = np.vstack(states), np.concatenate(modes)
    lengths = np.cumsum([0, *(len(own) for own in modes)])[:-1]
    spread = np.linspace(0, len(rows) - 1, min(len(rows), SETTINGS.most_first_modes)).astype(int)
    some = np.union1d(lengths, spread)
    return FirstModes(rows[some], labels[some])


def switch_times_of(found: Sequence[FoundTransition], n_recordings: int) -> list[Array]:
    """When each recording switches."""
    recording = np.concatenate([np.zeros(0, dtype=np.intp), *(one.recording for one in found)])
    times = np.concatenate([np.zeros(0), *(one.times for one in found)])
    return [np.sort(times[recording == k]) for k in range(n_recordings)]


def verdicts_of(
    found: Sequence[FoundTransition], order: NDArray[np.intp], interval: float
) -> list[TransitionVerdict]:
    """One verdict for each transition, in the names of the answer."""
    names, verdicts = np.argsort(order), []
    for one in found:
        near, miss = 0.0, np.inf
        if one.guard is not None:
            near, miss = one.guard.explained(interval), one.guard.miss
        verdicts.append(
            TransitionVerdict(int(names[one.source]), int(names[one.target]), len(one), near, miss)
        )
    return sorted(verdicts, key=lambda one: (one.source, one.target))
