"""How far the residuals of rows may move while coefficients move a little."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array

__all__ = ["Reach"]


@dataclass(frozen=True)
class Reach:
    r"""How far the residual of a row may still move: rows of much leverage move most.

    A change :math:`\Delta` of the coefficients with :math:`\Delta^T G \Delta \le s^2` moves the
    residual of a row d by at most :math:`s \, (d^T G^{-1} d)^{1/2}`, with equality for one of them.

    Attributes
    ----------
    metric : ndarray of shape (n_features, rank)
        A root of the inverse of G, the Gram matrix of the rows that the coefficients are known
        from.
    size : ndarray of shape (n_outputs,)
        The number s of each output; negative for one whose coefficients stay.
    most : float
        Leverage of a row that no row is expected to exceed.
    """

    metric: Array
    size: Array
    most: float = np.inf

    def near(self, design: Array, residuals: Array) -> list[NDArray[np.intp]]:
        """For each output the rows whose residual, (n_outputs, n_rows), is within their reach.

        Leverages are not computed for residuals out of reach of any expected row.
        """
        sizes = np.abs(residuals)
        some = np.flatnonzero(np.any(sizes <= self.farthest[:, None], axis=0))
        inside = sizes[:, some] <= self.of(design[some]).T
        return [some[chosen] for chosen in inside]

    def of(self, design: Array) -> Array:
        """Reach of every row for every output, (n_rows, n_outputs)."""
        whitened = design @ self.metric
        return np.sqrt(np.einsum("ij,ij->i", whitened, whitened))[:, None] * self.size

    @property
    def farthest(self) -> Array:
        """What no row is expected to reach beyond, (n_outputs,).

        Where nothing moves the reach is nothing, of whatever leverage a row may be.
        """
        return self.size * np.where(self.size == 0.0, 1.0, self.most)

    def scaled(self, factor: float) -> Reach:
        """The reach of changes that are so many times as large."""
        return replace(self, size=factor * self.size)

    @property
    def of_any_row(self) -> Reach:
        """The same reach for rows of any leverage."""
        return replace(self, most=np.inf)
