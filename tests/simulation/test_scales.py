"""Rollouts in other units and far from zero: tolerances and limits follow the states."""

import numpy as np
import pytest

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid._data.coordinates import Extent
from swsysid._simulation.inputs import Options
from swsysid._simulation.simulate import simulate
from swsysid._simulation.system import SwitchingSystem
from swsysid.refinement import StatedModel, StatedSurface
from swsysid.results import Status

T = np.linspace(0.0, 8.0, 81)
UNITS = [1e-12, 1e-6, 1e6, 1e12]


def bumper(x):
    """Velocities of a mass that meets a stiff bumper at 0.4."""
    force = -x[:, 0] - 0.1 * x[:, 1] - 15.0 * np.maximum(x[:, 0] - 0.4, 0.0)
    return np.column_stack([x[:, 1], force])


def fitted(offset=0.0, unit=1.0):
    x = np.random.default_rng(0).uniform(-1.5, 1.5, (300, 2))
    estimator = SwitchingSystemRegressor(
        2, feature_library=1, surface=PolynomialSurfaceClassifier(degree=1), random_state=0
    )
    return estimator.fit((x + offset) * unit, bumper(x) * unit)


@pytest.fixture(scope="module")
def usual():
    return fitted().simulate([-1.2, 0.0], T)


@pytest.mark.parametrize("unit", UNITS)
def test_a_rollout_is_the_same_in_any_unit(usual, unit):
    rollout = fitted(unit=unit).simulate([-1.2 * unit, 0.0], T)
    assert rollout.status is Status.COMPLETED
    assert len(rollout.events) == len(usual.events) == 4
    np.testing.assert_allclose(rollout.x / unit, usual.x, atol=1e-9)


@pytest.mark.parametrize("offset", [1e2, 1e4, 1e6])
def test_a_rollout_is_the_same_far_from_zero(usual, offset):
    moves = np.array([offset, 0.0])
    rollout = fitted(moves).simulate([offset - 1.2, 0.0], T)
    # events are located to 1e-8 of the integration; laws are known to a millionth of 1e-10
    np.testing.assert_allclose(rollout.x - moves, usual.x, atol=1e-6)
    np.testing.assert_allclose(
        [one.time for one in rollout.events], [one.time for one in usual.events], atol=1e-6
    )


def test_an_offset_and_a_small_unit_together(usual):
    moves, unit = np.array([3e4, 0.0]), 1e-9
    rollout = fitted(moves, unit).simulate(([-1.2, 0.0] + moves) * unit, T)
    np.testing.assert_allclose(rollout.x / unit - moves, usual.x, atol=1e-6)


@pytest.mark.parametrize("unit", UNITS)
def test_a_stated_model_takes_its_unit_from_the_start(unit):
    # one field pushes down above zero, the other up below: the state slides along v = 0
    laws = [[[0, 0, 1], [0.5 * unit, -1, 0]], [[0, 0, 1], [-0.5 * unit, -1, 0]]]
    surface = StatedSurface([[0, 0, 1]], 1)
    plant = StatedModel(1, laws, states=["x", "v"], surface=surface)
    rollout = plant.simulate([2.0 * unit, 0.0], T)
    assert rollout.status is Status.COMPLETED
    assert {"crossing", "sliding"} >= {one.kind for one in rollout.events}
    # half a period moves from 2 by way of a spring about 0.5 to -1, the next one to rest
    assert rollout.x[-1, 0] / unit == pytest.approx(0.0, abs=0.5)
    np.testing.assert_allclose(rollout.x[-1, 1] / unit, 0.0, atol=1e-8)


def test_states_diverge_a_thousand_million_spreads_away():
    class Growing(SwitchingSystem):
        def velocity(self, x, u, mode):
            return 1e10 * np.ones(1)

        def mode(self, x, u):
            return 0

    assert simulate(Growing(), [1.0], [0.0, 1.0]).status is Status.STATE_LIMIT
    assert simulate(Growing(), [1e10], [0.0, 1.0]).status is Status.COMPLETED
    limited = simulate(Growing(), [1e10], [0.0, 1.0], state_bound=1e9)
    assert (limited.status, len(limited.t)) == (Status.STATE_LIMIT, 0)


def test_what_a_user_gives_is_absolute():
    scales = Options(atol=1e-3, state_bound=5.0).scales(None, np.array([1e6, 0.0]))
    np.testing.assert_array_equal(scales.atol, 1e-3)
    np.testing.assert_array_equal(scales.bound, 5.0)
    known = Extent(np.array([300.0]), np.array([0.25]))
    scales = Options().scales(known, np.array([301.0]))
    np.testing.assert_allclose([scales.origin, scales.size], [[300.0], [0.25]])
    np.testing.assert_allclose([scales.atol[0], scales.bound[0]], [2.5e-11, 1e9])
