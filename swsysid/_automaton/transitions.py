"""What makes an automaton switch: guards that rise to zero, resets of the state, transitions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.features import Monomials
from swsysid._results import Array


@dataclass(frozen=True, eq=False)
class PolynomialGuard:
    """A polynomial in states, inputs and clocks; its transition is taken where it rises to zero.

    It is the sum over k of ``coef[k]`` times the product over c of ``column[c] ** powers[k, c]``.
    The columns are those of the laws (states, then inputs; with lags x[k], ..., x[k-lags], u[k],
    ..., u[k-lags]), then ``dwell``, the time since the mode was entered, and ``time``. In discrete
    time both count steps.

    Attributes
    ----------
    coef : ndarray of shape (n_monomials,)
    powers : ndarray of shape (n_monomials, n_columns + 2), int

    Examples
    --------
    A ball touches the ground where minus its height rises to zero:

    >>> import numpy as np
    >>> from swsysid.results import PolynomialGuard
    >>> guard = PolynomialGuard(np.array([-1.0]), np.array([[1, 0, 0, 0]]))
    >>> guard.values(np.array([[2.0, -3.0, 0.1, 0.1], [0.0, -7.0, 0.5, 0.5]])) < 0.0
    array([ True, False])
    """

    coef: Array
    powers: NDArray[np.intp]

    def values(self, columns: Array) -> Array:
        """Values at rows of columns, (n_rows, n_columns + 2) -> (n_rows,)."""
        return self._monomials(columns) @ self.coef

    def at(self, point: Array) -> float:
        """The value at one row of columns, (n_columns + 2,)."""
        return float(self._monomials.at(point) @ self.coef)

    @cached_property
    def _monomials(self) -> Monomials:
        return Monomials(self.powers)


@dataclass(frozen=True, eq=False)
class AffineReset:
    """What becomes of the state where a transition is taken: ``matrix @ x + offset``.

    With lags it is the newest state that jumps, or, if the matrix is of its size, the whole lagged
    state x[k], ..., x[k-lags] in one vector.

    Attributes
    ----------
    matrix : ndarray of shape (n_states, n_states)
    offset : ndarray of shape (n_states,)

    Examples
    --------
    >>> import numpy as np
    >>> from swsysid.results import AffineReset
    >>> AffineReset(np.diag([1.0, -0.8]), np.zeros(2)).applied(np.array([0.0, -5.0]))
    array([0., 4.])
    """

    matrix: Array
    offset: Array

    def applied(self, x: Array) -> Array:
        """The state after the jump from a state."""
        return self.matrix @ x + self.offset


@dataclass(frozen=True, eq=False)
class Transition:
    """One way out of a mode.

    Attributes
    ----------
    source, target : int
        The modes before and after; the same one for a jump within a mode.
    guard : PolynomialGuard
        Taken where it rises to zero.
    reset : AffineReset or None
        What becomes of the state; None where it goes on.
    support : int
        Number of switches of the data that it explains; 0 for one that was stated.
    """

    source: int
    target: int
    guard: PolynomialGuard
    reset: AffineReset | None = None
    support: int = 0


@dataclass(frozen=True, eq=False)
class FirstModes:
    """States of the recordings with their modes, which tell the mode that a rollout starts in.

    Attributes
    ----------
    states : ndarray of shape (n_rows, n_states * (lags + 1))
        The columns of states of the laws, newest first.
    modes : ndarray of shape (n_rows,), int
    """

    states: Array
    modes: NDArray[np.intp]

    def nearest(self, state: Array, among: NDArray[np.intp]) -> int:
        """The mode, of some, whose recorded states come nearest in units of their deviation."""
        spread = self.states.std(axis=0)
        distances = (self.states - state) / np.where(spread > 0.0, spread, 1.0)
        far = np.where(np.isin(self.modes, among), (distances**2).sum(axis=1), np.inf)
        return int(self.modes[far.argmin()])
