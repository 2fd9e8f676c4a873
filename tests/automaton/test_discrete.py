"""Automata in discrete time, iterated by hand."""

import numpy as np
import pytest

from swsysid import HybridAutomaton
from swsysid._results import Status

RELAY = HybridAutomaton.stated(
    [{"x": "x + 1"}, {"x": "x - 2"}],
    [(0, 1, "x >= 3"), (1, 0, "x <= -1")],
    states=["x"],
    discrete_time=True,
)


def fired(rollout):
    return [(event.time, event.before, event.after) for event in rollout.events]


def test_a_relay_with_hysteresis_on_a_counter():
    rollout = RELAY.simulate([1.0], np.arange(8.0), mode=0)
    # the guard is tested at a row, and the law of the mode found there makes the next
    assert rollout.x.ravel().tolist() == [1, 2, 3, 1, -1, 0, 1, 2]
    assert rollout.modes.tolist() == [0, 0, 1, 1, 0, 0, 0, 0]
    assert fired(rollout) == [(2.0, 0, 1), (4.0, 1, 0)]
    assert rollout.status is Status.COMPLETED


def test_a_guard_needs_no_rise_but_one_of_a_mode_to_itself_does():
    assert RELAY.simulate([5.0], np.arange(2.0), mode=0).modes.tolist() == [1, 1]
    stair = HybridAutomaton.stated(
        [{"x": "x + 1", "n": "n"}],
        [(0, 0, "x >= 2", {"n": "n + 1"})],
        states=["x", "n"],
        discrete_time=True,
    )
    # x stays beyond its level, which is passed once; a start beyond it is no passage
    assert stair.simulate([0.0, 0.0], np.arange(5.0)).x[:, 1].tolist() == [0, 0, 1, 1, 1]
    assert stair.simulate([3.0, 0.0], np.arange(3.0)).x[:, 1].tolist() == [0, 0, 0]


def test_resets_act_before_the_law():
    saw = HybridAutomaton.stated(
        [{"x": "1.5 x"}], [(0, 0, "x >= 2", {"x": "x - 2"})], states=["x"], discrete_time=True
    )
    rollout = saw.simulate([1.0], np.arange(6.0))
    assert rollout.x.ravel().tolist() == [1.0, 1.5, 0.25, 0.375, 0.5625, 0.84375]
    (event,) = rollout.events
    assert (event.time, event.state[0], event.kind) == (2.0, 2.25, "jump")


def test_clocks_count_rows():
    beat = HybridAutomaton.stated(
        [{"x": "x + 1"}, {"x": "x - 1"}],
        [(0, 1, "dwell >= 2"), (1, 0, "time >= 5")],
        states=["x"],
        discrete_time=True,
    )
    rollout = beat.simulate([0.0], np.linspace(0.0, 0.9, 10), mode=0)
    assert rollout.modes.tolist() == [0, 0, 1, 1, 1, 0, 0, 1, 0, 0]
    assert rollout.x.ravel().tolist() == [0, 1, 2, 1, 0, -1, 0, 1, 0, 1]
    assert [event.time for event in rollout.events] == pytest.approx([0.2, 0.5, 0.7, 0.8])


def by_hand(first, u, n):
    """y[k+1] = 0.5 y[k] - 0.3 y[k-1] + u[k] + 0.2 u[k-1], other signs beyond |y| = 1."""
    y, modes, mode = list(first), [0], 0
    for k in range(1, n):
        now, past = y[k], y[k - 1]
        if mode == 0 and now + 0.5 * past >= 1.0:
            mode = 1
        elif mode == 1 and u[k] - 0.5 * u[k - 1] - now >= 0.2:
            mode = 0
        modes.append(mode)
        sign = (1.0, -1.0)[mode]
        y.append(0.5 * now - sign * 0.3 * past + u[k] + sign * 0.2 * u[k - 1])
    return y[:n], modes


ARX = HybridAutomaton.stated(
    [
        {"y": "0.5 y - 0.3 y[k-1] + u + 0.2 u[k-1]"},
        {"y": "0.5 y[k] + 0.3 y[k-1] + u[k] - 0.2 u[k-1]"},
    ],
    [(0, 1, "y + 0.5 y[k-1] >= 1"), (1, 0, "u - 0.5 u[k-1] - y >= 0.2")],
    states=["y"],
    inputs=["u"],
    discrete_time=True,
    lags=1,
)


def test_laws_and_guards_see_the_rows_before():
    u = np.random.default_rng(0).uniform(-1.5, 1.5, 60)
    y, modes = by_hand([0.1, 0.4], u, 60)
    rollout = ARX.simulate([[0.1], [0.4]], np.arange(60.0), u, mode=0)
    np.testing.assert_allclose(rollout.x.ravel(), y, atol=1e-13)
    assert rollout.modes.tolist() == modes
    assert 4 <= len(rollout.events) == np.count_nonzero(np.diff(modes))


def test_a_reset_of_the_newest_state_or_of_all_of_it():
    def summed(reset):
        return HybridAutomaton.stated(
            [{"y": "y + y[k-1]"}],
            [(0, 0, "y >= 4", reset)],
            states=["y"],
            discrete_time=True,
            lags=1,
        )

    t = np.arange(7.0)
    newest, whole = summed({"y": "y - 4"}), summed({"y": "1", "y[k-1]": "y[k] - y[k-1]"})
    assert newest.transitions[0].reset.matrix.shape == (1, 1)
    assert whole.transitions[0].reset.matrix.shape == (2, 2)
    # 1 1 2 3, then 5 - 4 beside 3; and 5 -> 1 beside 5 - 3 = 2
    assert newest.simulate([[1.0], [1.0]], t).x.ravel().tolist() == [1, 1, 2, 3, 1, 0, 1]
    assert whole.simulate([[1.0], [1.0]], t).x.ravel().tolist() == [1, 1, 2, 3, 1, 3, 1]


def test_a_rollout_ends_with_its_inputs_and_at_its_bound():
    short = ARX.simulate([[0.0], [0.0]], np.arange(9.0), [0.1, 0.1, 0.1, 0.1], mode=0)
    assert short.status is Status.INPUT_RANGE and len(short.t) == 4
    doubled = HybridAutomaton.stated([{"x": "2 x"}], states=["x"], discrete_time=True)
    rollout = doubled.simulate([1.0], np.arange(40.0), state_bound=1000.0)
    assert rollout.status is Status.STATE_LIMIT and rollout.x[-1, 0] == 512.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"x0": [0.0, 0.0, 0.0]}, "x0 has 3 rows; give the states at the first 2 times."),
        ({"x0": [[0.0]]}, "x0 has 1 rows; give the states at the first 2 times."),
        ({"inputs": [1.0]}, "t and inputs have 1 rows; give at least the 2 of x0."),
        ({"mode": None}, "the guards leave the modes 0, 1 possible at the start; give mode."),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    right = {"x0": [[0.0], [0.0]], "t": np.arange(4.0), "inputs": np.zeros(4), "mode": 0}
    with pytest.raises(ValueError) as refused:
        ARX.simulate(**(right | arguments))
    assert message in str(refused.value)
