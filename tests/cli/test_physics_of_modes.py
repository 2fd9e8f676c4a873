"""What the command line says of modes that physics has a name for."""

import re
from types import SimpleNamespace

import numpy as np
import pytest

from swsysid import HybridAutomaton, SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid._cli.guard_words import higher_surface
from swsysid._cli.job import JobOptions, run_job
from swsysid._cli.measurement import Measurement
from swsysid._cli.text import render
from swsysid._tables.table import Table
from swsysid._verdict.comparison import Verdict
from swsysid.refinement import StatedModel, StatedSurface

NOISE = 0.01


def told(columns, states, inputs=(), **options):
    """The result of the job on columns t, run, states and inputs, and its text."""
    what = Measurement(tuple(states), inputs=tuple(inputs), time="t", groups="run")
    result = run_job(Table("made.csv", columns, {}), JobOptions(what, **options))
    return result, render(result)


def recorded(simulated, names, t, noise=NOISE):
    """Columns of noisy runs; each of `simulated` is (n_samples, n_columns), its inputs last."""
    generator = np.random.default_rng(0)
    n_states = sum(not name.startswith("u") for name in names)
    runs = [np.array(run) for run in simulated]
    for run in runs:
        run[:, :n_states] += noise * generator.standard_normal((len(t), n_states))
    together = np.vstack(runs)
    columns = dict(zip(names, together.T, strict=True))
    return columns | {
        "t": np.tile(t, len(runs)),
        "run": np.repeat(np.arange(len(runs)), len(t)).astype(float),
    }


@pytest.mark.nightly
@pytest.mark.parametrize("friction", [0.4, 0.15])
def test_laws_that_differ_by_a_constant_at_rest_are_dry_friction(friction):
    """x'' = -x - 0.1 x' + u -+ friction: half the difference of the laws is the friction."""
    t = np.arange(0.0, 12.0, 0.06)
    rail = StatedModel(
        1,
        [[[0, 0, 1, 0], [friction, -1, -0.1, 1]], [[0, 0, 1, 0], [-friction, -1, -0.1, 1]]],
        states=["x", "v"], inputs=["u"], surface=StatedSurface([[0, 0, 1, 0]], 1),
    )  # fmt: skip
    runs = []
    for run in range(5):
        force = 1.5 * np.sin((0.5 + 0.15 * run) * t)[:, None]
        moved = rail.simulate([2.0 - run, 1.0], t, force, input_hold="linear")
        runs.append(np.hstack([moved.x, force]))
    result, text = told(recorded(runs, ["x", "v", "u"], t), ["x", "v"], ["u"], sparsity="auto")
    line = next(line for line in text.splitlines() if "dry friction of" in line)
    assert "the two laws differ by a constant at v = 0" in line
    said = float(line.split("dry friction of ")[1].split()[0])
    assert said == pytest.approx(friction, abs=0.02)  # some standard errors
    assert result.comparison.verdict is Verdict.SWITCHES


@pytest.mark.nightly
def test_a_thermostat_is_told_that_its_guard_remembers():
    plant = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
    )
    t = np.arange(0.0, 30.0, 0.1)
    runs = [plant.simulate([T], t, mode=0).x for T in (15, 16, 17, 18.5, 20, 21)]
    result, text = told(recorded(runs, ["T"], t, noise=0.02), ["T"])
    assert "The guard remembers (hysteresis)" in text
    assert "--automaton" in text and "Do not trust the modes" not in text
    heats = result.model.coef_[:, 0, 0].argmax()  # 3 - 0.1 T beside 1 - 0.1 T
    begins = "below" if f"mode {heats} begins below" in text else "above"
    assert begins == "below"
    # the laws that stand: within 5 % of the truth
    assert sorted(result.model.coef_[:, 0, 0]) == pytest.approx([1.0, 3.0], rel=0.05)


