"""Truth, recordings, figures and tables of the automata benchmark."""

import json

import numpy as np
import pytest

from benchmarks.automata.__main__ import limited, main, parse, wanted
from benchmarks.automata.figures import FIGURES, figures
from benchmarks.automata.methods import METHODS
from benchmarks.automata.plant import Polynomial
from benchmarks.automata.plants import PLANTS
from benchmarks.automata.published import DAINARX
from benchmarks.automata.recordings import HELD_OUT, Scenario, record
from benchmarks.automata.truth import Start, run

CLEAN = Scenario()
FEW = Scenario(n_recordings=2)
ZERO = {"modes", "guard", "mean", "largest", "ended", "spurious", "apart", "tool_modes",
        "tool_instants", "tool_mean", "tool_largest"}  # fmt: skip
FLOWS = [name for name, plant in PLANTS.items() if not plant.is_map]


def _times(done):
    return np.array([crossing.time for crossing in done.crossings])


# -- truth by hand ---------------------------------------------------------------------------


def test_a_ball_lands_when_its_parabola_does():
    plant, g, height = PLANTS["bouncing ball"], 9.8, 1.25
    t = np.linspace(0.0, 4.0, 401)
    done = run(plant, Start(np.array([height, 0.0])), t, None)
    fall = np.sqrt(2.0 * height / g)
    speeds = g * fall * 0.9 ** np.arange(1, 6)  # after each impact
    impacts = fall + np.concatenate([[0.0], np.cumsum(2.0 * speeds / g)])
    np.testing.assert_allclose(_times(done), impacts[impacts < 4.0], atol=1e-10)
    last = impacts[impacts < 4.0][-1]
    since, speed = 4.0 - last, speeds[np.sum(impacts < 4.0) - 1]
    at_end = [speed * since - 0.5 * g * since**2, speed - g * since]
    np.testing.assert_allclose(done.x[-1], at_end, atol=1e-9)


def test_a_thermostat_has_its_period():
    plant = PLANTS["thermostat"]
    done = run(plant, Start(np.array([20.0])), np.linspace(0.0, 4.0, 401), None)
    heating, cooling = 2.0 * np.log(26.0 / 21.0), 2.0 * np.log(25.0 / 20.0)
    instants = np.cumsum([heating, cooling] * 5)
    np.testing.assert_allclose(_times(done), instants[instants < 4.0], atol=1e-10)
    assert [crossing.edge for crossing in done.crossings[:3]] == [0, 1, 0]


def test_doses_come_when_the_timer_says():
    plant = PLANTS["repeated doses"]
    t = np.linspace(0.0, 20.0, 101)
    done = run(plant, Start(np.array([4.0, 0.0])), t, None)
    np.testing.assert_allclose(_times(done), [6.1, 12.2, 18.3], atol=1e-10)
    doses = [(0.0, 4.0), (6.1, 10.0), (12.2, 10.0), (18.3, 10.0)]
    gut = sum(dose * np.exp(-(t - at)) * (t >= at) for at, dose in doses)
    np.testing.assert_allclose(done.x[:, 0], gut, atol=1e-9)
    # with absorption at 1 and elimination at .15 the blood has (e^-.15 s - e^-s) / .85 of a dose
    blood = sum(
        dose / 0.85 * (np.exp(-0.15 * (t - at)) - np.exp(-(t - at))) * (t >= at)
        for at, dose in doses
    )
    np.testing.assert_allclose(done.x[:, 1], blood, atol=1e-9)


def test_a_map_is_iterated_and_its_lags_are_its_own():
    plant = PLANTS["lynx"]
    done = run(plant, Start(np.array([[3.0], [3.3]])), np.arange(4.0), None)
    third = 0.62 + 1.25 * 3.3 - 0.43 * 3.0  # the row before is below the threshold
    fourth = 2.25 + 1.52 * third - 1.24 * 3.3  # now it is above
    np.testing.assert_allclose(done.x[:, 0], [3.0, 3.3, third, fourth], atol=1e-12)
    np.testing.assert_array_equal(done.modes[:3], [0, 0, 1])


