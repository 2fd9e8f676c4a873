"""Laws that jump at a level of a state: passing, sticking, and the slopes of both."""

import numpy as np
import pytest

from swsysid._output_error.breaks import Break, BreakingLaws

FRICTION = 1.0


def features(columns):
    """A drive, a spring, and dry friction by the side that counts."""
    side = columns[:, -1]
    return np.column_stack([columns[:, 1], columns[:, -2], columns[:, 0], -side])


def mass(drive=1.0):
    """x = (position, velocity): x' = v, v' = drive u - 2 x - friction sign(v)."""
    coef = np.array([[[1.0, 0.0, 0.0, 0.0], [0.0, drive, -2.0, FRICTION]]])
    free = np.zeros(coef.shape, dtype=bool)
    free[0, 1, 1:] = True
    return BreakingLaws(coef, features, np.ones(2), free, (Break(1, 0.0),))


def alone(columns):
    """A drive and dry friction of one velocity."""
    return np.column_stack([columns[:, 1], -columns[:, -1]])


def velocity():
    """v' = u - friction sign(v)."""
    coef = np.array([[[1.0, FRICTION]]])
    return BreakingLaws(coef, alone, np.ones(1), np.ones_like(coef, dtype=bool), (Break(0, 0.0),))


def test_a_velocity_that_friction_stops_sticks_and_forgets_where_it_came_from():
    u = np.zeros((1, 1))
    end, by_state, by_law = velocity().flow(0, np.array([[0.1]]), u, u, np.array([0.2]))
    assert end[0, 0] == 0.0
    assert by_state[0, 0, 0] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(by_law, 0.0, atol=1e-12)


def test_a_velocity_that_is_driven_through_zero_goes_on_more_slowly():
    """From -0.1 at a rate of 3 until 1/30, then at a rate of 1: 1/6 after a fifth."""
    u = np.full((1, 1), 2.0)
    end, by_state, by_law = velocity().flow(0, np.array([[-0.1]]), u, u, np.array([0.2]))
    assert end[0, 0] == pytest.approx(1.0 / 6.0, abs=1e-9)
    # so much earlier at zero as a third of what it begins later
    assert by_state[0, 0, 0] == pytest.approx(1.0 / 3.0, abs=1e-9)
    # (c u - f) (0.2 - 0.1 / (c u + f)) by c and by f, where c u + f = 3 and c u - f = 1
    left = 0.2 - 0.1 / 3.0
    np.testing.assert_allclose(
        by_law[:, 0, 0], [2.0 * left + 0.2 / 9.0, 0.1 / 9.0 - left], atol=1e-8
    )


def test_slopes_are_those_of_differences_where_some_pass_and_some_stick():
    rng, laws, step = np.random.default_rng(0), mass(), 1e-6
    x = rng.normal(size=(400, 2)) * [0.4, 0.1]
    u, duration = rng.normal(size=(400, 1)), np.full(400, 0.1)
    end, by_state, by_law = laws.flow(0, x, u, u, duration)
    assert 20 < np.count_nonzero(end[:, 1] == 0.0) < 200  # that stick
    for state in range(2):
        move = step * np.eye(2)[state]
        ends = [laws.flow(0, x + sign * move, u, u, duration)[0] for sign in (1.0, -1.0)]
        error = np.abs((ends[0] - ends[1]) / (2.0 * step) - by_state[state].T)
        # but for the few rows that pass or stick by the difference
        assert np.quantile(error, 0.98) < 1e-5
    ends = [mass(1.0 + sign * step).flow(0, x, u, u, duration)[0] for sign in (1.0, -1.0)]
    error = np.abs((ends[0] - ends[1]) / (2.0 * step) - by_law[0].T)
    assert np.quantile(error, 0.98) < 1e-6


def test_a_step_is_the_law_integrated_finely():
    rng, laws, count = np.random.default_rng(1), mass(), 20_000
    x = rng.normal(size=(60, 2)) * [0.4, 0.1]
    u = rng.normal(size=(60, 1))
    fine, h = x.copy(), 0.1 / count
    for _ in range(count):
        force = u[:, 0] - 2.0 * fine[:, 0]
        stuck = (fine[:, 1] == 0.0) & (np.abs(force) <= FRICTION)
        side = np.where(fine[:, 1] == 0.0, np.sign(force), np.sign(fine[:, 1]))
        after = fine[:, 1] + h * np.where(stuck, 0.0, force - FRICTION * side)
        fine[:, 0] += h * 0.5 * (fine[:, 1] + after)
        fine[:, 1] = np.where(after * fine[:, 1] < 0.0, 0.0, after)
    ends = laws.step(np.zeros(60, dtype=int), x, u, u, np.full(60, 0.1))
    np.testing.assert_allclose(ends, fine, atol=2e-4)  # of the fine steps, 5e-6 each


@pytest.mark.parametrize("start", [0.0, 1e-9, -1e-9, 0.05, -0.05])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_what_a_growing_drive_lets_go_within_a_step_begins_when_it_is_stronger(start, sign):
    """u goes from 0 to 3 sign in a second: what rests leaves at 1/3, friction being 1.

    Before that friction has stopped a velocity: of 0.05 with u = 3 s: v' = 3 s -+ 1 is zero at s.
    Behind it v = 1.5 (s - 1/3)^2.
    """
    at, after = np.zeros((1, 1)), np.full((1, 1), 3.0 * sign)
    end, by_state, by_law = velocity().flow(0, np.array([[start]]), at, after, np.array([1.0]))
    assert end[0, 0] == pytest.approx(sign * 1.5 * (2.0 / 3.0) ** 2, abs=1e-9)
    assert by_state[0, 0, 0] == pytest.approx(0.0, abs=1e-9)
    # c u - f sign from s = f / (3 c) on: by c and by f
    np.testing.assert_allclose(by_law[:, 0, 0], sign * np.array([4.0 / 3.0, -2.0 / 3.0]), atol=1e-9)


def test_a_rest_under_a_drive_that_goes_on_has_slopes_on_both_sides():
    """An infinitesimal velocity changes nothing, whether it is for or against the drive."""
    rng, laws = np.random.default_rng(2), mass()
    x = np.column_stack([rng.normal(size=300) * 0.3, np.zeros(300)])
    u, after = rng.normal(size=(2, 300, 1))
    duration = np.full(300, 0.1)
    middle, *_ = laws.flow(0, x, u, after, duration)
    assert 50 < np.count_nonzero(middle[:, 1]) < 250  # that leave, some of them after a while
    for move in (1e-9, -1e-9):
        ends, *_ = laws.flow(0, x + [0.0, move], u, after, duration)
        np.testing.assert_allclose(ends, middle, atol=1e-6)
