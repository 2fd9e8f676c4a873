"""Rollouts with effects beside a model, against closed forms and solve_ivp."""

import numpy as np
import pytest
from effect_fits import FREE, MASS, TIGHT, T, U, fit_by_hand, reference, relay
from scipy.integrate import solve_ivp

from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_model.simulation import simulate_with_effects
from swsysid._results import Status
from swsysid.effects import (
    AsymmetricFriction,
    Backlash,
    CoulombFriction,
    DeadZone,
    Delay,
    Drift,
    InputCoupling,
    Lag,
    PeriodicForcing,
    PlacedEffect,
    Polynomial,
    QuadraticDrag,
    Reset,
    StribeckFriction,
)

# -- against solve_ivp with the same right-hand side ---------------------------------------------


def _u(time):
    return np.interp(time, T, U)


def _played(time):
    """Play of the piecewise linear input, from the samples up to a time."""
    held = U[0]
    for value in [*U[T <= time], _u(time)]:
        held = min(max(held, value - 0.3), value + 0.3)
    return held


LAG = solve_ivp(lambda s, w: (_u(s) - w) / 0.4, (0, 6), U[:1], dense_output=True, **TIGHT).sol
CASES = {
    "cubic": (Polynomial(), (0, 0, 0), (), [-2.0], lambda t, x: -2.0 * x[0] ** 3),
    "drag": (QuadraticDrag(), 1, (), [0.7], lambda t, x: -0.7 * x[1] * abs(x[1])),
    "dead zone": (
        DeadZone(),
        2,
        (0.4,),
        [-1.5],
        lambda t, x: -1.5 * (_u(t) - np.clip(_u(t), -0.4, 0.4)),
    ),
    "drift": (Drift(), 0, (), [-0.3], lambda t, x: -0.3 * t * x[0]),
    "forcing": (
        PeriodicForcing(),
        "time",
        (0.7,),
        [0.5, -0.8],
        lambda t, x: 0.5 * np.sin(1.4 * np.pi * t) - 0.8 * np.cos(1.4 * np.pi * t),
    ),
    "signal": (InputCoupling(), 3, (), [1.2], lambda t, x: 1.2 * np.interp(t, T, np.cos(T))),
    "delay": (Delay(), 2, (0.33,), [1.5], lambda t, x: 1.5 * _u(t - 0.33)),
    "lag": (Lag(), 2, (0.4,), [1.5], lambda t, x: 1.5 * LAG(t)[0]),
    "backlash": (Backlash(), 2, (0.6,), [1.5], lambda t, x: 1.5 * _played(t)),
}
# a play and a dead zone bend between the samples at times that no grid knows
TOLERANCES = {"backlash": 3e-4, "dead zone": 2e-6, "lag": 1e-6}


@pytest.mark.parametrize("name", CASES)
def test_effects_agree_with_an_integrator_of_the_same_law(name):
    effect, place, theta, coef, force = CASES[name]
    fit = fit_by_hand(MASS, [PlacedEffect(effect, place, 1, theta=theta)], [coef])
    signals = np.cos(T) if name == "signal" else None
    rollout = simulate_with_effects(fit, [1.0, 0.5], T, U, signals=signals, input_hold="linear")

    def right(t, x):
        return [x[1], -4.0 * x[0] - 0.5 * x[1] + _u(t) + force(t, x)]

    expected = reference(right, [1.0, 0.5], T)
    assert rollout.status is Status.COMPLETED
    assert rollout.modes.max() == 0
    np.testing.assert_allclose(rollout.x, expected, atol=TOLERANCES.get(name, 2e-7))


def test_a_delayed_input_that_is_held_between_samples_jumps_late():
    # x' = u(t - d) with steps of u: a polygon
    t, d = np.linspace(0.0, 2.0, 21), 0.25
    u = np.sign(np.sin(5.0 * t + 0.1))
    fit = fit_by_hand([[[0.0, 0.0, 0.0]]], [PlacedEffect(Delay(), 1, 0, theta=(d,))], [[1.0]])
    rollout = simulate_with_effects(fit, [0.0], t, u)
    fine = np.linspace(0.0, 2.0, 40001)
    # the input had its first value before the first sample
    held = u[np.clip(np.searchsorted(t, fine - d + 1e-9, side="right") - 1, 0, None)]
    expected = np.concatenate([[0.0], np.cumsum(held[:-1]) * (fine[1] - fine[0])])
    np.testing.assert_allclose(rollout.x[:, 0], np.interp(t, fine, expected), atol=1e-4)