def test_an_angle_that_turns_over_stays_in_the_law():
    """theta'' = -9 sin theta - 0.3 theta' + 4: products of the angle say nothing of it."""
    t, runs = np.arange(0.0, 6.0, 0.02), []
    for start in (5.0, 6.5, 8.0, 9.5):
        x, rows = np.array([0.0, start]), []
        for _ in t:
            rows.append(x[:1])
            for _ in range(10):
                x = x + 0.002 * np.array([x[1], -9.0 * np.sin(x[0]) - 0.3 * x[1] + 4.0])
        runs.append(np.array(rows))
    columns = recorded(runs, ["theta"], t, noise=0.003)
    assert max(columns["theta"]) > 2.0 * np.pi
    what = Measurement(("theta",), time="t", groups="run", order=2)
    options = JobOptions(what, modes=1, quick=True)
    result = run_job(Table("made.csv", columns, {}), options)
    assert result.position_gain > 0.5
    assert "The position is kept in the law" in render(result)


def test_powers_of_a_switch_say_nothing_of_their_own():
    """x' = u - x with u in {0, 1}: u^2 is u, whatever a filter makes of it."""
    t = np.arange(0.0, 8.0, 0.05)
    recordings = []
    for run in range(3):
        u = (np.floor(t / (0.6 + 0.2 * run)) % 2)[:, None]
        x = [0.2 * run]
        for k in range(len(t) - 1):
            middle = 0.5 * (u[k, 0] + u[k + 1, 0])
            x.append(middle + (x[-1] - middle) * np.exp(-0.05))
        noisy = np.array(x) + 0.005 * np.random.default_rng(run).standard_normal(len(t))
        recordings.append({"t": t, "x": noisy[:, None], "inputs": u})
    estimator = SwitchingSystemRegressor(1, feature_library=3, random_state=0)
    found = TrajectoryIdentifier(estimator).fit(recordings)
    names = list(found.estimator_.feature_names_out_)
    powers = [names.index(name) for name in ("x1^2", "x1^3", "x0 x1^2")]
    assert (found.estimator_.coef_[:, :, powers] == 0.0).all()


def test_few_terms_are_asked_for_by_an_option():
    t, runs = np.arange(0.0, 6.0, 0.05), []
    for start in (2.0, -1.0, 1.0, -2.0, 1.5):
        runs.append(start * np.exp(-0.5 * t)[:, None])
    columns = recorded(runs, ["x"], t, noise=0.002)
    found = {
        sparsity: told(columns, ["x"], modes=1, library_degree=3, sparsity=sparsity)[0].model
        for sparsity in (None, "auto")
    }
    assert np.count_nonzero(found[None].coef_) == 4
    assert np.count_nonzero(found["auto"].coef_) == 1
    assert np.abs(found["auto"].coef_).sum() == pytest.approx(0.5, abs=0.01)


def test_a_surface_of_a_higher_degree_is_asked_for_where_it_tells_the_modes():
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (2000, 2))
    columns, beyond = SimpleNamespace(X=X), np.abs(X[:, 0]) > 0.4
    assert "--surface-degree 2" in higher_surface(beyond.astype(int), columns, 1)
    by_chance = np.random.default_rng(1).uniform(size=2000) > 0.6
    remembered = np.where(np.abs(X[:, 0]) > 0.5, X[:, 0] > 0.0, by_chance)
    assert higher_surface(by_chance.astype(int), columns, 1) == ""
    assert higher_surface(remembered.astype(int), columns, 1) == ""


def test_of_several_bounds_of_a_column_the_tightest_says_all():
    """A rate that saturates at -1 and 1: three surfaces part three modes by thresholds of x."""
    x = np.linspace(-3.0, 3.0, 601)
    columns = {"x": x, "dx": np.clip(2.0 * x, -1.0, 1.0)}
    what = Measurement(states=("x",), derivatives=("dx",))
    text = render(run_job(Table("made.csv", columns, {}), JobOptions(what, modes=3)))
    regions = re.findall(r"mode \d where (x .*)", text)
    bounds = [[float(one.split()[2]) for one in region.split(" and ")] for region in regions]
    # the samples are .01 apart
    assert sorted(len(each) for each in bounds) == [1, 1, 2]
    for each in bounds:
        assert np.abs(each) == pytest.approx(0.5, abs=0.02)
