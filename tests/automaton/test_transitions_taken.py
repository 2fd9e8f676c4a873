"""When a transition is taken, in cases that are solved by hand."""

import numpy as np
import pytest

from swsysid import HybridAutomaton
from swsysid._results import Status
from swsysid.refinement import StatedModel, StatedSurface
from swsysid.results import FirstModes

G, RESTITUTION = 9.81, 0.8
BALL = HybridAutomaton.stated(
    [{"h": "v", "v": "-g"}],
    [(0, 0, "h <= 0", {"v": "-r v"})],
    states=["h", "v"],
    parameters={"g": G, "r": RESTITUTION},
)


def fired(rollout):
    return [(event.time, event.before, event.after) for event in rollout.events]


def approx(fired_transitions):
    """Transitions whose instants are found to the last digits."""
    return [(pytest.approx(time, abs=1e-12), *modes) for time, *modes in fired_transitions]


def impacts(height, n):
    """First after the fall, then after flights that last r times as long each."""
    fall = np.sqrt(2 * height / G)
    return fall + 2 * fall * np.cumsum([0.0, *RESTITUTION ** np.arange(1, n)])


def test_a_ball_bounces_at_the_instants_of_the_closed_form():
    rollout = BALL.simulate([10.0, 0.0], np.linspace(0, 12, 121))
    expected = impacts(10.0, len(rollout.events))
    assert len(expected) > 10
    np.testing.assert_allclose([event.time for event in rollout.events], expected, atol=1e-11)
    assert {event.kind for event in rollout.events} == {"jump"}
    speeds = [event.state[1] for event in rollout.events]  # before the jump
    first = -np.sqrt(2 * 10.0 * G)
    np.testing.assert_allclose(speeds, first * RESTITUTION ** np.arange(len(speeds)), rtol=1e-10)


def test_a_row_at_an_instant_has_the_state_after_it():
    clock = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "0"}], [(0, 1, "time >= 2", {"x": "x + 10"})], states=["x"]
    )
    rollout = clock.simulate([0.0], [0.0, 1.0, 2.0, 3.0], mode=0)
    assert rollout.x.ravel().tolist() == pytest.approx([0.0, 1.0, 12.0, 12.0], abs=1e-12)
    assert rollout.modes.tolist() == [0, 0, 1, 1]
    assert fired(rollout) == [(2.0, 0, 1)]
    # an instant at the very end counts, and so does one at the start
    assert clock.simulate([0.0], [0.0, 2.0], mode=0).x[-1, 0] == pytest.approx(12.0, abs=1e-12)
    assert clock.simulate([0.0], [2.5, 3.0], mode=0).x.ravel().tolist() == [10.0, 10.0]


def test_a_ball_ends_where_its_bounces_accumulate():
    t = np.linspace(0, 20, 201)
    rollout = BALL.simulate([10.0, 0.0], t)
    end = np.sqrt(2 * 10.0 / G) * (1 + RESTITUTION) / (1 - RESTITUTION)
    assert rollout.status is Status.SWITCH_LIMIT
    assert rollout.events[-1].time == pytest.approx(end, abs=1e-6)
    assert rollout.t[-1] == t[t < end][-1]
    assert rollout.x[:, 0].min() > -1e-12


def test_a_ball_that_lies_on_the_ground_does_not_fall_through_it():
    rollout = BALL.simulate([0.0, 0.0], [0.0, 1.0])
    assert rollout.status is Status.SWITCH_LIMIT and len(rollout.t) == 1
    # thrown from the ground it flies first; thrown at the ground it bounces at once
    up = BALL.simulate([0.0, 5.0], [0.0, 1.0, 2.0]).events
    assert up[0].time == pytest.approx(2 * 5.0 / G, abs=1e-12)
    down = BALL.simulate([0.0, -5.0], [0.0, 0.1])
    assert fired(down) == [(0.0, 0, 0)] and down.x[0].tolist() == [0.0, 4.0]


@pytest.mark.parametrize("restitution", [0.5, 0.1, 1.0])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("start", [0.0, 1e4])
def test_a_bounce_is_one_event_whatever_the_units_and_the_time(restitution, scale, start):
    ball = HybridAutomaton.stated(
        [{"h": "v", "v": f"{-G * scale}"}],
        [(0, 0, "h <= 0", {"v": f"-{restitution} v"})],
        states=["h", "v"],
    )
    fall = np.sqrt(20.0 / G)
    rollout = ball.simulate([10.0 * scale, 0.0], start + np.linspace(0, 1.6, 4))
    assert rollout.status is Status.COMPLETED
    flights = 2 * fall * np.cumsum([0.0, *restitution ** np.arange(1, 4)])
    expected = [start + fall + flight for flight in flights if fall + flight < 1.6]
    instants = [event.time for event in rollout.events]
    np.testing.assert_allclose(instants, expected, atol=1e-8, rtol=0)


