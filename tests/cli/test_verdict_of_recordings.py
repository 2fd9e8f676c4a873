"""What the command line says of switching where noisy recordings are all that it has."""

from types import SimpleNamespace

import numpy as np
import pytest

from swsysid._cli.from_recordings import _Identification
from swsysid._cli.job import JobOptions, run_job
from swsysid._cli.measurement import Measurement
from swsysid._cli.text import render
from swsysid._data.recordings import Record
from swsysid._tables.table import Table
from swsysid._verdict.comparison import Verdict, certainty
from swsysid._verdict.held_out import Stretches
from swsysid._verdict.settings import JUDGING
from swsysid._verdict.words import distrust
from swsysid.refinement import StatedModel, StatedSurface

T = np.arange(0.0, 7.5, 0.05)
NOISE = 0.01
FREE = [[0.0, 0.0, 1.0], [0.0, -1.0, -0.1]]  # of 1, x, v
BUMPER = [[0.0, 0.0, 1.0], [10.0, -21.0, -0.6]]  # from x = 0.5 on
CONTACT = StatedModel(
    1, [FREE, BUMPER], states=["x", "v"], surface=StatedSurface([[-0.5, 1.0, 0.0]])
)
DAMPED = StatedModel(1, [[[0.0, 0.0, 1.0], [0.0, -2.0, -0.2]]], states=["x", "v"])
SPRING = np.array([0, 0, 1, 0, 0, 0, 0, 0, 0, 0.0]), np.array([0, -1, -0.1, 0, 0, 0, -0.3, 0, 0, 0])
DUFFING = StatedModel(3, [SPRING], states=["x", "v"])  # x'' = -x - 0.1 x' - 0.3 x^3
STARTS = np.random.default_rng(1).uniform([-1.5, -1.5], [0.4, 1.5], (8, 2))


def recorded(plant, inputs=None, n_runs=8):
    """Noisy runs of a plant, and the columns that a user would name."""
    generator, columns = np.random.default_rng(0), []
    for run, start in enumerate(STARTS[:n_runs]):
        force = None if inputs is None else inputs(run)[:, None]
        moved = plant.simulate(start, T, force, input_hold="linear").x
        driven = [] if force is None else [force]
        noisy = moved + NOISE * generator.standard_normal(moved.shape)
        columns.append(np.column_stack([np.full(len(T), run), T, noisy, *driven]))
    names = ["run", "t", "x", "v", *(["force"] if inputs is not None else [])]
    table = Table("made.csv", dict(zip(names, np.vstack(columns).T, strict=True)), {})
    return table, Measurement(("x", "v"), inputs=tuple(names[4:]), time="t", groups="run")


def judged(plant, *data, modes=2, **more):
    table, what = recorded(plant, *data, **more)
    return run_job(table, JobOptions(measurement=what, modes=modes))


def left(result, errors):
    """Root mean square of held-out errors, in units of the true noise."""
    return np.sqrt(np.mean(np.square(errors))) / NOISE


@pytest.mark.nightly
def test_a_bumper_switches():
    result = judged(CONTACT)
    comparison = result.comparison
    assert result.found is not None and comparison.verdict is Verdict.SWITCHES
    # nothing but noise is left by laws that never saw these samples; 5 % is its own uncertainty
    assert left(result, comparison.errors) == pytest.approx(1.0, abs=0.05)
    assert left(result, comparison.best.errors) > 2.0
    assert comparison.noise == pytest.approx(NOISE, rel=0.15)
    text = render(result)
    assert "Switching predicts the held-out samples clearly better than one mode" in text
    assert "held-out error: RMSE of rollouts over stretches of 30 samples" in text


@pytest.mark.nightly
def test_the_last_stretch_is_held_out_of_few_recordings():
    result = judged(CONTACT, n_runs=4)
    assert not result.split.whole_groups
    assert result.comparison.verdict is Verdict.SWITCHES
    assert left(result, result.comparison.errors) == pytest.approx(1.0, abs=0.1)


@pytest.mark.nightly
def test_two_straight_springs_of_a_cubic_one_are_no_modes():
    result = judged(DUFFING)
    assert result.comparison.verdict is Verdict.SMOOTH
    assert result.comparison.best.terms.degree == 3
    assert left(result, result.comparison.best.errors) == pytest.approx(1.0, abs=0.05)
    assert "Do not trust the modes" in render(result)


@pytest.mark.nightly
def test_auto_gives_modes_up_for_a_cubic_law_and_delivers_it(monkeypatch):
    regressor = JobOptions.regressor
    monkeypatch.setattr(
        JobOptions, "regressor", lambda *a, **more: regressor(*a, **{"max_modes": 2, **more})
    )
    result = judged(DUFFING, modes="auto", n_runs=5)
    assert result.given_up == 2 and result.found is not None and result.model.n_modes_ == 1
    names = [str(name) for name in result.model.feature_names_out_]
    law = dict(zip(names, result.model.coef_[0, 1], strict=True))
    assert [law[name] for name in ("x", "v", "x^3")] == pytest.approx([-1, -0.1, -0.3], abs=0.01)
    text = render(result)
    assert f"No switching: {result.given_up} modes were found" in text
    assert "have seen these samples too" in text


