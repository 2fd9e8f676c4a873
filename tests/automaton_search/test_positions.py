"""Automata from positions alone: speeds are measured by nobody, and jump where a position turns."""

import numpy as np
import pytest

from swsysid import HybridAutomaton, HybridAutomatonRegressor
from swsysid._automaton_search.jumps import jumps_of, without_impacts
from swsysid._stays.given import read_given

G, REBOUND = 9.81, 0.8


def heights(t, start=1.4):
    """Of a ball that falls from rest, parabola by parabola, and when it hits the ground."""
    instants, h, last, up = [], np.empty(len(t)), 0.0, 0.0
    level = start
    while last <= t[-1]:
        own = t >= last
        h[own] = level + up * (t[own] - last) - 0.5 * G * (t[own] - last) ** 2
        arrives = np.sqrt(up**2 + 2.0 * G * level)
        last, up, level = last + (up + arrives) / G, REBOUND * arrives, 0.0
        instants.append(last)
    return h, np.array(instants[:-1])


def filmed(rate, n_frames, noise, unit=1.0):
    t = np.arange(n_frames) / rate
    h, instants = heights(t)
    y = h + noise * np.random.default_rng(0).standard_normal(n_frames)
    return t, unit * y[:, None], instants


@pytest.mark.parametrize("rate, n_frames, noise", [(30, 110, 0.003), (120, 400, 0.002)])
def test_a_ball_in_a_video_has_one_law_and_an_impact(rate, n_frames, noise):
    t, y, instants = filmed(rate, n_frames, noise)
    found = HybridAutomatonRegressor(order=2, random_state=0).fit(y, t)
    [impact] = found.transitions_
    assert found.n_modes_ == 1
    # the law of 1, q and q', the rebound and the level, up to four of their standard errors
    law, errors = found.coef_[0, 1], found.coef_errors_[0, 1]
    assert (np.abs(law - [-G, 0.0, 0.0]) <= 4.0 * errors).all()
    assert (errors < 0.2).all()
    rebound, of_rebound = impact.reset.matrix[1, 1], found.reset_errors_[0][1, 2]
    assert abs(rebound + REBOUND) <= 4.0 * of_rebound < 0.02
    np.testing.assert_array_equal(impact.reset.matrix[0], [1.0, 0.0])  # it goes on where it is
    slope = impact.guard.gradient(np.array([0.0, -1.0, 1.0, 1.0]))[0]
    level = impact.guard.at(np.array([0.0, -1.0, 1.0, 1.0])) / slope
    assert abs(level) < 0.005
    seen = instants[instants < t[-1] - 1.0 / rate]
    assert len(found.switch_times_[0]) >= len(seen) - 1
    off = np.abs(found.switch_times_[0][:, None] - seen).min(axis=1)
    assert off.max() < 0.25 / rate
    assert "nothing but noise, and guards tell all switches" in str(found.report_)


def test_units_do_not_matter():
    t, metres, _ = filmed(30, 110, 0.003)
    both = [
        HybridAutomatonRegressor(order=2, random_state=0).fit(unit * metres, t)
        for unit in (1.0, 1000.0)
    ]
    assert both[0].n_modes_ == both[1].n_modes_
    [first], [second] = (one.transitions_ for one in both)
    np.testing.assert_allclose(first.reset.matrix[1, 1], second.reset.matrix[1, 1], rtol=1e-4)
    np.testing.assert_allclose(*(one.switch_times_[0] for one in both), atol=1e-4)


@pytest.mark.nightly
def test_a_mass_at_an_elastic_stop_has_two_laws():
    laws = [{"q": "v", "v": "-4 q - 0.3 v"}, {"q": "v", "v": "100 - 204 q - 3.3 v"}]
    switches = [(0, 1, "q >= 0.5"), (1, 0, "q <= 0.5")]
    plant = HybridAutomaton.stated(laws, switches, states=["q", "v"])
    t, noise = np.arange(0.0, 8.0, 0.02), np.random.default_rng(0)
    starts = [(-1.5, 0.0), (-1.2, 1.0), (-0.9, -2.0), (-1.8, 0.5)]
    runs = [plant.simulate(start, t, mode=0).x[:, :1] for start in starts]
    recordings = [{"t": t, "x": q + 0.003 * noise.standard_normal(q.shape)} for q in runs]
    found = HybridAutomatonRegressor(2, order=2, random_state=0).fit(recordings)
    truth = np.array([[0.0, -4.0, -0.3], [100.0, -204.0, -3.3]])
    off = np.abs(found.coef_[:, 1] - truth) / found.coef_errors_[:, 1]
    assert off.max() < 4.0
    assert [(one.source, one.target) for one in found.transitions_] == [(0, 1), (1, 0)]
    assert found.report_.rollouts.tells_switches
    # a rollout of a recording that it has not seen, from positions alone
    unseen = plant.simulate((-1.0, -1.0), t, mode=0).x[:, :1]
    assert found.score([{"t": t, "x": unseen}]) > 0.999


def test_turns_are_seen_where_they_are():
    t, y, instants = filmed(240, 600, 0.001)
    [found] = jumps_of(read_given(y, t, None, None).with_rates(2))
    np.testing.assert_array_equal(found, np.floor(instants * 240.0))


def test_a_turn_that_single_samples_hide_is_seen_in_means_of_them():
    t = np.arange(0.0, 20.0, 0.01)
    # a speed of one and back is, from one sample to the next, a third of the noise
    kinks = np.array([4.0, 9.0, 15.0])
    y = np.interp(t, [0.0, *kinks, 20.0], [0.0, 4.0, -1.0, 5.0, 0.0])
    other = np.exp(-0.5 * t) * np.sin(5.0 * t)  # a smooth motion that does not hide it
    y = np.column_stack([y, other]) + 0.03 * np.random.default_rng(0).standard_normal((len(t), 2))
    [found] = jumps_of(read_given(y, t, None, None).with_rates(2))
    assert len(found) == len(kinks)
    # nearer than the samples among which a cut is moved once laws are known
    assert np.abs(t[found] - kinks).max() <= 0.1


@pytest.mark.parametrize("step, noise", [(0.01, 1e-3), (0.02, 0.01), (0.05, 0.01)])
def test_a_smooth_motion_does_not_turn(step, noise):
    t = np.arange(0.0, 20.0, step)
    y = np.sin(np.pi * t) + noise * np.random.default_rng(0).standard_normal(len(t))
    [found] = jumps_of(read_given(y[:, None], t, None, None).with_rates(2))
    assert not len(found)


def test_what_is_measured_during_an_impact_is_left_out():
    """A ball of foam rests on the floor while a frame is taken: no parabola leads there."""
    t, y, instants = filmed(30, 110, 0.0005)
    places = np.rint(instants * 30.0).astype(int)[:3]
    y[places] = 0.03
    given = read_given(y, t, None, None).with_rates(2)
    jumps = jumps_of(given)
    assert set(places) <= {*jumps[0], *(jumps[0] + 1)}
    [record] = without_impacts(given, jumps).records
    lost = np.flatnonzero(np.isnan(record.y[:, 0]))
    np.testing.assert_array_equal(lost, places)
    found = HybridAutomatonRegressor(1, order=2, random_state=0).fit(y, t)
    [impact] = found.transitions_
    assert abs(impact.reset.matrix[1, 1] + REBOUND) < 0.01
    assert (impact.reset.matrix[0] == [1.0, 0.0]).all()  # a position does not jump


def test_positions_are_for_continuous_time():
    with pytest.raises(ValueError, match="set lags=1"):
        HybridAutomatonRegressor(order=2, discrete_time=True).fit(np.ones((20, 1)))