def test_two_laws_that_push_against_each_other_end_the_rollout():
    pushed = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "-1"}], [(0, 1, "x >= 1"), (1, 0, "x <= 1")], states=["x"]
    )
    rollout = pushed.simulate([0.0], np.linspace(0, 3, 31), mode=0)
    assert rollout.status is Status.SWITCH_LIMIT
    assert rollout.events[-1].time == pytest.approx(1.0, abs=1e-6)
    few = pushed.simulate([0.0], np.linspace(0, 3, 31), mode=0, max_switches=5)
    assert few.status is Status.SWITCH_LIMIT and len(few.events) == 5


def test_one_surface_for_both_directions_is_crossed_once():
    spring = HybridAutomaton.stated(
        [{"x": "v", "v": "-x"}, {"x": "v", "v": "-4 x"}],
        [(0, 1, "x >= 0"), (1, 0, "x <= 0")],
        states=["x", "v"],
    )
    rollout = spring.simulate([-1.0, 0.0], [0.0, 10.0])
    # a quarter of a period 2 pi, then halves of the periods pi and 2 pi by turns
    instants = np.cumsum(np.pi * np.array([0.5, 0.5, 1.0, 0.5]))
    np.testing.assert_allclose([event.time for event in rollout.events], instants, atol=2e-8)
    assert [event.after for event in rollout.events] == [1, 0, 1, 0]


def test_a_state_that_is_reset_behind_a_guard_goes_on_at_once():
    chain = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "1"}, {"x": "0"}],
        [(0, 1, "x >= 1", {"x": "5"}), (1, 2, "x >= 3", {"x": "x - 1"})],
        states=["x"],
    )
    rollout = chain.simulate([0.0], [0.0, 0.5, 2.0], mode=0)
    assert fired(rollout) == approx([(1.0, 0, 1), (1.0, 1, 2)])
    assert [event.state[0] for event in rollout.events] == pytest.approx([1.0, 5.0], abs=1e-12)
    assert rollout.x[-1, 0] == 4.0


def test_the_guard_that_rises_first_wins_and_the_first_of_two_at_once():
    laws = [{"x": "1"}, {"x": "0"}, {"x": "0"}]
    early = [(0, 1, "x >= 2"), (0, 2, "x >= 1")]
    tie = [(0, 2, "2 x >= 2"), (0, 1, "x >= 1")]
    for transitions in (early, tie, [(0, 1, "x >= 1.5"), *tie]):
        automaton = HybridAutomaton.stated(laws, transitions, states=["x"])
        assert fired(automaton.simulate([0.0], [0.0, 3.0], mode=0))[0][2] == 2


@pytest.mark.parametrize("width", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("method", ["DOP853", "RK45", "Radau"])
def test_a_short_visit_is_not_missed(width, method):
    # the integrator's steps on a constant law grow to as long as the whole time
    automaton = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "0"}], [(0, 1, f"(x - 7 / 3)^2 <= {width**2}")], states=["x"]
    )
    (event,) = automaton.simulate([0.0], [0.0, 5.0], mode=0, method=method).events
    # rounding of a square moves its root by eps / width
    assert event.time == pytest.approx(7 / 3 - width, abs=1e-14 / width)


def test_a_self_transition_starts_the_dwell_anew():
    pulse = HybridAutomaton.stated(
        [{"x": "-x"}], [(0, 0, "dwell >= 0.75", {"x": "x + 1"})], states=["x"]
    )
    rollout = pulse.simulate([1.0], np.linspace(0, 4, 9))
    instants = [event.time for event in rollout.events]
    np.testing.assert_allclose(instants, 0.75 * np.arange(1, 6), atol=1e-12)
    x = 1.0
    for _ in range(5):
        x = x * np.exp(-0.75) + 1
    assert rollout.x[-1, 0] == pytest.approx(x * np.exp(-0.25), abs=1e-7)


# -- inputs ----------------------------------------------------------------------------------------

SWITCHED = HybridAutomaton.stated(
    [{"x": "-1"}, {"x": "1"}],
    [(0, 1, "u >= 0.5"), (1, 0, "u <= 0.25")],
    states=["x"],
    inputs=["u"],
)


def test_held_inputs_switch_at_the_samples():
    u = [0.0, 0.5, 0.4, 0.2, 0.6, 0.6]
    rollout = SWITCHED.simulate([0.0], np.arange(6.0), u)
    assert fired(rollout) == [(1.0, 0, 1), (3.0, 1, 0), (4.0, 0, 1)]
    assert rollout.modes.tolist() == [0, 1, 1, 0, 1, 1]
    np.testing.assert_allclose(rollout.x.ravel(), [0, -1, 0, 1, 0, 1], atol=1e-12)


def test_linear_inputs_switch_where_they_cross():
    u = [0.0, 1.0, 1.0, 0.0, 0.0]
    rollout = SWITCHED.simulate([0.0], np.arange(5.0), u, input_hold="linear")
    assert fired(rollout) == approx([(0.5, 0, 1), (2.75, 1, 0)])
    assert rollout.x[-1, 0] == pytest.approx(-0.5 + 2.25 - 1.25, abs=1e-12)


