"""Rollouts of a switching model with effects beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from swsysid._checks.parameters import one_of
from swsysid._effect_model.joint_fit import JointFit
from swsysid._pipelines import steps_before, switching_step
from swsysid._results import Array, Status, Trajectory
from swsysid._simulation.effect_system import ActingTerm, EffectSystem, Memory
from swsysid._simulation.inputs import Options, checked_inputs, checked_options, checked_times
from swsysid._simulation.signals import Given, refined_grid, trajectory_records
from swsysid._simulation.simulate import follow, iterate
from swsysid._simulation.stepping import step_along
from swsysid.effects import PlacedEffect, ResetEffect
from swsysid.effects._base import Place
from swsysid.effects._placed import corrected

__all__ = ["simulate_with_effects"]


def simulate_with_effects(
    fit: JointFit, x0, t, inputs=None, *, signals=None, input_hold="zero", **options
) -> Trajectory:
    """Roll a fitted switching model with effects beside it out from a state.

    Effects of the present state, inputs and time, and those that remember an input, are
    integrated as `simulate` does, friction with its sticking included. Where an effect remembers
    the state (a delayed or played state, a guard with hysteresis) or lets it jump, each sample
    interval is cut into four Runge-Kutta steps. In discrete time the map is iterated.

    Parameters
    ----------
    fit : JointFit
    x0 : array-like of shape (n_states,)
        The first state as its sensors show it.
    t : array-like of shape (n_times,)
        Strictly increasing times, on the clock of the fit (a drift or a forcing starts there).
    inputs : array-like of shape (n_times, n_inputs), default=None
    signals : array-like of shape (n_times, n_signals), default=None
    input_hold : {"zero", "linear"}, default="zero"
        Inputs and signals between the samples.
    **options
        ``max_switches``, ``max_steps``, ``state_bound``, ``rtol``, ``atol``, ``method`` of
        `simulate`; those of its integrator have no effect on fixed steps and maps.

    Returns
    -------
    Trajectory
        Its states are what the sensors would record, those of its events the true ones. Where
        friction holds a state, "sliding" is the begin and "leaving" the end.
    """
    checked = checked_options(options)
    rollout = _Rollout(fit, x0, t, inputs, signals, input_hold)
    if rollout.is_discrete:
        trajectory = rollout.iterate(checked)
    elif rollout.system.remembers:
        trajectory = rollout.step(checked)
    else:
        trajectory = rollout.follow(checked)
    return rollout.as_recorded(trajectory)


@dataclass(frozen=True)
class _Sorted:
    """The terms of a fit by what a simulation has to do for them."""

    acting: list[ActingTerm]
    breaks: list[tuple[int, float]]
    tabulated: list[PlacedEffect]
    guard: Memory | None
    resets: list[tuple[tuple[int, int], int, float]]

    def without_breaks(self) -> _Sorted:
        """The same with columns that jump where the state does."""
        return replace(self, acting=[replace(one, breaks=()) for one in self.acting], breaks=[])


class _Rollout:
    """A checked request for one rollout."""

    def __init__(self, fit, x0, t, inputs, signals, input_hold):
        transform, switching = switching_step(fit.estimator)
        n_columns = fit.estimator.n_features_in_
        self.terms, self.n_states = fit.terms, switching.coef_.shape[1]
        self.is_discrete = bool(switching.discrete_time)
        one_of("input_hold", input_hold, ("zero", "linear"))
        x0, self.t = checked_times(x0, t)
        inputs = _samples(inputs, self.t, "inputs", n_columns - self.n_states)
        signals = _samples(signals, self.t, "signals", _n_signals(fit.terms, n_columns))
        _check_states(x0, self.n_states, n_columns)
        n_known = min(len(inputs), len(signals))
        self.inputs, self.signals = inputs[:n_known], signals[:n_known]
        self.sorted = _sorted(fit, n_columns, self.n_states, self.signals.shape[1])
        if self.is_discrete:  # a map steps over every level: its columns are those of the state
            self.sorted = self.sorted.without_breaks()
        sizes = (self.n_states, self.inputs.shape[1], self.signals.shape[1])
        before = None if steps_before(fit.estimator) is None else transform
        self.system = EffectSystem(
            fit.model,
            before,
            self.sorted.acting,
            self.sorted.breaks,
            sizes,
            guard=self.sorted.guard,
            resets=self.sorted.resets,
        )
        self.given = Given(
            self.n_states,
            self.t[:n_known],
            self.inputs,
            self.signals,
            input_hold == "linear",
            self.sorted.tabulated,
        )
        self.x0 = self._true(x0)

    def _true(self, x0):
        """The state behind what the sensors show."""
        row = np.concatenate([x0, self.inputs[0]])[None]
        records = trajectory_records(row, self.n_states, self.t[:1], self.signals[:1])
        return corrected(self.terms, records).X[0, : self.n_states]

    def _grid(self):
        every = [term.effect.instants(self.t, *term.theta) for term in self.terms]
        return refined_grid(self.t, np.concatenate([np.empty(0), *every]))

    # -- three ways to roll out ----------------------------------------------------------------

    def follow(self, options: Options) -> Trajectory:
        """Integrate from event to event."""
        grid, n_given = self._grid(), self.inputs.shape[1] + self.signals.shape[1]
        pieces = self.given.stretches(grid)
        if not n_given and not self.sorted.tabulated:
            # only time goes on: one stretch
            pieces = [(float(grid[-1]), pieces[0][1])]
        done = follow(self.system, self.x0, grid, pieces, options)
        if done.status is Status.SWITCH_LIMIT and len(self.sorted.breaks) > 1:
            # events one by one cannot hold two states at rest at once, fixed steps can
            return self.step(options)
        return self._without_sides(done)

    def step(self, options: Options) -> Trajectory:
        """Step from sample to sample."""
        grid = self._grid()
        return step_along(self.system, self.x0, grid, self.given.stretches(grid), options)

    def iterate(self, options: Options) -> Trajectory:
        """Iterate the map."""
        given = self.given.sampled(self.given.t)
        return iterate(self.system, self.x0, self.t, given, options)

    # -- what is returned ------------------------------------------------------------------------

    def _without_sides(self, done: Trajectory) -> Trajectory:
        """The trajectory with the model's modes; states that stick lie exactly on the level."""
        n_modes, x, events = self.system.n_modes, done.x.copy(), []
        ends = [event.time for event in done.events[1:]] + [np.inf]
        for event, end in zip(done.events, ends, strict=False):
            modes = event.before % n_modes, event.after % n_modes
            changed = event.before // n_modes ^ event.after // n_modes
            if event.kind == "sliding" and changed:
                held = (done.t >= event.time) & (done.t < end)
                for number, (channel, level) in enumerate(self.sorted.breaks):
                    if changed >> number & 1:
                        x[held, channel] = level
            if modes[0] != modes[1] or event.kind in ("sliding", "leaving"):
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


