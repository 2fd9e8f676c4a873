"""A hybrid automaton whose laws and transitions are known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator

from swsysid._automaton.documents import document_of, parts_of
from swsysid._automaton.equations import system_of, transition_equation
from swsysid._automaton.parts import AutomatonParts, check_lags
from swsysid._automaton.rollouts import roll_out
from swsysid._automaton.spaceex import spaceex_model, spaceex_settings
from swsysid._automaton.spaceex_reading import read_spaceex
from swsysid._automaton.stating import StatedLaws, StatedTransition, Statement
from swsysid._results import Trajectory
from swsysid._simulation.model import law_equations
from swsysid._whole_or_nothing import write_text, written_beside
from swsysid.exporting import HybridSystem, ToOtherTools


@dataclass(frozen=True, eq=False)
class HybridAutomaton(AutomatonParts, ToOtherTools):
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

    Examples
    --------
    See `stated`, which makes one, and `simulate`.
    """

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
            guard has inequalities, such as ``"T >= 22"`` or ``"x >= 1 and y < 0"``, in states,
            inputs, ``dwell`` (time since the mode was entered) and ``time``; a reset is a dict from
            states to affine functions of them, ``{"v": "-0.8 v"}``; other states go on.
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
        check_lags(discrete_time, lags)
        said = Statement(states, inputs, parameters, lags)
        coef, features = said.laws(laws, feature_library)
        return cls(coef, features, said.transitions(transitions), discrete_time, lags)

    def __repr__(self) -> str:
        time = "discrete" if self.discrete_time else "continuous"
        names, count = ", ".join(self.state_names), len(self.transitions)
        told = f"{names}; {self.n_modes} modes, {count} transitions, {time} time"
        return f"HybridAutomaton({told})"

    def equations(self, precision: int = 3, format: str = "text") -> list[str]:
        r"""The law of every mode and every transition, as text or LaTeX.

        Parameters
        ----------
        precision : int, default=3
            Decimals of coefficients of order one.
        format : {"text", "latex"}, default="text"

        Returns
        -------
        list of str
            One line for each mode and state, then one for each transition: where it is taken, and
            what becomes of the states that it resets.

        Raises
        ------
        ValueError
            If `format` is another one, or `precision` no number of decimals.

        Examples
        --------
        >>> from swsysid import HybridAutomaton
        >>> ball = HybridAutomaton.stated(
        ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
        ... )
        >>> print("\n".join(ball.equations(precision=2)))
        mode 0: h' = 1.00 v
        mode 0: v' = -9.81
        mode 0 -> 0 where h <= 0: v := -0.80 v
        """
        laws = law_equations(
            self.coef,
            self.feature_map,
            precision,
            format,
            discrete_time=self.discrete_time,
            states=self.state_names,
        )
        columns, states = self.guard_columns, self.guard_columns[: self.n_lagged]
        return laws + [
            transition_equation(one, columns, states, precision, format) for one in self.transitions
        ]

    def to_hybrid_system(self) -> HybridSystem:
        return system_of(self)

    # -- files -------------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, object]:
        """The automaton in types that JSON knows.

        Returns
        -------
        dict

        Raises
        ------
        TypeError
            If its features are functions of the user's, which a document without code cannot hold.

        Examples
        --------
        >>> import json
        >>> from swsysid import HybridAutomaton
        >>> timer = HybridAutomaton.stated(
        ...     [{"x": "1"}, {"x": "-1"}], [(0, 1, "dwell >= 2"), (1, 0, "x <= 0")], states=["x"]
        ... )
        >>> again = HybridAutomaton.from_dict(json.loads(json.dumps(timer.to_dict())))
        >>> again.equations() == timer.equations()
        True
        """
        return document_of(self)

    @classmethod
    def from_dict(cls, told: Mapping[str, object]) -> HybridAutomaton:
        """The automaton that `to_dict` wrote; no code is run.

        Parameters
        ----------
        told : dict

        Returns
        -------
        HybridAutomaton

        Raises
        ------
        ValueError
            If it is none, is damaged or was written by a newer version.
        """
        return cls(*parts_of(told))

    def to_spaceex(
        self,
        path: str | Path,
        component: str = "automaton",
        *,
        x0: ArrayLike | None = None,
        t: ArrayLike | None = None,
        mode: int | None = None,
    ) -> None:
        """Write a SpaceEx model, and beside it how it is run, as a ``.cfg``.

        The model is a component with a location for each mode. A location has the law of its mode
        as flow and, as transitions here are urgent, an invariant that ends where one of its guards
        becomes positive. A guard is written with its time derivative (``h <= 0 & v <= 0``), as it
        is taken where it rises; of a guard with inputs the derivative is not known. Clocks are
        further variables, ``dwell`` and ``time``; names are made to fit. What SpaceEx cannot say:
        that a mode entered beyond one of its guards is left at once (there it cannot be entered).

        Parameters
        ----------
        path : str or path
            Of the model; the ``.cfg`` has the same name otherwise.
        component : str, default="automaton"
        x0 : array-like of shape (n_states,), default=None
            The state at the start; None is the first recorded one. A comment in the ``.cfg`` says
            what is not known.
        t : array-like of shape (n_times,), default=None
            Times, which tell the horizon and the sampling.
        mode : int, default=None
            The mode at the start.

        Raises
        ------
        ValueError
            In discrete time, or if an argument is of another shape.
        TypeError
            If the features are no monomials.
        OSError
            If a file cannot be written.
        """
        model = spaceex_model(self, component)
        settings = spaceex_settings(self, component, x0, t, mode)
        with written_beside(path) as draft:
            draft.write_bytes(model)
            write_text(Path(path).with_suffix(".cfg"), settings)

    @classmethod
    def from_spaceex(
        cls,
        path: str | Path,
        parameters: Mapping[str, float] | None = None,
        *,
        component: str | None = None,
        settings: str | Path | None = None,
        urgent: bool = False,
    ) -> HybridAutomaton:
        """The automaton of a SpaceEx model that `to_spaceex` wrote, or of one that means the same.

        Networks are resolved: a mode for each combination of the locations of their instances.
        Flows are polynomials, assignments affine, and guards polynomial inequalities. SpaceEx
        transitions may be taken while their guard holds and must be where the invariant ends; here
        they are taken where their guard rises to zero. A model is read where that is the same:
        every invariant ends where a guard begins, or never; no guard begins earlier; and where a
        transition leads, the invariant holds. Anything else is refused.

        Parameters
        ----------
        path : str or path
        parameters : dict of str to float, default=None
            Values of the constants that the model leaves open, before those of the settings.
        component : str, default=None
            The system; None is that of the settings, or the one that is no part of another one.
        settings : str or path, default=None
            The ``.cfg``: component, constants, first mode. None is the one of the model's name.
        urgent : bool, default=False
            True lets the guards alone decide: transitions are taken as soon as they may be, and
            invariants are left out.

        Returns
        -------
        HybridAutomaton
            A state called dwell or time that is no clock is called dwell_2 or time_2.

        Raises
        ------
        ValueError
            If the model is damaged, or one that an automaton here cannot be.
        OSError
            If the file cannot be read.

        Examples
        --------
        >>> import tempfile
        >>> from pathlib import Path
        >>> from swsysid import HybridAutomaton
        >>> ball = HybridAutomaton.stated(
        ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
        ... )
        >>> path = Path(tempfile.mkdtemp()) / "ball.xml"
        >>> ball.to_spaceex(path, x0=[4.0, 0.0], t=[0.0, 0.01, 3.0])
        >>> HybridAutomaton.from_spaceex(path).equations() == ball.equations()
        True
        """
        model = read_spaceex(path, parameters, component, settings, urgent)
        stated = cls.stated(
            model.laws,
            model.transitions,
            states=model.states,
            inputs=model.inputs,
            parameters=model.parameters,
        )
        return replace(stated, first_modes=model.first_modes)

    # -- rollouts ----------------------------------------------------------------------------------

    def simulate(
        self,
        x0: ArrayLike,
        t: ArrayLike,
        inputs: ArrayLike | None = None,
        *,
        mode: int | None = None,
        input_hold: str = "zero",
        **options: object,
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
            The mode in which the rollout starts, taken as entered at the (newest) state in `x0`.
            None: the only mode that no guard leads out of there; of several, the one that was
            recorded at the nearest state.
        input_hold : {"zero", "linear", "next"}, default="zero"
            Inputs between the samples: constant until the next one, linear, or as the next one
            says.
        **options
            ``max_switches``, ``max_steps``, ``state_bound``, ``rtol``, ``atol``, ``method``; as
            for `SwitchingSystemRegressor.simulate`. A stated automaton has `x0` for a spread.

        Returns
        -------
        Trajectory
            A row at the instant of a transition has the state and the mode after it. ``events``
            are of the kind ``"jump"`` where the transition has a reset and ``"transition"``
            where not, with the state before. ``status`` says why the rollout ended:
            ``SWITCH_LIMIT`` where transitions crowd (Zeno behaviour, or two laws that push the
            state against each other's guards), ``INPUT_RANGE`` where the inputs end before the
            times.

        Raises
        ------
        ValueError
            If arguments are of another shape, or if the mode at the start is not given and the
            guards do not tell it.

        Examples
        --------
        >>> from swsysid import HybridAutomaton
        >>> ball = HybridAutomaton.stated(
        ...     [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
        ... )
        >>> rollout = ball.simulate([10.0, 0.0], [0.0, 2.0, 4.0])
        >>> [round(event.time, 3) for event in rollout.events]
        [1.428, 3.712]
        """
        return roll_out(self, x0, t, inputs, mode, input_hold, options)
