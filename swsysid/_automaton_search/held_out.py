"""What automata leave of recordings that they have not seen, for the verdict on their modes."""

from __future__ import annotations

from dataclasses import replace
from typing import Protocol, TypeVar

import numpy as np

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton_search.judged import judged_on, left_by_rollout
from swsysid._automaton_search.report import AutomatonReport
from swsysid._free_rollouts.judge import FreeRollouts
from swsysid._results import Array
from swsysid._stays.given import Given
from swsysid._verdict.comparison import Split
from swsysid._verdict.held_out import Cut, Fits, HeldOut, HeldOutTrajectories, Identified
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.terms import Terms


class IdentifiedGuards(Identified, Protocol):
    """A fit of an automaton, as `HybridAutomatonRegressor`."""

    automaton_: HybridAutomaton
    noise_: Array
    report_: AutomatonReport


OfGuards = TypeVar("OfGuards", bound=IdentifiedGuards)


class HeldOutAutomata(HeldOut[OfGuards]):
    """An automaton starts in the mode and the state that fit the first samples of a stretch best.

    In continuous time it stands beside smooth `laws`, which know neither guards nor jumps; a law
    starts where it fits all samples of a stretch, which is no advantage for the automaton. In
    discrete time a law is an automaton of one mode.
    """

    def __init__(
        self,
        given: Given,
        split: Split,
        fits: Fits[OfGuards],
        found: OfGuards,
        laws: HeldOutTrajectories | None,
    ):
        super().__init__(given, split, fits)
        self.n_columns = len(found.automaton_.feature_map.names_in)
        if laws is not None:
            self.laws, self.noise = laws, laws.noise
            self.cut, self.made_from = laws.cut, laws.made_from
            return
        spread = np.nanstd(np.vstack([record.y for record in given.records]), axis=0)
        self.noise = np.maximum(found.noise_, JUDGING.integrated * spread)
        guess = [one.filled for one in given.records]
        self.laws = self
        self.cut, self.made_from = Cut.of(given, guess, split), Cut.of(given, guess, split.swapped)

    def _options(self, terms: Terms, is_rival: bool) -> dict[str, object]:
        known: dict[str, object] = {"known": None} if is_rival else {}
        return known | {"feature_library": terms.library(self.n_columns)}

    def left_by(self, fit: OfGuards, cut: Cut) -> Array:
        """What rollouts over the stretches leave; where one ends early, what the mean leaves."""
        automaton = fit.automaton_
        left = np.vstack([left_by_rollout(automaton, part) for part in cut.stretches.parts])
        of_mean = cut.measured - np.nanmean(cut.measured, axis=0)
        return np.where(np.isfinite(left[cut.kept]), left[cut.kept], of_mean)

    def free(self, fit: OfGuards) -> FreeRollouts | None:
        """What free rollouts of a fit leave of the held-out recordings."""
        most = slice(JUDGING.most_rolled_out)
        records, labels = self.cut.records[most], self.cut.labels[most]
        some = replace(self.given, records=records, labels=labels)
        return judged_on(fit.automaton_, some, self.noise)

    def rollouts(self, fit: OfGuards) -> FreeRollouts:
        """What those of a fit leave of its own recordings."""
        return fit.report_.rollouts

    def leaves_noise(self, fit: OfGuards) -> bool:
        """Whether nothing but noise is left where the laws are told when to switch."""
        excess = fit.report_.excess
        return fit.report_.rollouts.holds if excess is None else excess <= JUDGING.noise_alone

    def channels(self, fit: OfGuards) -> tuple[str, ...]:
        """Names of the measured states."""
        return tuple(fit.automaton_.state_names[: self.given.n_channels])

    def told(self, fit: OfGuards) -> Array | None:
        """What the laws leave of samples that tell the modes, where guards do not.

        Modes that make up any curve by alternating fast are told by any samples.
        """
        report = fit.report_
        is_hidden = not report.imitates and not all(one.is_told for one in report.verdicts)
        return np.array([fit.noise_[: self.given.n_channels]]) if is_hidden else None

    def is_one_law(self, fit: OfGuards) -> bool:
        """Whether nothing switches, and nothing jumps."""
        return fit.n_modes_ == 1 and not fit.automaton_.transitions
