"""`HybridAutomatonRegressor` on stated plants: guards that remember, jumps, clocks, memory."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from benchmarks.automata.figures import figures
from benchmarks.automata.methods import METHODS, OURS
from benchmarks.automata.plants import PLANTS
from benchmarks.automata.recordings import Scenario, record
from swsysid import (
    GuardWarning,
    HybridAutomaton,
    HybridAutomatonRegressor,
    IdentificationWarning,
    MisfitWarning,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid._automaton_search import refined
from swsysid.metrics import mode_accuracy

THERMOSTAT = HybridAutomaton.stated(
    [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
    states=["T"],
)
BALL = HybridAutomaton.stated(
    [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
)
TIMER = HybridAutomaton.stated(
    [{"x": "1 - 0.5 x"}, {"x": "-0.5 x"}],
    [(0, 1, "x >= 1.2"), (1, 0, "dwell >= 1.5")],
    states=["x"],
)


def recorded(plant, starts, t, noise=0.0):
    """Recordings with noise in parts of the spread, and the modes."""
    runs = [plant.simulate(start, t, mode=mode) for start, mode in starts]
    spread, rng = np.vstack([run.x for run in runs]).std(axis=0), np.random.default_rng(0)
    listed = [
        {"t": t, "x": run.x + noise * spread * rng.standard_normal(run.x.shape)} for run in runs
    ]
    return listed, runs


def at(transition, *columns):
    return transition.guard.values(np.atleast_2d(np.array(columns, dtype=float)))[0]


@pytest.mark.parametrize(
    ("noise", "tolerance"), [(0.0, 1e-5), pytest.param(0.01, 0.1, marks=pytest.mark.nightly)]
)
def test_a_thermostat_has_one_guard_for_each_direction(noise, tolerance):
    starts = [([15.0 + k], 0) for k in range(3)] + [([25.0 - k], 1) for k in range(3)]
    data, runs = recorded(THERMOSTAT, starts, np.arange(0.0, 30.0, 0.1), noise)
    found = HybridAutomatonRegressor(random_state=0).fit(data)
    assert found.n_modes_ == 2
    assert mode_accuracy(np.concatenate([run.modes for run in runs]), found.modes_) > 0.999
    heating = int(np.argmax(found.coef_[:, 0, 0]))  # the mode of the larger constant
    for one in found.transitions_:
        threshold = 22.0 if one.source == heating else 18.0
        # the guard in degrees: it rises where its transition is taken
        slope = at(one, threshold + 1.0, 0.0, 0.0) - at(one, threshold, 0.0, 0.0)
        assert abs(at(one, threshold, 0.0, 0.0) / slope) < tolerance
        assert (slope > 0.0) == (one.source == heating)
        assert one.reset is None
    if not noise:
        again = found.simulate([16.5], data[0]["t"], mode=heating)
        truth = THERMOSTAT.simulate([16.5], data[0]["t"], mode=0)
        np.testing.assert_allclose(again.x, truth.x, atol=1e-5)


@pytest.mark.parametrize(
    ("noise", "tolerance"), [(0.0, 1e-6), pytest.param(0.03, 0.02, marks=pytest.mark.nightly)]
)
def test_a_ball_has_one_mode_and_jumps_within_it(noise, tolerance):
    starts = [([5.0 + 0.7 * k, 0.3 * k], 0) for k in range(6)]
    data, _ = recorded(BALL, starts, np.arange(0.0, 3.0, 0.01), noise)
    found = HybridAutomatonRegressor(random_state=0).fit(data)
    [one] = found.transitions_
    assert (found.n_modes_, one.source, one.target) == (1, 0, 0)
    np.testing.assert_allclose(one.reset.matrix, np.diag([1.0, -0.8]), atol=tolerance)
    np.testing.assert_allclose(one.reset.offset, 0.0, atol=tolerance)
    # the ground, as a time at the speed of an impact
    assert abs(at(one, 0.0, -10.0, 0.0, 0.0)) < max(tolerance, 1e-6)
    # an impact one sample late costs .003
    assert found.score(data) > (0.97 if noise else 0.999)
    assert (found.refinement_ is not None) == bool(noise)
    if noise:
        refinement, [guard], [reset] = (
            found.refinement_,
            found.refinement_.guard_standard_errors,
            found.refinement_.reset_standard_errors,
        )
        assert refinement.kept
        assert refinement.objective_after < refinement.objective_before
        # one of the two coefficients of the guard sets its scale; none is four deviations off
        assert abs(one.guard.coef[guard > 0.0]) < 4.0 * guard.max()
        assert abs(one.reset.matrix[1, 1] + 0.8) < 4.0 * reset[1, 2]


def test_what_follows_the_recordings_nowhere_is_no_refinement(monkeypatch):
    """Of a ball between two stops the objective was 1e102, and errors of guards were 5e49."""
    data, _ = recorded(THERMOSTAT, [([15.0], 0), ([16.0], 0)], np.arange(0.0, 30.0, 0.1), 0.01)
    jointly = refined.jointly

    def astray(*arguments):
        return replace(jointly(*arguments), value_before=1.1e102, value_after=1e102)

    monkeypatch.setattr(refined, "jointly", astray)
    found = HybridAutomatonRegressor(random_state=0).fit(data)
    assert not found.refinement_.kept
    assert str(found.refinement_).startswith("Laws and guards refined together do not follow")
    assert max(errors.max() for errors in found.guard_errors_) < 1.0


def test_without_noise_nothing_is_refined():
    data, _ = recorded(THERMOSTAT, [([15.0], 0), ([16.0], 0)], np.arange(0.0, 30.0, 0.1), 0.0)
    plain, refined = (
        HybridAutomatonRegressor(random_state=0, refine=one).fit(data) for one in (False, True)
    )
    assert refined.refinement_ is None
    # digits included
    np.testing.assert_array_equal(refined.coef_, plain.coef_)
    for one, other in zip(refined.transitions_, plain.transitions_, strict=True):
        np.testing.assert_array_equal(one.guard.coef, other.guard.coef)


@pytest.mark.nightly
def test_one_surface_comes_out_as_the_regressor_gives_it():
    spring = HybridAutomaton.stated(
        [{"x": "v", "v": "-x - 0.1 v"}, {"x": "v", "v": "-4 x - 0.1 v"}],
        [(0, 1, "x >= 0.3"), (1, 0, "x <= 0.3")],
        states=["x", "v"],
    )
    starts = [([1.0, 0.0], None), ([0.0, 2.0], None), ([-1.0, 0.5], None)]
    data, _ = recorded(spring, starts, np.arange(0.0, 15.0, 0.05), 0.01)
    found = HybridAutomatonRegressor(2, random_state=0).fit(data)
    surface = PolynomialSurfaceClassifier(degree=1)
    regressor = SwitchingSystemRegressor(2, feature_library=1, surface=surface, random_state=0)
    known = TrajectoryIdentifier(regressor).fit(data).estimator_
    order = np.argsort(found.coef_[:, 1, 1]), np.argsort(known.coef_[:, 1, 1])
    # digits included
    np.testing.assert_array_equal(found.coef_[order[0]], known.coef_[order[1]])
    for one in found.transitions_:
        np.testing.assert_array_equal(np.abs(one.guard.coef), np.abs(known.surface_.coef_[0]))


def test_samples_after_a_last_jump_keep_the_states_that_were_measured():
    starts = [([5.0 + 0.7 * k, 0.3 * k], 0) for k in range(6)]
    t = np.arange(0.0, 3.0, 0.01)
    data, runs = recorded(BALL, starts, t)
    ends = [int(np.flatnonzero(np.diff(run.x[:, 1]) > 1.0)[-1]) + 3 for run in runs]
    cut = [{"t": t[:end], "x": one["x"][:end]} for one, end in zip(data, ends, strict=True)]
    found = HybridAutomatonRegressor(random_state=0).fit(cut)
    np.testing.assert_allclose(found.states_, np.vstack([one["x"] for one in cut]), atol=1e-5)


def test_no_more_modes_are_found_in_discrete_time_than_are_allowed():
    plant = HybridAutomaton.stated(
        [{"T": "0.9 T + 3"}, {"T": "0.9 T + 1"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
        discrete_time=True,
    )
    data, _ = recorded(plant, [([10.0 + 1.7 * k], 0) for k in range(5)], np.arange(100.0))
    with pytest.warns(MisfitWarning, match="all 5 recordings where mode 0 -> 0"):
        found = HybridAutomatonRegressor(discrete_time=True, max_modes=1).fit(data)
    assert found.n_modes_ == 1


def test_a_clock_that_begins_with_the_mode_is_a_guard():
    starts = [([0.2 * k + 0.05], k % 2) for k in range(6)]
    data, _ = recorded(TIMER, starts, np.arange(0.0, 15.0, 0.05))
    found = HybridAutomatonRegressor(random_state=0).fit(data)
    clocks = [one for one in found.transitions_ if one.guard.powers[:, 1].any()]
    [clock] = [one for one in clocks if abs(at(one, 0.0, 1.5, 0.0)) < 1e-4]
    np.testing.assert_allclose(at(clock, 0.7, 0.5, 3.0), -1.0, atol=1e-4)  # of the dwell alone


def test_a_clock_that_begins_with_a_jump_is_known_to_the_instant():
    doses = HybridAutomaton.stated(
        [{"a": "-a", "c": "a - 0.15 c"}],
        [(0, 0, "dwell >= 6.1", {"a": "a + 10"})],
        states=["a", "c"],
    )
    data, _ = recorded(doses, [([2.0 * k, k], 0) for k in range(5)], np.arange(0.0, 92.0, 0.23))
    found = HybridAutomatonRegressor(random_state=0).fit(data)
    [one] = found.transitions_
    # the clock alone; the state, periodic but for the first stays, tells nearly as much
    np.testing.assert_allclose(at(one, 0.7, 0.3, 5.1, 40.0), -1.0, atol=1e-4)
    np.testing.assert_allclose(one.reset.offset, [10.0, 0.0], atol=1e-4)
    [verdict] = found.verdicts_
    assert verdict.is_told and verdict.explained == 1.0


def test_a_smooth_system_has_one_mode_and_no_transition():
    plant = HybridAutomaton.stated([{"x": "v", "v": "-x - 0.1 v"}], [], states=["x", "v"])
    data, _ = recorded(plant, [([1.0, 0.0], 0), ([0.0, 2.0], 0)], np.arange(0.0, 20.0, 0.05), 0.01)
    found = HybridAutomatonRegressor(random_state=0).fit(data)
    assert (found.n_modes_, found.transitions_) == (1, ())


def test_discrete_time_finds_thresholds_within_their_gap():
    plant = HybridAutomaton.stated(
        [{"T": "0.9 T + 3"}, {"T": "0.9 T + 1"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
        discrete_time=True,
    )
    data, runs = recorded(plant, [([10.0 + 1.7 * k], 0) for k in range(5)], np.arange(200.0))
    found = HybridAutomatonRegressor(discrete_time=True).fit(data)
    # the last sample has no law of its own, and the mode of the one before
    lasts = np.arange(1000) % 200 == 199
    states, modes = np.vstack([r["x"] for r in data])[~lasts, 0], found.modes_[~lasts]
    heating = int(np.argmax(found.coef_[:, 0, 0]))
    for one in found.transitions_:
        values = one.guard.values(np.column_stack([states, np.zeros((len(states), 2))]))
        assert (values[modes == one.source] < 0.0).all()
    again = found.simulate([12.5], np.arange(200.0), mode=heating)
    truth = plant.simulate([12.5], np.arange(200.0), mode=0)
    # the thresholds lie anywhere between samples that were seen
    assert np.mean(again.modes == np.where(truth.modes == 0, heating, 1 - heating)) > 0.95
    true = np.concatenate([run.modes for run in runs])[~lasts]
    assert mode_accuracy(true, modes) == 1.0


def bent():
    """A map of a state and an input that is bent where their sum is zero, and recordings of it."""
    plant = HybridAutomaton.stated(
        [{"y": "0.8 y + 0.4 u"}, {"y": "0.3 y - 0.1 u"}],
        [(0, 1, "y + u >= 0"), (1, 0, "y + u <= 0")],
        states=["y"],
        inputs=["u"],
        discrete_time=True,
    )
    rng, data, modes = np.random.default_rng(2), [], []
    for k in range(6):
        u = rng.uniform(-2.0, 2.0, (200, 1))
        run = plant.simulate([0.1 * k - 2.5], np.arange(200), u, mode=0)
        data.append({"t": np.arange(200.0), "x": run.x, "inputs": u})
        modes.append(run.modes)
    return plant, data, np.concatenate(modes)


def test_where_both_laws_agree_is_the_surface_of_both_ways():
    plant, data, modes = bent()
    found = HybridAutomatonRegressor(discrete_time=True).fit(data)
    values = [one.guard.values(np.array([[0.7, -0.7, 0.0, 0.0]])) for one in found.transitions_]
    # known from the laws, and so as well as they are
    np.testing.assert_allclose(values, 0.0, atol=1e-9)
    # the last sample of a recording has no row, but a surface
    assert mode_accuracy(modes, found.modes_) == 1.0


@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_noise_makes_no_switch_that_the_guards_do_not_explain(noise):
    _, data, modes = bent()
    spread, rng = np.vstack([one["x"] for one in data]).std(), np.random.default_rng(0)
    for one in data:
        one["x"] = one["x"] + noise * spread * rng.standard_normal(one["x"].shape)
    found = HybridAutomatonRegressor(discrete_time=True).fit(data)
    # without guards 99.6 % and 98.9 % of the samples are in their mode
    assert mode_accuracy(modes, found.modes_) > 0.999
    for one in found.transitions_:
        point = np.array([0.7, -0.7, 0.0, 0.0])
        slope = np.linalg.norm(one.guard.gradient(point)[:2] * [np.ptp(data[0]["x"]), 4.0])
        assert abs(one.guard.at(point)) < 0.01 * slope


def test_memory_is_found_with_its_lags():
    plant = HybridAutomaton.stated(
        [{"y": "0.6 y + 0.2 y[k-1] + u"}, {"y": "-0.3 y + 0.3 y[k-1] + 0.5 u"}],
        [(0, 1, "y >= 1.5"), (1, 0, "y <= -0.7")],
        states=["y"],
        inputs=["u"],
        discrete_time=True,
        lags=1,
    )
    rng, data = np.random.default_rng(0), []
    for k in range(5):
        u = rng.uniform(-0.9, 1.1, (300, 1))
        run = plant.simulate(np.array([[0.1 * k], [0.2]]), np.arange(300), u, mode=0)
        data.append({"t": np.arange(300.0), "x": run.x, "inputs": u})
    found = HybridAutomatonRegressor(2, lags=1, discrete_time=True).fit(data)
    laws = sorted(found.coef_[:, 0, 1:4].round(9).tolist())
    assert laws == [[-0.3, 0.3, 0.5], [0.6, 0.2, 1.0]]
    assert found.automaton_.lags == 1


@pytest.mark.nightly
def test_each_mode_has_the_order_that_its_held_out_rollouts_ask_for():
    plant = HybridAutomaton.stated(
        [{"y": "1.4 y - 0.6 y[k-1] + 0.5 u"}, {"y": "0.5 y - u"}],
        [(0, 1, "y >= 1.5"), (1, 0, "y <= -1")],
        states=["y"],
        inputs=["u"],
        discrete_time=True,
        lags=1,
    )
    rng, data, modes = np.random.default_rng(0), [], []
    for k in range(4):
        u = rng.standard_normal((250, 1))
        run = plant.simulate([[0.1 * k], [0.2]], np.arange(250), u, mode=0)
        data.append({"t": np.arange(250.0), "x": run.x, "inputs": u})
        modes.append(run.modes)
    spread = np.vstack([one["x"] for one in data]).std()
    for one in data:
        one["x"] = one["x"] + 0.03 * spread * rng.standard_normal(one["x"].shape)
    found = HybridAutomatonRegressor(lags="auto", discrete_time=True).fit(data)
    assert found.automaton_.lags == 1
    # constant, y[k], y[k-1], u[k], u[k-1]; one mode does not look back
    coef = found.coef_[np.argsort(found.coef_[:, 0, 1]), 0]
    np.testing.assert_array_equal(coef[0, [2, 4]], 0.0)
    expected = [[0.0, 0.5, 0.0, -1.0, 0.0], [0.0, 1.4, -0.6, 0.5, 0.0]]
    np.testing.assert_allclose(coef, expected, atol=0.02)
    assert mode_accuracy(np.concatenate(modes), found.modes_) > 0.99


def test_an_unrecorded_trigger_is_said_not_invented():
    rng, t = np.random.default_rng(3), np.arange(0.0, 40.0, 0.05)
    data = []
    for start in (0.1, 0.5, 0.9, 1.4):
        mode, x, rows, left = 0, start, [], 1.0
        for _ in t:
            rows.append(x)
            target = 2.0 if mode == 0 else 0.0
            x = target + (x - target) * np.exp(-0.5 * 0.05)
            left -= 0.05
            if left <= 0.0:
                mode, left = 1 - mode, rng.uniform(0.5, 3.0)
        data.append({"t": t, "x": np.array(rows)[:, None]})
    with pytest.warns(GuardWarning, match="record the signal"):
        found = HybridAutomatonRegressor(2, random_state=0).fit(data)
    assert any(not one.is_told for one in found.verdicts_)
    assert "record the signal" in str(found.report_)


def test_rows_that_follow_no_law_are_said():
    """A relay that switches every third row, with noise of no law on every seventh."""
    generator, y, rows = np.random.default_rng(0), 0.1, []
    for k in range(400):
        rows.append(y)
        y = 0.8 * y + 0.2 + (generator.uniform(-1.0, 1.0) if k % 7 == 0 else 0.0)
    with pytest.warns(MisfitWarning, match="the recording where the law of mode 0 leaves"):
        found = HybridAutomatonRegressor(1, discrete_time=True).fit(np.array(rows)[:, None])
    np.testing.assert_allclose(found.coef_[0, 0], [0.2, 0.8], atol=1e-9)
    assert "14% of the samples follow none of the laws" in str(found.report_)


def test_names_files_and_any_number_of_jobs():
    data, _ = recorded(THERMOSTAT, [([15.0], 0), ([17.0], 0)], np.arange(0.0, 30.0, 0.1))
    rows = pd.DataFrame(np.vstack([r["x"] for r in data]), columns=["T"])
    t, groups = np.tile(data[0]["t"], 2), np.repeat([0, 1], 300)
    found = HybridAutomatonRegressor(random_state=0).fit(rows, t, groups)
    assert any("where T >= 22.0" in line for line in found.equations(precision=1))
    told = json.loads(json.dumps(found.to_dict()))
    assert HybridAutomatonRegressor.from_dict(told).equations() == found.equations()
    other = HybridAutomatonRegressor(random_state=0, n_jobs=2).fit(rows, t, groups)
    np.testing.assert_array_equal(found.coef_, other.coef_)
    assert "->" in str(found.report_)


@pytest.mark.parametrize(
    ("parameters", "sentence"),
    [
        ({"lags": 1}, "discrete_time=True"),
        ({"lags": -1}, "lags"),
        ({"guard_degree": 0}, "guard_degree"),
        ({"n_modes": 0}, "n_modes"),
        ({"discrete_time": True, "sparsity": "auto"}, "sparsity"),
    ],
)
def test_wrong_parameters_are_refused_in_a_sentence(parameters, sentence):
    t = np.arange(0.0, 10.0, 0.1)
    with pytest.raises(ValueError, match=sentence):
        HybridAutomatonRegressor(**parameters).fit(np.sin(t)[:, None], t)


def test_the_warning_is_one_of_identification():
    assert issubclass(GuardWarning, IdentificationWarning)


@pytest.mark.parametrize(
    "name",
    [
        "hopping robot",
        *(
            pytest.param(name, marks=pytest.mark.nightly)
            for name in ("two rooms", "Duffing oscillator")
        ),
    ],
)
def test_automata_in_clean_recordings_are_found_to_rounding(name):
    """Stays between two samples; stays of four samples; jumps of a twentieth of a speed."""
    plant = PLANTS[name]
    seen, unseen = record(plant, Scenario(0.0), 1), record(plant, Scenario(0.0, 2), 2)
    reached = figures(plant, METHODS[OURS](plant, seen, 0), seen, unseen)
    assert reached["modes"] == 0.0
    assert reached["share"] == 1.0
    assert reached["guard"] < 1e-6  # of the range
    assert reached["largest"] < 1e-6
