"""An automaton from what was found of its stays and transitions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.equations import guard_text
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.parts import FirstModes
from swsysid._automaton.transitions import PolynomialGuard, Transition
from swsysid._automaton_search.certificates import Certificate
from swsysid._automaton_search.found import FoundTransition, Told
from swsysid._automaton_search.settings import SETTINGS
from swsysid._data.features import FeatureMap
from swsysid._rendering.printing import counted
from swsysid._results import Array
from swsysid._stays.identification import StayIdentification

# Digits of the numbers of rivals; samples that tell the first mode of a rollout.
_DIGITS_OF_RIVALS, _MOST_FIRST_MODES = 4, 2000


@dataclass(frozen=True)
class TransitionVerdict:
    """How well a guard tells when a transition is taken.

    Attributes
    ----------
    source, target : int
    support : int
        Switches of the recordings.
    explained : float
        Part of them at which the guard is zero within two samples, or three standard errors of the
        instant where the laws tell it no better, of those that it is known at: a clock is not where
        a recording begins. After a joint refinement, the part that free rollouts take within two
        samples, where that is more.
    miss : float
        Root mean square of the time by which it is not, in the unit of time.
    margin : float
        By how much the guard is below zero at every sample of its mode and above it where the old
        law takes the last sample before each switch, in units of its mean rise from there: at most
        a half, and negative where a sample is on the wrong side.
    largest_margin : float
        Of any guard of the same monomials: the optimum of the paper's margin program.
    n_coefficients : int
        Of the guard. With no more switches than coefficients, shared ones among them, it is not
        determined: guards of other columns tell the switches as well.
    rivals : tuple of str
        Guards of other columns, of no more, that tell the same switches to within two samples.
    n_shared : int
        Switches of other transitions, which cross the same surface.
    is_in_model : bool
        Whether the automaton has the transition: not where no guard explains more switches than it
        has coefficients, and not nearly all.
    """

    source: int
    target: int
    support: int
    explained: float
    miss: float
    margin: float = np.nan
    largest_margin: float = np.nan
    n_coefficients: int = 0
    rivals: tuple[str, ...] = ()
    n_shared: int = 0
    is_in_model: bool = True

    @property
    def is_told(self) -> bool:
        """True if the guard explains nearly all switches."""
        return self.explained >= SETTINGS.told_by_guard

    @property
    def is_determined(self) -> bool:
        """True if more switches cross the surface of the guard than it has coefficients."""
        return self.support + self.n_shared > self.n_coefficients

    def advice(self) -> str:
        """One sentence on a transition that no guard explains, or that too few switches tell."""
        between = f"from mode {self.source} to mode {self.target}"
        if self.is_told:
            rests = counted(self.support, "switch") if self.support != 1 else "one switch"
            rivals = " or ".join(f"`{one}`" for one in self.rivals)
            as_well = f"; {rivals} {'tells' if len(self.rivals) == 1 else 'tell'} them as well"
            return (
                f"The guard {between} is not determined: it has {self.n_coefficients} "
                f"coefficients and rests on {rests}{as_well if rivals else ''}. Record more "
                "switches, from other states."
            )
        return untold([self])


def untold(verdicts: Sequence[TransitionVerdict]) -> str:
    """What is said of all transitions that no guard explains, "" if there are none.

    Laws and instants owe nothing to guards, and stand.
    """
    listed = [
        f"{one.source} -> {one.target} ({_times(one.support)}, the best guard explains "
        f"{one.explained:.0%}{'' if one.is_in_model else ': no transition of the model'})"
        for one in verdicts
        if not one.is_told
    ]
    if not listed:
        return ""
    return (
        f"The switches {', '.join(listed)} happen where no condition on what was recorded tells: a "
        "signal that was not logged decides, or several conditions do. The laws of the modes and "
        "the instants stand without it; to predict, record the signal that triggers them and give "
        "it as an input, or raise guard_degree."
    )


def _times(count: int) -> str:
    return {1: "seen once", 2: "seen twice"}.get(count, f"{count} times")


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
    interval: float,
    *,
    discrete_time: bool = False,
    lags: int = 0,
) -> HybridAutomaton:
    """The automaton whose mode k is the mode ``order[k]`` that was found.

    Guards that tell nothing make no transitions.
    """
    names = np.argsort(order)
    asked = sorted(found, key=lambda one: (names[one.source], one.rank, names[one.target]))
    transitions = [
        Transition(
            int(names[one.source]),
            int(names[one.target]),
            one.guard.whole,
            one.reset.reset if one.jumps and one.reset is not None else None,
            len(one),
            interval if one.asked_at_samples else None,
        )
        for one in asked
        if one.guard is not None and one.guard.is_any(interval)
    ]
    named = FirstModes(first_modes.states, names[first_modes.modes])
    return HybridAutomaton(coef[order], feature_map, tuple(transitions), discrete_time, lags, named)


@dataclass(frozen=True)
class Assembled:
    """An automaton, and the mode that was found as each of its modes."""

    automaton: HybridAutomaton
    order: NDArray[np.intp]


def assembled(told: Told, stays: StayIdentification) -> Assembled:
    """The automaton in continuous time of what is told of stays."""
    feature_map = stays.model.switching_model.feature_map
    interval = stays.estimate.nodes.recordings.interval
    modes = [filled(own) for own in told.modes]
    order = order_of_modes(modes, len(told.coef))
    first_modes = first_modes_of(told.states, modes)
    automaton = automaton_of(told.coef, feature_map, told.changes, first_modes, order, interval)
    return Assembled(automaton, order)


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
    spread = np.linspace(0, len(rows) - 1, min(len(rows), _MOST_FIRST_MODES)).astype(int)
    some = np.union1d(lengths, spread)
    return FirstModes(rows[some], labels[some])


def switch_times_of(found: Sequence[FoundTransition], n_recordings: int) -> list[Array]:
    """When each recording switches."""
    recording = np.concatenate([np.zeros(0, dtype=np.intp), *(one.recording for one in found)])
    times = np.concatenate([np.zeros(0), *(one.times for one in found)])
    return [np.sort(times[recording == k]) for k in range(n_recordings)]


def verdicts_of(
    found: Sequence[FoundTransition],
    certificates: Sequence[Certificate],
    order: NDArray[np.intp],
    interval: float,
    columns: Sequence[str],
    in_users: Callable[[PolynomialGuard], PolynomialGuard] = lambda guard: guard,
) -> list[TransitionVerdict]:
    """One verdict for each transition, in the names of the answer.

    `columns` are those of guards, which `in_users` tells in the user's.
    """
    names, verdicts = np.argsort(order), []
    for one, margins in zip(found, certificates, strict=True):
        verdict = TransitionVerdict(
            int(names[one.source]), int(names[one.target]), len(one), 0.0, np.inf,
            is_in_model=False,
        )  # fmt: skip
        if one.guard is not None:
            guard = one.guard
            verdict = replace(
                verdict,
                explained=guard.explained(interval),
                miss=guard.miss,
                margin=margins.margin,
                largest_margin=margins.largest,
                n_coefficients=guard.n_coefficients,
                n_shared=guard.n_shared,
                rivals=tuple(
                    guard_text(in_users(rival.guard), columns, _DIGITS_OF_RIVALS, brief=True)
                    for rival in guard.rivals
                ),
                is_in_model=guard.is_any(interval),
            )
        verdicts.append(verdict)
    return sorted(verdicts, key=lambda one: (one.source, one.target))
