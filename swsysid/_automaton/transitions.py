"""What makes an automaton switch: guards that rise to zero, resets of the state, transitions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.parameters import real
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

    def gradient(self, point: Array) -> Array:
        """The derivatives by the columns at one row of them, (n_columns + 2,)."""
        gradient = np.zeros(len(point))
        for column, (slopes, monomials) in self._derivatives.items():
            gradient[column] = monomials.at(point) @ slopes
        return gradient

    def terms(self, point: Array) -> Array:
        """The terms whose sum is the value at one row of columns, (n_monomials,)."""
        return self._monomials.at(point) * self.coef

    @property
    def conditions(self) -> tuple[PolynomialGuard, ...]:
        """Itself: the one polynomial that is not negative where the guard holds."""
        return (self,)

    @cached_property
    def _monomials(self) -> Monomials:
        return Monomials(self.powers)

    @cached_property
    def _derivatives(self) -> dict[int, tuple[Array, Monomials]]:
        """Coefficients and monomials of the derivative by each column that occurs."""
        derivatives = {}
        for column in np.flatnonzero(self.powers.any(axis=0)).tolist():
            kept = self.powers[:, column] > 0
            lower = self.powers[kept].copy()
            lower[:, column] -= 1
            derivatives[column] = self.coef[kept] * self.powers[kept, column], Monomials(lower)
        return derivatives


@dataclass(frozen=True, eq=False)
class ConjunctiveGuard:
    """Several polynomials; its transition is taken where the last of them rises to zero.

    The guard is the least of its conditions: it holds where all are not negative.

    Attributes
    ----------
    conditions : tuple of PolynomialGuard
        At least two, of the same columns.

    Examples
    --------
    A valve lets a tank drain through a side outlet, above x = 1 and while y is negative:

    >>> import numpy as np
    >>> from swsysid.results import ConjunctiveGuard, PolynomialGuard
    >>> above = PolynomialGuard(np.array([1.0, -1.0]), np.array([[1, 0, 0, 0], [0, 0, 0, 0]]))
    >>> below = PolynomialGuard(np.array([-1.0]), np.array([[0, 1, 0, 0]]))
    >>> guard = ConjunctiveGuard((above, below))
    >>> guard.values(np.array([[2.0, -3.0, 0, 0], [2.0, 3.0, 0, 0], [0.5, -3.0, 0, 0]])) >= 0.0
    array([ True, False, False])
    """

    conditions: tuple[PolynomialGuard, ...]

    def values(self, columns: Array) -> Array:
        """Values at rows of columns, (n_rows, n_columns + 2) -> (n_rows,)."""
        return np.asarray(np.min([one.values(columns) for one in self.conditions], axis=0))

    def at(self, point: Array) -> float:
        """The value at one row of columns, (n_columns + 2,)."""
        return min(one.at(point) for one in self.conditions)

    def gradient(self, point: Array) -> Array:
        """The derivatives by the columns at one row of them, (n_columns + 2,)."""
        return self._last(point).gradient(point)

    def terms(self, point: Array) -> Array:
        """The terms whose sum is the value at one row of columns."""
        return self._last(point).terms(point)

    def _last(self, point: Array) -> PolynomialGuard:
        """The condition that is least at a row: the last to become true."""
        return min(self.conditions, key=lambda one: one.at(point))


Guard = PolynomialGuard | ConjunctiveGuard


def guard_of(conditions: Sequence[PolynomialGuard]) -> Guard:
    """The guard that holds where all conditions do."""
    return conditions[0] if len(conditions) == 1 else ConjunctiveGuard(tuple(conditions))


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
    guard : PolynomialGuard or ConjunctiveGuard
        Taken where it rises to zero.
    reset : AffineReset or None
        What becomes of the state; None where it goes on.
    support : int
        Number of switches of the data that it explains; 0 for one that was stated.
    asked_every : float or None
        Interval after which the guard is asked, counted from the start of a rollout, as by a
        controller that samples: the transition is taken where it is not negative then. None where
        it is watched all along, and in discrete time. Formulas for other tools do not have it.
    """

    source: int
    target: int
    guard: Guard
    reset: AffineReset | None = None
    support: int = 0
    asked_every: float | None = None

    @property
    def kind(self) -> str:
        """The kind of its events."""
        return "transition" if self.reset is None else "jump"

    def landing(self, x: Array) -> Array:
        """The state after the transition from a state."""
        return x if self.reset is None else self.reset.applied(x)


def check_transition(
    number: int, transition: Transition, n_modes: int, n_columns: int, state_sizes: tuple[int, int]
) -> None:
    """Refuse a transition between modes that there are not, or of another shape than the laws.

    `state_sizes` are those of the state and of the state with its lags.
    """
    which = f"transitions[{number}]"
    if not {transition.source, transition.target} <= set(range(n_modes)):
        raise ValueError(
            f"{which} leads from mode {transition.source} to mode {transition.target}; the modes "
            f"are numbered from 0 to {n_modes - 1}."
        )
    if transition.asked_every is not None:
        real(f"asked_every of {which}", transition.asked_every, above=0.0)
    reset = transition.reset
    for guard in transition.guard.conditions:
        if guard.powers.shape != (len(guard.coef), n_columns + 2):
            raise ValueError(
                f"the guard of {which} has {len(guard.coef)} coefficients and powers of shape "
                f"{guard.powers.shape}; give ({len(guard.coef)}, {n_columns + 2}): the columns of "
                "the laws, dwell and time."
            )
    numbers = [one.coef for one in transition.guard.conditions]
    numbers += [] if reset is None else [reset.matrix, reset.offset]
    if not all(np.isfinite(values).all() for values in numbers):
        raise ValueError(f"{which} holds NaN or infinity; give finite numbers.")
    sizes = {(size, size) for size in state_sizes}
    if reset is not None and (
        reset.matrix.shape not in sizes or reset.offset.shape != reset.matrix.shape[:1]
    ):
        raise ValueError(
            f"the reset of {which} has a matrix of shape {reset.matrix.shape} and an offset of "
            f"shape {reset.offset.shape}; give ({state_sizes[0]}, {state_sizes[0]}) and "
            f"({state_sizes[0]},)."
        )
