"""Rollouts against closed forms: event times, slides, sticking.

Systems that know the values of their surfaces and systems that only tell modes go through the
same tests: the two ways to locate an event check each other.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from switched import SwitchedWithValues, both_kinds

from swsysid._results import Status
from swsysid._simulation.simulate import simulate
from swsysid._simulation.system import SwitchingSystem

DAMPING = (0.1, 0.5)  # right and left of x = 0: the paper's linear example


def _oscillator(kind):
    return kind(lambda x, u, mode: (x[1], -x[0] - DAMPING[mode] * x[1]), [lambda x, u: -x[0]])


def _oscillator_crossings(horizon):
    """Zeros of x(t) from (1, 0).

    The first quarter turn solves tan(w t) = -2 w / g with w = (1 - g^2 / 4)^(1/2), g the first
    damping. From a zero to the next, x is e^(-g t / 2) sin(w t): half a period pi / w each.
    """
    frequencies = [np.sqrt(1 - g**2 / 4) for g in DAMPING]
    times = [(np.pi - np.arctan(2 * frequencies[0] / DAMPING[0])) / frequencies[0]]
    while times[-1] < horizon:
        times.append(times[-1] + np.pi / frequencies[len(times) % 2])
    return times[:-1]


@both_kinds
def test_damped_oscillator_crosses_at_the_analytic_times(kind):
    rollout = simulate(_oscillator(kind), [1.0, 0.0], np.linspace(0, 20, 201))
    expected = _oscillator_crossings(20)
    assert rollout.status is Status.COMPLETED
    assert len(expected) == len(rollout.events) == 6
    np.testing.assert_allclose([e.time for e in rollout.events], expected, atol=1e-8)
    assert [(e.before, e.after) for e in rollout.events] == [(0, 1), (1, 0)] * 3
    assert all(e.kind == "crossing" and abs(e.state[0]) < 1e-14 for e in rollout.events)
    # the labels of the requested times change at the events
    changes = np.searchsorted(expected, rollout.t) % 2
    np.testing.assert_array_equal(rollout.modes, changes)


@both_kinds
def test_error_of_the_event_times_follows_the_tolerance(kind):
    def error(rtol):
        rollout = simulate(_oscillator(kind), [1, 0], [0.0, 20.0], rtol=rtol, atol=rtol / 100)
        return np.abs(
            np.subtract([e.time for e in rollout.events], _oscillator_crossings(20))
        ).max()

    assert error(1e-12) < 1e-11 < error(1e-5) < 1e-4


@both_kinds
def test_states_match_the_closed_form_before_and_after_a_switch(kind):
    t = np.linspace(0, 3, 61)
    rollout = simulate(_oscillator(kind), [1.0, 0.0], t)
    (first,) = _oscillator_crossings(4)
    w = [np.sqrt(1 - g**2 / 4) for g in DAMPING]
    decay, angle = np.exp(-DAMPING[0] / 2 * t), w[0] * t
    before = decay * (np.cos(angle) + DAMPING[0] / (2 * w[0]) * np.sin(angle))
    speed = -np.exp(-DAMPING[0] / 2 * first) * np.sin(w[0] * first) / w[0]
    after = speed * np.exp(-DAMPING[1] / 2 * (t - first)) * np.sin(w[1] * (t - first)) / w[1]
    np.testing.assert_allclose(rollout.x[:, 0], np.where(t < first, before, after), atol=2e-8)


@both_kinds
def test_no_event_one_event_and_events_at_both_ends(kind):
    system = kind(lambda x, u, mode: [1.0 + mode], [lambda x, u: x[0]])
    assert simulate(system, [-5.0], [0.0, 1.0]).events == ()
    (event,) = simulate(system, [-1.0], [0.0, 3.0]).events
    assert (event.time, event.before, event.after) == pytest.approx((1.0, 0, 1), abs=1e-12)
    # at rest on the surface at first, and a switch at the very end
    assert len(simulate(system, [0.0], [0.0, 1.0]).events) == 1
    assert simulate(system, [-1.0], [0.0, 1.0]).x[-1] == pytest.approx(0.0, abs=1e-12)


@both_kinds
def test_bouncing_between_modes_keeps_its_rhythm(kind):
    # x' = v, v' = -sign(x): parabolas, each half period lasts 2 (2 x0)^(1/2)
    system = kind(lambda x, u, mode: (x[1], 1.0 - 2.0 * mode), [lambda x, u: x[0]])
    rollout = simulate(system, [0.5, 0.0], np.linspace(0, 100, 51))
    np.testing.assert_allclose(
        [e.time for e in rollout.events], 1.0 + 2.0 * np.arange(50), atol=1e-9
    )
    np.testing.assert_allclose(rollout.x, [[0.5, 0], [-0.5, 0]] * 25 + [[0.5, 0]], atol=1e-9)


def _parabola(kind, height):
    """y falls to `height` at time 1 and rises again; z counts the time spent below zero."""
    return kind(lambda x, u, mode: (1.0, 2 * (x[0] - 1), 1.0 - mode), [lambda x, u: x[1]]), [
        0.0,
        1.0 + height,
        0.0,
    ]


@pytest.mark.parametrize("height", [0.0, 1e-6, 1e-3])
def test_grazing_the_surface_is_no_switch(height):
    system, x0 = _parabola(SwitchedWithValues, height)
    rollout = simulate(system, x0, np.linspace(0, 3, 7))
    assert rollout.events == ()
    assert rollout.x[-1, 2] == 0.0


@pytest.mark.parametrize("depth", [1e-6, 1e-3, 1e-1])
def test_a_short_visit_to_the_other_side_is_not_missed(depth):
    system, x0 = _parabola(SwitchedWithValues, -depth)
    rollout = simulate(system, x0, [0.0, 3.0])
    assert [(e.before, e.after) for e in rollout.events] == [(1, 0), (0, 1)]
    times = [1 - np.sqrt(depth), 1 + np.sqrt(depth)]
    np.testing.assert_allclose([e.time for e in rollout.events], times, atol=1e-9)
    assert rollout.x[-1, 2] == pytest.approx(2 * np.sqrt(depth), abs=1e-9)


@both_kinds
def test_relay_feedback_slides_on_its_surface(kind):
    # x' = -sign(x) + 0.3, y' = sign(x) + 2: on x = 0 the weight of x > 0 is w with
    # -w + (1 - w) + 0.3 = 0, so w = 0.65 and y' = 2 w - 1 + 2 = 2.3
    system = kind(lambda x, u, mode: (1.3 - 2 * mode, 1.0 + 2 * mode), [lambda x, u: x[0]])
    t = np.linspace(0, 3, 31)
    rollout = simulate(system, [0.7, 0.0], t)
    (event,) = rollout.events
    assert event.kind == "sliding"
    assert event.time == pytest.approx(1.0, abs=1e-12)  # 0.7 at speed -0.7
    np.testing.assert_allclose(rollout.x[:, 0], np.clip(0.7 * (1 - t), 0, None), atol=1e-8)
    expected = np.where(t < 1, 3 * t, 3 + 2.3 * (t - 1))
    np.testing.assert_allclose(rollout.x[:, 1], expected, atol=1e-8)
    assert set(rollout.modes) == {1}  # the mode that the slide came from


@both_kinds
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_slide_ends_where_one_field_turns_away(kind, side):
    # y = 0 attracts until s = 1; then the field below, y' = 1 - s, pulls away on a parabola.
    # The mirrored system (side = -1) does the same above.
    system = kind(
        lambda x, u, mode: (1.0, -side if (mode == 1) == (side > 0) else side * (1 - x[0])),
        [lambda x, u: x[1]],
    )
    t = np.linspace(0, 3, 31)
    rollout = simulate(system, [0.0, 0.25 * side], t)
    sliding, leaving = rollout.events
    assert (sliding.kind, leaving.kind) == ("sliding", "leaving")
    assert sliding.time == pytest.approx(0.25, abs=1e-10)
    assert leaving.time == pytest.approx(1.0, abs=1e-7)
    assert leaving.after == (0 if side > 0 else 1)
    after = -side * np.clip(t - 1, 0, None) ** 2 / 2
    expected = np.where(t < 0.25, side * (0.25 - t), after)
    np.testing.assert_allclose(rollout.x[:, 1], expected, atol=1e-7)


@both_kinds
def test_sliding_on_a_curved_surface_stays_on_it(kind):
    # turning at rate 1, drawn to the unit circle at speed 2 from both sides
    def field(x, u, mode):
        pull = (1.0 - 2.0 * mode) * 2.0 / np.hypot(x[0], x[1])
        return pull * x[0] - x[1], pull * x[1] + x[0]

    system = kind(field, [lambda x, u: x @ x - 1.0])
    t = np.linspace(0, 4, 41)
    rollout = simulate(system, [0.5, 0.0], t)
    assert [e.kind for e in rollout.events] == ["sliding"]
    assert rollout.events[0].time == pytest.approx(0.25, abs=1e-9)
    radius = np.minimum(0.5 + 2 * t, 1.0)
    expected = radius[:, np.newaxis] * np.column_stack([np.cos(t), np.sin(t)])
    np.testing.assert_allclose(rollout.x, expected, atol=1e-7)


def _friction(kind, force=lambda x, u: -x[0]):
    """Unit mass, Coulomb friction of size 1; mode 1 where the velocity is positive."""
    return kind(lambda x, u, mode: (x[1], force(x, u) + 1.0 - 2.0 * mode), [lambda x, u: x[1]])


@both_kinds
def test_dry_friction_stops_the_mass_in_finite_time_and_it_stays(kind):
    # half periods of length pi about +1 and -1: 4.5 -> -2.5 -> 0.5, where |x| < 1 holds it
    t = np.linspace(0, 20, 101)
    rollout = simulate(_friction(kind), [4.5, 0.0], t)
    assert [e.kind for e in rollout.events] == ["crossing", "sliding"]
    np.testing.assert_allclose([e.time for e in rollout.events], [np.pi, 2 * np.pi], atol=1e-8)
    moving = np.where(t < np.pi, 1 + 3.5 * np.cos(t), -1 + 1.5 * np.cos(t))
    expected = np.where(t < 2 * np.pi, moving, 0.5)
    np.testing.assert_allclose(rollout.x[:, 0], expected, atol=1e-7)
    assert np.abs(rollout.x[t > 2 * np.pi, 1]).max() < 1e-12


@both_kinds
def test_a_stuck_mass_slips_when_the_force_exceeds_friction(kind):
    # force t, friction 1: at rest until t = 1, then v = (t - 1)^2 / 2
    t = np.linspace(0, 3, 13)
    rollout = simulate(
        _friction(kind, lambda x, u: u[0]), [0.0, 0.0], t, inputs=t, input_hold="linear"
    )
    assert [e.kind for e in rollout.events] == ["sliding", "leaving"]
    assert rollout.events[1].time == pytest.approx(1.0, abs=1e-9)
    slip = np.clip(t - 1, 0, None)
    np.testing.assert_allclose(rollout.x[:, 1], slip**2 / 2, atol=1e-8)
    np.testing.assert_allclose(rollout.x[:, 0], slip**3 / 6, atol=1e-8)


@both_kinds
def test_each_rest_is_one_slide_at_a_loose_tolerance_too(kind):
    # the force is linear between samples and tears the mass off where it exceeds the friction, 1
    def acceleration(x, u, mode):
        return (u[0] + (1.0 if mode else -1.0) - x[0] * abs(x[0]),)

    system = kind(acceleration, [lambda x, u: -x[0]])
    t = np.linspace(0, 20, 201)
    force = 1.5 * np.sin(t)
    rollout = simulate(system, [0.3], t, inputs=force, input_hold="linear", rtol=1e-3, atol=1e-6)
    left = [event.time for event in rollout.events if event.kind == "leaving"]
    excess = np.abs(force) - 1.0
    before = np.flatnonzero((excess[:-1] < 0) & (excess[1:] > 0))
    torn_off = t[before] + 0.1 * -excess[before] / (excess[before + 1] - excess[before])
    assert [event.kind for event in rollout.events] == ["sliding", "leaving"] * len(torn_off)
    np.testing.assert_allclose(left, torn_off, atol=1e-8)


@both_kinds
def test_a_stuck_mass_is_torn_off_by_a_jump_of_the_force(kind):
    t = np.arange(6.0)
    force = np.array([0.0, 0.5, 3.0, 3.0, -1.0, 0.0])
    rollout = simulate(_friction(kind, lambda x, u: u[0]), [0.0, 0.0], t, inputs=force)
    # accelerates with 3 - 1 from t = 2 to 4, then with -1 - 1
    np.testing.assert_allclose(rollout.x[:, 1], [0, 0, 0, 2, 4, 2], atol=1e-9)
    assert [(e.time, e.kind) for e in rollout.events][-1] == (2.0, "leaving")
    assert rollout.modes[2:].tolist() == [1, 1, 1, 1]


@both_kinds
def test_zeno_behaviour_ends_at_the_time_where_switches_accumulate(kind):
    # x' = v, v' = -2 sign(x) - sign(v): each half turn takes off a fixed ratio of the speed.
    # From x = 0 with speed v: v / 3 to the turning point, back with acceleration 1.
    def field(x, u, mode):
        return x[1], -2.0 * (1 if mode & 1 else -1) - (1 if mode & 2 else -1)

    system = kind(field, [lambda x, u: x[0], lambda x, u: x[1]])
    ratio = np.sqrt(1 / 3)
    zeno = (1 / 3 + ratio) / (1 - ratio)
    t = np.linspace(0, 5, 251)
    rollout = simulate(system, [1e-300, 1.0], t)
    assert rollout.status is Status.SWITCH_LIMIT
    assert rollout.events[-1].time == pytest.approx(zeno, abs=1e-5)
    assert len(rollout.t) == len(rollout.x) == len(rollout.modes)
    assert rollout.t[-1] <= zeno < rollout.t[-1] + 0.021
    few = simulate(system, [1e-300, 1.0], t, max_switches=5)
    assert few.status is Status.SWITCH_LIMIT
    assert [e.time for e in few.events] == [e.time for e in rollout.events[:5]]


@both_kinds
def test_units_of_state_and_time_do_not_matter(kind):
    metres = simulate(_friction(kind), [4.5, 0.0], [0.0, 8.0])
    # millimetres and milliseconds: v keeps its number, the acceleration shrinks by 1e3
    other = kind(
        lambda x, u, mode: (x[1], -x[0] * 1e-6 + 1e-3 * (1.0 - 2.0 * mode)), [lambda x, u: x[1]]
    )
    scaled = simulate(other, [4500.0, 0.0], [0.0, 8000.0])
    times = [[e.time for e in rollout.events] for rollout in (metres, scaled)]
    np.testing.assert_allclose(times[1], np.multiply(times[0], 1e3), rtol=1e-8)


def test_three_modes_agree_with_an_independent_integrator():
    # nested circles with three linear fields; the reference walks over the jumps in tiny steps
    fields = [np.array([[-0.02, 1.0 + mode], [-1.0, -0.02]]) for mode in range(4)]
    system = SwitchedWithValues(
        lambda x, u, mode: fields[mode] @ x,  # mode 2 is empty
        [lambda x, u: x @ x - 1.0, lambda x, u: x @ x - 2.0],
    )
    t = np.linspace(0, 6, 13)
    rollout = simulate(system, [1.6, 0.0], t)
    reference = solve_ivp(
        lambda time, x: system.velocity(x, None, system.mode(x, None)),
        (0, 6),
        rollout.x[0],
        t_eval=t,
        max_step=4e-3,
        rtol=1e-9,
        atol=1e-9,
    )
    assert len(rollout.events) >= 4
    np.testing.assert_allclose(rollout.x, reference.y.T, atol=1e-4)


def test_a_label_that_changes_without_a_sign_change_is_located():
    # the mode is the larger of two surface values, both positive: no value has a root
    class Largest(SwitchingSystem):
        has_surface_values = True

        def velocity(self, x, u, mode):
            return np.array([1.0 + mode])

        def surface_values(self, x, u):
            return np.array([10.0, 8.0 + x[0]])

        def decode(self, values):
            return int(np.argmax(values))

        def mode(self, x, u):
            return self.decode(self.surface_values(x, u))

    (event,) = simulate(Largest(), [0.0], [0.0, 5.0]).events
    assert event.time == pytest.approx(2.0, abs=1e-12)
