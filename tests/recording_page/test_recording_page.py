"""The page of an identification: its numbers are those of the model, and a browser shows them."""

import json
import re

import numpy as np
import pytest
from browser import rendered

from swsysid import (
    HybridAutomaton,
    HybridAutomatonRegressor,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid._recording_page.charts import charts_json
from swsysid._recording_page.tracks import ENDED, told_by, tracks_of
from swsysid._stays.given import read_given
from swsysid.report import recording_page

UNITS = {"x0": "°C", "time": "s"}

# what a reader does: put the mouse into the middle of the second panel
HOVER = """<script>
const over = document.querySelectorAll(".u-over")[1], box = over.getBoundingClientRect();
for (const kind of ["mouseenter", "mousemove"]) over.dispatchEvent(new MouseEvent(kind,
  { clientX: box.left + box.width / 2, clientY: box.top + 20, bubbles: true }));
setTimeout(() => { document.title = JSON.stringify([...document.querySelectorAll(".panel")].map(
  (one) => [one.querySelector("h3").textContent,
    [...one.querySelectorAll(".u-value")].map((value) => value.textContent)])); }, 300);
</script></body>"""


@pytest.fixture(scope="module")
def heater():
    """A heater that is off above 22 degrees and on below 18, without noise."""
    plant = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
    )
    t = np.arange(0.0, 30.0, 0.1)
    runs = [plant.simulate([start], t, mode=0) for start in (15.0, 17.0, 19.0)]
    recordings = [{"t": t, "x": run.x} for run in runs]
    return HybridAutomatonRegressor(random_state=0).fit(recordings), recordings, runs


@pytest.fixture(scope="module")
def page_of_heater(heater):
    return recording_page(heater[0], heater[1], units=UNITS, title="Heater")


@pytest.fixture(scope="module")
def gate():
    """A coil that a logged switch connects to 12 V or to 20 V behind it: the gate alone decides."""
    rng, t = np.random.default_rng(0), np.arange(0.0, 40.0, 0.1)
    rows = []
    for period in (4.1, 5.3, 6.7):
        u = (t % period < 0.45 * period).astype(float)
        x = np.array([1.0, 0.5])
        for k in range(len(t)):
            rows.append([t[k], *x, u[k]])
            rate = [-x[1] * (1.0 - u[k]) - 0.2 * x[0] + 1.0, x[0] * (1.0 - u[k]) - 0.5 * x[1]]
            x = x + 0.1 * np.array(rate)
    t, x, u = np.split(np.array(rows), [1, 3], axis=1)
    rate = np.column_stack(
        [-x[:, 1] * (1.0 - u[:, 0]) - 0.2 * x[:, 0] + 1.0, x[:, 0] * (1 - u[:, 0]) - 0.5 * x[:, 1]]
    )
    model = SwitchingSystemRegressor(
        2, feature_library=1, surface=PolynomialSurfaceClassifier(1), random_state=0
    )
    noise = 1e-3 * rng.standard_normal(rate.shape)
    return model.fit(np.hstack([x, u]), rate + noise), x, t[:, 0], np.repeat([0, 1, 2], 400), u


def data_of(page):
    found = re.search(r'<script id="recordings" type="application/json">(.*?)</script>', page)
    return json.loads(found[1])


def test_rollouts_are_those_of_the_planted_plant(heater):
    model, recordings, runs = heater
    given = read_given(recordings, None, None, None)
    for track, run in zip(tracks_of(told_by(model, given), given, 3, 10_000), runs, strict=True):
        np.testing.assert_allclose(track.rolled, run.x, atol=1e-4)  # its thresholds, to the sample
        # a sample on either side of a switch may be in either mode
        off = np.flatnonzero(track.rolled_modes != run.modes)
        assert len(off) <= len(run.events)


def test_a_guard_is_below_zero_in_its_mode_and_rises_to_it(heater):
    model, recordings, runs = heater
    given = read_given(recordings, None, None, None)
    told = told_by(model, given)
    assert [one.split(" where ")[0] for one in told.guards] == ["mode 0 -> 1", "mode 1 -> 0"]
    track = tracks_of(told, given, 1, 10_000)[0]
    warmer, colder = track.guards.T
    assert (np.isfinite(warmer) == (track.modes == 0)).all()
    assert (np.isfinite(colder) == (track.modes == 1)).all()
    # in degrees, by hand: T - 22 and 18 - T
    x = runs[0].x[:, 0]
    np.testing.assert_allclose(warmer[track.modes == 0], x[track.modes == 0] - 22.0, atol=0.01)
    np.testing.assert_allclose(colder[track.modes == 1], 18.0 - x[track.modes == 1], atol=0.01)


def test_a_guard_of_the_time_in_a_mode_counts_from_the_switch():
    plant = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "-1"}], [(0, 1, "dwell >= 2"), (1, 0, "x <= 0")], states=["x"]
    )
    t = np.arange(0.0, 20.0, 0.05)
    recordings = [{"t": t, "x": plant.simulate([x], t, mode=0).x} for x in (0.0, 0.7, 1.1, 0.3)]
    model = HybridAutomatonRegressor(random_state=0).fit(recordings)
    given = read_given(recordings, None, None, None)
    told = told_by(model, given)
    of_time = next(k for k, one in enumerate(told.guards) if "dwell" in one)
    guard = tracks_of(told, given, 4, 10_000)[1].guards[:, of_time]
    known = np.isfinite(guard)
    # it rises by a second a second, up to zero, and falls back with every stay
    rises = np.diff(guard[known])
    assert np.median(rises) > 0.0 and guard[known].max() < 0.2 * np.ptp(guard[known])
    assert (rises < 0.0).sum() == (np.diff(np.flatnonzero(known)) > 1).sum()


