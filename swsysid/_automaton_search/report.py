"""What an identification of an automaton has to say, as text."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from swsysid._automaton_search.answer import IdentifiedAutomaton
from swsysid._automaton_search.assembly import TransitionVerdict
from swsysid._automaton_search.doubts import doubts_of, imitates, untold_switches
from swsysid._automaton_search.refinement import AutomatonRefinement
from swsysid._automaton_search.settings import SETTINGS
from swsysid._discrete_stays.identify import KindsOfNoise
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._known.checks import KnownCheck, blamed
from swsysid._rendering.printing import counted
from swsysid._results import Array

_MOST_UNEXPLAINED = 0.05  # samples that follow no law


@dataclass(frozen=True, repr=False)
class AutomatonReport:
    """Laws and transitions of an automaton, how well each is told, and what to do about it.

    Attributes
    ----------
    n_recordings, n_samples : int
    equations : tuple of str
        With standard errors; a threshold in discrete time is one of an interval.
    shares : ndarray of shape (n_modes,)
        Part of the samples in each mode.
    verdicts : tuple of TransitionVerdict
    noise : ndarray of shape (n_channels,)
        What the laws leave of the measured states: noise of the sensor.
    noises : KindsOfNoise or None
        Of the sensor and in the equation: where states walk beside the laws, and in discrete time
        of all samples that are not exact.
    states : tuple of str
        Their names.
    refinement : AutomatonRefinement or None
        What was gained by refining all of it together.
    rollouts : FreeRollouts
        What rollouts of the automaton leave of the recordings, each from its estimated start, and
        which of the switches its own guards make.
    doubts : tuple of str
        What the recordings do not tell, or tell otherwise than asked: a sentence each.
    advice : str
    excess : float or None
        What the laws leave where they are told when to switch, in units of the noise that
        neighbouring samples show; None where that is not told.
    known : tuple of KnownCheck
        What the recordings would rather have, for each thing that was known.
    imitates : bool
        Whether modes that nothing tells alternate so fast that they make up for something gradual.
    """

    equations: tuple[str, ...]
    shares: Array
    verdicts: tuple[TransitionVerdict, ...]
    noise: Array
    noises: KindsOfNoise | None
    states: tuple[str, ...]
    refinement: AutomatonRefinement | None
    rollouts: FreeRollouts
    doubts: tuple[str, ...]
    advice: str
    # none of reports that were saved before these were counted
    imitates: bool = False
    n_recordings: int = 0
    n_samples: int = 0
    excess: float | None = None
    known: tuple[KnownCheck, ...] = ()

    @classmethod
    def of(
        cls, found: IdentifiedAutomaton, asked: int | str, most: int, n_samples: int,
        held: Iterable[str] = (),
    ) -> AutomatonReport:  # fmt: skip
        """The report of an answer where `asked` modes were asked for, at `most` some.

        `held` is what inputs do between two samples.
        """
        modes, automaton = np.concatenate(found.modes), found.automaton
        shares = np.bincount(modes, minlength=automaton.n_modes) / len(modes)
        untold = [told] if (told := untold_switches(found)) else []
        if found.excess is not None and found.excess > SETTINGS.excess(len(modes)):
            untold.append(
                f"The laws leave {found.excess:.2g} times the noise: a term or a mode is missing; "
                "try a larger library or more modes."
            )
        unexplained = found.n_unexplained / len(modes)
        if unexplained > _MOST_UNEXPLAINED:
            untold.append(
                f"{unexplained:.0%} of the samples follow none of the laws: a term or a mode "
                "is missing, or stays are too short to tell theirs; try a larger library, give "
                "n_modes, or record at a higher rate."
            )
        return cls(
            tuple(found.errors.lines(automaton)),
            shares,
            tuple(found.verdicts),
            found.noise,
            found.noises,
            tuple(automaton.state_names),
            found.refinement,
            found.rollouts,
            (*doubts_of(found, asked, most), *held),
            blamed(found.known) or " ".join(untold) or _judgement(found),
            imitates(found),
            len(found.modes),
            n_samples,
            found.excess,
            found.known,
        )

    def __str__(self) -> str:
        n_switches = sum(one.support for one in self.verdicts)
        n_untold = sum(one.support for one in self.verdicts if not one.is_told)
        head = f"{counted(len(self.shares), 'mode')}, {counted(n_switches, 'switch')}"
        if self.n_recordings:
            recordings = counted(self.n_recordings, "recording")
            head = f"{recordings}, {self.n_samples} samples: {head}"
        if n_untold:
            which = "all" if n_untold == n_switches else str(n_untold)
            head += f", {which} of them by what was not recorded"
        lived = ", ".join(f"mode {k} {share:.0%}" for k, share in enumerate(self.shares))
        taken: Counter[tuple[int, int]] = Counter()
        for one in self.verdicts:  # of the same modes there may be several
            taken[one.source, one.target] += one.support
        switches = ", ".join(
            f"{source} -> {target} {counted(count, 'time')}"
            for (source, target), count in taken.items()
        )
        lines = [f"{head}.", *self.equations, f"Samples: {lived}."]
        if switches:
            lines.append(f"Switches: {switches}.")
        lines += [f"Known: {one}." for one in self.known]
        lines.append(self._noise())
        if self.refinement is not None:
            lines.append(str(self.refinement))
        return "\n".join([*lines, self.rollouts.sentence(), *self.doubts, self.advice])

    def _noise(self) -> str:
        if self.noises is None:
            return f"The laws leave: {self._sizes(self.noise)}."
        kinds = []
        if self.noises.senses or not self.noises.drives:
            kinds.append(f"of the sensor: {self._sizes(self.noises.sensor)}")
        if self.noises.drives or not self.noises.senses:
            kinds.append(f"in the equation: {self._sizes(self.noises.equation)}")
        return f"Noise {'; '.join(kinds)}."

    def _sizes(self, noise: Array) -> str:
        pairs = zip(self.states[: len(noise)], noise, strict=True)
        return ", ".join(f"{name} {size:.3g}" for name, size in pairs)

    __repr__ = __str__


def _judgement(found: IdentifiedAutomaton) -> str:
    """What laws leave, and whether the guards of the model tell all switches by themselves."""
    rollouts = found.rollouts
    left = "The laws leave nothing but noise"
    if found.excess is None:
        left = "What the laws leave counts as noise"
    driven = found.noises is not None and found.noises.drives
    if not (rollouts.holds or found.verdicts or driven):
        return (
            f"{left} from one sample to the next; by itself the automaton leaves "
            f"{rollouts.strays or 'the recordings'}: a law is off, or the state jumps and is seen "
            "to do so too seldom."
        )
    if rollouts.holds and rollouts.tells_switches:
        if not found.verdicts:
            return f"{left}."
        if all(one.is_determined for one in found.verdicts):
            return f"{left}, and guards tell all switches."
        return f"{left}, and guards tell the switches of these recordings; not all are determined."
    if driven:
        return (
            f"{left}, one sample ahead; noise in the equation leads free rollouts away from any "
            "recording, which is no proof against the laws."
        )
    if rollouts.hangs_on_start:
        return (
            f"{left} where they are told when to switch; free rollouts hang on how well their "
            "start is known, as those of a chaotic motion do."
        )
    return (
        f"{left} where they are told when to switch; by itself the automaton "
        f"{f'leaves {own}' if (own := rollouts.strays) else 'goes another way'}: a guard or a law "
        "is off, or a transition is missing."
    )
