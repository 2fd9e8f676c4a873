r"""Symmetric matrices in the shape of an arrow: a band, bordered by a few full rows.

With B the band, E the border and D the corner,

.. math::

    \begin{pmatrix} B & E \\ E^\top & D \end{pmatrix}
    \begin{pmatrix} x \\ z \end{pmatrix} = \begin{pmatrix} b \\ d \end{pmatrix}
    \quad \text{by} \quad
    S z = d - E^\top B^{-1} b, \quad x = B^{-1} (b - E z), \quad S = D - E^\top B^{-1} E

takes a time that grows with the number of unknowns, not with its third power.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded

from swsysid._results import Array


@dataclass(frozen=True)
class Arrow:
    """A symmetric matrix; entry (j + d, j) of the band stands at [d, j]."""

    band: Array  # (width, n_band)
    border: Array  # (n_band, n_corner)
    corner: Array  # (n_corner, n_corner)

    @classmethod
    def zeros(cls, n_band: int, n_corner: int, width: int) -> Arrow:
        """The matrix of nothing."""
        return cls(
            np.zeros((width, n_band)), np.zeros((n_band, n_corner)), np.zeros((n_corner, n_corner))
        )

    def add(self, places: NDArray[np.intp], slopes: Array, shared: Array) -> None:
        """Add J'J of blocks of rows of J.

        `slopes` (n_blocks, n_rows, n_columns) stand in the columns `places` (n_blocks, n_columns)
        of the band, `shared` (n_blocks, n_rows, n_corner) in those of the corner.
        """
        transposed = slopes.transpose(0, 2, 1)
        below = places[:, :, None] - places[:, None, :]
        lower = below >= 0
        column = np.broadcast_to(places[:, None, :], below.shape)
        np.add.at(self.band, (below[lower], column[lower]), (transposed @ slopes)[lower])
        np.add.at(self.border, places, transposed @ shared)
        rows = shared.reshape(shared.shape[0] * shared.shape[1], shared.shape[2])
        self.corner[:] += rows.T @ rows

    @property
    def diagonal(self) -> Array:
        """Entries of the diagonal."""
        return np.append(self.band[0], np.diag(self.corner))

    def with_diagonal(self, more: Array | float) -> Arrow:
        """The matrix with something added to its diagonal."""
        n_band = len(self.border)
        more = np.broadcast_to(more, n_band + len(self.corner))
        band = self.band.copy()
        band[0] += more[:n_band]
        return Arrow(band, self.border, self.corner + np.diag(more[n_band:]))

    def in_units(self, unit: Array) -> Arrow:
        """The matrix of unknowns in other units."""
        of_band, of_corner = np.split(unit, [len(self.border)])
        band = self.band * of_band
        for d in range(len(band)):
            band[d, : len(of_band) - d] *= of_band[d:]
        border = self.border * of_band[:, None] * of_corner
        return Arrow(band, border, self.corner * of_corner[:, None] * of_corner)

    def __matmul__(self, vector: Array) -> Array:
        """Product with a vector."""
        x, z = np.split(vector, [len(self.border)])
        product = self.border @ z
        for d, entries in enumerate(self.band):
            entries = entries[: len(x) - d]
            product[d:] += entries * x[: len(entries)]
            if d:
                product[: len(entries)] += entries * x[d:]
        return np.append(product, self.border.T @ x + self.corner @ z)

    def toarray(self) -> Array:
        """The whole matrix."""
        return np.array([self @ unit for unit in np.eye(len(self.diagonal))])

    def factor(self) -> Factor:
        """What systems are solved by; LinAlgError where the matrix is not positive."""
        band = cholesky_banded(self.band, lower=True, check_finite=False)
        reached = cho_solve_banded((band, True), self.border, check_finite=False)
        corner = cho_factor(self.corner - self.border.T @ reached, check_finite=False)
        return Factor(band, self.border, reached, corner)


@dataclass(frozen=True)
class Factor:
    """A positive matrix factored."""

    band: Array  # lower factor of B
    border: Array
    reached: Array  # B^-1 E
    corner: tuple[Array, bool]  # factor of S

    def solve(self, right: Array) -> Array:
        """The solution of one system."""
        b, d = np.split(right, [len(self.border)])
        x = cho_solve_banded((self.band, True), b, check_finite=False)
        z = self._over_corner(d - self.border.T @ x)
        return np.append(x - self.reached @ z, z)

    @property
    def inverse_of_corner(self) -> Array:
        """The corner of the inverse."""
        return self._over_corner(np.eye(self.border.shape[1]))

    def _over_corner(self, right: Array) -> Array:
        """S^-1 times a vector or a matrix."""
        # SciPy before 1.14 refuses systems without unknowns, those of a matrix without corner.
        if not right.size:
            return right
        return np.asarray(cho_solve(self.corner, right, check_finite=False))

    def diagonal_of_inverse(self, places: NDArray[np.intp]) -> Array:
        """Diagonal entries of the inverse, of places in the band."""
        units = np.zeros((len(self.border), len(places)))
        units[places, np.arange(len(places))] = 1.0
        inverse = cho_solve_banded((self.band, True), units, check_finite=False)
        own = self.reached[places]
        bordered = np.einsum("pi,ij,pj->p", own, self.inverse_of_corner, own)
        return np.asarray(inverse[places, np.arange(len(places))] + bordered)
