"""The declared model, then one effect after the other, and the error of each on held-out rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.acceptance import Finding
from swsysid._effect_search.folds import Split
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._results import Array
from swsysid.effects import PlacedEffect

__all__ = ["Ladder"]


@dataclass(frozen=True)
class Ladder:
    """Nested models and their errors.

    Attributes
    ----------
    context : SearchContext
    structure : Structure
        What the search has ended with.
    terms : tuple of PlacedEffect
        Effects, the most important first.
    findings : tuple of Finding
        One for each effect: p-value in the light of all others, and rivals.
    fits : tuple of JointFit
        The declared model, then with one effect more each; fitted to the rows of the search.
    search, held_out : list of ndarray of shape (n_states,)
        Root mean square errors of each of `fits` on the rows of the search and on those held out.
    """

    context: SearchContext
    structure: Structure
    terms: tuple[PlacedEffect, ...]
    findings: tuple[Finding, ...]
    fits: tuple[JointFit, ...]
    search: list[Array]
    held_out: list[Array]
    targets: Array
    split: Split

    @classmethod
    def of(
        cls,
        context: SearchContext,
        structure: Structure,
        findings: tuple[Finding, ...],
        targets: Array,
        split: Split,
    ) -> Ladder:
        """Order the effects of a structure by what is lost without them, and climb."""
        fit, order = structure.fit, _by_loss(context, structure)
        terms = tuple(fit.terms[place] for place in order)
        fits = [context.declared]
        fits += [context.structure(terms[:n], fit.modes).fit for n in range(1, len(terms))]
        if terms:
            fits.append(replace(fit, terms=terms, coef=tuple(fit.coef[place] for place in order)))
        ladder = cls(
            context,
            structure,
            terms,
            tuple(findings[place] for place in order),
            tuple(fits),
            [],
            [],
            targets,
            split,
        )
        for one in fits:
            ladder.search.append(ladder.errors_of(one, split.search))
            ladder.held_out.append(ladder.errors_of(one))
        return ladder

    @property
    def records(self) -> Records:
        """The whole record."""
        return self.context.data.records

    def errors_of(self, fit: JointFit, rows: NDArray[np.intp] | None = None) -> Array:
        """Root mean square error in each state, on the held-out rows by default."""
        chosen = self.split.held_out if rows is None else rows
        errors = (self.targets - fit.predict(self.records))[chosen]
        return np.asarray(np.sqrt(np.mean(errors**2, axis=0)))


def _by_loss(context: SearchContext, structure: Structure) -> list[int]:
    """Places of the effects of a structure, the one whose loss costs most first."""
    places = list(range(len(structure.terms)))
    if len(places) < 2:
        return places
    return sorted(places, key=lambda place: -context.without(structure, place).price)