def test_a_spike_is_reset_at_its_step():
    plant = PLANTS["spiking neuron"]
    [crossing] = [one for one in record(plant, FEW, 0).runs[0].crossings if one.time == one.time][
        :1
    ]
    assert crossing.columns[0] >= 30.0 > crossing.before[0]
    np.testing.assert_allclose(crossing.after, [-65.0, crossing.columns[1] + 2.0], atol=1e-12)


def test_gradient_of_a_polynomial_is_its_finite_difference():
    guard = Polynomial.of({"x*x*v": 2.0, "v": -3.0, "1": 5.0}, ["x", "v", "u"])
    point = np.array([1.5, -0.5, 2.0])
    assert guard(point) == pytest.approx(2.0 * 1.5**2 * -0.5 + 1.5 + 5.0)
    np.testing.assert_allclose(guard.gradient(point), [2 * 2 * 1.5 * -0.5, 2 * 1.5**2 - 3, 0])


# -- recordings ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def recorded():
    """Every plant in the default scenario."""
    return {name: record(plant, CLEAN, 0) for name, plant in PLANTS.items()}


def test_there_are_enough_of_every_kind():
    plants = PLANTS.values()
    assert len(plants) >= 16
    assert sum(plant.is_map for plant in plants) >= 4 and sum(plant.lags > 0 for plant in plants)
    assert any(edge.source == edge.target for plant in plants for edge in plant.edges)
    assert any(not plant.edges for plant in plants)
    assert {plant.name for plant in plants if plant.reads_clocks} == {
        "hopping robot", "repeated doses", "epidemic with interventions",
    }  # fmt: skip
    assert all(plant.source for plant in plants)
    assert set(DAINARX) <= set(PLANTS)


@pytest.mark.parametrize("name", PLANTS)
def test_every_transition_is_recorded_and_nothing_runs_away(recorded, name):
    plant, campaign = PLANTS[name], recorded[name]
    assert np.isfinite(campaign.states).all()
    crossings = [crossing for one in campaign.runs for crossing in one.crossings]
    visits = np.bincount([one.edge for one in crossings], minlength=len(plant.edges))
    assert (visits[: len(plant.edges)] >= 3).all(), visits
    assert set(campaign.modes) == set(range(plant.n_modes))
    for one in crossings:
        # an edge is taken where its guard is zero, on entry or at a step of a map above it
        value = plant.guards[one.edge](one.columns)
        if not plant.is_map:
            assert abs(value) < 1e-7 * max(1.0, np.abs(one.columns).max())
        else:
            assert value >= 0.0


@pytest.mark.parametrize("name", FLOWS)
def test_no_plant_switches_ever_faster(recorded, name):
    for instants in recorded[name].instants:
        assert len(instants) < 0.2 * CLEAN.n_samples
        # no two at one instant: every mode that is entered lasts
        assert np.diff(instants).min(initial=np.inf) > 0.01 * PLANTS[name].dt


@pytest.mark.parametrize("name", FLOWS)
def test_the_start_is_no_transition(name):
    plant, rng = PLANTS[name], np.random.default_rng(0)
    for number in range(8):
        start = plant.start(rng, number)
        low = np.zeros((1, len(plant.input_names)))
        given = low[0] if plant.inputs is None else plant.inputs(rng, np.zeros(1))[0]
        columns = np.concatenate([start.x, given, [0.0, start.time]])
        out = [k for k, edge in enumerate(plant.edges) if edge.source == start.mode]
        assert all(plant.guards[k](columns) < 1e-9 for k in out)


