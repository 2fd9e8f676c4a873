"""What an identification of an automaton answers, in continuous and in discrete time alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton_search.assembly import TransitionVerdict
from swsysid._results import Array


@dataclass(frozen=True)
class IdentifiedAutomaton:
    """An automaton with what the recordings went through."""

    automaton: HybridAutomaton
    modes: list[NDArray[np.intp]]  # of the samples of each recording
    states: list[Array]  # without their noise
    switch_times: list[Array]
    noise: Array  # (n_states,): what the laws leave of the samples
    excess: float  # the largest of these, in units of the noise that neighbours show
    verdicts: list[TransitionVerdict]
    candidates: Sequence[object]  # of the number of modes


@dataclass(frozen=True, repr=False)
class AutomatonReport:
    """Laws and transitions of an automaton, how well each is told, and what to do about it.

    Attributes
    ----------
    equations : tuple of str
    shares : ndarray of shape (n_modes,)
        Part of the samples in each mode.
    verdicts : tuple of TransitionVerdict
    noise : ndarray of shape (n_states,)
        What the laws leave of the samples.
    advice : str
    """

    equations: tuple[str, ...]
    shares: Array
    verdicts: tuple[TransitionVerdict, ...]
    noise: Array
    advice: str

    @classmethod
    def of(cls, found: IdentifiedAutomaton) -> AutomatonReport:
        """The report of an answer."""
        modes = np.concatenate(found.modes)
        shares = np.bincount(modes, minlength=found.automaton.n_modes) / len(modes)
        untold = [one.advice() for one in found.verdicts if not one.is_told]
        if found.excess > 1.3:
            untold.append(
                f"The laws leave {found.excess:.2g} times the noise: a term or a mode is missing; "
                "try a larger library or more modes."
            )
        advice = (
            " ".join(untold) or "The laws leave nothing but noise, and guards tell all switches."
        )
        equations = tuple(found.automaton.equations())
        return cls(equations, shares, tuple(found.verdicts), found.noise, advice)

    def __str__(self) -> str:
        lived = ", ".join(f"mode {k} {share:.0%}" for k, share in enumerate(self.shares))
        counted = ", ".join(
            f"{one.source} -> {one.target} {one.support} times" for one in self.verdicts
        )
        lines = [*self.equations, f"Samples: {lived}."]
        if counted:
            lines.append(f"Switches: {counted}.")
        return "\n".join([*lines, self.advice])

    __repr__ = __str__
