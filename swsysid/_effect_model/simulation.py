"""Rollouts of a switching model with effects beside it.

One of its surfaces, or an automaton with effects beside its laws, tells the modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from swsysid._automaton.continuous import PresentMode
from swsysid._automaton.continuous import follow as follow_automaton
from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.parts import first_mode
from swsysid._automaton.rollouts import iterate as iterate_automaton
from swsysid._automaton.transitions import Transition
from swsysid._checks.parameters import one_of, whole
from swsysid._data.coordinates import Extent
from swsysid._data.recordings import a_row_sooner
from swsysid._effect_model.declared import SwitchingLaws
from swsysid._effect_model.equations import NoAutomatonError, automaton_of_fit
from swsysid._effect_model.joint_fit import JointFit
from swsysid._pipelines import steps_before
from swsysid._results import Array, Status, Trajectory
from swsysid._simulation.effect_system import ActingTerm, EffectFields, EffectSystem, Memory, bits
from swsysid._simulation.inputs import (
    Given,
    Options,
    Stretch,
    checked_inputs,
    checked_options,
    checked_times,
    refined_grid,
    trajectory_records,
)
from swsysid._simulation.simulate import follow, iterate
from swsysid._simulation.stepping import step_along
from swsysid.effects import PlacedEffect, ResetEffect
from swsysid.effects._placed import corrected, n_signals

_NOTED = ("sliding", "leaving", "jump", "transition")  # events that change no mode and matter


def simulate_with_effects(
    fit: JointFit, x0, t, inputs=None, *, signals=None, input_hold="zero", mode=None, **options
) -> Trajectory:
    """Roll a fitted switching model with effects beside it out from a state.

    Effects of the present state, inputs and time, and those that remember an input, are
    integrated as `simulate` does, friction with its sticking included. Where an effect remembers
    the state (a delayed or played state, a guard with hysteresis) or lets it jump, each sample
    interval is cut into four Runge-Kutta steps. In discrete time the map is iterated. Options of
    the integrator of `simulate` have no effect on fixed steps and maps. An automaton starts in
    `mode`, and takes its transitions as `HybridAutomaton.simulate` does.

    The states, from `x0` on, are what the sensors record, those of the events the true ones. Where
    friction holds a state, "sliding" is the begin and "leaving" the end. Times are on the clock
    of the fit: a drift or a forcing starts there.
    """
    checked = checked_options(options)
    rollout = _rollout(fit, x0, t, inputs, signals, input_hold)
    return rollout.as_recorded(rollout.run(checked, mode))


class _Rollout:
    """A checked request for one rollout."""

    def __init__(self, fit, x0, t, inputs, signals, input_hold):
        self.fit, self.laws = fit, fit.laws
        laws, n_columns = self.laws, self.laws.n_columns
        self.terms, self.n_states = fit.terms, laws.coef.shape[1]
        self.is_discrete = laws.discrete_time
        one_of("input_hold", input_hold, ("zero", "linear", "next"))
        x0, self.t = checked_times(x0, t)
        inputs = _samples(inputs, self.t, "inputs", n_columns - self.n_states)
        signals = _samples(signals, self.t, "signals", n_signals(fit.terms, n_columns))
        _check_states(x0, self.n_states, n_columns)
        n_known = min(len(inputs), len(signals))
        if input_hold == "next":
            inputs = a_row_sooner(inputs, np.ones(inputs.shape[1], dtype=bool))
        self.inputs, self.signals = inputs[:n_known], signals[:n_known]
        # among the given channels, tabulated columns follow the inputs, the time and the signals
        first_tabulated = n_columns - self.n_states + 1 + self.signals.shape[1]
        self.acting, self.breaks = _acting_terms(fit, self.n_states, first_tabulated)
        self.sizes = self.n_states, self.inputs.shape[1], self.signals.shape[1]
        self.given = Given(
            self.n_states,
            self.t[:n_known],
            self.inputs,
            self.signals,
            input_hold == "linear",
            [one.term for one in self.acting if one.tabulated is not None],
        )
        # the state behind what the sensors show
        row = np.concatenate([x0, self.inputs[0]])[None]
        records = trajectory_records(row, self.n_states, self.t[:1], self.signals[:1])
        self.x0 = corrected(self.terms, records).X[0, : self.n_states]

    def run(self, options: Options, mode: int | None) -> Trajectory:
        """Iterate the map, integrate from event to event, or step from sample to sample."""
        if mode is not None:
            raise ValueError("the state tells the mode at the start; leave mode out.")
        system, given = self._system(), self.given
        if self.is_discrete:
            return iterate(system, self.x0, self.t, given.sampled(given.t), options)
        grid, pieces, whole = self._stretches()
        if not system.remembers:
            done = follow(system, self.x0, grid, whole, options)
            # events one by one cannot hold two states at rest at once, fixed steps can
            if done.status is not Status.SWITCH_LIMIT or len(system.breaks) < 2:
                return self.without_sides(done)
        return step_along(system, self.x0, grid, pieces, options)

    def _system(self) -> EffectSystem:
        fit, laws = self.fit, self.laws
        assert isinstance(laws, SwitchingLaws)
        transform = None if steps_before(laws.estimator) is None else laws.seen
        resets = [
            (term.place, term.target, term.effect.factor(*term.theta))
            for term in fit.terms
            if isinstance(term.effect, ResetEffect)
        ]
        return EffectSystem(
            laws.switching.switching_model,
            transform,
            self.acting,
            self.breaks,
            self.sizes,
            fit.terms,
            guard=None if fit.guard is None else Memory(fit.guard),
            resets=resets,
        )

    def _stretches(self) -> tuple[Array, list[Stretch], list[Stretch]]:
        """Times, stretches between them of what is given, and the same as few as they can be."""
        every = [term.effect.instants(self.t, *term.theta) for term in self.terms]
        grid = refined_grid(self.t, np.concatenate([np.empty(0), *every]))
        pieces = self.given.stretches(grid)
        only_time = not (self.inputs.shape[1] or self.signals.shape[1] or self.given.terms)
        return grid, pieces, [(float(grid[-1]), pieces[0][1])] if only_time else pieces

    # -- what is returned ------------------------------------------------------------------------

    def without_sides(self, done: Trajectory) -> Trajectory:
        """The trajectory with the model's modes; states that stick lie exactly on the level."""
        n_modes, x, events = self.fit.n_modes, done.x.copy(), []
        ends = [event.time for event in done.events[1:]] + [np.inf]
        for event, end in zip(done.events, ends, strict=False):
            modes = event.before % n_modes, event.after % n_modes
            changed = event.before // n_modes ^ event.after // n_modes
            if event.kind == "sliding" and changed:
                held = (done.t >= event.time) & (done.t < end)
                for number, (channel, level) in enumerate(self.breaks):
                    if changed >> number & 1:
                        x[held, channel] = level
            if modes[0] != modes[1] or event.kind in _NOTED:
                events.append(replace(event, before=modes[0], after=modes[1]))
        return replace(done, x=x, modes=done.modes % n_modes, events=tuple(events))

    def as_recorded(self, done: Trajectory) -> Trajectory:
        """The trajectory at the requested times as the sensors show it."""
        inputs, signals = self.given.at(done.t)
        X = np.column_stack([done.x, inputs])
        records = trajectory_records(X, self.n_states, done.t, signals)
        for term in reversed(self.terms):
            records = term.recorded(records)
        asked = np.isin(done.t, self.t)
        x = records.X[asked, : self.n_states]
        return replace(done, t=done.t[asked], x=x, modes=done.modes[asked])


