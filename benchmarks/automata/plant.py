"""What a hybrid automaton is here: laws by their terms, edges with guard and reset, an experiment.

A term is a product of columns, written ``x*v``, or ``1``. Columns are the states, the inputs,
``dwell`` (the time since the mode was entered) and ``time``. With lags, ``y[-1]`` is the state y
one step ago, ``u[-1]`` the input. Dwell and time of a map count steps.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Edge", "Plant", "Polynomial", "Start"]

Array = NDArray[np.float64]
Terms = Mapping[str, float]
CLOCKS = ("dwell", "time")


@dataclass(frozen=True)
class Polynomial:
    """A polynomial in some columns, or several with the same monomials.

    Attributes
    ----------
    coef : ndarray of shape (n_terms,), of several (n_terms, n_polynomials)
    powers : ndarray of shape (n_terms, n_columns), int
    """

    coef: Array
    powers: NDArray[np.intp]

    @classmethod
    def of(cls, terms: Terms, columns: Sequence[str]) -> Polynomial:
        """From terms, whose factors must be among the columns."""
        several = cls.several([terms], columns)
        return cls(several.coef[:, 0], several.powers)

    @classmethod
    def several(cls, polynomials: Sequence[Terms], columns: Sequence[str]) -> Polynomial:
        """Several polynomials as one with a column of coefficients each."""
        union = list(dict.fromkeys(term for terms in polynomials for term in terms))
        powers = np.zeros((len(union), len(columns)), dtype=np.intp)
        for row, term in zip(powers, union, strict=True):
            for name in [] if term == "1" else term.split("*"):
                row[columns.index(name)] += 1
        coef = [[terms.get(term, 0.0) for terms in polynomials] for term in union]
        return cls(np.array(coef, dtype=float).reshape(len(union), len(polynomials)), powers)

    def __call__(self, values: Array) -> Array:
        """Values at points, (..., n_columns) -> (...) or (..., n_polynomials)."""
        return np.prod(values[..., None, :] ** self.powers, axis=-1) @ self.coef

    def gradient(self, values: Array) -> Array:
        """Derivatives of one polynomial at one point, (n_columns,)."""
        lowered = np.maximum(self.powers - np.eye(len(values), dtype=int)[:, None], 0)
        return (self.powers.T * np.prod(values**lowered, axis=-1)) @ self.coef


@dataclass(frozen=True)
class Edge:
    """A transition: taken where its guard rises to zero, or is positive on entry.

    Attributes
    ----------
    source, target : int
    guard : terms
    reset : mapping from a state to the terms, of degree one, that it becomes
        States that are not named go on.
    """

    source: int
    target: int
    guard: Terms
    reset: Mapping[str, Terms] = field(default_factory=dict)


@dataclass(frozen=True)
class Start:
    """Where a recording begins.

    Attributes
    ----------
    x : ndarray of shape (n_states,), with lags (lags + 1, n_states), the oldest row first
    mode : int
    time : float
    """

    x: Array
    mode: int = 0
    time: float = 0.0


@dataclass(frozen=True)
class Plant:
    """A hybrid automaton and the experiment in which it is recorded.

    Attributes
    ----------
    laws : for each mode, from each state to the terms of its velocity, or of its next value
        A state that is not named stands still.
    edges : sequence of Edge
        Of several at one instant the first in this order is taken.
    start : callable
        A `Start` from a random generator and the number of the recording.
    dt : float
        Between two samples; 1 for a map.
    source : str
        Where the equations are published, and what of the experiment is not from there.
    degree, guard_degree : int
        Of the polynomials that an identification is told to use.
    inputs : callable or None
        Inputs (n_times, n_inputs) from a generator and the times of the knots; linear between
        the knots of a flow.
    knot : int
        Samples from one knot to the next.
    is_map : bool
        Discrete time: the laws give the next state.
    lags : int
        How many past rows the laws and guards of a map see beside the present one.
    """

    name: str
    states: Sequence[str]
    laws: Sequence[Mapping[str, Terms]]
    edges: Sequence[Edge]
    start: Callable[[np.random.Generator, int], Start]
    dt: float
    source: str
    degree: int = 1
    guard_degree: int = 1
    input_names: Sequence[str] = ()
    inputs: Callable[[np.random.Generator, Array], Array] | None = None
    knot: int = 1
    is_map: bool = False
    lags: int = 0

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.laws)

    @property
    def n_states(self) -> int:
        """Number of states, without their lags."""
        return len(self.states)

    @property
    def columns(self) -> list[str]:
        """Columns of laws: states, newest first, then inputs."""
        ages = ["", *(f"[-{age}]" for age in range(1, self.lags + 1))]
        return [name + age for names in (self.states, self.input_names)
                for age in ages for name in names]  # fmt: skip

    @property
    def reads_clocks(self) -> bool:
        """Whether a guard reads dwell or time."""
        terms = (term for edge in self.edges for term in edge.guard)
        return any(clock in term.split("*") for term in terms for clock in CLOCKS)

    @property
    def has_one_surface(self) -> bool:
        """Whether the sign of one polynomial of states and inputs says the mode, without memory."""
        if not self.edges:
            return True
        if self.n_modes != 2 or len(self.edges) != 2 or any(edge.reset for edge in self.edges):
            return False
        there, back = (edge.guard for edge in self.edges)
        return not self.reads_clocks and there == {term: -value for term, value in back.items()}

    @cached_property
    def law(self) -> list[Polynomial]:
        """The law of each mode, a polynomial for each state."""
        return [
            Polynomial.several([law.get(state, {}) for state in self.states], self.columns)
            for law in self.laws
        ]

    @cached_property
    def guards(self) -> list[Polynomial]:
        """The guard of each edge, in the columns of laws, dwell and time."""
        return [Polynomial.of(edge.guard, [*self.columns, *CLOCKS]) for edge in self.edges]

    def jumped(self, edge: Edge, x: Array) -> Array:
        """The state after an edge was taken."""
        matrix, offset = self.reset_of(edge)
        return matrix @ x + offset

    def reset_of(self, edge: Edge) -> tuple[Array, Array]:
        """Matrix and offset of the reset of an edge."""
        matrix, offset = np.eye(self.n_states), np.zeros(self.n_states)
        for state, terms in edge.reset.items():
            row = list(self.states).index(state)
            matrix[row] = [terms.get(name, 0.0) for name in self.states]
            offset[row] = terms.get("1", 0.0)
        return matrix, offset
