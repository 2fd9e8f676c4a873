"""What a hybrid automaton consists of, and what follows from that at once.

That is also the mode in which a rollout starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.transitions import (
    AffineReset,
    Transition,
    check_transition,
    guard_of,
)
from swsysid._checks.parameters import flag, whole
from swsysid._data.coordinates import Extent
from swsysid._data.features import FeatureMap
from swsysid._results import Array
from swsysid._simulation.system import Laws

# Past rows that a law may see: more is a slip of the hand.
_MOST_LAGS = 1000


class RunningMap(Laws, Protocol):
    """An automaton in discrete time as its rollouts ask for it."""

    @property
    def transitions(self) -> tuple[Transition, ...]:
        """In the order in which they are taken."""

    @property
    def lags(self) -> int:
        """Past rows that the laws see."""

    def affine_law(self, mode: int) -> tuple[Array, Array, Array] | None:
        """Matrix, constant and matrix of the inputs of the law of a mode, if it is affine."""

    @property
    def n_states(self) -> int:
        """Number of states, without their lags."""

    @property
    def n_inputs(self) -> int:
        """Number of inputs that guards see, without their lags; the laws may see further ones."""


@dataclass(frozen=True, eq=False)
class AutomatonParts:
    """Modes with a law each, and transitions between them; see `HybridAutomaton`."""

    coef: Array
    feature_map: FeatureMap
    transitions: tuple[Transition, ...]
    discrete_time: bool = False
    lags: int = 0
    first_modes: FirstModes | None = None

    def __post_init__(self):
        check_lags(self.discrete_time, self.lags)
        n_features = self.feature_map.n_features_out
        if not np.isfinite(self.coef).all():
            raise ValueError("coef holds NaN or infinity; give finite numbers.")
        if self.coef.ndim != 3 or self.coef.shape[2] != n_features:
            raise ValueError(
                f"coef has shape {self.coef.shape}; give (n_modes, n_states, {n_features}), one "
                "column for each feature."
            )
        n_columns = len(self.feature_map.names_in)
        if n_columns % (self.lags + 1) or self.n_inputs < 0:
            raise ValueError(
                f"the laws have {n_columns} columns; give those of {self.n_states} states and of "
                f"the inputs, each {self.lags + 1} times."
            )
        sizes = self.n_states, self.n_lagged
        for number, transition in enumerate(self.transitions):
            check_transition(number, transition, self.n_modes, n_columns, sizes)

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.coef)

    @property
    def n_states(self) -> int:
        """Number of states, without their lags."""
        return self.coef.shape[1]

    @property
    def n_lagged(self) -> int:
        """Number of columns of the laws that are states, the lagged ones included."""
        return self.n_states * (self.lags + 1)

    @property
    def n_inputs(self) -> int:
        """Number of inputs, without their lags."""
        return len(self.feature_map.names_in) // (self.lags + 1) - self.n_states

    @property
    def extent(self) -> Extent | None:
        """Where the states were in the recordings, None where the automaton was stated."""
        if self.first_modes is None:
            return None
        return Extent.of(self.first_modes.states[:, : self.n_states])

    @property
    def state_names(self) -> list[str]:
        """Names of the states."""
        return _without_row(self.feature_map.names_in[: self.n_states])

    @property
    def input_names(self) -> list[str]:
        """Names of the inputs."""
        return _without_row(self.feature_map.names_in[self.n_lagged :][: self.n_inputs])

    @property
    def parameters(self) -> Array:
        """Coefficients of the laws, then of guard and reset of each transition.

        Those of a guard are those of its conditions, those of a reset offset and matrix row by row.
        """
        parts = [self.coef]
        for one in self.transitions:
            parts += [condition.coef for condition in one.guard.conditions]
            if one.reset is not None:
                parts.append(np.column_stack([one.reset.offset, one.reset.matrix]))
        return np.concatenate([np.ravel(part) for part in parts])

    def with_parameters(self, parameters: Array) -> Self:
        """The same automaton with other coefficients."""
        coef, rest = np.split(parameters, [self.coef.size])
        transitions = []
        for one in self.transitions:
            conditions, reset = [], one.reset
            for condition in one.guard.conditions:
                own, rest = np.split(rest, [len(condition.coef)])
                conditions.append(replace(condition, coef=own))
            if reset is not None:
                n_rows = len(reset.offset)
                own, rest = np.split(rest, [n_rows * (n_rows + 1)])
                maps = own.reshape(n_rows, -1)
                reset = AffineReset(maps[:, 1:], maps[:, 0])
            transitions.append(replace(one, guard=guard_of(conditions), reset=reset))
        coef = coef.reshape(self.coef.shape)
        return replace(self, coef=coef, transitions=tuple(transitions))

    @property
    def guard_columns(self) -> list[str]:
        """Names of the columns of guards: those of the laws, then the clocks."""
        return [*self.feature_map.names_in, *CLOCKS]

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """The velocity, or the next state, in one mode.

        Parameters
        ----------
        x : ndarray of shape (n_lagged,)
            States; with lags x[k], x[k-1], ..., x[k-lags].
        u : ndarray of shape (n_inputs * (lags + 1),)
        mode : int

        Returns
        -------
        ndarray of shape (n_states,)
        """
        return self.coef[mode] @ self.feature_map.at(np.concatenate([x, u]))

    def affine_law(self, mode: int) -> tuple[Array, Array, Array] | None:
        """Matrix, constant and matrix of the inputs of the law of a mode, if it is affine."""
        powers = self.feature_map.powers
        if powers is None or powers.sum(axis=1).max(initial=0) > 1:
            return None
        law = self.coef[mode] @ powers
        constant = self.coef[mode][:, ~powers.any(axis=1)].sum(axis=1)
        return law[:, : self.n_lagged], constant, law[:, self.n_lagged :]


def check_lags(discrete_time: bool, lags: int) -> None:
    """Refuse past rows in continuous time, and more of them than anyone can use."""
    flag("discrete_time", discrete_time)
    whole("lags", lags, least=0, most=_MOST_LAGS if discrete_time else 0)


def _without_row(names: list[str]) -> list[str]:
    """Names of newest columns without what tells that they are the newest."""
    return [name.removesuffix("[k]") for name in names]


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

    def nearest(self, state: Array, among: Sequence[int]) -> int | None:
        """The mode, of some, whose recorded states come nearest in units of their deviation.

        None where none of them was recorded.
        """
        spread = self.states.std(axis=0)
        distances = (self.states - state) / np.where(spread > 0.0, spread, 1.0)
        known = np.isin(self.modes, among)
        if not known.any():
            return None
        return int(self.modes[np.where(known, (distances**2).sum(axis=1), np.inf).argmin()])


def first_mode(
    transitions: Sequence[Transition],
    n_modes: int,
    columns: Array,
    state: Array,
    recorded: FirstModes | None,
) -> int:
    """The only mode that no guard leads out of at the start, else the one recorded nearest.

    `columns` are those of guards at the start; `state` its columns of states.
    """
    left = {one.source for one in transitions if one.guard.at(columns) >= 0.0}
    possible = [mode for mode in range(n_modes) if mode not in left] or list(range(n_modes))
    if len(possible) == 1:
        return possible[0]
    nearest = None if recorded is None else recorded.nearest(state, possible)
    if nearest is None:
        listed = ", ".join(map(str, possible))
        raise ValueError(f"the guards leave the modes {listed} possible at the start; give mode.")
    return nearest
