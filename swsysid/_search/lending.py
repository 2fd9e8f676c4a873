"""Gains that the columns of an effect lend to the feature whose place they take.

An effect in the place of a feature (a lag of the input instead of the input) has one gain in each
mode. What it adds is taken from the velocities before the declared model is fitted to the rest; all
that tells modes apart that differ in this gain alone would go with it. The feature has the gains
while the model is fitted, and the fitted laws give them back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid._search.trials import PlacedEffect

__all__ = ["Loan", "loans"]


@dataclass(frozen=True)
class Loan:
    """Gains of one feature in one equation.

    Attributes
    ----------
    target : int
        State equation.
    feature : int
    gains : ndarray of shape (n_modes,)
        In the feature's own unit.
    """

    target: int
    feature: int
    gains: Array

    def values(self, features: Array, modes: NDArray[np.intp]) -> Array:
        """What the feature adds to the velocity with these gains, shape (n_samples,)."""
        return self.gains[modes] * features[:, self.feature]

    def give_back(self, laws: Array, order: NDArray[np.intp]) -> None:
        """Take the gains out of fitted laws, in place; `order` has the new number of each mode."""
        for mode, gain in enumerate(self.gains):
            if order[mode] < len(laws):  # a mode may have been left without rows
                laws[order[mode], self.target, self.feature] -= gain


def loans(
    terms: Sequence[PlacedEffect],
    coef: Sequence[Array],
    features: Array,
    records: Records,
    n_modes: int,
) -> list[Loan]:
    """What the effects in the place of features lend."""
    given = []
    for term, values in zip(terms, coef, strict=True):
        if term.replaced is not None:
            column, channel = features[:, term.replaced], records.channel(int(term.place))
            unit = float(column @ channel) / max(float(column @ column), 1e-300)
            gains = values.reshape(n_modes, -1).sum(axis=1)
            given.append(Loan(term.target, term.replaced, unit * gains))
    return given