def test_rollouts_begin_anew_where_laws_are_judged_by_stretches():
    rng, t = np.random.default_rng(0), np.linspace(0.0, 9.0, 181)
    x = np.exp(-t)[:, None] + 0.01 * rng.standard_normal((181, 1))
    cooling = TrajectoryIdentifier(SwitchingSystemRegressor(1), refine=False).fit(x, t)
    given = read_given(x, t, None, None)
    told = told_by(cooling, given)
    track = tracks_of(told, given, 1, 10_000)[0]
    begins = np.arange(0, 180, told.stretch)
    assert told.stretch == 30
    np.testing.assert_allclose(track.rolled[begins], cooling.states_[begins], atol=1e-9)
    assert "anew after every 30 samples" in recording_page(cooling, x, t)


def test_a_rollout_that_ends_is_drawn_as_far_as_it_goes():
    """x' = x^2 from 1 is 1 / (1 - t), which no rollout follows to t = 1."""
    t = np.linspace(0.0, 0.9, 91)
    x = (1.0 / (1.0 - t))[:, None]
    model = SwitchingSystemRegressor(1, feature_library=2).fit(x, x**2)
    longer = np.linspace(0.0, 1.5, 151)
    given = read_given(np.ones((151, 1)), longer, None, None)
    told = told_by(model, given)
    track = tracks_of(told, given, 1, 10_000)[0]
    assert track.rolled_modes[0] == 0 and track.rolled_modes[-1] == ENDED
    assert np.isnan(track.rolled[-1]) and json.loads(charts_json(told, [track], {}, 100))


def test_the_page_is_small_and_needs_no_network(page_of_heater):
    assert len(page_of_heater.encode()) < 200_000  # 53 kB of it the library that draws
    outside = re.findall(r'(?:src|href)="(?!data:)[^"]*"|@import|url\(', page_of_heater)
    assert not outside


def test_no_name_of_a_file_ends_the_script(heater):
    model, recordings, _ = heater
    bad = "</script><b>x</b>"
    page = recording_page(model, recordings, units={"x0": bad}, title=bad, found=bad)
    assert bad not in page and data_of(page)["panels"][0]["title"] == f"x0 [{bad}]"


def test_long_recordings_are_thinned_and_many_left_out(gate):
    model, x, t, groups, u = gate
    many = np.concatenate([groups + 3 * k for k in range(4)])
    page = recording_page(model, np.tile(x, (4, 1)), np.tile(t, 4), many, np.tile(u, (4, 1)))
    assert "The first 8 of 12 recordings." in page
    told = told_by(model, read_given(x, t, groups, u))
    track = tracks_of(told, read_given(x, t, groups, u), 1, 10_000)[0]
    thinned = json.loads(charts_json(told, [track], {}, 100))["recordings"][0]
    assert thinned["columns"]["t"] == [float(f"{one:.5g}") for one in track.t[::4]]
    assert thinned["every"] == 4
    # what is left out of the curves is not left out of the modes
    assert len(thinned["modes"]) == 1 + (np.diff(track.modes) != 0).sum()


@pytest.mark.parametrize(
    ("model", "error", "says"),
    [
        ("no model", TypeError, "model is a str; give a fitted TrajectoryIdentifier"),
        (SwitchingSystemRegressor(), ValueError, "not fitted yet"),
        (TrajectoryIdentifier(), ValueError, "not fitted yet"),
    ],
)
def test_what_is_no_fitted_model_is_refused(model, error, says):
    t = np.linspace(0.0, 1.0, 20)
    with pytest.raises(error, match=says):
        recording_page(model, np.exp(-t)[:, None], t)


def test_other_recordings_are_refused(heater):
    model, recordings, _ = heater
    with pytest.raises(ValueError, match="fitted to 900 samples and x has 600"):
        recording_page(model, recordings[:2])


def test_the_plane_is_that_of_the_columns_that_decide(gate):
    from swsysid.plotting import SwitchingSurfaceDisplay

    model, x, t, groups, u = gate
    display = SwitchingSurfaceDisplay.from_estimator(
        model, np.hstack([x, u]), features="auto", names=["i", "v", "gate"]
    )
    assert display.labels == ("i", "gate")
    # the gate hardly helps where the first columns tell
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (400, 3))
    of_first = SwitchingSystemRegressor(2, random_state=0)
    of_first.fit(states, -states * (1.0 + (states[:, :1] > 0.1)))
    display = SwitchingSurfaceDisplay.from_estimator(of_first, states, features="auto")
    assert display.labels == ("x0", "x1")


def test_a_browser_shows_values_under_the_mouse(page_of_heater, heater, tmp_path):
    path = tmp_path / "page.html"
    path.write_text(page_of_heater.replace("</body>", HOVER), encoding="utf-8")
    document = rendered(path.as_uri(), tmp_path / "browser")
    title = re.search(r"<title>(.*?)</title>", document)[1]
    panels = dict(json.loads(title.replace("&gt;", ">").replace("&lt;", "<")))
    run = heater[2][0]
    time, recorded, rolled = panels["modes"]
    k = int(np.argmin(np.abs(run.t - float(time))))
    assert 10.0 < float(time) < 20.0 and recorded == rolled == f"mode {run.modes[k]}"
    shown = [float(one) for one in panels["x0 [°C]"]]
    assert shown == pytest.approx([run.t[k], run.x[k, 0], run.x[k, 0]], abs=1e-3)
    left = float(panels["measured minus rolled out: x0 [°C]"][1])
    assert abs(left) < 1e-3
    guards = [values[1] for title, values in panels.items() if title.startswith("mode 0 ->")]
    assert (guards[0] == "--") == (run.modes[k] != 0)
