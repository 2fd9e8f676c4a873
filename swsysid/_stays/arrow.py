r"""Symmetric matrices in the shape of an arrow: block tridiagonal, bordered by full rows.

With B the blocks, E the border and D the corner,

.. math::

    \begin{pmatrix} B & E \\ E^\top & D \end{pmatrix}
    \begin{pmatrix} x \\ z \end{pmatrix} = \begin{pmatrix} b \\ d \end{pmatrix}
    \quad \text{by} \quad
    S z = d - E^\top B^{-1} b, \quad x = B^{-1} (b - E z), \quad S = D - E^\top B^{-1} E

takes a time that grows with the number of unknowns, not with its third power.

What equations of least squares do not tell of their unknowns has an infinite variance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded
from scipy.linalg.lapack import dtbtrs

from swsysid._known.program import Steps
from swsysid._results import Array
from swsysid._stays.settings import LIMITS


@dataclass(frozen=True)
class Arrow:
    """A symmetric matrix; entry (j + d, j) of the band stands at [d, j]."""

    band: Array  # (2 size, n_band)
    border: Array  # (n_band, n_corner)
    corner: Array  # (n_corner, n_corner)

    @classmethod
    def of_blocks(cls, diagonal: Array, below: Array, border: Array, corner: Array) -> Arrow:
        """From blocks (size, size, n_blocks) on the diagonal and below it.

        Block k of `below` stands in the rows of block k + 1; the border is (n_corner, n_blocks,
        size).
        """
        size, n_blocks = diagonal.shape[1:]
        band = np.zeros((2 * size, n_blocks * size))
        for column in range(size):
            for row in range(size):
                if row >= column:
                    band[row - column, column::size] = diagonal[row, column]
                band[size + row - column, column::size] = below[row, column]
        return cls(band, border.reshape(len(border), n_blocks * size).T, corner)

    def in_units(self, unit: Array) -> Arrow:
        """The matrix of other units in the corner."""
        corner = self.corner * unit[:, None] * unit
        return replace(self, border=self.border * unit, corner=corner)

    def factor(
        self, damping: float = 0.0, least: Array | float = 0.0, within: Steps | None = None
    ) -> Factor:
        """What systems are solved by; LinAlgError where the matrix is not positive.

        The diagonal of S grows by a share of its own, and by what it has at least. Where z must be
        `within` some steps, a solution is the least of the quadratic form among these.
        """
        band, schur = self._eliminated[0], self.schur.copy()
        more = damping * np.maximum(np.diag(schur), 0.0) + least
        schur[np.diag_indices_from(schur)] += more
        corner = Corner(schur) if within is None else CornerWithin(schur, within)
        return Factor(band, self.border, corner, more)

    @property
    def schur(self) -> Array:
        """What S says of the corner once the band is eliminated."""
        return self._eliminated[2]

    def pull(self, right: Array) -> Array:
        """What a right side says of the corner once the band is eliminated."""
        b, d = np.split(right, [len(self.border)])
        band, half, _ = self._eliminated
        return np.asarray(d - half.T @ _forward(band, b))

    @property
    def log_det_of_band(self) -> float:
        """Logarithm of the determinant of B."""
        return 2.0 * float(np.log(self._eliminated[0][0]).sum())

    @cached_property
    def _eliminated(self) -> tuple[Array, Array, Array]:
        """Lower factor L of B, L^-1 E, and S.

        Of a border that stands in memory column after column that takes a fourth of B^-1 E.
        """
        band = cholesky_banded(self.band, lower=True, check_finite=False)
        half = _forward(band, self.border)
        return band, half, self.corner - half.T @ half


@dataclass(frozen=True)
class Factor:
    """A positive matrix factored."""

    band: Array  # lower factor of B
    border: Array
    corner: Corner  # S
    more: Array  # what was added to the diagonal of S

    def solve(self, right: Array) -> Array:
        """The solution of one system."""
        b, d = np.split(right, [len(self.border)])
        z = self.corner.solve(d - self.border.T @ self._over(b))
        return np.append(self._over(b - self.border @ z), z)

    def held_back(self, right: Array, z: Array) -> Array:
        """What pulls at the corner z of a solution: zero but where it must be within steps."""
        b, d = np.split(right, [len(self.border)])
        return np.asarray(d - self.border.T @ self._over(b) - self.corner.matrix @ z)

    def checked(self) -> Factor:
        """The same; LinAlgError where the matrix is not positive within the steps of its corner."""
        self.corner.check()
        return self

    @property
    def inverse_of_corner(self) -> Array:
        """The corner of the inverse."""
        return self.corner.over(np.eye(self.border.shape[1]))

    def quadratic_form(self, places: NDArray[np.intp], own: Array, shared: Array) -> Array:
        """V' A^-1 v of some vectors v (n_vectors,).

        Each has entries `own` (n_vectors, n_own) at `places` of the band, which follow each other
        within its width, and `shared` (n_vectors, n_corner) in the corner.
        """
        left = shared - np.einsum("vi,vic->vc", own, self._over(self.border)[places])
        forms = (left * self.corner.over(left.T).T).sum(axis=1)
        of_place: dict[int, list[int]] = {}
        for number, place in enumerate(places[:, 0].tolist()):
            of_place.setdefault(place, []).append(number)
        # entries of B^-1 next to its diagonal, the last first (Takahashi et al., 1973)
        width, near = len(self.band), np.zeros((len(self.band), len(self.band)))
        size = own.shape[1]
        for place in range(self.band.shape[1] - 1, -1, -1):
            pivot, column = self.band[0, place], self.band[1:, place] / self.band[0, place]
            before = near[: width - 1, : width - 1].copy()
            near[1:, 1:], reach = before, before @ column
            near[1:, 0] = near[0, 1:] = -reach
            near[0, 0] = pivot**-2.0 + column @ reach
            for number in of_place.get(place, ()):
                forms[number] += own[number] @ near[:size, :size] @ own[number]
        return np.asarray(forms)

    def _over(self, right: Array) -> Array:
        """B^-1 times a vector or a matrix."""
        return np.asarray(cho_solve_banded((self.band, True), right, check_finite=False))


def _forward(band: Array, right: Array) -> Array:
    """L^-1 times a vector or a matrix; L in lower banded form."""
    if not right.size:  # which LAPACK does not take
        return right
    return np.asarray(dtbtrs(band, right, uplo="L")[0]).reshape(right.shape)


class Corner:
    """What S says of the unknowns in the corner."""

    def __init__(self, matrix: Array):
        self.matrix, self._factor = matrix, cho_factor(matrix, check_finite=False)

    def check(self) -> None:
        """LinAlgError where S has no inverse, which its factor has told."""

    def over(self, right: Array) -> Array:
        """S^-1 times a vector or a matrix."""
        # SciPy before 1.14 refuses systems without unknowns, those of a matrix without corner.
        if not right.size:
            return right
        return np.asarray(cho_solve(self._factor, right, check_finite=False))

    def solve(self, right: Array) -> Array:
        """The solution of S z = right."""
        return self.over(right)


class CornerWithin(Corner):
    """The same, z within some steps."""

    def __init__(self, matrix: Array, steps: Steps):
        super().__init__(matrix)
        self._steps = steps

    def check(self) -> None:
        """LinAlgError where S is not positive on the steps, by rounding, though it is on all."""
        _ = self._inverse

    @cached_property
    def _inverse(self) -> Array:
        return self._steps.inverse(self.matrix)

    def over(self, right: Array) -> Array:
        """What the equalities leave of S^-1, times a vector or a matrix."""
        return np.asarray(self._inverse @ right)

    def solve(self, right: Array) -> Array:
        """The least z' S z / 2 - right' z of the steps."""
        return self._steps.least(self.matrix, right)


def covariance_of(information: Array, steps: Steps | None = None) -> Array:
    """The inverse of a matrix of least squares, infinite on the diagonal where it tells nothing.

    Unknowns of which only a combination is told, such as rate and constant of a mode that rests at
    its fixed point, are not told either. Equalities of `steps` are met, their bounds are not asked.

    Examples
    --------
    >>> covariance_of(np.array([[4.0, 0.0, 0.0], [0.0, 1.0, 2.0], [0.0, 2.0, 4.0]])).diagonal()
    array([0.25,  inf,  inf])
    """
    inverse, told = pseudo_inverse(information, steps)
    every = np.arange(len(inverse))
    inverse[every, every] = np.where(told, np.diag(inverse), np.inf)
    return inverse


def pseudo_inverse(
    information: Array, steps: Steps | None = None
) -> tuple[Array, NDArray[np.bool_]]:
    """The inverse of a matrix of least squares but for what it does not tell; unknowns it tells."""
    diagonal = np.diag(information)
    unit = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    basis = np.eye(len(unit)) if steps is None else steps.in_units(unit).basis
    sizes, directions = np.linalg.eigh(basis.T @ (information * unit[:, None] * unit) @ basis)
    directions = basis @ directions
    lost = sizes <= LIMITS.rounding * max(1.0, float(sizes.max(initial=0.0)))
    kept = directions[:, ~lost]
    inverse = np.asarray((kept / sizes[~lost]) @ kept.T * unit[:, None] * unit)
    # a direction that is lost is one of all unknowns in it, but for rounding
    share = np.square(directions[:, lost]).sum(axis=1)
    return inverse, share <= LIMITS.exactly
