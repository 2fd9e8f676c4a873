"""What an identification of an automaton answers, in continuous and in discrete time alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton_search.assembly import TransitionVerdict
from swsysid._automaton_search.refinement import AutomatonRefinement
from swsysid._automaton_search.settings import SETTINGS
from swsysid._results import Array


@dataclass(frozen=True)
class IdentifiedAutomaton:
    """An automaton with what the recordings went through."""

    automaton: HybridAutomaton
    modes: list[NDArray[np.intp]]  # of the samples of each recording
    states: list[Array]  # without their noise
    switch_times: list[Array]
    noise: Array  # (n_states,): what the laws leave of the samples
    excess: float | None  # the largest of these, in units of the noise that neighbours show, if any
    verdicts: list[TransitionVerdict]
    candidates: Sequence[object]  # of the number of modes
    unexplained: float = 0.0  # part of the samples that no law explains
    refinement: AutomatonRefinement | None = None  # None where there was nothing to refine


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
    states : tuple of str
        Their names.
    refinement : AutomatonRefinement or None
        What was gained by refining all of it together.
    advice : str
    """

    equations: tuple[str, ...]
    shares: Array
    verdicts: tuple[TransitionVerdict, ...]
    noise: Array
    states: tuple[str, ...]
    refinement: AutomatonRefinement | None
    advice: str

    @classmethod
    def of(cls, found: IdentifiedAutomaton) -> AutomatonReport:
        """The report of an answer."""
        modes = np.concatenate(found.modes)
        shares = np.bincount(modes, minlength=found.automaton.n_modes) / len(modes)
        untold = [one.advice() for one in found.verdicts if not one.is_told]
        if found.excess is not None and found.excess > SETTINGS.most_excess:
            untold.append(
                f"The laws leave {found.excess:.2g} times the noise: a term or a mode is missing; "
                "try a larger library or more modes."
            )
        if found.unexplained > SETTINGS.most_unexplained:
            untold.append(
                f"{found.unexplained:.0%} of the samples follow none of the laws: a term or a mode "
                "is missing, or stays are too short to tell theirs; try a larger library, give "
                "n_modes, or record at a higher rate."
            )
        left = "The laws leave nothing but noise"
        if found.excess is None:
            left = "What the laws leave counts as noise"
        fine = f"{left}, and guards tell all switches."
        advice = " ".join(untold) or fine
        equations = tuple(found.automaton.equations())
        names = tuple(found.automaton.state_names)
        verdicts, refinement = tuple(found.verdicts), found.refinement
        return cls(equations, shares, verdicts, found.noise, names, refinement, advice)

    def __str__(self) -> str:
        lived = ", ".join(f"mode {k} {share:.0%}" for k, share in enumerate(self.shares))
        counted = ", ".join(
            f"{one.source} -> {one.target} {one.support} times" for one in self.verdicts
        )
        lines = [*self.equations, f"Samples: {lived}."]
        if counted:
            lines.append(f"Switches: {counted}.")
        left = ", ".join(
            f"{name} {size:.3g}" for name, size in zip(self.states, self.noise, strict=True)
        )
        lines.append(f"The laws leave: {left}.")
        if self.refinement is not None:
            lines.append(str(self.refinement))
        return "\n".join([*lines, self.advice])

    __repr__ = __str__
