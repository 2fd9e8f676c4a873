"""A hybrid automaton whose laws and transitions are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from sklearn.base import BaseEstimator

from swsysid._automaton.continuous import follow
from swsysid._automaton.discrete import iterate
from swsysid._automaton.first_modes import FirstModes, first_mode
from swsysid._automaton.stating import StatedLaws, StatedTransition, Statement
from swsysid._automaton.transitions import Transition, check_transition
from swsysid._checks.arrays import state, table
from swsysid._checks.parameters import flag, whole
from swsysid._data.features import FeatureMap
from swsysid._results import Array, Trajectory
from swsysid._simulation.inputs import Options, checked_options, checked_request, stretches
from swsysid._simulation.system import GuardedLaws


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

    @classmethod
    def stated(
        cls,
        laws: StatedLaws,
        transitions: Sequence[StatedTransition] = (),
        *,
        states: Sequence[str],
        inputs: Sequence[str] = (),
        feature_library: BaseEstimator | int | None = None,
        parameters: Mapping[str, float] | None = None,
        discrete_time: bool = False,
        lags: int = 0,
    ) -> HybridAutomaton:
        """An automaton that is written down instead of identified.

        Parameters
        ----------
        laws : list of dict, or array-like of shape (n_modes, n_states, n_features)
            For each mode the velocity (in discrete time the next value) of each state by its name,
            a polynomial as text such as ``"2 x^2 - v"``; or coefficients of the features of
            `feature_library`.
        transitions : list of tuple
            (source, target, guard) or (source, target, guard, reset), or `Transition` objects. A
            guard is one inequality, such as ``"T >= 22"``, in states, inputs, ``dwell`` (time since
            the mode was entered) and ``time``; a reset is a dict from states to affine functions
            of the states, such as ``{"v": "-0.8 v"}``, and leaves the other states alone.
        states, inputs : sequence of str
            Names of the states and of the inputs.
        feature_library : None, int, transformer or PySINDy library, default=None
            What the coefficients of `laws` belong to, as for `SwitchingSystemRegressor`.
        parameters : dict of str to float, default=None
            Values of further names in the texts.
        discrete_time : bool, default=False
            The laws give the next state instead of the velocity; dwell and time count rows.
        lags : int, default=0
            How many past rows the laws see in discrete time; ``x[k-1]`` is the row before.

        Returns
        -------
        HybridAutomaton

        Raises
        ------
        ValueError
            If a text cannot be read or a shape is wrong; the sentence names the place.

        Examples
        --------
        A thermostat heats until 22 degrees and cools down to 20:

        >>> from swsysid import HybridAutomaton
        >>> thermostat = HybridAutomaton.stated(
        ...     [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        ...     [(0, 1, "T >= 22"), (1, 0, "T <= 20")],
        ...     states=["T"],
        ... )
        >>> rollout = thermostat.simulate([20.0], [0.0, 5.0], mode=0)
        >>> [round(event.time, 3) for event in rollout.events]
        [2.231, 4.055]
        """
        flag("discrete_time", discrete_time)
        said = Statement(states, inputs, parameters, whole("lags", lags, least=0))
        coef, features = said.laws(laws, feature_library)
        told = tuple(said.transition(number, one) for number, one in enumerate(transitions))
        return cls(coef, features, told, discrete_time, lags)

    def __post_init__(self):
        flag("discrete_time", self.discrete_time)
        whole("lags", self.lags, least=0, most=None if self.discrete_time else 0)
        n_features = self.feature_map.n_features_out
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
        sizes = self.n_states, self.n_states * (self.lags + 1)
        for number, transition in enumerate(self.transitions):
            check_transition(number, transition, self.n_modes, n_columns, sizes)

    def __repr__(self) -> str:
        time = "discrete" if self.discrete_time else "continuous"
        names = ", ".join(self.state_names)
        return (
            f"HybridAutomaton({names}; {self.n_modes} modes, {len(self.transitions)} transitions, "
            f"{time} time)"
        )

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

    @property
    def state_names(self) -> list[str]:
        """Names of the states."""
        newest = self.feature_map.names_in[: self.n_states]
        return [name.removesuffix("[k]") for name in newest]

    @property
    def input_names(self) -> list[str]:
        """Names of the inputs."""
        first = self.n_states * (self.lags + 1)
        newest = self.feature_map.names_in[first : first + self.n_inputs]
        return [name.removesuffix("[k]") for name in newest]

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """The velocity, or the next state, at one point in one mode."""
        return self.coef[mode] @ self.feature_map.at(np.concatenate([x, u]))

    def simulate(
        self, x0, t, inputs=None, *, mode=None, input_hold="zero", **options
    ) -> Trajectory:
        """Roll the automaton out, with its transitions located.

        Transitions are *urgent*: in a mode, that one is taken whose guard rises to zero first; of
        several at one instant, the first in the tuple. A guard that is zero when the mode is
        entered counts where it rises along the law of the mode, one that is positive counts at
        once; so a ball that has just jumped does not jump again. What a transition resets is reset
        at that instant, and a mode entered there may be left at the same instant. There are no
        invariants: a state that no guard stops goes on, so there is no deadlock. In continuous
        time instants are found to the last digit on the integrator's dense output.

        In discrete time the guards of the present mode are tested once at each row: a transition
        is taken where its guard is not negative (one of a mode to itself, where it was negative
        a row before). The reset acts on this row, and the law of the mode then makes the next.

        Parameters
        ----------
        x0 : array-like of shape (n_states,), or (lags + 1, n_states)
            The state at the first of the times; with lags the states at the first of the times,
            the oldest first.
        t : array-like of shape (n_times,)
            Strictly increasing times; in discrete time they only count the rows.
        inputs : array-like of shape (n_samples, n_inputs), default=None
            Those at the first of the times.
        mode : int, default=None
            The mode in which the rollout starts, taken as entered at the first time. None: the
            only mode that no guard leads out of there; of several, the one that was recorded at
            the nearest state.
        input_hold : {"zero", "linear"}, default="zero"
            Inputs between the samples: constant until the next one, or linear.
        **options
            ``max_switches``, ``max_steps``, ``state_bound``, ``rtol``, ``atol``, ``method``; as
            for `SwitchingSystemRegressor.simulate`.

        Returns
        -------
        Trajectory
            A row at the instant of a transition has the state and the mode after it. ``events``
            are of the kind ``"jump"`` where the transition has a reset and ``"transition"``
            where not, with the state before. ``status`` says why the rollout ended:
            ``SWITCH_LIMIT`` where transitions crowd (Zeno behaviour), ``INPUT_RANGE`` where the
            inputs end before the times.

        Raises
        ------
        ValueError
            If arguments are of another shape, or if the mode at the start is not given and the
            guards do not tell it.
        """
        checked = checked_options(options)
        first = whole("mode", mode, least=0, most=self.n_modes - 1, also=(None,))
        rows = self._first_rows(x0)
        widths = self.n_states, self.n_inputs
        _, times, samples = checked_request(rows[-1], t, inputs, input_hold, widths)
        held = np.empty((len(times), 0)) if samples is None else samples
        if len(held) <= self.lags:
            raise ValueError(
                f"t and inputs have {len(held)} rows; give at least the {self.lags + 1} of x0."
            )
        if first is None:
            first = self._first_mode(
                rows, held, float(self.lags if self.discrete_time else times[0])
            )
        done = self._rolled_out(first, rows, times, samples, held, input_hold, checked)
        return replace(done, names=tuple(self.state_names))

    def _rolled_out(
        self, mode: int, rows: Array, t: Array, samples, held, input_hold: str, options: Options
    ) -> Trajectory:
        if self.discrete_time:
            laws = GuardedLaws(self, options.state_bound)
            return iterate(laws, self.transitions, mode, rows, t, held)
        pieces = list(stretches(t, samples, input_hold))
        return follow(self, self.transitions, mode, rows[0], t, pieces, options)

    def _first_rows(self, x0) -> Array:
        """The states that a rollout starts from, (lags + 1, n_states)."""
        if not self.lags:
            return state("x0", x0, self.n_states)[None]
        rows = table("x0", x0, n_columns=self.n_states)
        if len(rows) != self.lags + 1:
            raise ValueError(
                f"x0 has {len(rows)} rows; give the states at the first {self.lags + 1} times."
            )
        return rows

    def _first_mode(self, rows: Array, inputs: Array, time: float) -> int:
        """The mode at the start, as the guards or the recordings tell it."""
        lagged = rows[::-1].ravel()
        dwell = float(self.lags)
        columns = np.concatenate([lagged, inputs[self.lags :: -1].ravel(), (dwell, time)])
        return first_mode(self.transitions, self.n_modes, columns, lagged, self.first_modes)