def test_an_effect_of_one_mode_acts_there_only():
    # two modes by the sign of x; a constant force beside them in the right one
    laws = [[[0.0, 1.0, 0.0], [-4.0, 0.0, 0.0]], [[0.0, 1.0, 0.0], [-9.0, 0.0, 0.0]]]
    fit = fit_by_hand(laws, guard=lambda X: X[:, 0])
    right_mode = int(fit.estimator.predict_modes([[0.5, 0.0]])[0])
    term = PlacedEffect(Polynomial(), (0, 0, 0), 1, mode=right_mode)
    fit = JointFit(fit.estimator, (term,), (np.array([-3.0]),), fit.modes)
    t = np.linspace(0.0, 5.0, 51)
    rollout = simulate_with_effects(fit, [1.0, 0.0], t)

    def right(time, x):
        if fit.estimator.predict_modes(x[None])[0] == right_mode:
            return [x[1], -9.0 * x[0] - 3.0 * x[0] ** 3]
        return [x[1], -4.0 * x[0]]

    np.testing.assert_allclose(rollout.x, reference(right, [1.0, 0.0], t), atol=2e-3)
    assert set(rollout.modes) == {0, 1}


# -- dry friction --------------------------------------------------------------------------------


def test_a_mass_with_dry_friction_comes_to_rest_and_stays():
    # v' = -f sign(v): it stops at v0 / f after v0^2 / (2 f)
    fit = fit_by_hand(FREE, [PlacedEffect(CoulombFriction(), 1, 1)], [[0.8]])
    t = np.linspace(0.0, 4.0, 41)
    rollout = simulate_with_effects(fit, [0.3, 1.0], t)
    stop = 1.0 / 0.8
    moving = np.minimum(t, stop)
    np.testing.assert_allclose(rollout.x[:, 0], 0.3 + moving - 0.4 * moving**2, atol=1e-8)
    assert (rollout.x[t > stop, 1] == 0.0).all()
    (event,) = rollout.events
    assert event.kind == "sliding"
    assert event.time == pytest.approx(stop, abs=1e-9)


