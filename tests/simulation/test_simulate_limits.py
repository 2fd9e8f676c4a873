"""Rollouts: why they end, inputs between samples, maps, bad arguments."""

import numpy as np
import pytest
from switched import Switched, SwitchedWithValues, both_kinds

from swsysid._results import Status
from swsysid._simulation.simulate import simulate

UNSWITCHED = [lambda x, u: -1.0]


@pytest.mark.parametrize("method", ["DOP853", "RK45", "Radau"])
def test_a_blow_up_ends_at_the_state_bound_without_warning(method):
    system = Switched(lambda x, u, mode: x**2, UNSWITCHED)
    t = np.linspace(0, 2, 41)
    rollout = simulate(system, [1.0], t, state_bound=1e4, method=method)
    assert rollout.status is Status.STATE_LIMIT
    # x = 1 / (1 - t) passes 1e4 at t = 0.9999
    assert rollout.t[-1] == pytest.approx(0.95, abs=1e-12)
    np.testing.assert_allclose(rollout.x[:, 0], 1 / (1 - rollout.t), rtol=1e-4)


def test_overflow_in_the_model_is_a_status():
    system = Switched(lambda x, u, mode: np.exp(x**3), UNSWITCHED)
    rollout = simulate(system, [1.0], np.linspace(0, 5, 11))
    assert rollout.status in (Status.STATE_LIMIT, Status.STEP_FAILURE)
    assert np.isfinite(rollout.x).all()


def test_a_start_outside_the_bound_gives_an_empty_trajectory():
    rollout = simulate(Switched(lambda x, u, mode: -x, UNSWITCHED), [5.0], [0, 1], state_bound=1.0)
    assert (rollout.status, rollout.x.shape) == (Status.STATE_LIMIT, (0, 1))


def _refuses(x, u, mode):
    if x[0] > 1.0:
        raise ValueError("no features here")
    return np.ones(1)


@pytest.mark.parametrize(
    "field", [_refuses, lambda x, u, mode: np.where(x < 1.0, 1.0, np.nan)], ids=["raises", "nan"]
)
def test_a_field_that_stops_existing_is_a_step_failure(field):
    rollout = simulate(Switched(field, UNSWITCHED), [0.0], np.linspace(0, 2, 21))
    assert rollout.status is Status.STEP_FAILURE
    np.testing.assert_allclose(rollout.x[:, 0], rollout.t, atol=1e-9)
    assert 0.85 < rollout.t[-1] <= 1.0


def test_a_surface_that_stops_existing_is_a_step_failure():
    def guard(x, u):
        if x[0] > 1.0:
            raise ValueError("no features here")
        return -1.0

    for kind in (Switched, SwitchedWithValues):
        rollout = simulate(kind(lambda x, u, mode: [1.0], [guard]), [0.0], np.linspace(0, 2, 21))
        assert rollout.status is Status.STEP_FAILURE


def test_too_many_steps_are_a_step_failure():
    stiff = Switched(lambda x, u, mode: -1e6 * (x - 1.0), UNSWITCHED)
    assert simulate(stiff, [0.0], [0.0, 10.0], max_steps=200).status is Status.STEP_FAILURE
    implicit = simulate(stiff, [0.0], [0.0, 10.0], max_steps=200, method="Radau")
    assert implicit.status is Status.COMPLETED
    assert implicit.x[-1] == pytest.approx(1.0, abs=1e-7)


LAG = Switched(lambda x, u, mode: u - x, UNSWITCHED)  # x' = u - x


def test_zero_hold_matches_its_closed_form():
    rng = np.random.default_rng(0)
    t, u = np.cumsum(rng.uniform(0.1, 1.0, 20)), rng.normal(size=20)
    expected = [0.3]
    for step, value in zip(np.diff(t), u, strict=False):
        expected.append(value + (expected[-1] - value) * np.exp(-step))
    rollout = simulate(LAG, [0.3], t, inputs=u)
    np.testing.assert_allclose(rollout.x[:, 0], expected, atol=1e-8)


def test_linear_hold_matches_its_closed_form():
    # between samples u = p + q s, and x = p - q + q s + (x0 - p + q) e^-s
    rng = np.random.default_rng(1)
    t, u = np.cumsum(rng.uniform(0.1, 1.0, 20)), rng.normal(size=20)
    expected = [0.3]
    for step, value, following in zip(np.diff(t), u, u[1:], strict=False):
        slope = (following - value) / step
        homogeneous = (expected[-1] - value + slope) * np.exp(-step)
        expected.append(following - slope + homogeneous)
    rollout = simulate(LAG, [0.3], t, inputs=u[:, np.newaxis], input_hold="linear")
    np.testing.assert_allclose(rollout.x[:, 0], expected, atol=1e-8)


@both_kinds
def test_a_jump_of_the_input_changes_the_mode_at_the_sample(kind):
    system = kind(lambda x, u, mode: [1.0 + mode], [lambda x, u: u[0]])
    rollout = simulate(system, [0.0], np.arange(5.0), inputs=[-1.0, -1.0, 1.0, 1.0, -1.0])
    assert [(e.time, e.before, e.after, e.kind) for e in rollout.events] == [
        (2.0, 0, 1, "input"),
        (4.0, 1, 0, "input"),
    ]
    np.testing.assert_allclose(rollout.x[:, 0], [0, 1, 2, 4, 6], atol=1e-12)
    assert rollout.modes.tolist() == [0, 0, 1, 1, 0]  # of each row's state and input


