"""Signs and places that physics allows: a friction opposes a velocity, in its own equation."""

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid.datasets import make_undeclared
from swsysid.effects import (
    AsymmetricFriction,
    CoulombFriction,
    Delay,
    Lag,
    Polynomial,
    QuadraticDrag,
)
from swsysid.effects._kinematics import with_kinematics

FRICTIONS = [CoulombFriction(), QuadraticDrag(), AsymmetricFriction(), Polynomial()]


def seen(data, Xdot=None, rows=1500, **options):
    """The record with what its velocities say of the states."""
    options = {"t": data.t, "groups": data.groups} | options
    records = make_records(data.X, 2, names=["x", "v", "u"], **options)
    targets = (data.Xdot if Xdot is None else Xdot)[:rows]
    return with_kinematics(records, np.arange(rows), targets, False)


@pytest.fixture(scope="module")
def pendulum():
    return make_undeclared(None, system="pendulum", random_state=5)


def search(data, Xdot, effects):
    found = EffectSearchCV(data.estimator, effects=effects, max_effects=2)
    return found.fit(data.X, Xdot, t=data.t, groups=data.groups)


def with_force(data, force):
    """Velocities with a further force."""
    return data.Xdot + np.outer(force, [0.0, 1.0])


@pytest.mark.parametrize("noise", [0.02, 0.2])
def test_velocities_tell_positions(noise):
    data = make_undeclared(None, noise=noise, outliers=0.05, random_state=5)
    known = seen(data)
    assert (known.rates, known.positions) == ({0, 1}, {0: 1})
    untimed = seen(data, t=None)
    assert (untimed.rates, untimed.positions) == ({0, 1}, {0: 1})
    # x' = v says so without any order of the rows
    assert seen(data, t=None, groups=None).positions == {0: 1}


def test_of_an_oscillation_one_state_is_the_position():
    # x' = v and nearly v' = -2 x: the other way round it fits less well
    rng, t = np.random.default_rng(0), 0.02 * np.arange(1000)
    x, v = np.sin(1.414 * t), 1.414 * np.cos(1.414 * t)
    targets = np.column_stack([v, -2.0 * x + 0.2 * rng.standard_normal(1000)])
    records = make_records(np.column_stack([x, v]), 2, t=t, names=["x", "v"])
    assert with_kinematics(records, np.arange(1000), targets, False).positions == {0: 1}


def test_a_law_of_a_force_is_the_rate_of_nothing(pendulum):
    forces = 95.0 * pendulum.Xdot + 20.0 * np.sign(pendulum.X[:, :2])
    known = seen(pendulum, forces[:, ::-1])
    assert not known.rates and not known.positions


def test_friction_has_its_place_in_its_own_equation(pendulum):
    known, friction = seen(pendulum), CoulombFriction()
    assert list(friction.places(known)) == [1]
    assert friction.acts_in(known, 1, 1) and not friction.acts_in(known, 1, 0)
    # without times and kinematics nothing is known, and nothing is refused
    unknown = make_records(pendulum.X, 2, names=["x", "v", "u"])
    assert list(friction.places(unknown)) == [0, 1] and friction.acts_in(unknown, 0, 1)
    named = CoulombFriction(velocities=["x", 2])
    assert list(named.places(known)) == [0, 2]
    with pytest.raises(ValueError, match="'speed' is no channel of this record; choose from x, v"):
        CoulombFriction(velocities=["speed"]).places(known)


def test_what_gives_power_is_no_friction(pendulum):
    """A dry force along the motion, such as that of an escapement."""
    pushed = search(pendulum, with_force(pendulum, np.sign(pendulum.X[:, 1])), FRICTIONS)
    assert "coulomb_friction" not in [found.kind for found in pushed.effects_]
    held = search(pendulum, with_force(pendulum, -np.sign(pendulum.X[:, 1])), FRICTIONS)
    assert [found.kind for found in held.effects_] == ["coulomb_friction"]
    # 1500 rows at 2 % noise, which is 0.08 in the unit of the force
    assert held.effects_[0].parameters["friction"] == pytest.approx(1.0, abs=0.02)


@pytest.mark.nightly
def test_a_relay_of_the_position_is_no_friction(pendulum):
    force = with_force(pendulum, -2.0 * np.sign(pendulum.X[:, 0]))
    found = search(pendulum, force, FRICTIONS).effects_
    assert found and not [one.kind for one in found if one.kind.endswith("friction")]


# -- causes come first -----------------------------------------------------------------------------


def driven(seen_of_input, step=0.02):
    """``v' = -v + what is seen of a switched input``, with one per cent of noise."""
    rng, t = np.random.default_rng(0), step * np.arange(1600)
    u = np.repeat(rng.choice([-1.0, 1.0], 80), 20)
    acting = seen_of_input(u)
    v = np.zeros(len(t))
    for row in range(1, len(t)):
        v[row] = v[row - 1] + step * (acting[row - 1] - v[row - 1])
    Xdot = acting - v + 0.01 * rng.standard_normal(len(t))
    return np.column_stack([v, u]), Xdot[:, None], t


@pytest.mark.parametrize(
    ("kernel", "kinds"),
    [
        ([0.1, 0.2, 0.4, 0.2, 0.1], []),  # a filter looks both ways
        ([0.0, 0.0, 0.7, 0.3, 0.0], []),  # held between samples: late by 0.3 steps
        ([0.0, 0.0, 0.0, 0.0, 1.0], ["delay"]),  # two samples late
    ],
    ids=["filtered", "held", "delayed"],
)
def test_what_a_filter_or_a_hold_does_to_an_input_is_no_delay(kernel, kinds):
    X, Xdot, t = driven(lambda u: np.convolve(u, kernel, mode="same"))
    declared = SwitchingSystemRegressor(1, feature_library=1, loss="squared", random_state=0)
    search = EffectSearchCV(declared, effects=[Delay(), Lag()], max_effects=1).fit(X, Xdot, t=t)
    assert [found.kind for found in search.effects_] == kinds
    for found in search.effects_:
        assert found.parameters["delay"] == pytest.approx(0.04, rel=0.1)
