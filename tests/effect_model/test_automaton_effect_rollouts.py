"""Rollouts of automata with effects beside their laws, against SciPy's events and closed forms."""

import numpy as np
import pytest
from event_integration import integrate_events

from swsysid import HybridAutomaton
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_model.simulation import simulate_with_effects
from swsysid.effects import CoulombFriction, Delay, PeriodicForcing, PlacedEffect, Reset


def fit_of(automaton, *terms):
    """An automaton with (effect, place, target, mode, theta, coefficients) beside it."""
    placed = tuple(
        PlacedEffect(effect, place, target, mode, theta=theta)
        for effect, place, target, mode, theta, _ in terms
    )
    coef = tuple(np.array(values, dtype=float) for *_, values in terms)
    return JointFit(automaton, placed, coef, np.zeros(1, dtype=np.intp))


HAMMER = HybridAutomaton.stated(
    [{"x": "v", "v": "3 - x - 0.2 v"}, {"x": "v", "v": "-3 - x - 0.2 v"}],
    [(0, 1, "x >= 1.5"), (1, 0, "x <= -1", {"v": "-0.6 v"})],
    states=["x", "v"],
)


def test_friction_in_one_mode_between_guards_that_remember_and_a_wall():
    fit = fit_of(HAMMER, (CoulombFriction(), 1, 1, 1, (), [0.5]))

    def law(push, friction):
        return lambda time, x: [x[1], push - x[0] - 0.2 * x[1] - friction * np.sign(x[1])]

    transitions = [
        (0, 1, lambda time, x, entered: x[0] - 1.5, lambda x: x),
        (1, 0, lambda time, x, entered: -1.0 - x[0], lambda x: x * (1.0, -0.6)),
    ]
    t = np.linspace(0.0, 6.0, 61)
    # the reference steps over v = 0, where its friction jumps: it is right to its longest step
    run = integrate_events([law(3.0, 0.0), law(-3.0, 0.5)], transitions, 0, [0.3, 0.2], t, 1e-3)
    done = simulate_with_effects(fit, [0.3, 0.2], t, mode=0, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(done.x, np.array(run.x), atol=1e-5)
    np.testing.assert_array_equal(done.modes, run.modes)
    assert [(event.before, event.after) for event in done.events] == [
        (before, after) for _, before, after in run.events
    ]
    times = [event.time for event in done.events]
    np.testing.assert_allclose(times, [time for time, _, _ in run.events], atol=1e-5)
    assert {event.kind for event in done.events} == {"transition", "jump"}


def test_a_mass_that_sticks_until_a_clock_lets_it_go():
    # v' = -sign(v) from v = 1: at rest after 1, held against a push of 0.5 until t = 3, then pushed
    # by 2: v = (2 - 1)(t - 3), until x = 1 at t = 4 sends it back with half its speed
    automaton = HybridAutomaton.stated(
        [{"x": "v", "v": "0"}, {"x": "v", "v": "2"}],
        [(0, 1, "time >= 3"), (1, 1, "x >= 1", {"v": "-0.5 v"})],
        states=["x", "v"],
    )
    fit = fit_of(automaton, (CoulombFriction(), 1, 1, None, (), [1.0]))
    t = np.array([0.0, 0.5, 1.0, 2.0, 2.9, 3.5, 4.1])
    done = simulate_with_effects(fit, [0.0, 1.0], t, mode=0)
    speed = np.where(t < 1.0, 1.0 - t, np.where(t < 3.0, 0.0, t - 3.0))
    place = np.where(t < 1.0, t - t**2 / 2, np.where(t < 3.0, 0.5, 0.5 + (t - 3.0) ** 2 / 2))
    # against 2 + 1
    speed[-1], place[-1] = -0.5 + 3.0 * 0.1, 1.0 - 0.5 * 0.1 + 1.5 * 0.1**2
    np.testing.assert_allclose(done.x, np.column_stack([place, speed]), atol=1e-7)
    assert [event.kind for event in done.events][:2] == ["sliding", "transition"]
    assert done.events[1].time == pytest.approx(3.0, abs=1e-12)
    assert "jump" in [event.kind for event in done.events]
    np.testing.assert_array_equal(done.modes, [0, 0, 0, 0, 0, 1, 1])


def test_a_forcing_that_only_time_tells():
    relay = HybridAutomaton.stated(
        [{"x": "1 - x"}, {"x": "-1 - x"}], [(0, 1, "x >= 0.5"), (1, 0, "x <= -0.5")], states=["x"]
    )
    # c sin(w t) + d cos(w t)
    fit = fit_of(relay, (PeriodicForcing(), "time", 0, None, (0.3,), [0.4, 0.2]))
    columns = PeriodicForcing().column_names("time", 0.3)
    t = np.linspace(0.0, 10.0, 101)
    done = simulate_with_effects(fit, [0.0], t, mode=0, rtol=1e-10, atol=1e-12)

    def force(time):
        angle = 2.0 * np.pi * 0.3 * time
        parts = {"sin": np.sin(angle), "cos": np.cos(angle)}
        return sum(
            value * parts["sin" if "sin" in name else "cos"]
            for name, value in zip(columns, (0.4, 0.2), strict=True)
        )

    laws = [lambda time, x: 1.0 - x + force(time), lambda time, x: -1.0 - x + force(time)]
    transitions = [
        (0, 1, lambda time, x, entered: x[0] - 0.5, lambda x: x),
        (1, 0, lambda time, x, entered: -0.5 - x[0], lambda x: x),
    ]
    run = integrate_events(laws, transitions, 0, [0.0], t, 0.01)
    np.testing.assert_allclose(done.x, np.array(run.x), atol=1e-8)


def test_a_jump_that_was_found_is_taken_at_its_transition():
    plain = HybridAutomaton.stated(
        [{"h": "v", "v": "-9.81"}, {"h": "v", "v": "-9.81"}],
        [(0, 1, "h <= 0"), (1, 0, "v <= 0")],
        states=["h", "v"],
    )
    fit = fit_of(plain, (Reset(), (0, 1), 1, None, (-0.8,), []))
    done = simulate_with_effects(fit, [10.0, 0.0], [0.0, 2.0, 4.0], mode=0)
    # free fall from 10: down at sqrt(2 h / g), up with 0.8 of the speed
    assert done.events[0].time == pytest.approx(np.sqrt(20.0 / 9.81), abs=1e-8)
    again = [event for event in done.events if event.kind == "jump"][1]
    assert again.time == pytest.approx(2.6 * np.sqrt(20.0 / 9.81), abs=1e-7)


def test_what_a_rollout_cannot_do_is_refused_in_a_sentence():
    delayed = fit_of(HAMMER, (Delay(states=True), 0, 1, None, (0.1,), [1.0]))
    with pytest.raises(ValueError, match="remembers a state"):
        simulate_with_effects(delayed, [0.0, 0.0], [0.0, 1.0], mode=0)
    plain = fit_of(HAMMER)
    with pytest.raises(ValueError, match="mode"):
        simulate_with_effects(plain, [0.0, 0.0], [0.0, 1.0], mode=2)
    with pytest.raises(ValueError, match="give mode"):
        simulate_with_effects(plain, [0.0, 0.0], [0.0, 1.0])