# -- what a fit needs ------------------------------------------------------------------------------


def _channels(place: Place) -> tuple[int, ...] | None:
    """Channels that a place names, None if it is something else."""
    listed = place if isinstance(place, tuple) else (place,)
    numbers = [number for number in listed if isinstance(number, (int, np.integer))]
    return tuple(map(int, numbers)) if len(numbers) == len(listed) else None


def _n_signals(terms: Sequence[PlacedEffect], n_columns: int) -> int:
    """Number of logged signals that the effects use."""
    used = [channel for term in terms for channel in _channels(term.place) or ()]
    return max([channel + 1 - n_columns for channel in used if channel >= n_columns], default=0)


def _sorted(fit: JointFit, n_columns: int, n_states: int, n_signals: int) -> _Sorted:
    guard = None if fit.guard is None else Memory(fit.guard)
    done = _Sorted([], [], [], guard, [])
    # among the given channels, tabulated columns follow the inputs, the time and the signals
    place = n_columns - n_states + 1 + n_signals
    for term, coef in zip(fit.terms, fit.coef, strict=True):
        effect = term.effect
        if isinstance(effect, ResetEffect):
            done.resets.append((term.place, term.target, effect.factor(*term.theta)))
        gains = _gains(term, coef, fit.n_modes)
        if not gains.size:
            continue
        tabulated = memory = None
        if "order" in effect.needs and _only_given(term.place, n_states):
            tabulated = slice(place, place + gains.shape[1])
            place = tabulated.stop
            done.tabulated.append(term)
        elif "order" in effect.needs:
            memory = Memory(term)
        own = effect.breaks(term.place, *term.theta)
        done.breaks.extend(one for one in own if one not in done.breaks)
        numbers = tuple(done.breaks.index(one) for one in own)
        done.acting.append(ActingTerm(term, gains, numbers, tabulated, memory))
    return done


def _gains(term: PlacedEffect, coef: Array, n_modes: int) -> Array:
    """Coefficients of the columns in each mode, (n_modes, n_columns)."""
    each = [term.in_mode(coef, mode, n_modes) for mode in range(n_modes)]
    width = max(map(len, each))
    return np.array([own if len(own) else np.zeros(width) for own in each])


def _only_given(place: Place, n_states: int) -> bool:
    """True if an effect is a function of inputs and signals alone."""
    channels = _channels(place)
    return channels is not None and min(channels) >= n_states


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
