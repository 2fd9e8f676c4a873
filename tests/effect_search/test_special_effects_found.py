"""Effects that have to be asked for: found where planted, refused where a simpler one does."""

import numpy as np
import presliding_plants as plants
import pytest

from swsysid import EffectRegressor, EffectSearchCV, SwitchingSystemRegressor
from swsysid.datasets import make_undeclared
from swsysid.effects import (
    Bias,
    BoucWen,
    CoulombFriction,
    DahlFriction,
    Hill,
    InputGain,
    LoadFriction,
    LuGreFriction,
    PlacedEffect,
    Polynomial,
    QuadraticDrag,
    Quantisation,
    Ripple,
    Saturation,
    SensorOffset,
    SoftSaturation,
    StribeckFriction,
    Trigonometric,
)

COMMON = [Bias(), CoulombFriction(), QuadraticDrag(), Polynomial(), Saturation()]
COMMON += [Trigonometric(), StribeckFriction(), SensorOffset()]


def search(data, effects, max_effects=2):
    found = EffectSearchCV(data.estimator, effects=effects, max_effects=max_effects)
    return found.fit(data.X, data.Xdot, t=data.t, groups=data.groups)


# effect, plant, parameter, its tolerance (relative)
PLANTED = [
    (LoadFriction(), "pendulum", "friction", 0.02),
    (LoadFriction(), "oscillator", "friction", 0.02),
    (InputGain(), "pendulum", "change", 0.02),
    (SoftSaturation(), "pendulum", "scale", 0.1),
    (Hill(), "pendulum", "scale", 0.05),
    (Ripple(), "pendulum", "period", 0.002),
    (Ripple(), "quartic", "period", 0.002),
    (Quantisation(), "pendulum", "step", 1e-6),
    (Quantisation(), "oscillator", "step", 1e-6),
]


@pytest.mark.parametrize(
    ("effect", "system", "name", "tolerance"),
    [
        pytest.param(
            *row,
            id=f"{row[0].kind}-{row[1]}",
            # the same effects in other plants
            marks=[] if row[1] == "pendulum" else [pytest.mark.nightly],
        )
        for row in PLANTED
    ],
)
def test_a_planted_effect_is_found_among_the_common_ones(effect, system, name, tolerance):
    data = make_undeclared(effect.kind, system=system, random_state=3)
    first, truth = search(data, [*COMMON, effect]).effects_[0], data.effects[0]
    assert (first.kind, first.target) == (effect.kind, truth.target)
    assert first.parameters[name] == pytest.approx(truth.parameters[name], rel=tolerance)
    assert first.error_after < 0.8 * first.error_before


CONTACTS = [
    (plants.dahl, 0.0, [DahlFriction()], {"friction": plants.FRICTION, "stiffness": 40.0}),
    (plants.bouc_wen, 0.0, [DahlFriction(), BoucWen()], {"friction": plants.FRICTION}),
    (plants.lugre, 3.0, [DahlFriction(), LuGreFriction()], {"micro_damping": 3.0}),
]


@pytest.mark.parametrize(
    ("contact", "micro_damping", "library", "known"),
    CONTACTS,
    ids=[row[0].__name__ for row in CONTACTS],
)
def test_a_contact_with_a_hidden_state_is_found(contact, micro_damping, library, known):
    data = plants.recorded(contact, 3, micro_damping=micro_damping)
    data.estimator = SwitchingSystemRegressor(1, feature_library=1, loss="squared")
    effects = [Bias(), CoulombFriction(), Polynomial(), StribeckFriction(), *library]
    result = search(data, effects, max_effects=1)
    first = result.effects_[0]
    assert (first.kind, first.place, first.target) == (library[-1].kind, "x1", 1)
    for name, value in known.items():
        assert first.parameters[name] == pytest.approx(value, rel=0.05)
    # what is left is the noise
    assert first.error_after < 1.15 * 0.02 * data.Xdot[:, 1].std()


def test_what_a_search_has_found_is_rolled_out():
    data = plants.recorded(plants.dahl, 3, noise=0.0)
    effect = PlacedEffect(DahlFriction(), 1, 1, theta=(plants.DISTANCE,))
    model = EffectRegressor(
        SwitchingSystemRegressor(1, feature_library=1, loss="squared"), [effect]
    )
    model.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    rows = data.groups == 2
    t, x, u = data.t[rows][:100], data.X[rows, :2][:100], data.X[rows, 2:][:100]
    rolled = model.simulate(x[0], t, u, input_hold="linear").x
    # two hundredths of the spread: the contact at the start is that of its own first velocity
    assert np.abs(rolled - x).max() < 0.02 * x.std(axis=0).max()


# -- what the record cannot tell -------------------------------------------------------------------

REFUSED = [
    ("coulomb_friction", [CoulombFriction(), DahlFriction()]),
    ("coulomb_friction", [CoulombFriction(), LuGreFriction()]),
    ("coulomb_friction", [CoulombFriction(), BoucWen()]),
    ("coulomb_friction", [CoulombFriction(), LoadFriction()]),
    ("trigonometric", [Trigonometric(), Ripple()]),
    ("quadratic_drag", [QuadraticDrag(), InputGain(), SoftSaturation()]),
    ("polynomial", [Polynomial(), SoftSaturation(), Hill(), InputGain()]),
    ("sensor_offset", [SensorOffset(), Quantisation()]),
]


@pytest.mark.parametrize(
    ("kind", "library"), REFUSED, ids=[f"{row[0]}-{row[1][-1].kind}" for row in REFUSED]
)
def test_the_simpler_effect_stays(kind, library):
    data = make_undeclared(kind, system="pendulum", random_state=3)
    found = search(data, library).effects_
    assert [one.kind for one in found] == [kind]


def test_a_constant_load_is_no_load():
    data = make_undeclared("coulomb_friction", system="pendulum", random_state=3)
    effects = [CoulombFriction(), LoadFriction(loads=["signal0"])]
    model = EffectSearchCV(data.estimator, effects=effects)
    signals = np.full((len(data.X), 1), 2.5)
    model.fit(data.X, data.Xdot, t=data.t, groups=data.groups, signals=signals)
    (found,) = model.effects_
    assert found.kind == "coulomb_friction"
    assert [rival.kind for rival in found.rivals] == ["load_friction"]


@pytest.mark.nightly
def test_the_size_of_a_pump_that_never_runs_backwards_is_the_pump():
    data = make_undeclared(None, system="tanks", random_state=3)
    loss = -0.02 * data.X[:, 2] * data.X[:, 0]
    data.Xdot = data.Xdot + np.outer(loss, [1.0, 0.0])
    (found,) = search(data, [Polynomial(), InputGain()]).effects_
    assert (found.kind, found.place) == ("polynomial", "x0 x2")
    assert "input_gain" in [rival.kind for rival in found.rivals]


@pytest.mark.parametrize("system", ["pendulum", "tanks"])
def test_a_clean_system_stays_clean(system):
    data = make_undeclared(None, system=system, random_state=4)
    asked = [LoadFriction(), InputGain(), SoftSaturation(), Hill(), Ripple(), Quantisation()]
    assert search(data, [*asked, DahlFriction()]).effects_ == []
