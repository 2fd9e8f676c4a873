"""The declared model, then one effect after the other, and the error of each on held-out rows."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid._search.folds import Split
from swsysid._search.greedy import Search
from swsysid._search.joint_fit import JointFit
from swsysid._search.trials import PlacedEffect
from swsysid._search.workshop import Finding, Structure

__all__ = ["Ladder"]


@dataclass(frozen=True)
class Ladder:
    """Nested models and their errors.

    Attributes
    ----------
    terms : tuple of PlacedEffect
        Effects, the most important first.
    findings : tuple of Finding
        One for each effect: p-value in the light of all others, and rivals.
    fits : tuple of JointFit
        The declared model, then with one effect more each; fitted to the rows of the search.
    search, held_out : list of ndarray of shape (n_states,)
        Root mean square errors of each of `fits` on the rows of the search and on those held out.
    """

    terms: tuple[PlacedEffect, ...]
    findings: tuple[Finding, ...]
    fits: tuple[JointFit, ...]
    search: list[Array]
    held_out: list[Array]
    records: Records
    targets: Array
    split: Split

    @classmethod
    def of(
        cls,
        search: Search,
        structure: Structure,
        findings: tuple[Finding, ...],
        targets: Array,
        split: Split,
    ) -> Ladder:
        """Order the effects of a structure by what is lost without them, and climb."""
        order = _by_loss(search, structure)
        terms = tuple(structure.fit.terms[place] for place in order)
        findings = tuple(findings[place] for place in order)
        fits = [search.declared]
        for count in range(1, len(terms) + 1):
            if count == len(terms):
                fits.append(replace_terms(structure.fit, terms))
            else:
                fits.append(search.structure(terms[:count], structure.fit.modes).fit)
        ladder = cls(terms, findings, tuple(fits), [], [], search.records, targets, split)
        for fit in fits:
            ladder.search.append(ladder.errors_of(fit, split.search))
            ladder.held_out.append(ladder.errors_of(fit))
        return ladder

    def errors_of(self, fit: JointFit, rows: NDArray[np.intp] | None = None) -> Array:
        """Root mean square error in each state, on the held-out rows by default."""
        chosen = self.split.held_out if rows is None else rows
        errors = (self.targets - fit.predict(self.records))[chosen]
        return np.sqrt(np.mean(errors**2, axis=0))


def _by_loss(search: Search, structure: Structure) -> list[int]:
    """Places of the effects of a structure, the one whose loss costs most first."""
    order = list(range(len(structure.fit.terms)))
    if len(order) > 1:
        losses = {place: search.without(structure, place).price for place in order}
        order.sort(key=lambda place: -losses[place])
    return order


def replace_terms(fit: JointFit, terms: tuple[PlacedEffect, ...]) -> JointFit:
    """The same fit with its terms in another order."""
    order = [fit.terms.index(term) for term in terms]
    return replace(fit, terms=terms, coef=tuple(fit.coef[place] for place in order))
