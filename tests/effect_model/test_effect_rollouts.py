"""Rollouts with effects: sensors, maps, planted plants, and what is refused."""

import numpy as np
import pytest
from effect_fits import MASS, T, U, fit_by_hand, relay
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from swsysid import EffectRegressor, SwitchingSystemRegressor
from swsysid._effect_model.simulation import simulate_with_effects
from swsysid._results import Status
from swsysid.datasets import make_undeclared
from swsysid.effects import (
    Backlash,
    ClockLag,
    CoulombFriction,
    Delay,
    Drift,
    Effect,
    GuardHysteresis,
    InputCoupling,
    Lag,
    PeriodicForcing,
    PlacedEffect,
    Reset,
    SensorOffset,
)
from swsysid.effects._guards import Guard

# -- sensors -------------------------------------------------------------------------------------


def test_what_a_sensor_with_an_offset_shows():
    plain = simulate_with_effects(fit_by_hand(MASS), [1.0, 0.5], T, U)
    fit = fit_by_hand(MASS, [PlacedEffect(SensorOffset(), 0, 0, theta=(0.4,))], [[]])
    rollout = simulate_with_effects(fit, [1.4, 0.5], T, U)
    np.testing.assert_allclose(rollout.x, plain.x + [0.4, 0.0], atol=1e-9)


def test_a_late_sensor_shows_the_past():
    law = [[[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]]
    fit = fit_by_hand(law, [PlacedEffect(ClockLag(), 0, 0, theta=(0.13,))], [[]])
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
    fit = fit_by_hand(law, terms, [[0.2], [0.3], [0.1], [0.01]], discrete=True)
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
    fit = fit_by_hand(MASS, [PlacedEffect(InputCoupling(), 4, 1)], [[1.0]])
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
    banded, _ = relay(-0.1, 0.1)
    with pytest.raises(TypeError, match="accuracy"):
        simulate_with_effects(banded, [0.0], T, accuracy=1)


def test_what_happens_to_the_samples_before_the_model_happens_in_a_rollout():
    scaled = make_pipeline(
        StandardScaler(), SwitchingSystemRegressor(n_modes=1, feature_library=1, random_state=0)
    )
    rng = np.random.default_rng(1)
    X = rng.uniform(-1, 1, (200, 3)) * [1.0, 2.0, 5.0] + [0.5, 0.0, 1.0]
    Xdot = np.column_stack([X[:, 1], -4 * X[:, 0] - 0.5 * X[:, 1] + X[:, 2]])
    Xdot[:, 1] -= 0.3 * np.sign(X[:, 1])
    terms = [PlacedEffect(CoulombFriction(), 1, 1)]
    model = EffectRegressor(scaled, terms).fit(X, Xdot)
    rollout = model.simulate([1.0, 0.0], T, U, input_hold="linear")
    plain = simulate_with_effects(
        fit_by_hand(MASS, terms, [[0.3]]), [1.0, 0.0], T, U, input_hold="linear"
    )
    np.testing.assert_allclose(rollout.x, plain.x, atol=1e-7)


@pytest.mark.parametrize("terms", [[], [PlacedEffect(Delay(), 0, 1, theta=(0.1,))]])
def test_a_rollout_ends_where_its_inputs_end(terms):
    fit = fit_by_hand(MASS, terms, [[0.1] for _ in terms])
    rollout = simulate_with_effects(fit, [1.0, 0.0], T, U[:50])
    assert rollout.status is Status.INPUT_RANGE
    np.testing.assert_array_equal(rollout.t, T[:50])


@pytest.mark.parametrize("terms", [[], [PlacedEffect(Delay(), 0, 0, theta=(0.1,))]])
def test_a_rollout_that_diverges_says_so(terms):
    fit = fit_by_hand([[[2.0, 0.0]]], terms, [[1.0] for _ in terms])
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

    fit = fit_by_hand([[[0.0, 0.0]]], [PlacedEffect(Latch(), 0, 0, theta=(0.25,))], [[0.5]])
    t = np.linspace(0.0, 3.0, 31)
    rollout = simulate_with_effects(fit, [1.0], t)
    np.testing.assert_allclose(rollout.x[:, 0], np.maximum(1.0 - 0.5 * t, 0.25), atol=1e-9)
