"""The search for effects says the same in any unit and far from zero."""

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid.effects import Bias, CoulombFriction
from swsysid.refinement import StatedModel, StatedSurface
from swsysid.results import Status

T = np.linspace(0.0, 12.0, 241)
STARTS = ([2.0, 0.0], [-2.5, 0.0], [1.5, 2.0], [0.0, 3.0], [3.0, -1.0], [-1.0, -2.0])


def recorded(unit=1.0, offset=0.0):
    """A spring with viscous and dry friction, with its measured velocities."""
    laws = [[[0.3 * side * (row == 1), -row, 1 - 1.2 * row] for row in (0, 1)] for side in (1, -1)]
    plant = StatedModel(1, laws, states=["x", "v"], surface=StatedSurface([[0, 0, 1]], 1))
    x = np.vstack([plant.simulate(start, T).x for start in STARTS])
    velocities = np.column_stack([x[:, 1], -x[:, 0] - 0.2 * x[:, 1] - 0.3 * np.sign(x[:, 1])])
    velocities += 0.02 * np.random.default_rng(0).standard_normal(x.shape)
    groups = np.repeat(np.arange(len(STARTS)), len(T))
    return (x + [offset, 0.0]) * unit, velocities * unit, np.tile(T, len(STARTS)), groups


def searched(unit=1.0, offset=0.0):
    x, velocities, t, groups = recorded(unit, offset)
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(declared, effects=[Bias(), CoulombFriction()], random_state=0)
    return search.fit(x, velocities, t=t, groups=groups)


@pytest.fixture(scope="module")
def usual():
    return searched()


def test_a_rollout_that_diverges_at_once_is_empty(usual):
    for hold in ("zero", "linear"):
        rollout = usual.simulate([2.0, 0.0], T, state_bound=1.0, input_hold=hold)
        assert (rollout.status, rollout.x.shape) == (Status.STATE_LIMIT, (0, 2))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("unit", "offset"), [(1e-12, 0.0), (1e12, 0.0), (1.0, 1e3), (1.0, 1e6), (1e-9, 1e4)]
)
def test_the_same_effect_of_the_same_size(usual, unit, offset):
    other = searched(unit, offset)
    [one], [same] = usual.effects_, other.effects_
    assert (one.kind, one.target) == (same.kind, same.target) == ("coulomb_friction", 1)
    assert same.parameters["friction"] / unit == pytest.approx(one.parameters["friction"], rel=1e-6)
    assert same.error_after / unit == pytest.approx(one.error_after, rel=1e-6)
    moves = np.array([offset, 0.0])
    rollouts = [
        usual.simulate([2.0, 0.0], T).x,
        other.simulate(([2.0, 0.0] + moves) * unit, T).x / unit - moves,
    ]
    np.testing.assert_allclose(rollouts[1], rollouts[0], atol=1e-6)