class _AutomatonRollout(_Rollout):
    """One in modes that are left where guards rise to zero, and entered with a jump of the state.

    So is that of a surface which remembers.
    """

    def __init__(self, automaton: HybridAutomaton, *request):
        super().__init__(*request)
        self.automaton = automaton

    def run(self, options: Options, mode: int | None) -> Trajectory:
        whole("mode", mode, least=0, most=self.automaton.n_modes - 1, also=(None,))
        system = AutomatonEffects(self.automaton, self.acting, self.breaks, self.sizes, self.terms)
        if system.remembers:
            raise ValueError(
                "an effect remembers a state, which a rollout of an automaton cannot; leave it out."
            )
        system.begin(self.x0, self.inputs[0], float(self.t[0]), self._first(mode))
        if self.is_discrete:
            rows = self.given.sampled(self.given.t)
            present, x0 = system.present, self.x0[None]
            return iterate_automaton(_Map(system), present, x0, self.t, rows, options)
        grid, _, pieces = self._stretches()
        return self.without_sides(follow_automaton(system, self.x0, grid, pieces, options))

    def _first(self, mode: int | None) -> int | None:
        """The mode at the start as the surface tells it, if there is one."""
        if mode is not None or self.laws.automaton is not None:
            return mode
        row = np.concatenate([self.x0, self.inputs[0]])[None]
        records = trajectory_records(row, self.n_states, self.t[:1], self.signals[:1])
        return int(self.fit.predict_modes(records)[0])