def test_a_spring_with_dry_friction_loses_the_same_width_each_half_period():
    # v' = -x - f sign(v): half circles about +f and -f, each amplitude smaller by 2 f
    law = [[[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]]
    fit = fit_by_hand(law, [PlacedEffect(CoulombFriction(), 1, 1)], [[0.1]])
    t = np.linspace(0.0, 6 * np.pi, 61)
    rollout = simulate_with_effects(fit, [0.95, 0.0], t)
    turns = [event for event in rollout.events if event.kind == "sliding"]
    assert len(turns) == 1  # the other turns are crossings of v = 0 without rest
    # 0.95, -0.75, 0.55, -0.35, 0.15, and 0.05, inside the band: at rest
    assert rollout.x[-1, 0] == pytest.approx(0.05, abs=1e-7)
    assert rollout.x[-1, 1] == 0.0
    assert turns[0].time == pytest.approx(5 * np.pi, abs=1e-7)


def test_a_held_mass_starts_where_the_force_exceeds_friction():
    # u = t at rest: it breaks loose at t = f, then v = (t - f)^2 / 2
    law = [[[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]]
    fit = fit_by_hand(law, [PlacedEffect(CoulombFriction(), 1, 1)], [[0.53]])
    t = np.linspace(0.0, 2.0, 21)
    rollout = simulate_with_effects(fit, [0.0, 0.0], t, t, input_hold="linear")
    free = np.maximum(t - 0.53, 0.0)
    np.testing.assert_allclose(rollout.x, np.column_stack([free**3 / 6, free**2 / 2]), atol=1e-7)
    assert [event.kind for event in rollout.events] == ["sliding", "leaving"]
    assert rollout.events[1].time == pytest.approx(0.53, abs=1e-6)


@pytest.mark.parametrize(
    "effect, theta, coef, force",
    [
        (StribeckFriction(), (0.3,), [0.2, 0.5], lambda v: 0.2 + 0.5 * np.exp(-((v / 0.3) ** 2))),
        (AsymmetricFriction(), (), [0.4, 0.2, 0.3], lambda v: 0.4 + 0.3 * v),
    ],
)
def test_other_dry_frictions_stop_a_mass_as_well(effect, theta, coef, force):
    fit = fit_by_hand(FREE, [PlacedEffect(effect, 1, 1, theta=theta)], [coef])
    t = np.linspace(0.0, 5.0, 51)
    rollout = simulate_with_effects(fit, [0.0, 1.0], t)
    stops = solve_ivp(
        lambda s, x: [x[1], -force(x[1])],
        (0, 5),
        [0.0, 1.0],
        events=lambda s, x: x[1],
        **TIGHT,
    )
    stop, rest = stops.t_events[0][0], stops.y_events[0][0][0]
    assert rollout.events[0].time == pytest.approx(stop, abs=1e-6)
    assert (rollout.x[t > stop, 1] == 0.0).all()
    np.testing.assert_allclose(rollout.x[t > stop, 0], rest, atol=1e-6)


@pytest.mark.nightly
def test_two_masses_come_to_rest_at_once():
    law = [
        [
            [0.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 0.0, 1.0, 0.0],
            [-2.0, 1.0, 0.0, 0.0, 0.0],
            [1.0, -2.0, 0.0, 0.0, 0.0],
        ]
    ]
    size = (0.4, 0.3)
    terms = [PlacedEffect(CoulombFriction(), 2, 2), PlacedEffect(CoulombFriction(), 3, 3)]
    fit = fit_by_hand(law, terms, [size[:1], size[1:]])
    t = np.linspace(0.0, 20.0, 401)
    rollout = simulate_with_effects(fit, [3.0, 0.0, 0.0, 0.0], t)

    def right(time, x):
        friction = np.array(size) * np.tanh(x[2:] / 1e-4)
        return [*x[2:], -2 * x[0] + x[1] - friction[0], x[0] - 2 * x[1] - friction[1]]

    options = {"method": "Radau", "rtol": 1e-7, "atol": 1e-9, "max_step": 0.05}
    smooth = solve_ivp(right, (0, 20), [3.0, 0.0, 0.0, 0.0], t_eval=t, **options).y.T
    assert rollout.status is Status.COMPLETED
    np.testing.assert_allclose(rollout.x, smooth, atol=2e-3)  # the width of tanh
    assert (rollout.x[-1, 2:] == 0.0).all()


def test_both_ways_to_roll_out_agree():
    # an effect without a coefficient that remembers the state: fixed steps in place of events
    friction = PlacedEffect(CoulombFriction(), 1, 1)
    nothing = PlacedEffect(Delay(), 0, 1, theta=(0.1,))
    u = 0.9 * np.sin(T)
    rollouts = [
        simulate_with_effects(fit, [1.0, 0.0], T, u, input_hold="linear")
        for fit in (
            fit_by_hand(MASS, [friction], [[0.5]]),
            fit_by_hand(MASS, [friction, nothing], [[0.5], [0]]),
        )
    ]
    np.testing.assert_allclose(rollouts[1].x, rollouts[0].x, atol=1e-7)
    kinds = [[event.kind for event in rollout.events] for rollout in rollouts]
    assert kinds[0] == kinds[1] == ["sliding", "leaving"]
    for first, second in zip(rollouts[0].events, rollouts[1].events, strict=True):
        assert second.time == pytest.approx(first.time, abs=1e-6)


def test_friction_does_not_stop_what_a_spring_pulls_through():
    fit = fit_by_hand(MASS, [PlacedEffect(CoulombFriction(), 1, 1)], [[0.3]])
    rollout = simulate_with_effects(fit, [1.0, 0.0], T, U, input_hold="linear")

    def right(t, x):
        return [x[1], -4.0 * x[0] - 0.5 * x[1] + _u(t) - 0.3 * np.tanh(x[1] / 1e-4)]

    options = {"method": "Radau", "rtol": 1e-8, "atol": 1e-10, "max_step": 0.05}
    smooth = solve_ivp(right, (0, 6), [1.0, 0.0], t_eval=T, **options).y.T
    np.testing.assert_allclose(rollout.x, smooth, atol=2e-3)  # the width of tanh


# -- effects that remember the state -------------------------------------------------------------


def test_a_delayed_state_by_the_method_of_steps():
    # x' = -x(t - 1), x = 1 before: 1 - t, then 1 - t + (t - 1)^2 / 2, then - (t - 2)^3 / 6
    fit = fit_by_hand([[[0.0, 0.0]]], [PlacedEffect(Delay(), 0, 0, theta=(1.0,))], [[-1.0]])
    t = np.linspace(0.0, 3.0, 61)
    rollout = simulate_with_effects(fit, [1.0], t)
    expected = 1.0 - t + np.maximum(t - 1, 0) ** 2 / 2 - np.maximum(t - 2, 0) ** 3 / 6
    np.testing.assert_allclose(rollout.x[:, 0], expected, atol=1e-4)  # history linear in substeps


def test_a_delay_shorter_than_a_step():
    # x' = -x(t - d) with slow exponential solutions: x = e^(-s t), s = e^(s d)
    d, s = 0.02, 1.0
    for _ in range(50):
        s = np.exp(s * d)
    fit = fit_by_hand([[[0.0, 0.0]]], [PlacedEffect(Delay(), 0, 0, theta=(d,))], [[-1.0]])
    t = np.linspace(0.0, 2.0, 11)
    rollout = simulate_with_effects(fit, [1.0], t)
    rates = -np.diff(np.log(rollout.x[5:, 0])) / np.diff(t[5:])
    np.testing.assert_allclose(rates, s, rtol=2e-4)  # history linear in substeps of 0.05 s


def test_play_of_a_state():
    # a mass that moves as cos t drags w with a play of 0.4: y' = w
    law = [[[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]]
    fit = fit_by_hand(law, [PlacedEffect(Backlash(), 0, 2, theta=(0.4,))], [[1.0]])
    t = np.linspace(0.0, 6.0, 121)
    rollout = simulate_with_effects(fit, [1.0, 0.0, 0.0], t)
    fine = np.linspace(0.0, 6.0, 60001)
    held, played = 1.0, []
    for value in np.cos(fine):
        held = min(max(held, value - 0.2), value + 0.2)
        played.append(held)
    expected = np.concatenate([[0.0], np.cumsum(played[:-1]) * (fine[1] - fine[0])])
    np.testing.assert_allclose(rollout.x[:, 0], np.cos(t), atol=1e-8)
    np.testing.assert_allclose(rollout.x[:, 2], np.interp(t, fine, expected), atol=3e-4)


def test_a_relay_with_hysteresis_oscillates_across_its_band():
    fit, upper = relay(-0.31, 0.17)
    t = np.linspace(0.0, 5.0, 101)
    rollout = simulate_with_effects(fit, [-0.5], t)
    # up to 0.17 at first, then a saw tooth of width 0.48
    expected = 0.67 + 0.48 * np.arange(len(rollout.events))
    np.testing.assert_allclose([event.time for event in rollout.events], expected, atol=1e-8)
    assert len(rollout.events) == 10
    # from inside the band: the side that is nearer holds until the other edge
    inside = simulate_with_effects(fit, [-0.1], t)
    assert inside.events[0].time == pytest.approx(0.27, abs=1e-8)
    assert [event.after for event in rollout.events[:2]] == [upper, 1 - upper]
    since = np.mod(t - 0.67, 0.96)
    tooth = np.where(since < 0.48, 0.17 - since, -0.31 + since - 0.48)
    np.testing.assert_allclose(rollout.x[:, 0], np.where(t < 0.67, t - 0.5, tooth), atol=1e-8)


def test_a_bouncing_ball():
    # v' = -1 above the floor; x < 0 is the other mode, and the speed is multiplied by -0.7
    laws = [[[0.0, 1.0, 0.0], [0.0, 0.0, -1.0]], [[0.0, 1.0, 0.0], [0.0, 0.0, -1.1]]]
    fit = fit_by_hand(laws, guard=lambda X: -X[:, 0])
    # the surface of the fit is a hair off zero: the ball bounces there
    above, below = (int(m) for m in fit.estimator.predict_modes([[0.5, 0.0], [-0.5, 0.0]]))
    term = PlacedEffect(Reset(), (above, below), 1, theta=(-0.7,))
    fit = JointFit(fit.estimator, (term,), (np.zeros(0),), fit.modes)
    t = np.linspace(0.0, 5.0, 51)
    rollout = simulate_with_effects(fit, [0.5, 0.0], t)
    first, second = rollout.events[:2]
    floor = first.state[0]
    speed = np.sqrt(2 * (0.5 - floor))
    assert abs(floor) < 0.05
    assert first.time == pytest.approx(speed, abs=1e-7)
    assert first.state[1] == pytest.approx(0.7 * speed, abs=1e-7)
    assert second.time - first.time == pytest.approx(1.4 * speed, rel=0.05)
    assert rollout.x[:, 0].min() > floor - 1e-9
