"""Rollouts with effects beside a model: closed forms, solve_ivp, and planted plants.

Most fits here are made by hand: the declared model is fitted to its own exact velocities, and the
effects' coefficients are given.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swsysid import EffectRegressor, SwitchingSystemRegressor
from swsysid._effect_simulation import simulate_with_effects
from swsysid._results import Status
from swsysid._search.joint_fit import JointFit
from swsysid.datasets import make_undeclared
from swsysid.effects import (
    AsymmetricFriction,
    Backlash,
    ClockLag,
    CoulombFriction,
    DeadZone,
    Delay,
    Drift,
    Effect,
    GuardHysteresis,
    InputCoupling,
    Lag,
    PeriodicForcing,
    PlacedEffect,
    Polynomial,
    QuadraticDrag,
    Reset,
    SensorOffset,
    StribeckFriction,
)
from swsysid.effects._guards import Guard

TIGHT = {"rtol": 1e-11, "atol": 1e-12, "max_step": 0.01}


def _fit(laws, terms=(), coef=(), guard=None, discrete=False):
    """A fit with given laws, (n_modes, n_states, n_states + n_inputs + 1), constant last."""
    laws = np.atleast_3d(np.asarray(laws, dtype=float))
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (400, laws.shape[2] - 1))
    modes = np.zeros(len(X), int) if guard is None else (guard(X) > 0).astype(int)
    features = np.column_stack([X, np.ones(len(X))])
    Xdot = np.einsum("nkf,nf->nk", laws[modes], features)
    start = {} if guard is None else {"init": modes}
    estimator = SwitchingSystemRegressor(
        n_modes=len(laws), feature_library=1, discrete_time=discrete, random_state=0, **start
    ).fit(X, Xdot)
    return JointFit(estimator, tuple(terms), tuple(map(np.array, coef)), estimator.modes_)


MASS = [[[0.0, 1.0, 0.0, 0.0], [-4.0, -0.5, 1.0, 0.0]]]  # x' = v, v' = -4 x - v / 2 + u
FREE = [[[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]]  # x' = v, v' = 0


def _reference(right, x0, t):
    solved = solve_ivp(right, (t[0], t[-1]), x0, t_eval=t, **TIGHT)
    return solved.y.T


def _drive(t):
    return np.sin(1.3 * t) + 0.5 * np.cos(3.1 * t)


# -- against solve_ivp with the same right-hand side ---------------------------------------------

T = np.linspace(0.0, 6.0, 121)
U = _drive(T)


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
    fit = _fit(MASS, [PlacedEffect(effect, place, 1, theta=theta)], [coef])
    signals = np.cos(T) if name == "signal" else None
    rollout = simulate_with_effects(fit, [1.0, 0.5], T, U, signals=signals, input_hold="linear")

    def right(t, x):
        return [x[1], -4.0 * x[0] - 0.5 * x[1] + _u(t) + force(t, x)]

    expected = _reference(right, [1.0, 0.5], T)
    assert rollout.status is Status.COMPLETED
    assert rollout.modes.max() == 0
    np.testing.assert_allclose(rollout.x, expected, atol=TOLERANCES.get(name, 2e-7))


def test_a_delayed_input_that_is_held_between_samples_jumps_late():
    # x' = u(t - d) with steps of u: a polygon
    t, d = np.linspace(0.0, 2.0, 21), 0.25
    u = np.sign(np.sin(5.0 * t + 0.1))
    fit = _fit([[[0.0, 0.0, 0.0]]], [PlacedEffect(Delay(), 1, 0, theta=(d,))], [[1.0]])
    rollout = simulate_with_effects(fit, [0.0], t, u)
    fine = np.linspace(0.0, 2.0, 40001)
    # the input had its first value before the first sample
    held = u[np.clip(np.searchsorted(t, fine - d + 1e-9, side="right") - 1, 0, None)]
    expected = np.concatenate([[0.0], np.cumsum(held[:-1]) * (fine[1] - fine[0])])
    np.testing.assert_allclose(rollout.x[:, 0], np.interp(t, fine, expected), atol=1e-4)


def test_an_effect_of_one_mode_acts_there_only():
    # two modes by the sign of x; a constant force beside them in the right one
    laws = [[[0.0, 1.0, 0.0], [-4.0, 0.0, 0.0]], [[0.0, 1.0, 0.0], [-9.0, 0.0, 0.0]]]
    fit = _fit(laws, guard=lambda X: X[:, 0])
    right_mode = int(fit.estimator.predict_modes([[0.5, 0.0]])[0])
    term = PlacedEffect(Polynomial(), (0, 0, 0), 1, mode=right_mode)
    fit = JointFit(fit.estimator, (term,), (np.array([-3.0]),), fit.modes)
    t = np.linspace(0.0, 5.0, 51)
    rollout = simulate_with_effects(fit, [1.0, 0.0], t)

    def right(time, x):
        if fit.estimator.predict_modes(x[None])[0] == right_mode:
            return [x[1], -9.0 * x[0] - 3.0 * x[0] ** 3]
        return [x[1], -4.0 * x[0]]

    np.testing.assert_allclose(rollout.x, _reference(right, [1.0, 0.0], t), atol=2e-3)
    assert set(rollout.modes) == {0, 1}


# -- dry friction --------------------------------------------------------------------------------


def test_a_mass_with_dry_friction_comes_to_rest_and_stays():
    # v' = -f sign(v): it stops at v0 / f after v0^2 / (2 f)
    fit = _fit(FREE, [PlacedEffect(CoulombFriction(), 1, 1)], [[0.8]])
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
    fit = _fit(law, [PlacedEffect(CoulombFriction(), 1, 1)], [[0.1]])
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
    fit = _fit(law, [PlacedEffect(CoulombFriction(), 1, 1)], [[0.53]])
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
    fit = _fit(FREE, [PlacedEffect(effect, 1, 1, theta=theta)], [coef])
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


def test_friction_does_not_stop_what_a_spring_pulls_through():
    fit = _fit(MASS, [PlacedEffect(CoulombFriction(), 1, 1)], [[0.3]])
    rollout = simulate_with_effects(fit, [1.0, 0.0], T, U, input_hold="linear")

    def right(t, x):
        return [x[1], -4.0 * x[0] - 0.5 * x[1] + _u(t) - 0.3 * np.tanh(x[1] / 1e-4)]

    options = {"method": "Radau", "rtol": 1e-8, "atol": 1e-10, "max_step": 0.05}
    smooth = solve_ivp(right, (0, 6), [1.0, 0.0], t_eval=T, **options).y.T
    np.testing.assert_allclose(rollout.x, smooth, atol=2e-3)  # the width of tanh


# -- effects that remember the state -------------------------------------------------------------


def test_a_delayed_state_by_the_method_of_steps():
    # x' = -x(t - 1), x = 1 before: 1 - t, then 1 - t + (t - 1)^2 / 2, then - (t - 2)^3 / 6
    fit = _fit([[[0.0, 0.0]]], [PlacedEffect(Delay(), 0, 0, theta=(1.0,))], [[-1.0]])
    t = np.linspace(0.0, 3.0, 61)
    rollout = simulate_with_effects(fit, [1.0], t)
    expected = 1.0 - t + np.maximum(t - 1, 0) ** 2 / 2 - np.maximum(t - 2, 0) ** 3 / 6
    np.testing.assert_allclose(rollout.x[:, 0], expected, atol=1e-4)  # history linear in substeps


def test_a_delay_shorter_than_a_step():
    # x' = -x(t - d) with slow exponential solutions: x = e^(-s t), s = e^(s d)
    d, s = 0.02, 1.0
    for _ in range(50):
        s = np.exp(s * d)
    fit = _fit([[[0.0, 0.0]]], [PlacedEffect(Delay(), 0, 0, theta=(d,))], [[-1.0]])
    t = np.linspace(0.0, 2.0, 11)
    rollout = simulate_with_effects(fit, [1.0], t)
    rates = -np.diff(np.log(rollout.x[5:, 0])) / np.diff(t[5:])
    np.testing.assert_allclose(rates, s, rtol=2e-4)  # history linear in substeps of 0.05 s


def test_play_of_a_state():
    # a mass that moves as cos t drags w with a play of 0.4: y' = w
    law = [[[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]]
    fit = _fit(law, [PlacedEffect(Backlash(), 0, 2, theta=(0.4,))], [[1.0]])
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


def _relay(low, high, terms=(), coef=()):
    """x' = 1 below the band, -1 above it; the surface itself is at x = 0."""
    laws = [[[0.0, 1.0]], [[0.0, -1.0]]]
    fit = _fit(laws, guard=lambda X: X[:, 0])
    upper = int(fit.estimator.predict_modes([[0.5]])[0])
    guard = Guard(terms=((0,),), weights=(1.0,), upper_mode=upper)
    term = PlacedEffect(GuardHysteresis(), guard, 0, theta=(low, high))
    return JointFit(fit.estimator, (term, *terms), (np.zeros(0), *coef), fit.modes), upper