@both_kinds
def test_a_moving_surface_is_crossed_between_samples(kind):
    # the guard x - u meets x = t at u = 2 - t / 2: t = 4 / 3, within a sampling interval
    system = kind(lambda x, u, mode: [1.0 + mode], [lambda x, u: x[0] - u[0]])
    t = np.linspace(0, 4, 5)
    rollout = simulate(system, [0.0], t, inputs=2 - t / 2, input_hold="linear")
    (event,) = rollout.events
    assert (event.time, event.kind) == (pytest.approx(4 / 3, abs=1e-12), "crossing")


def test_inputs_are_never_extrapolated():
    rollout = simulate(LAG, [0.0], np.arange(6.0), inputs=np.ones(4))
    assert rollout.status is Status.INPUT_RANGE
    assert rollout.t.tolist() == [0.0, 1.0, 2.0, 3.0]
    assert simulate(LAG, [0.0], [0.0, 1.0], inputs=[1.0]).t.tolist() == [0.0]


def test_one_time_is_the_initial_state():
    rollout = simulate(LAG, [0.5], [3.0], inputs=[1.0])
    assert (rollout.t.tolist(), rollout.x.tolist(), rollout.modes.tolist()) == ([3], [[0.5]], [0])


def _tent(x, u, mode):
    return 1.9 * (1.0 - x) if mode else 1.9 * x


@both_kinds
def test_discrete_time_iterates_the_map(kind):
    rollout = simulate(
        kind(_tent, [lambda x, u: x[0] - 0.5]), [0.3], np.arange(30), discrete_time=True
    )
    x, expected = 0.3, []
    for _ in range(30):
        expected.append(x)
        x = 1.9 * min(x, 1 - x)
    np.testing.assert_allclose(rollout.x[:, 0], expected, rtol=1e-12)
    np.testing.assert_array_equal(rollout.modes, np.array(expected) > 0.5)
    changes = np.flatnonzero(np.diff(rollout.modes)) + 1
    assert [e.time for e in rollout.events] == changes.tolist()


def test_discrete_time_uses_inputs_and_stops_at_its_limits():
    growing = Switched(lambda x, u, mode: 10 * x + u, UNSWITCHED)
    steps = np.arange(20)
    driven = simulate(growing, [0.0], steps, inputs=[1.0, 2.0, 3.0], discrete_time=True)
    assert driven.status is Status.INPUT_RANGE
    assert driven.x.ravel().tolist() == [0.0, 1.0, 12.0]
    free = Switched(lambda x, u, mode: 10 * x, UNSWITCHED)
    rollout = simulate(free, [1.0], steps, state_bound=1e6, discrete_time=True)
    assert (rollout.status, len(rollout.t)) == (Status.STATE_LIMIT, 7)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (dict(x0=[[1.0]], t=[0, 1]), "give one finite state"),
        (dict(x0=[np.nan], t=[0, 1]), "x0 contains NaN or infinity"),
        (dict(x0=[1.0], t=[0, 0]), "strictly increasing"),
        (dict(x0=[1.0], t=[0, 1], inputs=np.ones(3)), "one row for each time"),
        (
            dict(x0=[1.0], t=[0, 1], inputs=[1, np.inf]),
            "inputs contains NaN or infinity .* fill them in",
        ),
        (dict(x0=[1.0], t=[0, 1], inputs=[1, 1], input_hold="cubic"), "'zero', 'linear' or 'next'"),
        (dict(x0=[1.0], t=[0, 1], inputs=[1, 1], method="Euler"), "choose 'auto', 'DOP853'"),
        (dict(x0=[1.0, 2.0, 3.0], t=[0, 1], inputs=[[1, 1], [1, 1]]), "shape"),
    ],
)
def test_bad_arguments_get_a_sentence(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        simulate(LAG, **arguments)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (dict(x0=[1.0], inputs=[1, 1]), "x0 holds 1 states .* give 2 and 1"),
        (dict(x0=[1.0, 0.0]), "inputs hold 0 columns; give 2 and 1"),
        (dict(x0=[1.0, 0.0], inputs=np.ones((2, 3))), "inputs hold 3 columns; give 2 and 1"),
    ],
)
def test_states_and_inputs_are_held_to_the_sizes_of_the_system(arguments, sentence):
    # monomials of a point broadcast: without the check a missing input gives a wrong rollout
    class Sized(Switched):
        n_states, n_inputs = 2, 1

    system = Sized(lambda x, u, mode: -x, UNSWITCHED)
    with pytest.raises(ValueError, match=sentence):
        simulate(system, t=[0, 1], **arguments)


def test_a_velocity_of_the_wrong_length_gets_a_sentence():
    with pytest.raises(ValueError, match="one value for each state"):
        simulate(Switched(lambda x, u, mode: [1.0], UNSWITCHED), [0.0, 0.0], [0.0, 1.0])
