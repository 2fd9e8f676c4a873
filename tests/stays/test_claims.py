"""What a report of recordings claims: only what free rollouts of the delivered model keep."""

import re
import warnings

import numpy as np
import pytest

from swsysid import (
    HybridAutomaton,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)
from swsysid._stays.doubts import mode_doubts, thresholds
from swsysid.refinement import StatedModel, StatedSurface

T = np.linspace(0.0, 12.0, 241)
STARTS = ([2.0, 1.0], [-2.0, 0.0], [1.5, -1.0], [0.0, 3.0])
FINE = "The rollouts leave nothing but noise."


def spring():
    """A mass on a spring that is stiffer on one side."""
    laws = [[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]]]
    return StatedModel(None, laws, states=["x", "v"], surface=StatedSurface([[0, 1, 0]], 1))


def recorded(plant, noise, starts=STARTS, t=T, **options):
    """Recordings with noise of the deviation ``noise(number, states)``."""
    rng, found = np.random.default_rng(0), []
    for number, start in enumerate(starts):
        x = plant.simulate(start, t, **options).x
        found.append({"t": t, "x": x + noise(number, x) * rng.standard_normal(x.shape)})
    return found


def report(recordings, n_modes=2, *, refine=True, library=None, sparsity="auto", hold="auto"):
    estimator = SwitchingSystemRegressor(
        n_modes,
        feature_library=library,
        surface=PolynomialSurfaceClassifier(degree=1),
        sparsity=sparsity,
        random_state=0,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        asked = TrajectoryIdentifier(estimator, refine=refine, input_hold=hold)
        return asked.fit(recordings).report_


def with_a_held_input(n_samples=300, step=0.02, seed=3):
    """Beyond x = 0.5 a controller holds its input: no law is seen to depend on it there."""
    rng, found = np.random.default_rng(seed), []
    for _ in range(4):
        x, rows = float(rng.uniform(-1.0, 0.4)), []
        wish = np.interp(
            np.arange(n_samples), np.arange(0, n_samples + 40, 40), rng.uniform(-1, 3, 9)
        )
        for k in range(n_samples):
            u = wish[k] if x < 0.5 else 2.0
            rows.append((x, u))
            for _ in range(50):
                x += step / 50 * (u - x if x < 0.5 else u - 4.0 * x + 1.5)
        states, inputs = np.array(rows).T
        noisy = states + 0.003 * rng.standard_normal(n_samples)
        found.append(
            {"t": step * np.arange(n_samples), "x": noisy[:, None], "inputs": inputs[:, None]}
        )
    return found


def test_an_input_that_never_changes_in_a_mode_is_not_determined_there():
    found = report(with_a_held_input(), library=1, sparsity=None, hold="linear")
    beyond, below = found.laws
    assert beyond.endswith("+0 (not determined) x1") and "not determined" not in below


def test_an_input_that_is_held_into_a_mode_is_determined_there():
    beyond, _ = report(with_a_held_input(), library=1, sparsity=None).laws
    told = re.findall(r"([-+][.0-9]+) \(([.0-9]+)\)", beyond)
    for (value, error), true in zip(told, (1.5, -4.0, 1.0), strict=True):
        assert float(value) == pytest.approx(true, abs=3.0 * float(error))


def test_terms_are_chosen_beside_an_input_that_never_changes():
    beyond, below = report(with_a_held_input(), library=1).laws
    values = {
        name: float(value) for value, name in re.findall(r"([-+][.0-9]+) \(.*?\) ?(x\d|)", beyond)
    }
    assert values["x0"] == pytest.approx(-4.0, abs=0.05)
    assert values.get("", 0.0) + 2.0 * values.get("x1", 0.0) == pytest.approx(3.5, abs=0.05)
    assert "x0" in below and "x1" in below


def test_one_switch_determines_no_surface_and_a_time_tells_it_as_well():
    t = np.linspace(0.0, 2.5, 120)
    found = report(recorded(spring(), lambda k, x: 0.01, STARTS[:1], t))
    true = spring().simulate(STARTS[0], t).events[0].time
    (told,) = found.doubts
    assert told.startswith("f0 rests on 1 switch and has 1 free coefficient: it is not determined")
    rival = float(told.partition("time >= ")[2].split()[0].rstrip("."))
    assert rival == pytest.approx(true, abs=0.03)  # a step and a half
    assert found.rollouts.n_switches == 1 and found.rollouts.holds


def test_stretches_are_said_to_be_stretches():
    found = report(recorded(spring(), lambda k, x: 0.01), refine=False)
    assert "Free rollouts over stretches of 30 samples leave: x0 " in str(found)
    assert "all 20 switches within 1 sample." in str(found)
    assert found.advice == FINE and found.rollouts.holds


@pytest.mark.nightly
def test_noise_in_proportion_to_the_value_is_no_missing_term():
    found = report(recorded(spring(), lambda k, x: 0.03 * np.abs(x) + 0.001))
    assert (found.noise > 1.3 * found.noise_of_differences).all()  # what looks like a missing term
    told = [one for one in found.doubts if "grows with its size" in one]
    shares = [float(one.partition("size: ")[2].split()[0]) for one in told]
    np.testing.assert_allclose(shares, 3.0, rtol=0.15)
    assert found.advice == FINE


@pytest.mark.nightly
def test_noise_that_differs_by_recording_is_no_missing_term():
    found = report(recorded(spring(), lambda k, x: (0.01, 0.01, 0.06, 0.01)[k]))
    assert (found.noise > 1.3 * found.noise_of_differences).all()
    assert sum("differs by recording: 0.00" in one for one in found.doubts) == 2
    assert all("in recording 2" in one for one in found.doubts if "differs" in one)
    assert found.advice == FINE


@pytest.mark.nightly
def test_a_thermostat_is_not_said_to_have_one_law():
    plant = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
    )
    t = np.arange(0.0, 40.0, 0.1)
    given = recorded(plant, lambda k, x: 0.05, ([15.0], [19.0], [20.0]), t, mode=0)
    found = report(given, library=1)
    assert not found.rollouts.holds
    assert any("show 1 of the 2 modes asked for" in one for one in found.doubts)
    assert "HybridAutomatonRegressor" in str(found) and FINE not in str(found)


