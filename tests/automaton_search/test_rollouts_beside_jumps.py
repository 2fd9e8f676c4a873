"""Rollouts whose jumps are off by less than a step: what they leave of the samples beside them."""

import numpy as np
import pytest

from swsysid import HybridAutomaton
from swsysid._automaton_search.judged import judged_on, left_by_rollout
from swsysid._data.recordings import Record
from swsysid._stays.given import read_given

T = np.arange(0.0, 1.8, 0.02)


def ball(floor: float) -> HybridAutomaton:
    """A ball that jumps from a floor at some height."""
    return HybridAutomaton.stated(
        [{"h": "v", "v": "-9.81"}],
        [(0, 0, f"h <= {floor}", {"v": "-0.8 v"})],
        states=["h", "v"],
    )


@pytest.mark.parametrize("floor", [-0.008, -0.004, 0.004, 0.008])
def test_an_instant_between_two_samples_is_not_all_that_a_rollout_leaves(floor):
    """A floor that is 8 mm off is met 2 ms late: speeds differ by some cm/s, not by metres."""
    # a sample between the two instants at which a ball falls to either floor
    between = 0.5 * (np.sqrt(2.0 / 9.81) + np.sqrt(2.0 * (1.0 - floor) / 9.81))
    t = np.arange(88) * between / 22.0
    y = ball(0.0).simulate([1.0, 0.0], t, mode=0).x
    left = left_by_rollout(ball(floor), Record(t, y, np.zeros((len(t), 0))))
    # 2 ms by 1.8 g, four times; on the other side of an impact it is 8 m/s
    assert np.abs(left[:, 1]).max() < 0.2 < np.ptp(y[:, 1]) / 20.0


def test_a_jump_that_is_two_samples_late_is_seen():
    y = ball(0.0).simulate([1.0, 0.0], T, mode=0).x
    left = left_by_rollout(ball(-0.2), Record(T, y, np.zeros((len(T), 0))))
    assert np.abs(left[:, 1]).max() > 2.0


def test_free_rollouts_of_unseen_impacts_follow_them():
    """With noise of .003 the instants are known to a millisecond or two."""
    x = ball(0.0).simulate([1.0, 0.0], T, mode=0).x
    y = x + 0.003 * np.random.default_rng(1).standard_normal(x.shape)
    given = read_given([{"t": T, "x": y}], None, None, None)
    rolled = judged_on(ball(0.0), given, np.full(2, 0.003))
    assert rolled.left.max() < 3.0  # of the noise; beside impacts speeds are off by a thousand


def test_a_rollout_begins_where_two_positions_alone_say():
    """A ball that is thrown; what its positions say of the speeds is off by half an interval."""
    thrown = HybridAutomaton.stated(
        [{"x": "v", "h": "w", "v": "-0.3 v", "w": "-9.81"}],
        [(0, 0, "h <= 0", {"w": "-0.8 w"})],
        states=["x", "h", "v", "w"],
    )
    y = thrown.simulate([0.0, 1.0, 2.0, 0.5], T, mode=0).x[:, :2]
    left = left_by_rollout(thrown, Record(T, y, np.zeros((len(T), 0))))
    assert left.shape == y.shape and np.abs(left).max() < 1e-3  # of 2 m
