r"""Gauss and Newton's equations of recordings with a node at every time.

A node is tied to the next one only, so that the matrix of all nodes is block tridiagonal,
:math:`D_k` on the diagonal and :math:`O_k` below; coefficients of laws and surfaces border it.
A switch instant :math:`\tau` touches one interval: with its own column g and diagonal entry s it is
eliminated there,

.. math:: H - \frac{g g^\top}{s}, \qquad r - \frac{g \, r_\tau}{s}, \qquad
          \delta_\tau = \frac{r_\tau - g^\top \delta}{s},

which changes two nodes and the border, and no band gets wider. An instant since which a clock runs
that tells a later switch touches that one, too, and stays in the border. Nodes inside of stays are
eliminated in pairs (`segments`); one banded Cholesky factor of the others with the border as
further right-hand sides then solves everything (`arrow`).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from swsysid._known.program import Steps
from swsysid._results import Array
from swsysid._stays.arrow import Arrow, Factor
from swsysid._stays.flow import Legs
from swsysid._stays.nodes import Rows
from swsysid._stays.segments import Eliminated, Ties
from swsysid._stays.settings import LIMITS

_MORE_ROUNDING = 100.0  # by which that of the diagonal grows until equations can be solved
_UNTOLD = 0.1  # part of a direction that nothing else tells, of a coefficient in it


@dataclass
class NodeEquations:
    """The matrix, the negative gradient and the value, summed up from blocks of residuals.

    States are in units in which the noise is one. The corner are coefficients of laws, of guards
    and of resets, and the instants that are not eliminated.
    """

    shape: tuple[int, int]  # (n_nodes, n_states)
    n_laws: int
    n_guards: int
    n_resets: int
    unit: Array  # (n_states,): of the nodes
    at: Rows  # (n_switches,): node before each switch
    kept: NDArray[np.bool_]  # (n_nodes,): those that are not inside of a segment
    since: Rows  # numbers of the switches since which a clock runs that tells another one
    hold: float  # what holds an instant where it is
    steps: Steps | None = None  # of the coefficients of laws, that are allowed
    value: float = 0.0
    of_samples: Array = field(init=False)  # (n_states, n_nodes): diagonal of the samples
    right_of_samples: Array = field(init=False)  # likewise
    right: Array = field(init=False)  # (n_states, n_nodes)
    segments: list[Ties] = field(init=False, default_factory=list)
    diagonal: Array = field(init=False)  # (n_states, n_states, n_kept): of the other ties
    below: Array = field(init=False)  # likewise: rows of the next node, columns of this one
    border: Array = field(init=False)  # (n_corner, n_states, n_kept)
    corner: Array = field(init=False)
    right_of_corner: Array = field(init=False)
    own: Array = field(init=False)  # (n_switches, 2 n_states): g of both nodes of a switch
    shared: Array = field(init=False)  # (n_switches, n_corner): and of the corner
    stiffness: Array = field(init=False)  # (n_switches,): s
    right_of_instants: Array = field(init=False)

    def __post_init__(self) -> None:
        (n_nodes, n), n_switches, n_kept = self.shape, len(self.at), int(self.kept.sum())
        n_corner = self.n_laws + self.n_guards + self.n_resets + len(self.since)
        self.place = np.cumsum(self.kept) - 1  # of kept nodes among these
        self.of_samples, self.right_of_samples, self.right = np.zeros((3, n, n_nodes))
        self.diagonal, self.below = np.zeros((n, n, n_kept)), np.zeros((n, n, n_kept))
        self.border = np.zeros((n_corner, n, n_kept))
        self.corner, self.right_of_corner = np.zeros((n_corner, n_corner)), np.zeros(n_corner)
        self.own = np.zeros((n_switches, 2 * n))
        self.shared = np.zeros((n_switches, n_corner))
        self.stiffness, self.right_of_instants = np.zeros(n_switches), np.zeros(n_switches)

    @property
    def n_states(self) -> int:
        """Number of states."""
        return self.shape[1]

    # -- residuals ---------------------------------------------------------------------------

    def add_samples(self, misfit: Array, slopes: Array) -> None:
        """Misfits of the samples in units of their noise, and minus their slopes by the nodes.

        Both are zero where nothing was measured.
        """
        self.of_samples += np.square(slopes).T
        self.right_of_samples += (misfit * slopes).T
        self.right += self.right_of_samples
        self.value += 0.5 * float(np.square(misfit).sum())

    def add_ties(self, legs: Legs, nodes: Rows, gaps: Array, weight: Array) -> None:
        """Gaps (n_rows, n_states), tied by weights (n_states, n_rows), in these units."""
        F, G = self._in_units(legs)
        weight = weight[:, : F.shape[2]]  # one of all where they last equally long
        H = np.empty((len(G) + 1, *G.shape[1:]))
        np.multiply(G, weight, out=H[:-1])
        np.multiply(gaps.T, weight, out=H[-1])
        ties = Ties.of(legs.columns, nodes.reshape(legs.n_joined, -1), weight * F, H, weight)
        self.right[:, ties.before] += ties.of_before[-1]
        self.right[:, ties.after] += ties.of_after[-1]
        self.right_of_corner[legs.columns] += ties.corner[-1, :-1]
        self.value += 0.5 * float(ties.corner[-1, -1])
        self.corner[np.ix_(legs.columns, legs.columns)] += ties.corner[:-1, :-1]
        if legs.n_joined > 1:
            self.segments.append(ties)
        else:
            self._put(ties, self.diagonal, self.below, self.border)

    def _put(self, ties: Ties, diagonal: Array, below: Array, border: Array) -> None:
        """Add what joined intervals say of kept nodes."""
        first, after = self.place[ties.before[0]], self.place[ties.after[0]]
        diagonal[:, :, first] += ties.before_before[:, :, 0]
        diagonal[:, :, after] += ties.after_after[:, :, 0]
        below[:, :, first] += ties.before_after[:, :, 0].swapaxes(0, 1)
        columns = ties.columns[:, None, None], np.arange(self.n_states)[:, None]
        border[*columns, first] += ties.of_before[:-1, :, 0]
        border[*columns, after] += ties.of_after[:-1, :, 0]

    def add_instants(self, legs: Legs, by_instant: Array, gaps: Array, weight: Array) -> None:
        """What the gaps of the intervals with a switch say of its instant."""
        by_instant, square = by_instant / self.unit, np.square(weight).T
        moved = (square * by_instant).T  # (n_states, n_switches)
        F, G = self._in_units(legs)
        self.own[:, : self.n_states] += np.einsum("bar,ar->rb", F, moved)
        self.own[:, self.n_states :] -= moved.T
        self.shared[:, legs.columns] += np.einsum("par,ar->rp", G, moved)
        self.stiffness += (square * np.square(by_instant)).sum(axis=1)
        self.right_of_instants += (square * by_instant * gaps).sum(axis=1)

    def hold_instants(self, known: NDArray[np.bool_], ends: NDArray[np.intp]) -> None:
        """Leave those where they are that are known, or cannot be later (1) or sooner (-1)."""
        held = known | (ends * self.right_of_instants > 0.0)
        for part in (self.own, self.shared, self.stiffness, self.right_of_instants):
            part[held] = 0.0

    def add_misses(
        self, switches: Rows, left: Array, by_state: Array, by_corner: Array, by_instant: Array
    ) -> None:
        """Crossings that miss their surface by `left` (n_used,), with derivatives of that."""
        by_state = by_state * self.unit
        first = self.place[self.at[switches]]
        # a node has one switch at most, so that no place is met twice
        self.diagonal[:, :, first] += _outer(by_state, by_state)
        self.border[:, :, first] += _outer(by_corner, by_state)
        self.right[:, self.at[switches]] -= (by_state * left[:, None]).T
        self.corner += by_corner.T @ by_corner
        self.right_of_corner -= by_corner.T @ left
        self.own[switches, : self.n_states] += by_state * by_instant[:, None]
        self.shared[switches] += by_corner * by_instant[:, None]
        self.stiffness[switches] += np.square(by_instant)
        self.right_of_instants[switches] -= by_instant * left

    def add_sides(self, matrix: Array, right: Array) -> None:
        """Equations of the coefficients of surfaces alone."""
        own = slice(self.n_laws, self.n_laws + self.n_guards)
        self.corner[own, own] += matrix
        self.right_of_corner[own] += right

    def keep_instants(self) -> None:
        """Move what was said of the instants since which clocks run to the border."""
        since, first = self.since, self.place[self.at[self.since]]
        places = self.n_shared + np.arange(len(since))
        before, after = np.split(self.own[since], 2, axis=1)
        self.border[places, :, first] += before
        self.border[places, :, first + 1] += after
        self.corner[places] += self.shared[since]
        self.corner[:, places] += self.shared[since].T
        self.corner[places, places] += self.stiffness[since]
        self.right_of_corner[places] += self.right_of_instants[since]
        for part in (self.own, self.shared, self.stiffness, self.right_of_instants):
            part[since] = 0.0

    def _in_units(self, legs: Legs) -> tuple[Array, Array]:
        """Derivatives by states and by laws, both of states in units of the noise."""
        unit = self.unit[:, None]
        return legs.by_state * (self.unit[:, None, None] / unit), legs.by_law / unit

    # -- solving -----------------------------------------------------------------------------

    def step(self, damping: float) -> tuple[Array, float]:
        """The step of damped equations, and by how much it should lower the value.

        Nodes are damped as their samples hold them, not as stiffly as they are tied: the ties would
        else keep whole trajectories where they are. Laws and surfaces are damped by what is known
        of them once nodes and instants are eliminated.
        """
        least = LIMITS.rounding * np.where(np.diag(self.corner) > 0.0, np.diag(self.corner), 1.0)
        least[self.n_shared :] += self.hold * (1.0 + damping)
        try:
            matrix, right, turns = self._reduced(self.hold * (1.0 + damping), damping)
            within = None if self.steps is None else self.steps.padded(len(self.corner))
            factor = matrix.factor(damping, least, within)
        except LinAlgError:  # not positive by rounding, or not finite
            return np.zeros(self._n_unknowns), 0.0
        nodes, corner = np.split(factor.solve(right), [len(right) - len(self.corner)])
        states = np.empty(self.right.shape)
        states[:, self.kept] = nodes.reshape(-1, self.n_states).T
        for columns, eliminated in reversed(turns):
            eliminated.told(states, corner[columns])
        both = np.vstack([states[:, self.at], states[:, self.at + 1]]).T
        s = self.stiffness + self.hold * (1.0 + damping)
        moves = (self.own * both).sum(axis=1) + self.shared @ corner
        instants = (self.right_of_instants - moves) / s
        instants[self.since] = corner[self.n_shared :]
        gained = (self.right * states).sum() + self.right_of_corner @ corner
        gained += self.right_of_instants @ instants
        held = damping * (np.square(states).sum() + self.hold * np.square(instants).sum())
        if within is not None:  # steps that bounds end, or that must reach a level
            gained += corner @ factor.held_back(right, corner)
        promised = 0.5 * float(gained + held + factor.more @ np.square(corner))
        laws, others = np.split(corner[: self.n_shared], [self.n_laws])
        step = np.concatenate([laws, (states.T * self.unit).ravel(), instants, others])
        return (step, promised) if np.isfinite(step).all() else (np.zeros(len(step)), 0.0)

    @property
    def negative_gradient(self) -> Array:
        """By all unknowns, in the order of their steps."""
        laws, others = np.split(self.right_of_corner[: self.n_shared], [self.n_laws])
        instants = self.right_of_instants.copy()
        instants[self.since] = self.right_of_corner[self.n_shared :]
        return np.concatenate([laws, (self.right.T / self.unit).ravel(), instants, others])

    def reduced(self) -> tuple[Arrow, Array]:
        """The matrix of nodes, laws and surfaces, instants eliminated, and what is right of it."""
        return self._reduced(LIMITS.rounding * self.hold, LIMITS.rounding)[:2]

    def covariance(self) -> Covariance:
        """That of the unknowns; what nothing tells is held a little.

        LinAlgError where nodes and laws held as by a sample are no positive matrix.
        """
        hold = LIMITS.rounding * self.hold
        unit = 1.0 / np.sqrt(np.where(np.diag(self.corner) > 0.0, np.diag(self.corner), 1.0))
        held = LIMITS.rounding
        while True:
            try:
                matrix = self._reduced(hold, held)[0]
                within = self._at_bounds(unit)
                factor = matrix.in_units(unit).factor(least=held, within=within).checked()
                return Covariance(
                    factor, unit, held, self.n_laws, self.n_guards, self.place[self.at], self.own,
                    self.shared, self.stiffness + hold, self.since,
                )  # fmt: skip
            except LinAlgError:  # not positive by rounding
                if held > 1.0:
                    raise
                held *= _MORE_ROUNDING

    def _at_bounds(self, unit: Array) -> Steps | None:
        """Steps in some units that change no equality and leave no bound."""
        if self.steps is None:
            return None
        own = self.steps.at_bounds(self.corner[: self.n_laws, : self.n_laws])
        return own.padded(len(unit)).in_units(unit)

    def _reduced(
        self, hold: float, of_nodes: float
    ) -> tuple[Arrow, Array, list[tuple[Rows, Eliminated]]]:
        """The matrix of kept nodes and corner, what is right of it, and how the others follow."""
        n, kept = self.n_states, self.kept
        diagonal, below, border = self.diagonal.copy(), self.below.copy(), self.border.copy()
        corner, right_of_corner = self.corner.copy(), self.right_of_corner.copy()
        of_samples, right, every = self.of_samples + of_nodes, self.right.copy(), np.arange(n)
        diagonal[every, every] += of_samples[:, kept]
        turns = []
        for segment in self.segments:
            ties, eliminated = segment.joined(of_samples, self.right_of_samples)
            self._put(ties, diagonal, below, border)
            right[:, ties.before[0]] += ties.of_before[-1, :, 0] - segment.of_before[-1, :, 0]
            right[:, ties.after[0]] += ties.of_after[-1, :, 0] - segment.of_after[-1, :, -1]
            change, columns = ties.corner - segment.corner, ties.columns
            corner[np.ix_(columns, columns)] += change[:-1, :-1]
            right_of_corner[columns] += change[-1, :-1]
            turns += [(columns, one) for one in eliminated]
        # instants
        right, first, s = right[:, kept], self.place[self.at], self.stiffness + hold
        before, after = self.own[:, :n], self.own[:, n:]
        scaled = self.own / s[:, None]
        # a node has one switch at most: no place is met twice
        diagonal[:, :, first] -= _outer(before, scaled[:, :n])
        diagonal[:, :, first + 1] -= _outer(after, scaled[:, n:])
        below[:, :, first] -= _outer(after, scaled[:, :n])
        border[:, :, first] -= _outer(self.shared, scaled[:, :n])
        border[:, :, first + 1] -= _outer(self.shared, scaled[:, n:])
        moved = self.right_of_instants / s
        right[:, first] -= (before * moved[:, None]).T
        right[:, first + 1] -= (after * moved[:, None]).T
        corner -= self.shared.T @ (self.shared / s[:, None])
        right_of_corner -= self.shared.T @ moved
        arrow = Arrow.of_blocks(diagonal, below, border.transpose(0, 2, 1), corner)
        return arrow, np.append(right.T.ravel(), right_of_corner), turns

    @property
    def n_shared(self) -> int:
        """Number of coefficients of laws, guards and resets."""
        return self.n_laws + self.n_guards + self.n_resets

    @property
    def _n_unknowns(self) -> int:
        return self.right.size + self.n_shared + len(self.at)


def _outer(first: Array, second: Array) -> Array:
    """Products of rows, (n, m, n_rows)."""
    return first.T[:, None, :] * second.T[None, :, :]


@dataclass(frozen=True)
class Covariance:
    """Covariance of the unknowns."""

    factor: Factor
    unit: Array  # of the corner
    held: float  # the share of the diagonal that holds what the data do not tell
    n_laws: int
    n_guards: int
    at: Rows  # what the equations say of instants: node before each, and their columns
    own: Array
    shared: Array
    stiffness: Array
    since: Rows  # numbers of those that are in the corner

    @property
    def untold_laws(self) -> NDArray[np.bool_]:
        """Free coefficients of the laws of which nothing but what holds them tells."""
        return self._untold[: self.n_laws]

    @property
    def of_laws(self) -> Array:
        """Of the free coefficients of the laws."""
        n = self.n_laws
        return self._in_own_units[:n, :n]

    @property
    def of_guards(self) -> Array:
        """Of the free coefficients of the surfaces."""
        n, n_guards = self.n_laws, self.n_guards
        return self._in_own_units[n : n + n_guards, n : n + n_guards]

    @property
    def of_shared(self) -> Array:
        """Of those of laws, guards and resets; the variance of what nothing tells is infinite."""
        n = len(self.unit) - len(self.since)
        own = self._in_own_units[:n, :n]
        every = np.arange(n)
        own[every, every] = np.where(self._untold[:n], np.inf, own[every, every])
        return own

    @property
    def variances_of_instants(self) -> Array:
        """Of every instant."""
        n_own, n_since = self.own.shape[1], len(self.since)
        places = self.at[:, None] * (n_own // 2) + np.arange(n_own)
        form = self.factor.quadratic_form(places, self.own, self.shared * self.unit)
        variances = 1.0 / self.stiffness + form / np.square(self.stiffness)
        variances[self.since] = np.diag(self._in_own_units)[len(self.unit) - n_since :]
        return np.asarray(variances)

    @cached_property
    def _corner(self) -> Array:
        return self.factor.inverse_of_corner

    @property
    def _untold(self) -> NDArray[np.bool_]:
        return np.asarray(np.diag(self._corner) > _UNTOLD / self.held)

    @property
    def _in_own_units(self) -> Array:
        return np.asarray(self._corner * self.unit[:, None] * self.unit)
