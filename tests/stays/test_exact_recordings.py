"""Recordings without noise: laws interval by interval, modes and instants where flows meet."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid import (
    GuardWarning,
    HybridAutomatonRegressor,
    MisfitWarning,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid._data.features import Monomials
from swsysid._data.recordings import Record
from swsysid._stays.exact import exact_modes
from swsysid._stays.intervals import Intervals, along_flows, laws_of, without_equal
from swsysid._stays.laws import Laws
from swsysid._stays.recordings import Recordings
from swsysid._stays.settings import StaySettings

# x' = 1 and x' = -x + 3 y, y' = -3 x - y, in the features 1, x, y
STRAIGHT = [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
SPIRAL = [[0.0, -1.0, 3.0], [0.0, -3.0, -1.0]]
FALLING = [[0.0, 0.0, 0.0], [-2.0, 0.0, 0.0]]
TRUTH = np.array([STRAIGHT, SPIRAL, FALLING])
FREE = np.ones(TRUTH.shape, dtype=bool)
FEATURES = Monomials.up_to(1, 2)
STEP, TURNS = 0.05, 60


def flown(mode, x, duration):
    """The state after some time in one mode, in closed form."""
    x = np.asarray(x, dtype=float)
    if mode != 1:
        return x + duration * TRUTH[mode][:, 0]
    turn = np.exp((-1.0 - 3.0j) * duration) * (x[0] + 1j * x[1])
    return np.array([turn.real, turn.imag])


def sampled(start, stays, n_samples, jump=None):
    """One recording: modes with the times at which they end, and the time and size of a jump."""
    events = [(end, mode, 0.0) for mode, end in stays]
    x, now, rows, t = np.asarray(start, dtype=float), 0.0, [], STEP * np.arange(n_samples)
    for time in t:
        while events and events[0][0] <= time:
            end, mode, _ = events.pop(0)
            x, now = flown(mode, x, end - now), end
            if jump is not None and jump[0] == end:
                x = x + jump[1]
        x, now = flown(events[0][1], x, time - now), time
        rows.append(x)
    return Record(t, np.array(rows), np.empty((n_samples, 0)))


def several(**options):
    stays = [(0, 0.512), (1, 1.333), (2, 1.827), (0, 2.291), (1, 9.0)]
    starts = [(0.3, 1.0), (-0.5, 0.7), (0.1, -0.6)]
    return Recordings.of([sampled(start, stays, 80, **options) for start in starts])


def told(recordings):
    spread = recordings.joined(recordings.y).std(axis=0)
    return exact_modes(Laws(TRUTH, FEATURES, spread, FREE), recordings, StaySettings())


def test_laws_that_are_nearly_right_become_exact_and_what_is_left_are_switches():
    intervals = Intervals.of(several())
    near = TRUTH + 0.05 * np.random.default_rng(0).standard_normal(TRUTH.shape)
    found = laws_of(near, FREE, FEATURES, intervals, TURNS)
    assert found.tell_all
    assert found.unexplained.sum() == 4 * 3  # one interval for each switch
    np.testing.assert_allclose(found.coef, TRUTH, atol=1e-5)  # by Simpson's rule
    laws = along_flows(found, FEATURES, TURNS)
    np.testing.assert_allclose(laws.coef, TRUTH, atol=1e-8)  # of Runge and Kutta's method


def test_too_few_laws_leave_intervals_amid_others():
    intervals = Intervals.of(several())
    found = laws_of(TRUTH[:2], FREE[:2], FEATURES, intervals, TURNS)
    assert not found.tell_all
    assert found.amid.sum() >= 3 * 8  # the stay in the third mode holds nine whole intervals


def test_what_only_a_switch_tells_of_a_law_is_not_believed():
    # the second state rests at zero in the first mode, but for the interval in which it gets there
    t = STEP * np.arange(60)
    x = np.column_stack([np.where(t < 1.52, 1.0 + t, 2.52), np.maximum(0.0, 1.52 - t)])
    intervals = Intervals.of(Recordings.of([Record(t, x, np.empty((60, 0)))]))
    laws = np.array([STRAIGHT, [[0.0, 0.0, 0.4], [0.0, 0.0, -20.0]]])
    laws[0, 1, 0] = -1.0
    found = laws_of(laws, FREE[:2], FEATURES, intervals, TURNS)
    np.testing.assert_allclose(found.coef[1], 0.0, atol=1e-9)
    assert found.unexplained.sum() == 1


def test_equal_laws_become_one():
    intervals = Intervals.of(several())
    four = np.concatenate([TRUTH, TRUTH[1:2] + 1e-4])
    found = laws_of(four, np.ones(four.shape, dtype=bool), FEATURES, intervals, TURNS)
    fewer = without_equal(found, FEATURES, TURNS)
    assert len(fewer.coef) == 3 and fewer.tell_all


def test_modes_and_instants_are_where_flows_meet():
    modes = told(several())
    assert not modes.broken.any()
    for stays in modes.stays_of_all:
        assert stays.modes.tolist() == [0, 1, 2, 0, 1]
        np.testing.assert_allclose(stays.instants, [0.512, 1.333, 1.827, 2.291], atol=1e-8)


def test_a_stay_between_two_samples_is_found():
    # in mode 2 from 1.812 to 1.834 only, with samples at 1.80 and 1.85
    stays = [(0, 0.512), (2, 0.9), (1, 1.812), (2, 1.834), (0, 2.4), (2, 2.9), (1, 9.0)]
    starts = [(0.3, 1.0), (-0.5, 0.7)]
    # elsewhere it switches in the same ways, one by one
    usual = [(1, 0.43), (2, 0.91), (0, 1.33), (1, 9.0)]
    records = [sampled(start, stays, 80) for start in starts] + [sampled((1, 1), usual, 80)]
    modes = told(Recordings.of(records))
    assert not modes.broken.any()
    for k, stay in enumerate(modes.stays_of_all[:2]):
        assert stay.modes.tolist() == [0, 2, 1, 2, 0, 2, 1]
        np.testing.assert_allclose(stay.instants[2:4], [1.812, 1.834], atol=1e-7)
        assert 1.812 < modes.between(k)[0] < 1.834


def test_errors_of_one_sign_add_up_to_the_drift_of_a_stay():
    # x' = 1 is told as 1 + 1e-3: off by 5e-5 in each of 40 intervals
    record = Record(STEP * np.arange(41), np.arange(41.0)[:, None] * STEP, np.empty((41, 0)))
    law = Laws(np.array([[[1.001]]]), Monomials.up_to(0, 1), np.ones(1), np.ones((1, 1, 1), bool))
    modes = exact_modes(law, Recordings.of([record]), StaySettings())
    whole = replace(modes, broken=np.zeros_like(modes.broken))
    np.testing.assert_allclose(whole.drift(law), 40 * 5e-5, rtol=1e-9)
    np.testing.assert_allclose(whole.errors(law), np.sqrt(40) * 5e-5, rtol=1e-9)


@pytest.mark.filterwarnings("ignore:The switches")  # at times that no state tells
def test_laws_that_explain_all_stays_are_not_descended(monkeypatch):
    def never(*_, **__):
        raise AssertionError("a descent has nothing to mend")

    stays = [(0, 0.512), (1, 1.333), (2, 1.827), (0, 2.291), (1, 9.0)]
    starts = [(0.3, 1.0), (-0.5, 0.7), (0.1, -0.6), (0.7, 0.2)]
    records = [sampled(start, stays, 80) for start in starts]
    monkeypatch.setattr("swsysid._stays.rounds.most_likely", never)
    recordings = [{"t": record.t, "x": record.y} for record in records]
    with pytest.warns((GuardWarning, MisfitWarning)):  # a clock decides
        found = HybridAutomatonRegressor(3, refine=False, random_state=0).fit(recordings)
    order = [int(np.abs(found.coef_ - law).max(axis=(1, 2)).argmin()) for law in TRUTH]
    np.testing.assert_allclose(found.coef_[order], TRUTH, atol=1e-7)
    np.testing.assert_allclose(found.switch_times_, [[0.512, 1.333, 1.827, 2.291]] * 4, atol=1e-7)


def test_a_jump_is_a_break_and_no_switch():
    recordings = several(jump=(1.827, np.array([0.2, -0.1])))
    modes = told(recordings)
    assert [places.tolist() for places in modes.breaks] == [[36]] * 3  # between 1.80 and 1.85
    for k in range(3):
        assert modes.stays(k, 0, 36).modes.tolist() == [0, 1, 2]
        assert modes.stays(k, 37).modes.tolist() == [0, 1]


def test_times_between_samples_may_be_given():
    record = sampled((0.3, 1.0), [(0, 9.0)], 20)
    recordings = Recordings.of([record], between=[np.array([0.12])])
    assert len(recordings.times[0]) == 21
    assert np.isnan(recordings.y[3, 0]).all()  # nothing was measured at 0.12
    np.testing.assert_array_equal(recordings.times[0][recordings.sampled[0]], record.t)
    np.testing.assert_allclose(recordings.steps[2:4, 0], [0.02, 0.03], atol=1e-12)


@pytest.mark.parametrize("n_modes", [2, "auto"])
def test_trajectories_without_noise_are_identified_to_rounding(n_modes):
    records = []
    for start in (0.2, 0.5, 0.9, 1.4):
        # x'' = -1 for x > 0 and +2 for x < 0: parabolas in closed form
        rows, x, v = [], start, 0.3
        for _ in range(160):
            rows.append((x, v))
            left = STEP
            while left > 0.0:
                a = -1.0 if x > 0.0 or (x == 0.0 and v > 0.0) else 2.0
                roots = np.roots([0.5 * a, v, x])
                real = roots[np.isreal(roots)].real
                ahead = real[real > 1e-12]
                h = min(left, ahead.min()) if len(ahead) else left
                x, v = x + v * h + 0.5 * a * h * h, v + a * h
                x, left = (0.0 if h < left else x), left - h
        records.append({"t": STEP * np.arange(160), "x": np.array(rows)})
    surface = PolynomialSurfaceClassifier(degree=1)
    estimator = SwitchingSystemRegressor(
        n_modes, feature_library=1, surface=surface, random_state=0
    )
    found = TrajectoryIdentifier(estimator).fit(records)
    assert found.n_modes_ == 2
    forces = np.sort(found.estimator_.coef_[:, 1, 0])
    np.testing.assert_allclose(forces, [-1.0, 2.0], atol=1e-7)
    assert len(found.mode_selection_) == (2 if n_modes == "auto" else 0)