def test_noise_does_not_change_what_happens(recorded):
    name = "two rooms"
    noisy = record(PLANTS[name], Scenario(noise=0.03), 0)
    np.testing.assert_array_equal(noisy.states, recorded[name].states)
    spread = noisy.noise.std(axis=0) / noisy.states.std(axis=0)
    # 3200 samples know a standard deviation to 1.3 %
    np.testing.assert_allclose(spread, 0.03, rtol=0.06)


def test_one_surface_explains_what_has_neither_memory_nor_jumps():
    explained = {name for name, plant in PLANTS.items() if plant.has_one_surface}
    assert explained == {
        "one-legged jumper", "predator and prey", "hinging ARX", "lynx", "Van der Pol oscillator",
    }  # fmt: skip


# -- figures ---------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PLANTS)
def test_the_truth_has_no_error(name):
    plant = PLANTS[name]
    seen, unseen = record(plant, FEW, 0), record(plant, FEW, HELD_OUT)
    got = figures(plant, METHODS["truth"](plant, seen, 0), seen, unseen)
    assert set(got) == set(FIGURES)
    for figure, value in got.items():
        assert value == pytest.approx(0.0 if figure in ZERO else 1.0, abs=1e-12), figure


def test_figures_of_a_wrong_guard_and_of_swapped_names():
    plant = PLANTS["thermostat"]
    seen, unseen = record(plant, FEW, 0), record(plant, FEW, HELD_OUT)
    true = METHODS["truth"](plant, seen, 0)

    def late(source, target):
        guard = true.guard(1 - source, 1 - target)  # its modes have each other's names
        return guard and (lambda rows: guard(rows) - 0.5)

    def roll(start, t, inputs):
        done = true.roll(Start(start.x, 1 - start.mode), t, inputs)
        return done._replace(x=done.x + 0.1, instants=done.instants + 0.03)

    found = type(true)(2, 1 - seen.modes, [one[1:] for one in seen.instants], roll, late)
    got, span = figures(plant, found, seen, unseen), np.ptp(unseen.states)
    assert got["share"] == 1.0 and got["edges"] == 1.0
    assert got["guard"] == pytest.approx(0.5 / span)
    assert got["mean"] == pytest.approx(0.1 / span) == pytest.approx(got["largest"])
    assert got["apart"] == pytest.approx(3.0) and got["tool_instants"] == pytest.approx(0.03)
    n_instants = sum(len(one) for one in seen.instants)
    assert got["near"] == pytest.approx(1.0 - 2.0 / n_instants) and got["spurious"] == 0.0


# -- the program -----------------------------------------------------------------------------


def test_a_cell_is_run_once_and_printed(tmp_path, capsys):
    arguments = ["--output", str(tmp_path), "--plants", "hinging ARX", "bouncing ball"]
    arguments += ["--methods", "truth", "--noise", "0", "--recordings", "2", "--samples", "50"]
    main(arguments)
    printed = capsys.readouterr().out
    assert "| hinging ARX |" in printed and "samples right: 100 %" in printed
    assert "here / DAINARX" in printed
    kept = (tmp_path / "automata.jsonl").read_text()
    main(arguments)
    assert (tmp_path / "automata.jsonl").read_text() == kept
    assert len(list(wanted(parse(arguments)))) == 2
    assert "origin" in json.loads((tmp_path / "automata.json").read_text())["automata"]


def test_a_cell_that_takes_too_long_is_given_up():
    with pytest.raises(TimeoutError, match="Given up after 0.05 CPU seconds"), limited(0.05):
        while True:
            pass


def test_one_surface_is_found_by_the_surface_method():
    plant = PLANTS["hinging ARX"]
    seen, unseen = record(plant, CLEAN, 0), record(plant, FEW, HELD_OUT)
    got = figures(plant, METHODS["surface"](plant, seen, 0), seen, unseen)
    assert got["share"] > 0.999 and got["modes"] == 0.0
    assert got["guard"] < 1e-2  # of the range: the widest gap between rows of the two modes