def test_a_relay_with_hysteresis_oscillates_across_its_band():
    fit, upper = _relay(-0.31, 0.17)
    t = np.linspace(0.0, 5.0, 101)
    rollout = simulate_with_effects(fit, [-0.5], t)
    # up to 0.17 at first, then a saw tooth of width 0.48
    expected = 0.67 + 0.48 * np.arange(len(rollout.events))
    np.testing.assert_allclose([event.time for event in rollout.events], expected, atol=1e-8)
    assert len(rollout.events) == 10
    assert [event.after for event in rollout.events[:2]] == [upper, 1 - upper]
    since = np.mod(t - 0.67, 0.96)
    tooth = np.where(since < 0.48, 0.17 - since, -0.31 + since - 0.48)
    np.testing.assert_allclose(rollout.x[:, 0], np.where(t < 0.67, t - 0.5, tooth), atol=1e-8)


def test_a_bouncing_ball():
    # v' = -1 above the floor; x < 0 is the other mode, and the speed is multiplied by -0.7
    laws = [[[0.0, 1.0, 0.0], [0.0, 0.0, -1.0]], [[0.0, 1.0, 0.0], [0.0, 0.0, -1.1]]]
    fit = _fit(laws, guard=lambda X: -X[:, 0])
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


# -- sensors -------------------------------------------------------------------------------------


