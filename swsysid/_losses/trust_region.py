"""How far the residuals of rows may move while coefficients move a little."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array


@dataclass(frozen=True)
class TrustRegion:
    r"""Within which distance the residual of a row may move: rows of much leverage move most.

    A change :math:`\Delta` of the coefficients with :math:`\Delta^T G \Delta \le s^2` moves the
    residual of a row d by at most :math:`s \, (d^T G^{-1} d)^{1/2}`, with equality for one of them.
    """

    # (n_features, rank): a root of the inverse of G, the Gram matrix of the rows that the
    # coefficients are known from.
    metric: Array
    size: Array  # (n_outputs,): the number s of each; negative where the coefficients stay
    most: float = np.inf  # leverage of a row that no row is expected to exceed

    def near(self, design: Array, residuals: Array) -> list[NDArray[np.intp]]:
        """For each output the rows whose residual, (n_outputs, n_rows), may change its sign."""
        # Leverages are not computed for residuals beyond the distance of any expected row.
        sizes = np.abs(residuals)
        some = np.flatnonzero(np.any(sizes <= self.farthest[:, None], axis=0))
        inside = sizes[:, some] <= self.of(design[some]).T
        return [some[chosen] for chosen in inside]

    def of(self, design: Array) -> Array:
        """The distance of every row for every output, (n_rows, n_outputs)."""
        whitened = design @ self.metric
        return np.sqrt(np.einsum("ij,ij->i", whitened, whitened))[:, None] * self.size

    @property
    def farthest(self) -> Array:
        """What no row is expected to move beyond, (n_outputs,); where nothing moves, nothing."""
        return self.size * np.where(self.size == 0.0, 1.0, self.most)

    def scaled(self, factor: float) -> TrustRegion:
        """The trust region of changes that are so many times as large."""
        return replace(self, size=factor * self.size)

    @property
    def of_any_row(self) -> TrustRegion:
        """The same for rows of any leverage."""
        return replace(self, most=np.inf)
