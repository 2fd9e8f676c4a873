"""What a hybrid automaton consists of, and what follows from that at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from swsysid._automaton.columns import CLOCKS
from swsysid._automaton.first_modes import FirstModes
from swsysid._automaton.settings import SETTINGS
from swsysid._automaton.transitions import Transition, check_transition
from swsysid._checks.parameters import flag, whole
from swsysid._data.coordinates import Extent
from swsysid._data.features import FeatureMap
from swsysid._results import Array
from swsysid._simulation.system import Laws


class RunningMap(Laws, Protocol):
    """An automaton in discrete time as its rollouts ask for it."""

    @property
    def transitions(self) -> tuple[Transition, ...]:
        """In the order in which they are taken."""

    @property
    def lags(self) -> int:
        """Past rows that the laws see."""

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


def check_lags(discrete_time: bool, lags: int) -> None:
    """Refuse past rows in continuous time, and more of them than anyone can use."""
    flag("discrete_time", discrete_time)
    whole("lags", lags, least=0, most=SETTINGS.most_lags if discrete_time else 0)


def _without_row(names: list[str]) -> list[str]:
    """Names of newest columns without what tells that they are the newest."""
    return [name.removesuffix("[k]") for name in names]