def test_what_a_sensor_with_an_offset_shows():
    plain = simulate_with_effects(_fit(MASS), [1.0, 0.5], T, U)
    fit = _fit(MASS, [PlacedEffect(SensorOffset(), 0, 0, theta=(0.4,))], [[]])
    rollout = simulate_with_effects(fit, [1.4, 0.5], T, U)
    np.testing.assert_allclose(rollout.x, plain.x + [0.4, 0.0], atol=1e-9)


def test_a_late_sensor_shows_the_past():
    law = [[[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]]
    fit = _fit(law, [PlacedEffect(ClockLag(), 0, 0, theta=(0.13,))], [[]])
    t = np.linspace(0.0, 5.0, 26)
    rollout = simulate_with_effects(fit, [1.0, 0.0], t)
    expected = np.column_stack([np.cos(np.maximum(t - 0.13, 0.0)), -np.sin(t)])
    np.testing.assert_array_equal(rollout.t, t)
    np.testing.assert_allclose(rollout.x, expected, atol=1e-7)


# -- maps ----------------------------------------------------------------------------------------


def test_maps_with_memory_are_iterated():
    # x[k+1] = 0.5 x[k] + 0.2 x[k-2] + 0.3 u[k-1] - 0.1 sign(x[k]) + 0.01 t
    law = [[[0.5, 0.0, 0.0]]]
    terms = [
        PlacedEffect(Delay(), 0, 0, theta=(2.0,)),
        PlacedEffect(Delay(), 1, 0, theta=(1.0,)),
        PlacedEffect(CoulombFriction(), 0, 0),
        PlacedEffect(Drift(), "level", 0),
    ]
    fit = _fit(law, terms, [[0.2], [0.3], [0.1], [0.01]], discrete=True)
    t, u = np.arange(30.0), np.sin(np.arange(30.0))
    rollout = simulate_with_effects(fit, [1.0], t, u)
    x = [1.0]
    for k in range(29):
        late, past = x[max(k - 2, 0)], u[max(k - 1, 0)]
        x.append(0.5 * x[k] + 0.2 * late + 0.3 * past - 0.1 * np.sign(x[k]) + 0.01 * k)
    np.testing.assert_allclose(rollout.x[:, 0], x, atol=1e-9)


# -- against plants with planted effects ---------------------------------------------------------


def _value(data, name):
    return data.effects[0].parameters[name]


PLANTED = {
    "coulomb_friction": lambda d: PlacedEffect(CoulombFriction(), 1, 1),
    "drift": lambda d: PlacedEffect(Drift(), "level" if _value(d, "of") == "level" else 0, 1),
    "periodic_forcing": lambda d: PlacedEffect(
        PeriodicForcing(), "time", 1, theta=(_value(d, "frequency"),)
    ),
    "input_coupling": lambda d: PlacedEffect(InputCoupling(), 3 + d.effects[0].channel, 1),
    "delay": lambda d: PlacedEffect(Delay(), 2, 1, replaced=2, theta=(_value(d, "delay"),)),
    "lag": lambda d: PlacedEffect(Lag(), 2, 1, replaced=2, theta=(_value(d, "time_constant"),)),
    "backlash": lambda d: PlacedEffect(Backlash(), 2, 1, replaced=2, theta=(_value(d, "width"),)),
    "sensor_offset": lambda d: PlacedEffect(SensorOffset(), 0, 0, theta=(_value(d, "offset"),)),
    "clock_lag": lambda d: PlacedEffect(ClockLag(), 1, 1, theta=(_value(d, "delay"),)),
    "guard_hysteresis": lambda d: PlacedEffect(
        GuardHysteresis(),
        Guard(((0,),), (1.0,), 1),
        1,
        theta=(0.2 - _value(d, "half_width"), 0.2 + _value(d, "half_width")),
    ),
    "reset": lambda d: PlacedEffect(Reset(), (0, 1), 1, theta=(_value(d, "factor"),)),
}


@pytest.mark.parametrize("kind", PLANTED)
def test_the_true_structure_rolls_out_like_the_plant(kind):
    data = make_undeclared(kind, n_samples=800, n_trajectories=8, noise=0.0, random_state=3)
    model = EffectRegressor(data.estimator, [PLANTED[kind](data)])
    model.fit(data.X, data.Xdot, t=data.t, groups=data.groups, signals=data.signals)
    fresh, error = data.test, []
    for group in range(3):
        rows = fresh.groups == group
        signals = None if fresh.signals is None else fresh.signals[rows]
        rollout = model.simulate(
            fresh.X[rows][0, :2],
            fresh.t[rows],
            fresh.X[rows][:, 2:],
            signals=signals,
            input_hold="linear",
        )
        assert rollout.status is Status.COMPLETED
        error.append(rollout.x - fresh.X[rows][:, :2])
    # the plant changes its mode at the end of a step of 12 ms, the model at the surface's own
    # time; the band of a hysteresis is known to a sample of 50 ms
    size = np.sqrt(np.mean(np.concatenate(error) ** 2, axis=0)) / fresh.X[:, :2].std(axis=0)
    assert (size < (0.08 if kind == "guard_hysteresis" else 0.05)).all()


# -- sentences -----------------------------------------------------------------------------------


def test_refusals_say_what_to_give():
    fit = _fit(MASS, [PlacedEffect(InputCoupling(), 4, 1)], [[1.0]])
    signals = np.zeros((len(T), 2))
    with pytest.raises(ValueError, match=r"has 1 inputs; give `inputs`"):
        simulate_with_effects(fit, [0.0, 0.0], T, signals=signals)
    with pytest.raises(ValueError, match=r"has 2 signals; give `signals`"):
        simulate_with_effects(fit, [0.0, 0.0], T, U)
    with pytest.raises(ValueError, match=r"signals hold 1 columns; give 2"):
        simulate_with_effects(fit, [0.0, 0.0], T, U, signals=signals[:, :1])
    with pytest.raises(ValueError, match=r"signals has shape \(122, 2\) for 121 times"):
        simulate_with_effects(fit, [0.0, 0.0], T, U, signals=np.zeros((122, 2)))
    with pytest.raises(ValueError, match="inputs hold 2 columns; give 1"):
        simulate_with_effects(fit, [0.0, 0.0], T, np.column_stack([U, U]), signals=signals)
    with pytest.raises(ValueError, match="x0 holds 3 states; give 2"):
        simulate_with_effects(fit, [0.0, 0.0, 0.0], T, U, signals=signals)
    with pytest.raises(ValueError, match="input_hold='cubic' is unknown"):
        simulate_with_effects(fit, [0.0, 0.0], T, U, signals=signals, input_hold="cubic")
    with pytest.raises(TypeError, match="accuracy"):
        simulate_with_effects(fit, [0.0, 0.0], T, U, signals=signals, accuracy=1)
    relay, _ = _relay(-0.1, 0.1)
    with pytest.raises(TypeError, match="accuracy"):
        simulate_with_effects(relay, [0.0], T, accuracy=1)


@pytest.mark.parametrize("terms", [[], [PlacedEffect(Delay(), 0, 1, theta=(0.1,))]])
def test_a_rollout_ends_where_its_inputs_end(terms):
    fit = _fit(MASS, terms, [[0.1] for _ in terms])
    rollout = simulate_with_effects(fit, [1.0, 0.0], T, U[:50])
    assert rollout.status is Status.INPUT_RANGE
    np.testing.assert_array_equal(rollout.t, T[:50])


@pytest.mark.parametrize("terms", [[], [PlacedEffect(Delay(), 0, 0, theta=(0.1,))]])
def test_a_rollout_that_diverges_says_so(terms):
    fit = _fit([[[2.0, 0.0]]], terms, [[1.0] for _ in terms])
    rollout = simulate_with_effects(fit, [1.0], np.linspace(0, 20, 101), state_bound=1e3)
    assert rollout.status is Status.STATE_LIMIT
    assert np.abs(rollout.x).max() <= 1e3


def test_a_user_effect_with_a_break_slides():
    class Latch(Effect):
        kind = "latch"
        terms = ("force",)

        def columns(self, records, place, level):
            return -np.sign(records.channel(place) - level)[:, None]

        def breaks(self, place, level):
            return ((place, level),)

    fit = _fit([[[0.0, 0.0]]], [PlacedEffect(Latch(), 0, 0, theta=(0.25,))], [[0.5]])
    t = np.linspace(0.0, 3.0, 31)
    rollout = simulate_with_effects(fit, [1.0], t)
    np.testing.assert_allclose(rollout.x[:, 0], np.maximum(1.0 - 0.5 * t, 0.25), atol=1e-9)
