"""What an identification of an automaton answers, in continuous and in discrete time alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton_search.assembly import TransitionVerdict
from swsysid._automaton_search.errors import AutomatonErrors
from swsysid._automaton_search.refinement import AutomatonRefinement
from swsysid._discrete_stays.identify import KindsOfNoise
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._known.checks import KnownCheck
from swsysid._results import Array
from swsysid._stays.walk import Walk


@dataclass(frozen=True)
class IdentifiedAutomaton:
    """An automaton with what the recordings went through."""

    automaton: HybridAutomaton
    errors: AutomatonErrors
    modes: list[NDArray[np.intp]]  # of the samples of each recording
    states: list[Array]  # without their noise
    switch_times: list[Array]
    noise: Array  # (n_states,): what the laws leave of the samples
    excess: float | None  # the largest of these, in units of the noise that neighbours show, if any
    verdicts: list[TransitionVerdict]
    rollouts: FreeRollouts  # from the start of each recording
    shared_exits: Sequence[str]  # what is said of modes that are left two ways at one guard
    candidates: Sequence[object]  # of the number of modes
    n_unexplained: int = 0  # samples that no law explains
    refinement: AutomatonRefinement | None = None  # None where there was nothing to refine
    noises: KindsOfNoise | None = None  # where states walk; in discrete time, of all but exact rows
    known: tuple[KnownCheck, ...] = ()  # what the recordings would rather have


def beside_walk(answer: IdentifiedAutomaton, walk: Walk) -> IdentifiedAutomaton:
    """The answer of states that walk beside the laws."""
    sensor, nothing = walk.sensor[: len(answer.noise)], np.zeros(0)
    # laws of either noise alone are told where nothing tells them apart
    noises = KindsOfNoise(
        sensor, walk.walk, walk.nats, walk.nats_of_sensor, nothing, nothing
    )  # fmt: skip
    return replace(answer, noise=sensor, noises=noises)
