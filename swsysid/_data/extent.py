"""Where columns are: numerical limits count from their centre, in their spreads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from swsysid._results import Array

# Spreads from zero from which on columns are counted from their mean. A surface of plain monomials
# with the usual margin and box then has a margin of at most three hundredths of a spread.
FAR = 30.0


class Extent(NamedTuple):
    """Centres of columns, zero for those that are not far from it, and standard deviations."""

    centre: Array  # (n_columns,)
    spread: Array  # (n_columns,)

    @classmethod
    def of(cls, columns: Array) -> Extent:
        """That of some rows, without their missing values.

        Examples
        --------
        >>> Extent.of(np.array([[300.0, -1.0], [302.0, 1.0]]))
        Extent(centre=array([301.,   0.]), spread=array([1., 1.]))
        """
        middle = np.nanmean(columns, axis=0)
        spread = np.sqrt(np.nanmean(np.square(columns - middle), axis=0))
        far = (np.abs(middle) > FAR * spread) & (spread > 0.0)
        return cls(np.where(far, middle, 0.0), spread)

    def first(self, n_columns: int) -> Extent:
        """That of the first columns."""
        return Extent(self.centre[:n_columns], self.spread[:n_columns])