@pytest.mark.nightly
def test_a_chaotic_motion_is_not_called_a_wrong_law():
    lorenz = StatedModel(
        2, [[
            [0, -10, 10, 0, 0, 0, 0, 0, 0, 0],
            [0, 28, -1, 0, 0, 0, -1, 0, 0, 0],
            [0, 0, 0, -8 / 3, 0, 1, 0, 0, 0, 0],
        ]], states=["x", "y", "z"],
    )  # fmt: skip
    starts, t = ([-8.0, -8.0, 27.0], [5.0, 5.0, 20.0]), np.arange(0.0, 12.0, 0.02)
    given = recorded(lorenz, lambda k, x: 0.1, starts, t)
    whole = report(given, 1, library=2)
    assert whole.rollouts.hangs_on_start and "no proof against the laws" in str(whole)
    assert whole.rollouts.first_break.follows > 2.0  # of 12 s
    assert "refine=False" in whole.advice
    assert report(given, 1, library=2, refine=False).advice == FINE


def test_thresholds_are_of_columns_that_part_all_samples():
    columns = np.column_stack([np.arange(6.0), [0, 1, 2, 0, 1, 2], -0.1 * np.arange(6.0)])
    sides = columns[:, 0] > 2.5
    assert thresholds(columns, sides, ["x", "y", "z"]) == {"x": "x >= 2.5", "z": "z >= -0.25"}
    assert thresholds(columns, np.ones(6, dtype=bool), "xyz") == {}


def test_fewer_modes_than_asked_for_and_the_most_tried_are_said():
    assert not list(mode_doubts(2, 2, 2)) and not list(mode_doubts(2, "auto", 6))
    assert "show 2 of the 3 modes asked for" in next(mode_doubts(2, 3, 3))
    assert "raise max_modes" in next(mode_doubts(6, "auto", 6))


def test_a_fit_counts_samples_by_the_noise_that_they_are_seen_to_have():
    t, rng = np.linspace(0.0, 10.0, 251), np.random.default_rng(3)
    plant = StatedModel(
        None, [[[0, 1], [-1, -0.1]], [[0, 1], [-4, -0.1]]], states=["x", "v"],
        surface=StatedSurface([[0, 1, 0]], 1),
    )  # fmt: skip
    recordings = []
    starts = ([1, 1], [-2, 0], [1.5, -1], [0.5, 2])
    for start, noise in zip(starts, (0.01, 0.01, 0.08, 0.08), strict=True):
        x = plant.simulate(start, t).x
        recordings.append({"t": t, "x": x + noise * rng.standard_normal(x.shape)})
    estimator = SwitchingSystemRegressor(sparsity="auto", random_state=0)
    found = TrajectoryIdentifier(estimator).fit(recordings)
    clear = TrajectoryIdentifier(estimator).fit(recordings[:2])
    # two recordings of a tenth of the noise tell nearly all: with equal weights errors are as large
    # as those of the others, four times these
    order = np.argsort([-one.coef_[:, 1, 0] for one in (found.estimator_, clear.estimator_)])
    errors = [one.coef_errors_[own] for one, own in zip((found, clear), order, strict=True)]
    told = errors[1] > 0.0
    assert (errors[0][told] < 1.3 * errors[1][told]).all()
    assert "differs by recording" in str(found.report_)