def _rollout(fit: JointFit, *request) -> _Rollout:
    """The kind of rollout that suits a fit."""
    remembering = any(one.memory is not None for one in _acting_terms(fit, fit.n_states, 0)[0])
    guarded = fit.guard is not None and not remembering and not fit.laws.discrete_time
    if guarded or fit.laws.automaton is not None:
        with suppress(NoAutomatonError):
            return _AutomatonRollout(automaton_of_fit(fit), fit, *request)
    return _Rollout(fit, *request)


# -- what a fit needs ------------------------------------------------------------------------------


def _acting_terms(
    fit: JointFit, n_states: int, first_tabulated: int
) -> tuple[list[ActingTerm], list[tuple[int, float]]]:
    """Effects with columns, and where these jump."""
    # Columns of inputs and signals alone are known, and tabulated, before the rollout.
    acting: list[ActingTerm] = []
    breaks: list[tuple[int, float]] = []
    place = first_tabulated
    for term, coef in zip(fit.terms, fit.coef, strict=True):
        each = [term.in_mode(coef, mode, fit.n_modes) for mode in range(fit.n_modes)]
        width = max(map(len, each))
        if not width:
            continue
        gains = np.array([own if len(own) else np.zeros(width) for own in each])
        tabulated = memory = None
        if "order" in term.effect.needs:
            channels = term.channels
            if channels and min(channels) >= n_states:
                tabulated = slice(place, place + width)
                place = tabulated.stop
            else:
                memory = Memory(term)
        # a map steps over every level: its columns are those of the state
        own = () if fit.laws.discrete_time else term.effect.breaks(term.place, *term.theta)
        breaks.extend(one for one in own if one not in breaks)
        numbers = tuple(breaks.index(one) for one in own)
        acting.append(ActingTerm(term, gains, numbers, tabulated, memory))
    return acting, breaks


# -- refusals --------------------------------------------------------------------------------------


def _samples(values, t: Array, name: str, wanted: int) -> Array:
    """Samples of the inputs (as many as wanted) or signals (at least so many)."""
    if values is None:
        if wanted:
            raise ValueError(
                f"The model has {wanted} {name}; give `{name}`, one row for each time."
            )
        return np.empty((len(t), 0))
    samples = checked_inputs(values, t, name)
    if samples.shape[1] < wanted or (name == "inputs" and samples.shape[1] > wanted):
        raise ValueError(f"{name} hold {samples.shape[1]} columns; give {wanted}.")
    return samples


def _check_states(x0: Array, n_states: int, n_columns: int) -> None:
    if n_states > n_columns:
        raise ValueError(
            f"The model has {n_states} velocities but only {n_columns} columns in X; simulate "
            "needs the states themselves as the first columns of X."
        )
    if len(x0) != n_states:
        raise ValueError(f"x0 holds {len(x0)} states; give {n_states}.")


class AutomatonEffects(EffectFields, PresentMode):
    """The laws of an automaton with effects, in the mode in which it is at present."""

    def __init__(
        self,
        automaton: HybridAutomaton,
        acting: Sequence[ActingTerm],
        breaks: Sequence[tuple[int, float]],
        sizes: tuple[int, int, int],
        terms: Sequence[PlacedEffect] = (),
    ):
        super().__init__(automaton, None, acting, breaks, sizes, terms)
        self.automaton, self.present = automaton, 0

    @property
    def has_surface_values(self) -> bool:
        """The levels of effects are known."""
        return True

    def surface_values(self, x: Array, u: Array) -> Array:
        """Distances to the levels."""
        return self.heights(x)

    def decode(self, values: Array) -> int:
        """Composite mode for given distances."""
        return self.present + self.n_modes * bits(values)

    def base_mode(self, x: Array, u: Array) -> int:
        """The present mode."""
        return self.present

    def begin(self, x: Array, u: Array, time: float, mode: int | None) -> None:
        """Start in a mode, or in that which guards and recordings tell."""
        if mode is None:
            own = self.automaton
            columns = np.concatenate([x, u[: own.n_inputs], (0.0, time)])
            mode = first_mode(own.transitions, own.n_modes, columns, x, own.first_modes)
        self.present = mode


@dataclass(frozen=True)
class _Map:
    """The automaton in discrete time: a map steps over every level."""

    system: AutomatonEffects
    lags: int = 0

    @property
    def transitions(self) -> tuple[Transition, ...]:
        return self.system.automaton.transitions

    @property
    def n_states(self) -> int:
        return self.system.automaton.n_states

    @property
    def n_inputs(self) -> int:
        return self.system.automaton.n_inputs

    @property
    def extent(self) -> Extent | None:
        return self.system.extent

    def affine_law(self, mode: int) -> None:
        return None  # effects are functions of the state

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        return self.system.field(x, u, mode, self.system.sides(x))
