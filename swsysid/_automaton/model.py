"""A hybrid automaton whose laws and transitions are known."""

from __future__ import annotations

from dataclasses import dataclass

from swsysid._automaton.transitions import FirstModes, Transition
from swsysid._data.features import FeatureMap
from swsysid._results import Array


@dataclass(frozen=True, eq=False)
class HybridAutomaton:
    """Modes with a law each, and transitions between them.

    Attributes
    ----------
    coef : ndarray of shape (n_modes, n_states, n_features_out)
        The law of each mode: the velocity, or in discrete time the next state, is ``coef[mode]``
        times the features.
    feature_map : FeatureMap
        The features of the columns: states, then inputs; with lags x[k], x[k-1], ..., x[k-lags],
        u[k], ..., u[k-lags].
    transitions : tuple of Transition
    discrete_time : bool
    lags : int
        How many past rows a law in discrete time sees beside the present one.
    first_modes : FirstModes or None
        What tells the mode in which a rollout starts where the guards do not.
    """

    coef: Array
    feature_map: FeatureMap
    transitions: tuple[Transition, ...]
    discrete_time: bool = False
    lags: int = 0
    first_modes: FirstModes | None = None

    @property
    def n_modes(self) -> int:
        """Number of modes."""
        return len(self.coef)

    @property
    def n_states(self) -> int:
        """Number of states, without their lags."""
        return self.coef.shape[1]

    @property
    def n_inputs(self) -> int:
        """Number of inputs, without their lags."""
        return len(self.feature_map.names_in) // (self.lags + 1) - self.n_states
