"""Effects that are looked for where they are asked for: columns by hand and by other means."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swsysid._data.records import make_records
from swsysid.effects import (
    BoucWen,
    CoulombFriction,
    DahlFriction,
    Hill,
    InputGain,
    LoadFriction,
    LuGreFriction,
    PlacedEffect,
    Quantisation,
    Ripple,
    SoftSaturation,
)


def records(X, n_states=None, **options):
    X = np.asarray(X, dtype=float)
    return make_records(X, n_states or X.shape[1], names=list("abcd")[: X.shape[1]], **options)


def test_products_of_two_channels_by_hand():
    data = records([[2.0, -3.0, -0.5], [-1.0, 4.0, 2.0]], n_states=2)
    # against the sign of b, in proportion to |c|
    assert LoadFriction().columns(data, (1, 2))[:, 0].tolist() == [0.5, -2.0]
    assert InputGain().columns(data, (0, 2))[:, 0].tolist() == [1.0, -2.0]
    assert LoadFriction(velocities=["b"], loads=["c", 0]).places(data) == [(1, 2), (1, 0)]
    # one choice more than friction under a constant load
    counts = [
        PlacedEffect(effect, place, 1).n_parameters
        for effect, place in ((CoulombFriction(), 1), (LoadFriction(), (1, 2)))
    ]
    assert counts == [1, 2]


def test_a_logged_load_is_a_place():
    data = records([[1.0], [-1.0]], t=[0.0, 1.0], signals=[[3.0], [4.0]])
    assert LoadFriction().places(data) == [(0, 1)]
    assert LoadFriction().label((0, 1), data.names) == "|signal0| sign(a)"
    assert LoadFriction().columns(data, (0, 1))[:, 0].tolist() == [-3.0, 4.0]


def test_rational_terms_by_hand():
    data = records([[-2.0], [0.0], [2.0]])
    assert SoftSaturation().columns(data, 0, 2.0)[:, 0].tolist() == [-1.0, 0.0, 1.0]
    assert Hill().columns(data, 0, 2.0)[:, 0].tolist() == [0.5, 0.0, 0.5]


def test_a_ripple_begins_where_a_slow_sine_ends():
    data = records(np.linspace(0.0, 1.0, 1001)[:, None])
    np.testing.assert_allclose(
        Ripple().columns(data.take(np.array([0, 25, 50])), 0, 0.1),
        [[0, 1], [1, 0], [0, -1]],
        atol=1e-12,
    )
    (period,) = Ripple().parameters(data, 0)
    # six periods to a hundred in the range, of which two hundredths are left out
    assert period.values[[0, -1]] == pytest.approx([0.98 / 100.0, 0.98 / 6.0])
    (known,) = Ripple(period=0.25).parameters(data, 0)
    assert known.values.tolist() == [0.25]


def test_steps_of_a_sensor_are_seen_and_undone():
    t = np.linspace(0.0, 10.0, 500)
    x = np.sin(t) + 0.3
    data = records((0.25 * np.round(x / 0.25))[:, None], t=t)
    effect = Quantisation()
    (step,) = effect.parameters(data, 0)
    np.testing.assert_allclose(step.values, [0.0, 0.25], atol=1e-12)
    assert effect.is_possible(data, 0, data.X, False)
    errors = [one.X[:, 0] - x for one in (data, effect.corrected(data, 0, 0.25))]
    # of a rounding 0.25 / sqrt(12), and between the edges of the steps a third of that
    assert errors[0].std() == pytest.approx(0.072, abs=0.005)
    assert errors[1].std() < 0.4 * errors[0].std()
    assert effect.recorded(data, 0, 0.25).X.tolist() == data.X.tolist()
    assert effect.corrected(data, 0, 0.0).X.tolist() == data.X.tolist()
    # no steps: a smooth record, one of three decimals, a constant
    for smooth in (x, np.round(x, 3), np.ones(500)):
        assert not effect.is_possible(records(smooth[:, None], t=t), 0, data.X, False)


# -- hidden states, against an integration of their differential equations ------------------------

DISTANCE = 0.1


def dahl(w, v):
    return (v - abs(v) * w) / DISTANCE


def lugre(w, v):
    return (v - abs(v) * w / (1.0 + 0.5 * np.exp(-((v / 0.4) ** 2)))) / DISTANCE


def bouc_wen(w, v):
    return (v - abs(w) ** 2 * (0.6 * abs(v) * np.sign(w) + 0.4 * v)) / DISTANCE


@pytest.mark.parametrize(
    ("effect", "theta", "law", "tolerance"),
    [
        (DahlFriction(), (DISTANCE,), dahl, 1e-4),
        (LuGreFriction(), (DISTANCE, 0.4, 0.5), lugre, 2e-3),  # one velocity for each step
        (BoucWen(), (DISTANCE, 2.0, 0.6), bouc_wen, 2e-3),
    ],
    ids=["dahl", "lugre", "bouc_wen"],
)
def test_the_hidden_state_is_that_of_the_differential_equation(effect, theta, law, tolerance):
    t = np.linspace(0.0, 6.0, 601)
    velocity = np.sin(2.0 * t) + 0.5 * np.sin(5.3 * t)
    data = records(velocity[:, None], t=t)

    def field(time, w):
        return [law(w[0], np.interp(time, t, velocity))]

    done = solve_ivp(field, (0.0, 6.0), [0.0], t_eval=t, max_step=0.01, rtol=1e-8, atol=1e-10)
    columns = effect.columns(data, 0, *theta)
    np.testing.assert_allclose(columns[:, 0], -done.y[0], atol=tolerance)
    if effect.kind == "lugre_friction":
        rates = [DISTANCE * law(w, v) for w, v in zip(done.y[0], velocity, strict=True)]
        np.testing.assert_allclose(columns[:, 1], -np.array(rates), atol=5.0 * tolerance)


@pytest.mark.parametrize(
    "effect", [DahlFriction(), LuGreFriction(), BoucWen()], ids=lambda e: e.kind
)
def test_a_stiff_contact_is_dry_friction(effect):
    t = np.linspace(0.0, 6.0, 301)
    data = records(np.sin(2.0 * t)[:, None] + 0.001, t=t)
    theta = [parameter.values[0] for parameter in effect.parameters(data, 0)]
    theta[0] = 1e-6
    if effect.kind == "lugre_friction":
        theta[2] = 0.0
    dry = CoulombFriction().columns(data, 0)
    np.testing.assert_allclose(effect.columns(data, 0, *theta)[:, :1], dry, atol=1e-6)


@pytest.mark.parametrize(
    "effect", [DahlFriction(), LuGreFriction(), BoucWen()], ids=lambda e: e.kind
)
def test_a_shortened_record_goes_on_alike(effect):
    rng = np.random.default_rng(0)
    t = 0.01 * np.arange(2000)
    data = records(np.cumsum(rng.normal(scale=0.1, size=2000))[:, None], t=t)
    theta = [DISTANCE, 2.0, 0.6][: len(effect.parameters(data, 0))]
    short = effect.shortened(data, 0, *theta)
    assert len(short) < len(data)
    last = effect.columns(short, 0, *theta)[-1], effect.columns(data, 0, *theta)[-1]
    np.testing.assert_allclose(*last, atol=1e-6)


def test_two_trajectories_do_not_share_a_contact():
    t = np.linspace(0.0, 1.0, 50)
    velocity = np.concatenate([np.sin(9.0 * t), np.cos(9.0 * t)])
    both = records(velocity[:, None], t=np.tile(t, 2), groups=np.repeat([0, 1], 50))
    second = records(velocity[50:, None], t=t)
    columns = DahlFriction().columns(both, 0, DISTANCE)[50:]
    np.testing.assert_array_equal(columns, DahlFriction().columns(second, 0, DISTANCE))
    # the velocity was there before the first sample
    assert columns[0, 0] == -1.0
