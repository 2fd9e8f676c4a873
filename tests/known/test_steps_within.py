"""The least of a quadratic form within linear constraints."""

import numpy as np
import pytest
from scipy.optimize import minimize

from swsysid import Known
from swsysid._known.program import Steps

NOTHING = np.zeros((0, 2)), np.zeros(0)


def test_a_corner_by_hand():
    # |z - (3, 1)|^2 on z0 + z1 = 2 with z0 <= 1.5: without the bound (2, 0)
    steps = Steps(np.ones((1, 2)), np.array([2.0]), np.array([[1.0, 0.0]]), np.array([1.5]))
    np.testing.assert_allclose(steps.least(np.eye(2), np.array([3.0, 1.0])), [1.5, 0.5], atol=1e-14)
    free = steps.without_bounds.least(np.eye(2), np.array([3.0, 1.0]))
    np.testing.assert_allclose(free, [2.0, 0.0], atol=1e-14)


@pytest.mark.parametrize("seed", range(20))
def test_it_is_the_answer_of_another_solver(seed):
    rng = np.random.default_rng(seed)
    n, size = 6, 10.0 ** rng.normal()
    root, right = rng.normal(size=(8, n)), 5.0 * rng.normal(size=n)
    A, b, G = rng.normal(size=(2, n)), rng.normal(size=2), rng.normal(size=(4, n))
    h = rng.uniform(0.0, 1.0, 4) + G @ np.linalg.lstsq(A, b, rcond=None)[0]
    S = size * root.T @ root
    found = Steps(A, b, G, h).least(S, right)
    other = minimize(
        lambda z: z @ S @ z / 2 - right @ z, np.zeros(n), jac=lambda z: S @ z - right,
        constraints=[
            {"type": "eq", "fun": lambda z: A @ z - b},
            {"type": "ineq", "fun": lambda z: h - G @ z},
        ],
        method="SLSQP", options={"maxiter": 500, "ftol": 1e-15},
    )  # fmt: skip
    # SLSQP stops 1e-9 above the least
    assert found @ S @ found / 2 - right @ found <= other.fun + 1e-9 * (1.0 + abs(other.fun))
    np.testing.assert_allclose(A @ found, b, atol=1e-12)
    assert (G @ found <= h + 1e-12).all()


def test_units_change_nothing():
    rng = np.random.default_rng(0)
    root, unit = rng.normal(size=(5, 3)), np.array([1e-6, 1.0, 1e5])
    S, right = root.T @ root, rng.normal(size=3)
    steps = Steps(np.ones((1, 3)), np.ones(1), np.eye(3), np.full(3, 0.5))
    moved = Steps(steps.equal * unit, steps.gap, steps.most * unit, steps.room)
    found = moved.least(S * unit[:, None] * unit, right * unit)
    np.testing.assert_allclose(found * unit, steps.least(S, right), atol=1e-12)


def test_covariance_is_that_of_what_stays_free():
    # of z0 = -z1 with information 1 and 3: their difference has information 4
    steps = Steps(np.ones((1, 2)), np.zeros(1), *NOTHING)
    expected = np.array([[0.25, -0.25], [-0.25, 0.25]])
    np.testing.assert_allclose(steps.inverse(np.diag([1.0, 3.0])), expected, atol=1e-15)
    nothing = Steps(*NOTHING, *NOTHING)
    np.testing.assert_allclose(nothing.inverse(np.diag([1.0, 4.0])), np.diag([1.0, 0.25]))


def test_nearest_laws_are_of_the_region():
    region = Known.from_text(["x' = -v'", "x'[x] >= 1"]).region(["x", "v"], ["x", "v"], 2)
    coef, free = np.arange(8.0).reshape(2, 2, 2), np.ones((2, 2, 2), dtype=bool)
    near = region.nearest(coef, free, np.eye(8))
    np.testing.assert_allclose(near[:, 0], -near[:, 1], atol=1e-14)
    np.testing.assert_allclose(near[:, 0, 0], 1.0)  # -1 without the bound
    np.testing.assert_allclose(near[:, 0, 1], -1.0)
