"""Another coefficient from an instant on, or for some time: found, told from drift, in a model."""

import re

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid.effects import Drift, InputCoupling, Lag, TimeInterval

STEP, LOSS, POWER = 2.0, 0.01, 0.5


def box(seed, loss=lambda t: LOSS, draught=lambda t: 0.0, n_samples=900, lag=0.0):
    """T' = -loss(t) T + .5 u + draught(t), read in steps of a tenth with noise of .05.

    With a lag it is a heater that follows u, and begins with it.
    """
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.integers(0, 2, n_samples // 30), 30) * rng.uniform(0.7, 1.3)
    t, T, states, parts = STEP * np.arange(n_samples), rng.uniform(5.0, 20.0), [], 10
    power = u[0]
    for now, heat in zip(t, u, strict=True):
        states.append(T)
        for part in range(parts):
            at = now + STEP * part / parts
            power += STEP / parts * (heat - power) / lag if lag else heat - power
            T += STEP / parts * (-loss(at) * T + POWER * power + draught(at))
    x = np.round((np.array(states) + 0.05 * rng.standard_normal(n_samples)) / 0.1) * 0.1
    return {"t": t, "x": x[:, None], "inputs": u[:, None]}


def searched(recordings):
    plain = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    library = [InputCoupling(), Drift(), TimeInterval()]
    return EffectSearchCV(plain, effects=library).fit(recordings)


def errors(search):
    return [model["held_out"][0] for model in search.report_["errors"]]


@pytest.mark.nightly
def test_a_fan_that_starts_is_no_drift():
    search = searched([box(0, draught=lambda t: -0.15 * (t > 1000.0))])
    [effect] = search.effects_
    assert (effect.kind, effect.place) == ("time_interval", "level")
    # the temperature falls by the noise within some ten seconds
    assert effect.parameters["begin"] == pytest.approx(1000.0, abs=20.0)
    assert effect.parameters["change"] == pytest.approx(-0.15, rel=0.1)
    before, after = errors(search)
    assert after < 0.25 * before
    assert any("< t]" in law for law in search.equations())
    assert effect.formula.startswith("-0.1") and " level from t = " in effect.formula


@pytest.mark.nightly
def test_nothing_tells_when_that_began_which_acts_from_the_start():
    """A lid that is open until 400 s and from 900 to 1200 s, or closed at all other times."""
    data = box(0, loss=lambda t: 3.0 * LOSS if t < 400.0 or 900.0 < t < 1200.0 else LOSS)
    [effect] = searched([data]).effects_
    instants = {name: one for name, one in effect.parameters.items() if name != "change"}
    outside = {name for name, one in instants.items() if not 0.0 <= one <= data["t"][-1]}
    assert len(outside) == 1
    for name, instant in instants.items():
        low, high = effect.intervals[name]
        is_told = name not in outside
        assert np.isfinite([low, high]).tolist() == [is_told, is_told]
        if is_told:
            assert low < instant < high
    # the box is cold from 280 s on, and tells no more of its loss until it is heated
    assert {round(one, -1) for one in instants.values()} > {900.0, 1200.0}


def test_what_ages_is_no_event():
    search = searched([box(1, draught=lambda t: -2e-4 * t)])
    assert [(one.kind, one.place) for one in search.effects_] == [("drift", "level")]


def test_nothing_happens_where_nothing_happened():
    assert searched([box(2)]).effects_ == []


@pytest.mark.nightly
def test_a_lid_that_is_open_in_one_recording_of_four():
    def opened(t):
        return 2.0 * LOSS if 800.0 < t < 1100.0 else LOSS

    recordings = [box(3), box(4, loss=opened), box(5), box(6)]
    search = searched(recordings)
    [effect] = search.effects_
    assert (effect.kind, effect.place) == ("time_interval", "x0 in recording 1")
    assert effect.parameters["begin"] == pytest.approx(800.0, abs=15.0)
    assert effect.parameters["end"] == pytest.approx(1100.0, abs=15.0)
    assert effect.parameters["change"] == pytest.approx(-LOSS, rel=0.1)
    model = search.best_estimator_
    here, elsewhere = model.in_recording(1), model.in_recording(0)
    one = recordings[1]
    runs = [
        each.simulate(one["x"][0], one["t"], one["inputs"]).x[:, 0] for each in (here, elsewhere)
    ]
    inside = (one["t"] > 900.0) & (one["t"] < 1100.0)
    left = [np.sqrt(np.mean((run - one["x"][:, 0])[inside] ** 2)) for run in runs]
    assert left[0] < 0.2 * left[1]


@pytest.mark.nightly
def test_a_lid_that_is_opened_twice_and_bends_the_law():
    # thrice the loss for a sixth of the record: least squares lie in between
    opened = ((300.0, 420.0), (1190.0, 1280.0))

    def loss(t):
        return 3.0 * LOSS if any(a < t < b for a, b in opened) else LOSS

    search = searched([box(7, loss=loss)])
    [effect] = search.effects_
    assert (effect.kind, effect.place) == ("time_interval", "x0")
    assert list(effect.placed.theta) == pytest.approx(sum(opened, ()), abs=10.0)
    assert effect.parameters["change"] == pytest.approx(-2.0 * LOSS, rel=0.1)
    before, after = errors(search)
    assert after < 0.25 * before
    assert re.search(r" x0 from t = 300(\.\d)? to 4", effect.formula)
    assert " and from 1190 to 12" in effect.formula
    assert "Root mean square error of free rollouts" in search.report_.to_html()


@pytest.mark.nightly
def test_a_lag_shows_once_what_happened_is_known():
    """A lid that nobody has told hides the lag of the heater, or its size."""

    def opened(t):
        return 4.0 * LOSS if 700.0 < t < 1000.0 else LOSS

    recordings = [box(11, lag=20.0), box(12, lag=20.0, loss=opened), box(13, lag=20.0)]
    plain = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    library = [Lag(), TimeInterval()]
    search = EffectSearchCV(plain, effects=library).fit(recordings)
    found = search.effects_
    assert {one.kind for one in found} == {"lag", "time_interval"}
    by_kind = {one.kind: one.parameters for one in found}
    assert by_kind["lag"]["time_constant"] == pytest.approx(20.0, rel=0.2)
    assert by_kind["time_interval"]["begin"] == pytest.approx(700.0, abs=15.0)
    assert by_kind["time_interval"]["end"] == pytest.approx(1000.0, abs=15.0)
    # in a recording that was held out, too, in which the lid was open
    before, *_, after = errors(search)
    assert after < 0.05 * before


def test_what_hardly_moves_is_the_level():
    t = np.arange(200.0)
    X = np.column_stack([np.sin(t), 21.4 + 1e-3 * np.sin(t)])
    records = make_records(X, 1, t=t, names=["T", "T_room"])
    assert TimeInterval().places(records) == ["level", 0]


def test_several_intervals_of_one_change_are_found_by_turns():
    t = np.arange(400.0)
    rng = np.random.default_rng(1)
    x = rng.uniform(1.0, 2.0, 400)
    records = make_records(x[:, None], 1, t=t, names=["x"])
    inside = ((t >= 40.0) & (t < 100.0)) | ((t >= 240.0) & (t < 320.0))
    left = (np.where(inside, 0.3, 0.0) * x + 0.02 * rng.standard_normal(400))[:, None]
    change = np.array([0.3])
    once = TimeInterval().rescanned(records, 0, (180.0, 200.0), change, left)
    np.testing.assert_allclose(once, [240.0, 320.0], atol=4.0)
    left = left - TimeInterval().columns(records, 0, *once) * change
    again, theta = TimeInterval().once_more(records, 0, once, change, left)
    np.testing.assert_allclose(theta, [40.0, 100.0, 240.0, 320.0], atol=4.0)
    column = again.columns(records, 0, 239.5, 319.5, 39.5, 99.5)[:, 0]
    np.testing.assert_allclose(column, np.where(inside, x, 0.0))
    assert again.column_names("x", 40.0, 100.0, 240.0, 320.0) == (
        "x [40 < t < 100 or 240 < t < 320]",
    )


def test_the_interval_of_a_scan_is_the_one_of_the_residual():
    t = np.arange(400.0)
    rng = np.random.default_rng(0)
    x = rng.uniform(1.0, 2.0, 400)
    records = make_records(x[:, None], 1, t=t, names=["x"])
    inside = (t >= 120.0) & (t < 180.0)
    left = (np.where(inside, 0.3, 0.0) * x + 0.05 * rng.standard_normal(400))[:, None]
    effect = TimeInterval()
    begins, ends = effect.parameters(records, 0)
    grid = np.array([[one, other] for one in begins.values for other in ends.values])
    [found] = effect.shortlist(records, 0, grid, left)
    np.testing.assert_allclose(found, [120.0, 180.0], atol=4.0)  # a hundredth of the record
    np.testing.assert_allclose(
        effect.columns(records, 0, 119.5, 179.5)[:, 0], np.where(inside, x, 0.0)
    )


def test_what_acts_for_a_moment_of_a_long_record_is_seen():
    """Thirty samples of twenty thousand, a sixth of a hundredth: instants follow the residual."""
    t = np.arange(20_000.0)
    rng = np.random.default_rng(3)
    x = rng.uniform(1.0, 2.0, len(t))
    records = make_records(x[:, None], 1, t=t, names=["x"])
    inside = (t >= 7_311.0) & (t < 7_341.0)
    left = (np.where(inside, 0.3, 0.0) * x + 0.1 * rng.standard_normal(len(t)))[:, None]
    effect = TimeInterval()
    [found] = effect.shortlist(records, 0, effect.grid(records, 0), left)
    np.testing.assert_allclose(found, [7_311.0, 7_341.0], atol=1.0)  # 4.5 of the noise each
