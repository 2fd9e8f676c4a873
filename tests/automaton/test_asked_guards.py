"""Guards that are asked every so often, as by a controller that samples."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid import HybridAutomaton


def _zigzag(every):
    """Up until 2.5 and down until 1.5, asked every so often."""
    plant = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "-1"}], [(0, 1, "x >= 2.5"), (1, 0, "x <= 1.5")], states=["x"]
    )
    asked = tuple(replace(one, asked_every=every) for one in plant.transitions)
    return replace(plant, transitions=asked)


@pytest.mark.parametrize("step", [0.25, 0.3, 1.0])
def test_a_guard_is_asked_at_its_own_times_alone(step):
    """Up to 3 at t = 3, down to 1 at t = 5, up to 3 at t = 7, whatever is asked of the rollout."""
    rollout = _zigzag(1.0).simulate([0.0], np.arange(0.0, 8.01, step), mode=0)
    # instants are times of the rollout where they are the same, else sums of intervals
    np.testing.assert_allclose([one.time for one in rollout.events], [3, 5, 7], atol=1e-12)
    np.testing.assert_allclose([one.state[0] for one in rollout.events], [3, 1, 3], atol=1e-9)
    assert [one.after for one in rollout.events] == [1, 0, 1]


def test_a_row_at_which_a_transition_is_taken_is_behind_it():
    rollout = _zigzag(0.1).simulate([0.0], 0.1 * np.arange(61), mode=0)
    changes = np.flatnonzero(np.diff(rollout.modes)) + 1  # 2.5 itself is reached, or rounding is
    assert changes[0] in (25, 26) and rollout.events[0].time == rollout.t[changes[0]]


def test_a_mode_entered_beyond_its_guard_is_left_when_that_is_asked_next():
    plant = _zigzag(1.0)
    first, second = plant.transitions
    beyond = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "-1"}], [(1, 0, "x >= 0")], states=["x"]
    ).transitions[0]
    plant = replace(plant, transitions=(first, replace(beyond, asked_every=1.0)))
    rollout = plant.simulate([0.0], np.arange(0.0, 6.0, 0.5), mode=0)
    np.testing.assert_allclose([one.time for one in rollout.events], [3, 4, 5], atol=1e-12)


def test_how_often_is_written_and_read():
    plant = _zigzag(0.25)
    again = HybridAutomaton.from_dict(plant.to_dict())
    assert [one.asked_every for one in again.transitions] == [0.25, 0.25]
    assert again.equations()[-1] == "mode 1 -> 0 where x <= 1.500, every 0.25"
    assert r"\text{ every } 0.25" in again.equations(format="latex")[-1]
    assert "asked_every" not in str(_zigzag(None).to_dict())


def test_no_interval_is_refused():
    with pytest.raises(ValueError, match=r"asked_every of transitions\[0\]=0"):
        _zigzag(0.0)