def test_a_guard_of_state_and_input_with_both_holds():
    # x = t against u: constant between the samples, or the line through them
    automaton = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "0"}], [(0, 1, "x >= u")], states=["x"], inputs=["u"]
    )
    u = [1.6, 1.5, 0.9, 0.9]
    held = automaton.simulate([0.0], np.arange(4.0), u, mode=0)
    assert fired(held) == approx([(1.5, 0, 1)])
    line = automaton.simulate([0.0], np.arange(4.0), u, mode=0, input_hold="linear")
    assert fired(line) == approx([(2.1 / 1.6, 0, 1)])


def test_inputs_that_end_early_end_the_rollout():
    rollout = SWITCHED.simulate([0.0], np.arange(6.0), [0.0, 0.0, 1.0])
    assert rollout.status is Status.INPUT_RANGE and rollout.t.tolist() == [0, 1, 2]
    assert rollout.modes.tolist() == [0, 0, 1]


def test_a_surface_in_both_directions_is_that_of_a_switching_model():
    automaton = HybridAutomaton.stated(
        [{"x": "v", "v": "-x - 0.4 v + u"}, {"x": "v", "v": "-x - 0.9 v + u"}],
        [(0, 1, "x >= 0.1"), (1, 0, "x <= 0.1")],
        states=["x", "v"],
        inputs=["u"],
    )
    laws = [[[0.0, 1.0, 0.0], [-1.0, -damping, 1.0]] for damping in (0.4, 0.9)]
    surface = StatedSurface([[-0.1, 1.0, 0.0, 0.0]])
    switching = StatedModel(None, laws, states=["x", "v"], inputs=["u"], surface=surface)
    t, u = np.linspace(0, 20, 201), np.sin(np.linspace(0, 30, 201))
    for hold in ("zero", "linear"):
        ours = automaton.simulate([-1.0, 0.0], t, u, input_hold=hold)
        other = switching.simulate([-1.0, 0.0], t, u, input_hold=hold)
        assert len(ours.events) == len(other.events) > 4
        np.testing.assert_allclose(ours.x, other.x, atol=1e-12)
        np.testing.assert_array_equal(ours.modes, other.modes)


# -- starting mode ---------------------------------------------------------------------------------

THERMOSTAT = HybridAutomaton.stated(
    [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 20")],
    states=["T"],
)


def test_the_guards_tell_the_mode_at_the_start_where_they_can():
    assert THERMOSTAT.simulate([19.0], [0.0, 0.1]).modes[0] == 0
    assert THERMOSTAT.simulate([23.0], [0.0, 0.1]).modes[0] == 1
    assert THERMOSTAT.simulate([21.0], [0.0, 0.1], mode=1).modes[0] == 1


def test_recordings_tell_it_where_the_guards_do_not():
    with pytest.raises(ValueError, match="leave the modes 0, 1 possible at the start; give mode"):
        THERMOSTAT.simulate([21.0], [0.0, 0.1])
    seen = FirstModes(np.array([[20.2], [20.8], [21.8], [25.0]]), np.array([0, 1, 0, 1]))
    told = HybridAutomaton(
        THERMOSTAT.coef, THERMOSTAT.feature_map, THERMOSTAT.transitions, first_modes=seen
    )
    first = [told.simulate([x], [0.0, 0.1]).modes[0] for x in (20.1, 20.9, 21.9, 19.0)]
    assert first == [0, 1, 0, 0]


# -- ends and refusals -----------------------------------------------------------------------------


def test_a_state_beyond_the_bound_ends_the_rollout():
    grows = HybridAutomaton.stated([{"x": "x"}], [(0, 0, "x >= 10", {"x": "1000 x"})], states=["x"])
    rollout = grows.simulate([1.0], np.linspace(0, 5, 51), state_bound=100.0)
    assert rollout.status is Status.STATE_LIMIT
    assert rollout.t[-1] <= np.log(10.0) and len(rollout.events) == 1
    blown_up = HybridAutomaton.stated([{"x": "x^2"}], states=["x"])
    assert blown_up.simulate([1.0], np.linspace(0, 2, 21)).status is Status.STATE_LIMIT
    assert blown_up.simulate([1e3], [0.0, 1.0], state_bound=10.0).t.size == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"x0": [1.0, 2.0]}, "x0 holds 2 states; give 1."),
        ({"t": [0.0, 0.0]}, "t must be a 1-d array of finite, strictly increasing times."),
        ({"mode": 2}, "mode=2 is out of reach; it must be at most 1."),
        ({"inputs": [[1.0], [2.0]]}, "x0 holds 1 states and inputs hold 1 columns; give 1 and 0."),
        ({"input_hold": "cubic"}, "input_hold='cubic' is unknown; choose 'zero', 'linear' or "),
        ({"rtol": 2.0}, "rtol=2.0 must be a number at least 0 and below 1."),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    right = {"x0": [21.0], "t": [0.0, 1.0], "mode": 0}
    with pytest.raises(ValueError, match=message.replace(".", r"\.")):
        THERMOSTAT.simulate(**(right | arguments))
