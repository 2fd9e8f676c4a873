"""The untouched part of a record as judge: what does not lower the error there is not added.

Neither significance nor a gain in the folds is proof that a model with the effect predicts what no
choice has seen. An effect stays if its error there falls by more than the standard error of that
fall, from block to block; otherwise it is listed as tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.acceptance import Finding, confirmed
from swsysid._effect_search.chance import BlockSum
from swsysid._effect_search.folds import Folds, make_folds
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._noise import robust_scale
from swsysid._results import Array
from swsysid.effects import GuardEffect, PlacedEffect, ResetEffect


@dataclass(frozen=True)
class Tried:
    """An effect that chance does not explain and that does not help."""

    candidate: PlacedEffect
    p_value: float
    before: Array  # root mean square errors on the untouched rows without it, (n_states,)
    after: Array


@dataclass(frozen=True)
class Untouched:
    """Rows that have taken part in no choice."""

    context: SearchContext
    records: Records
    targets: Array  # of the whole record
    rows: NDArray[np.intp]

    @cached_property
    def _folds(self) -> Folds:
        rng = np.random.RandomState(0)
        return make_folds(self.records.take(self.rows), SETTINGS.n_folds, rng)

    @cached_property
    def _scale(self) -> Array:
        """Usual errors of the declared model; a few that are gross decide nothing."""
        data = self.context.data
        errors = self.context.declared.residuals(data.records, data.rows, data.targets)
        return np.maximum(robust_scale(errors), data.exact)

    def _errors(self, fit: JointFit) -> Array:
        return self.targets[self.rows] - fit.predict(self.records)[self.rows]

    def gain(self, before: JointFit, after: JointFit) -> BlockSum:
        """By how much the squares of the errors fall from one fit to another."""
        gross = self.context.settings.gross
        losses = [
            np.sum(np.minimum(np.abs(self._errors(fit)) / self._scale, gross) ** 2, axis=1)
            for fit in (before, after)
        ]
        return BlockSum.of(self._folds.independent_sums(losses[0] - losses[1]))

    def judged(
        self, structure: Structure, findings: tuple[Finding, ...]
    ) -> tuple[Structure, tuple[Finding, ...], tuple[Tried, ...]]:
        """Without the effects that do not help, the least helpful first; and these."""
        tried: list[Tried] = []
        while structure.terms:
            fewer = [self._without(structure, place) for place in range(len(structure.terms))]
            gains = [self.gain(fit, structure.fit) for fit in fewer]
            useless = [
                place
                for place, term in enumerate(structure.terms)
                if self._shows(term) and not gains[place].is_clear
            ]
            if not useless:
                break
            worst = min(useless, key=lambda place: gains[place].value)
            before, after = (
                np.sqrt(np.mean(self._errors(fit) ** 2, axis=0))
                for fit in (fewer[worst], structure.fit)
            )
            lost = findings[worst]
            tried.append(Tried(lost.candidate, lost.p_value, before, after))
            structure, findings = confirmed(self.context, self.context.without(structure, worst))
        return structure, findings, tuple(tried)

    def _without(self, structure: Structure, place: int) -> JointFit:
        if len(structure.terms) == 1:
            return self.context.declared
        return self.context.without(structure, place).fit

    def _shows(self, term: PlacedEffect) -> bool:
        """Whether velocities show an effect: no jump, and no guard where they end at switches."""
        if isinstance(term.effect, ResetEffect):
            return False
        return self.records.told is None or not isinstance(term.effect, GuardEffect)
