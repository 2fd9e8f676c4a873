"""Recordings that a solver wrote: no noise, but an error as smooth as its steps."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swsysid import HybridAutomatonRegressor

STEP, LOSS = 0.01, 0.7


def ball(method, tolerance, drag, *, limits, height=1.0):
    """h' = v, v' = -9.81 - drag v, and v := -0.7 v at h = 0; t, x and the impacts.

    On an even grid, with two rows at each impact where `limits` are written.
    """

    def hit(_, x):
        return x[0]

    hit.terminal, hit.direction = True, -1
    begin, x, rows, impacts = 0.0, [height, 0.0], [], []
    while True:
        done = solve_ivp(
            lambda _, x: [x[1], -9.81 - drag * x[1]], (begin, 2.3), x, method=method,
            rtol=tolerance, atol=tolerance, events=hit, dense_output=True,
        )  # fmt: skip
        grid = STEP * np.arange(np.ceil(begin / STEP), np.ceil(done.t[-1] / STEP))
        rows += [(t, *done.sol(t)) for t in grid]
        begin, speed = done.t[-1], done.y[1, -1]
        if done.status != 1 or abs(speed) < 0.5:
            break
        x = [0.0, -LOSS * speed]
        impacts.append(begin)
        if limits:
            rows += [(begin, 0.0, speed), (begin, *x)]
    rows = np.array(rows)
    return rows[:, 0], rows[:, 1:], np.array(impacts)


def expect_the_ball(method, tolerance, drag, *, limits):
    t, x, impacts = ball(method, tolerance, drag, limits=limits)
    found = HybridAutomatonRegressor(random_state=0).fit(x, t)
    # what the laws miss is what the solver was off by: about its tolerance, in a usual step more
    far = max(1e-4, 30.0 * tolerance)
    assert found.n_modes_ == 1
    np.testing.assert_allclose(found.coef_[0], [[0, 0, 1], [-9.81, 0, -drag]], atol=far)
    assert [(one.source, one.target) for one in found.transitions_] == [(0, 0)]
    np.testing.assert_allclose(found.switch_times_[0], impacts, atol=far * 0.1)
    reset = found.transitions_[0].reset
    np.testing.assert_allclose(reset.matrix, [[1.0, 0.0], [0.0, -LOSS]], atol=far)
    assert found.score(x, t) > 0.95


# errors of 0.4 % that grow along a solver's steps are a misfit of any law, and are said to be one
SAID = pytest.mark.filterwarnings("ignore:By itself the automaton leaves")


@SAID
@pytest.mark.parametrize(
    ("method", "tolerance", "drag", "limits"),
    [
        ("BDF", 1e-5, 0.0, True),
        ("BDF", 1e-5, 0.0, False),
        ("LSODA", 1e-3, 0.0, False),
        ("RK45", 1e-3, 0.1, True),
    ],
)
def test_the_impacts_of_a_ball_stand_out_over_the_errors_of_a_solver(
    method, tolerance, drag, limits
):
    expect_the_ball(method, tolerance, drag, limits=limits)


@SAID
@pytest.mark.nightly
@pytest.mark.parametrize("limits", [True, False])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-10])
@pytest.mark.parametrize("method", ["BDF", "LSODA", "Radau", "RK45"])
def test_the_impacts_of_a_ball_with_drag_stand_out_at_any_tolerance(method, tolerance, limits):
    expect_the_ball(method, tolerance, 0.1, limits=limits)