@pytest.mark.nightly
def test_auto_tries_one_mode_more_before_a_law_that_leaves_more_than_noise(monkeypatch):
    """Diodes clip v' = source - v at 0.5 both ways; a cubic law beats the two modes found first."""
    identified = _Identification.identified

    def two_first(self, terms, n_modes, whole, **options):
        return identified(self, terms, 2 if n_modes == "auto" else n_modes, whole, **options)

    monkeypatch.setattr(_Identification, "identified", two_first)
    edges = StatedSurface(
        [[-0.5, 1.0, 0.0], [0.5, 1.0, 0.0]], mode_book=[[-1, 1], [1, 1], [-1, -1]]
    )
    laws = [[[0.0, -1.0, 1.0]], [[10.0, -21.0, 1.0]], [[-10.0, -21.0, 1.0]]]
    plant = StatedModel(1, laws, states=["v"], inputs=["source"], surface=edges)
    generator, t, columns = np.random.default_rng(0), T[:120], []
    for run in range(3):
        source = 2.0 * np.sin((0.9 + 0.4 * run) * t + run)
        v = plant.simulate([0.0], t, source[:, None], input_hold="linear").x[:, 0]
        noisy = v + 0.005 * generator.standard_normal(len(t))
        columns.append(np.column_stack([np.full(len(t), run), t, noisy, source]))
    names = ["run", "t", "v", "source"]
    table = Table("made.csv", dict(zip(names, np.vstack(columns).T, strict=True)), {})
    what = Measurement(("v",), inputs=("source",), time="t", groups="run")
    result = run_job(table, JobOptions(measurement=what, modes="auto"))
    assert (result.given_up, result.model.n_modes_) == (None, 3)
    assert result.comparison.verdict is Verdict.SWITCHES and result.comparison.lacks_something


def test_one_mode_is_enough_for_a_linear_oscillator():
    result = judged(DAMPED)
    assert result.comparison.verdict is Verdict.ONE_MODE
    assert result.model.n_modes_ == 1
    assert "The trajectories show 1 of the 2 modes asked for." in render(result)


def push(run):
    return 0.9 * np.sin((0.7 + 0.1 * run) * T + run) + 0.5 * np.sin(2.3 * T + 2 * run)


@pytest.mark.nightly
def test_dry_friction_switches():
    sides = [[0.15, -1.0, -0.05, 1.0], [-0.15, -1.0, -0.05, 1.0]]  # v < 0, v > 0
    laws = [[[0.0, 0.0, 1.0, 0.0], side] for side in sides]
    surface = StatedSurface([[0.0, 0.0, 1.0, 0.0]])
    plant = StatedModel(1, laws, states=["x", "v"], inputs=["force"], surface=surface)
    result = judged(plant, push)
    assert result.comparison.verdict is Verdict.SWITCHES
    assert left(result, result.comparison.errors) == pytest.approx(1.0, abs=0.1)
    gaps = np.diff(result.model.coef_[:, 1, 0])
    assert np.abs(gaps) == pytest.approx(0.3, abs=0.02)  # from one side to the other


# -- rollouts over stretches -----------------------------------------------------------------------


def test_the_best_start_of_a_stretch_is_that_of_least_squares():
    """x' = 0: the best start is the mean of a stretch, and what it leaves the deviations."""
    values = np.random.default_rng(0).standard_normal(60)
    record = Record(np.arange(60.0), values[:, None], np.zeros((60, 0)))
    still = StatedModel(None, [[0.0]], states=["x"]).switching_model
    stretches = Stretches.of([record], [np.zeros((60, 1)) + np.linspace(0, 1, 60)[:, None]], 30)
    found = stretches.left_by(still, np.ones(1))[:, 0]
    parts = values.reshape(-1, JUDGING.stretch)
    expected = parts.mean(axis=1, keepdims=True) - parts
    np.testing.assert_allclose(found, expected.ravel(), atol=1e-6)
    assert stretches.blocks.tolist() == [0] * 30 + [1] * 30


def test_rollouts_of_the_truth_leave_its_noise_and_miss_no_switch():
    run = CONTACT.simulate(STARTS[0], T).x
    record = Record(T, np.where(np.arange(len(T))[:, None] % 7 == 3, np.nan, run), run[:, :0])
    stretches = Stretches.of([record], [run + 0.05], 30)
    found = stretches.left_by(CONTACT.switching_model, np.full(2, NOISE))
    assert np.isnan(found).any(axis=1).sum() == sum(np.arange(len(T)) % 7 == 3)
    # a switch that is found a step late would leave 0.05 * 0.1 of v
    assert np.nanmax(np.abs(found)) < 2e-4


def test_certainty_counts_given_blocks():
    errors = np.repeat(np.linspace(0.5, 1.5, 10), 20)[:, None]
    rich = errors * np.repeat([0.5, 0.6] * 5, 20)[:, None]
    in_ten = certainty(errors, rich, np.ones(1), np.arange(200) // 20)
    assert in_ten == pytest.approx(certainty(errors, rich, np.ones(1)), rel=1e-9)
    assert certainty(errors, rich, np.ones(1), np.zeros(200, dtype=int)) == 0.0


def broken_after(follows):
    return SimpleNamespace(first_break=SimpleNamespace(follows=follows))


def test_a_model_is_trusted_from_a_known_state_for_as_long_as_rollouts_hold():
    holds = SimpleNamespace(first_break=None)
    assert distrust([holds, None], "s") == ""
    assert " 0.52 s after a known state" in distrust([broken_after(2.0), broken_after(0.52)], "s")
    assert " 0.52 units of time after" in distrust([broken_after(0.52)], "")
    assert "leaves the noise from the start" in distrust([holds, broken_after(0.0)], "s")
