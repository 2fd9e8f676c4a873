"""Two rows at one time: the left and the right limit of an event."""

import numpy as np
import pytest

from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid._data.trajectories import evened, events_in, is_coarse, limits_apart
from swsysid._stays.given import read_given
from swsysid._stays.pieces import between_jumps
from swsysid.differentiation import differentiate

DECAY, GAIN = 0.5, 2.0


def driven(stays=12, noise=0.0):
    """x' = -x / 2 + 2 u with u switched at uneven times, a row for each limit; t, x, u."""
    rng = np.random.default_rng(0)
    rows, x, t, u = [], 0.3, 0.0, 1.0
    for duration in rng.uniform(0.55, 1.35, stays):
        for since in [*np.arange(0.0, duration, 0.1), duration]:
            end = GAIN * u / DECAY
            rows.append((t + since, end + (x - end) * np.exp(-DECAY * since), u))
        x, t, u = rows[-1][1], rows[-1][0], 1.0 - u
    t, x, u = np.array(rows).T
    return t, x[:, None] + noise * rng.standard_normal((len(t), 1)), u[:, None]


def doses(n=8):
    """c' = -c / 2, and one unit more every two seconds, with a row for each limit; t and c."""
    since = np.arange(0.0, 2.05, 0.1)
    rows, c = [], 1.0
    for k in range(n):
        rows += [(2.0 * k + s, c * np.exp(-0.5 * s)) for s in since]
        c = rows[-1][1] + 1.0
    t, c = np.array(rows).T
    return t, c[:, None]


def affine():
    return SwitchingSystemRegressor(1, feature_library=1, random_state=0)


@pytest.mark.parametrize(("noise", "far"), [(0.0, 1e-6), (0.01, 0.02)])
def test_an_input_that_jumps_at_an_event_does_not_ramp(noise, far):
    t, x, u = driven(noise=noise)
    found = TrajectoryIdentifier(affine()).fit(x, t, inputs=u)
    coef = found.estimator_.coef_[0, 0]
    np.testing.assert_allclose(coef, [0.0, -DECAY, GAIN], atol=far * 4.0)
    assert found.modes_.shape == (len(t),)
    assert found.score(x, t, inputs=u) > 1.0 - max(1e-9, far)


def test_a_state_may_jump_at_an_event_of_a_model_without_resets():
    t, c = doses()
    found = TrajectoryIdentifier(affine()).fit(c, t)
    np.testing.assert_allclose(found.estimator_.coef_[0, 0], [0.0, -0.5], atol=1e-6)
    assert found.score(c, t) > 1.0 - 1e-9
    np.testing.assert_allclose(found.states_, c, atol=1e-5)  # a row each, both limits included
    assert "1 recording, " in str(found.report_)


def test_what_the_rows_of_an_event_say_does_not_depend_on_their_number():
    t, x, u = driven()
    event = int(events_in(t)[3])
    amid = np.r_[np.arange(event + 1), event, np.arange(event + 1, len(t))]
    t, x, u = t[amid], x[amid].copy(), u[amid].copy()
    x[event + 1], u[event + 1] = 99.0, -7.0  # between the first and the last row of that time
    found = TrajectoryIdentifier(affine()).fit(x, t, inputs=u)
    np.testing.assert_allclose(found.estimator_.coef_[0, 0], [0.0, -DECAY, GAIN], atol=1e-5)


def test_recordings_with_stretches_too_short_for_any_filter_are_differentiated():
    t, x, u = driven(stays=200)
    keep = np.ones(len(t), dtype=bool)
    for begin, end in zip(np.r_[0, events_in(t) + 1], np.r_[events_in(t), len(t) - 1], strict=True):
        keep[begin + 3 : end] = False  # four samples between two events
    t, x, u = t[keep], x[keep], u[keep]
    X, Xdot, times, _, _ = differentiate(x, t, inputs=u)
    assert (np.diff(times) > 0.0).all()
    coef = np.linalg.lstsq(np.column_stack([np.ones(len(X)), X]), Xdot[:, 0], rcond=None)[0]
    np.testing.assert_allclose(coef, [0.0, -DECAY, GAIN], atol=0.03)  # a parabola a second long


def test_derivatives_know_nothing_of_the_other_side_of_an_event():
    t = np.r_[np.arange(0.0, 1.01, 0.05), np.arange(1.0, 2.01, 0.05)]
    x = np.r_[t[:21], 5.0 - 2.0 * t[21:]]
    X, Xdot, times, _, _ = differentiate(x, t)
    np.testing.assert_allclose(Xdot[:, 0], np.where(times < 1.0, 1.0, -2.0), atol=1e-9)


def test_the_limits_of_an_event_are_told_from_any_origin_of_the_clock():
    t, x, u = driven()
    for origin in (0.0, -1e3, 1.7e9):
        given = read_given(x, t + origin, None, u)
        assert len(given.records[0].events) == 11


@pytest.mark.parametrize("origin", [0.0, 1e6])
def test_times_apart_keep_their_order(origin):
    t = origin + np.array([0.0, 1.0, 1.0, 1.0, 1.0 + 1e-6, 2.0, 2.0])
    apart = limits_apart(t)
    assert (np.diff(apart) > 0.0).all()
    np.testing.assert_allclose(apart, t, rtol=0, atol=1e-8)
    assert limits_apart(t[:2]) is not None and len(events_in(t[:2])) == 0


def test_a_clock_that_is_too_coarse_is_no_row_of_events():
    t = np.linspace(0.0, 10.0, 201)
    x = np.column_stack([np.sin(t), np.cos(t)])
    ticks = np.repeat(t[:101], 2)[:201]
    assert is_coarse(ticks, x)
    with pytest.raises(ValueError, match="repeats a time at its sample 1 .*clock is too coarse"):
        read_given(x, ticks, None, None)
    t, x, u = driven()
    assert not is_coarse(t, np.column_stack([x, u]))
    clocked = np.repeat(np.arange(100.0), 2)  # a controller that acts at every sample
    assert not is_coarse(clocked, np.column_stack([np.sin(clocked), np.arange(200) % 7]))


def test_an_even_clock_that_was_rounded_has_no_events():
    """A tracker prints the times of 120 frames a second to a hundredth: every sixth repeats."""
    t = np.arange(480) / 120.0
    x = np.column_stack([np.cos(3.0 * t), -3.0 * np.sin(3.0 * t)])
    printed = np.round(t, 2)
    np.testing.assert_allclose(np.diff(evened(printed, x)), 1.0 / 120.0, rtol=1e-3)
    coef = TrajectoryIdentifier(affine()).fit(x, printed).estimator_.coef_[0]
    np.testing.assert_allclose(coef, [[0.0, 0.0, 1.0], [0.0, -9.0, 0.0]], atol=0.02)
    X, Xdot, *_ = differentiate(x, printed)
    np.testing.assert_allclose(Xdot[:, 0], X[:, 1], atol=0.02)


def test_events_are_no_rounded_clock():
    for t, columns in ((t, np.column_stack(each)) for t, *each in (driven(noise=0.05), doses())):
        assert evened(t, columns) is t


def test_recordings_are_cut_where_states_jump_and_nowhere_else():
    t, c = doses(4)
    pieces = between_jumps(read_given(c, t, None, None))
    assert pieces.last.tolist() == [20, 41, 62, 83]
    t, x, u = driven()
    assert len(between_jumps(read_given(x, t, None, u)).first) == 1
