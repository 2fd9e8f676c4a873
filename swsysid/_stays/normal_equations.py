"""Gauss and Newton's equations of multiple shooting, each segment coupled to the next one only."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from swsysid._results import Array
from swsysid._stays.arrow import Arrow, Factor
from swsysid._stays.segments import Segments
from swsysid._stays.settings import LIMITS


@dataclass(frozen=True)
class Layout:
    """Where each unknown stands in the arrow: start and instants of a segment side by side.

    The unknowns are coefficients of laws, starts, instants and coefficients of surfaces, in this
    order; laws and surfaces are the corner.
    """

    starts: NDArray[np.intp]  # (n_segments, n_states): places of the starts
    instants: NDArray[np.intp]  # (n_instants,): of the instants
    n_laws: int
    n_guards: int

    @classmethod
    def of(cls, segments: Segments, n_states: int, n_laws: int, n_guards: int) -> Layout:
        """That of some segments."""
        n = len(segments)
        count = np.bincount(segments.segment, minlength=n)
        first = n_states * np.arange(n) + np.cumsum(count) - count
        starts = first[:, None] + np.arange(n_states)
        instants = first[segments.segment] + n_states + segments.within
        return cls(starts, instants, n_laws, n_guards)

    @property
    def n_band(self) -> int:
        """Number of starts and instants."""
        return self.starts.size + len(self.instants)

    @property
    def n_corner(self) -> int:
        """Number of coefficients of laws and surfaces."""
        return self.n_laws + self.n_guards

    @property
    def width(self) -> int:
        """Of the band: a segment reaches to the end of the next start."""
        ends = np.append(self.starts[1:, -1], self.n_band)
        return int((ends - self.starts[:, 0]).max()) + 1

    @property
    def places(self) -> NDArray[np.intp]:
        """Place of every unknown."""
        corner = self.n_band + np.arange(self.n_corner)
        laws, guards = np.split(corner, [self.n_laws])
        return np.concatenate([laws, self.starts.ravel(), self.instants, guards])


@dataclass(frozen=True)
class NormalEquations:
    """The matrix, the negative gradient and the value at an estimate."""

    layout: Layout
    matrix: Arrow
    right: Array  # in the order of the arrow
    value: float

    @classmethod
    def zeros(cls, layout: Layout) -> NormalEquations:
        """Of no residuals."""
        matrix = Arrow.zeros(layout.n_band, layout.n_corner, layout.width)
        return cls(layout, matrix, np.zeros(layout.n_band + layout.n_corner), 0.0)

    def add(
        self, places: NDArray[np.intp], slopes: Array, shared: Array, left: Array
    ) -> NormalEquations:
        """The same with blocks of residuals `left` (n_blocks, n_rows), and their squares.

        As in `Arrow.add`, `slopes` are minus their derivatives by unknowns of the band, and
        `shared` by those of the corner.
        """
        self.matrix.add(places, slopes, shared)
        np.add.at(self.right, places, np.matmul(left[:, None, :], slopes)[:, 0])
        rows = shared.reshape(left.size, self.layout.n_corner)
        self.right[self.layout.n_band :] += left.ravel() @ rows
        return replace(self, value=self.value + 0.5 * float(np.square(left).sum()))

    def add_to_corner(self, first: int, matrix: Array, right: Array, value: float):
        """The same with equations of the coefficients from the number `first` on."""
        self.matrix.corner[first:, first:] += matrix
        self.right[self.layout.n_band + first :] += right
        return replace(self, value=self.value + value)

    def held(self, hold: Array) -> NormalEquations:
        """The same, every unknown held by a spring of such a stiffness."""
        return replace(self, matrix=self.matrix.with_diagonal(self._in_arrow(hold)))

    def step(self, damping: float) -> Array:
        """The step of damped equations, in the order of the unknowns; none if there is none."""
        unit = _unit(self.matrix.diagonal)
        try:
            factor = self.matrix.in_units(unit).with_diagonal(damping).factor()
        except LinAlgError:  # not positive by rounding, or not finite
            return np.zeros(len(self.right))
        step = factor.solve(self.right * unit) * unit
        return step[self.layout.places] if np.isfinite(step).all() else np.zeros(len(step))

    def promised(self, step: Array) -> float:
        """By how much a step lowers the value, if the equations are right."""
        own = self._in_arrow(step)
        return float(own @ (self.right - 0.5 * (self.matrix @ own)))

    def inverse(self) -> Inverse:
        """The inverse of the matrix; what the data do not tell is very large in it, not zero."""
        unit = _unit(self.matrix.diagonal)
        scaled = self.matrix.in_units(unit)
        scaled = Arrow(*(np.nan_to_num(part) for part in vars(scaled).values()))
        more = LIMITS.rounding
        while True:
            try:
                return Inverse(self.layout, unit, scaled.with_diagonal(more).factor(), more)
            except LinAlgError:  # not positive by rounding
                more *= LIMITS.more_rounding

    def toarray(self) -> Array:
        """The whole matrix, in the order of the unknowns."""
        return self.matrix.toarray()[np.ix_(self.layout.places, self.layout.places)]

    @property
    def negative_gradient(self) -> Array:
        """By all unknowns, in their order."""
        return self.right[self.layout.places]

    def _in_arrow(self, vector: Array) -> Array:
        own = np.empty(len(vector))
        own[self.layout.places] = vector
        return own


@dataclass(frozen=True)
class Inverse:
    """Covariance of the unknowns."""

    layout: Layout
    unit: Array
    factor: Factor
    held: float  # the share of the diagonal that holds what the data do not tell

    @property
    def untold_laws(self) -> NDArray[np.bool_]:
        """Free coefficients of the laws of which nothing but what holds them tells."""
        of_laws = np.diag(self.factor.inverse_of_corner)[: self.layout.n_laws]
        return np.asarray(of_laws > LIMITS.untold / self.held)

    @property
    def of_laws(self) -> Array:
        """Of the free coefficients of the laws."""
        return self._of_corner[: self.layout.n_laws, : self.layout.n_laws]

    @property
    def of_guards(self) -> Array:
        """Of the free coefficients of the surfaces."""
        return self._of_corner[self.layout.n_laws :, self.layout.n_laws :]

    @property
    def variances_of_instants(self) -> Array:
        """Of every instant."""
        places = self.layout.instants
        return np.asarray(self.factor.diagonal_of_inverse(places) * np.square(self.unit[places]))

    @property
    def _of_corner(self) -> Array:
        unit = self.unit[self.layout.n_band :]
        return np.asarray(self.factor.inverse_of_corner * unit[:, None] * unit)


def _unit(diagonal: Array) -> Array:
    """Units in which the diagonal is one."""
    return 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
