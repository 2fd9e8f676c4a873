"""Scores and choices of the benchmark of measured data."""

import numpy as np
import pytest

from benchmarks.measured import by_command, by_default, modes_by_default
from benchmarks.measured.choice import best_of, blocks, held_out_errors
from benchmarks.measured.effects import _emps, _incubator, _searched
from benchmarks.measured.rows import LEFT_OUT, FreeRun, Run
from swsysid.refinement import ParametricLibrary, StatedModel


def test_a_score_leaves_out_the_first_samples():
    run = Run(np.array([3.0, 1.0, -1.0]), np.zeros((3, 1)))
    assert run.error() == pytest.approx(np.sqrt(11.0 / 3.0))
    assert run.error(1) == pytest.approx(1.0)
    assert Run(np.zeros(2), np.zeros(3)).error() == np.inf


def test_a_row_has_the_scores_that_the_literature_may_mean():
    run = Run(np.arange(60.0), np.zeros(60))
    row = FreeRun.of_runs("data", "change", [run], [run, run], left_out=5)
    assert row.before == (run.error(5),)
    assert row.after_leaving_out == tuple((run.error(n), run.error(n)) for n in LEFT_OUT)


def test_blocks_make_up_a_record():
    parts = blocks(10, 3)
    assert [part.stop - part.start for part in parts] == [3, 3, 4]
    assert parts[0].start == 0 and parts[-1].stop == 10


def test_held_out_stretches_choose_the_law_that_made_the_record():
    """x' = -x^3 + u under a known input; the other candidate is linear."""

    def stated(terms):
        library = ParametricLibrary({**terms, "u": lambda u: u}, ["x", "u"])
        return StatedModel(library, [[-0.5, 1.0]], states=["x"], inputs=["u"])

    candidates = {
        "linear": stated({"x": lambda x: x}),
        "cubic": stated({"x^3": lambda x: x**3}),
    }
    t = np.linspace(0.0, 20.0, 201)
    u = 2.0 * np.sin(t)
    truth = candidates["cubic"]
    truth.coef_[0, 0, 0] = -1.0
    record = {"t": t, "x": truth.simulate([0.0], t, u[:, None]).x, "inputs": u[:, None]}
    errors = held_out_errors(candidates, record, blocks(len(t), 3)[1:])
    assert best_of(errors) == "cubic"
    assert errors["cubic"] < 1e-3 < 0.05 < errors["linear"]


@pytest.mark.nightly
@pytest.mark.measured
def test_what_a_heater_explains_in_one_episode_is_no_force():
    """Its rows are gross errors without the lag of the heater, far above any slow force."""
    found = _searched("incubator", *_incubator())
    assert found.found.startswith("lag of heater")
    assert found.after < 0.5 * found.before  # .47 instead of 1.41 on the test records


@pytest.mark.nightly
@pytest.mark.measured
def test_a_worn_screw_is_no_function_without_a_name():
    """One of the velocity beside one of velocity and acceleration had taken its place."""
    found = _searched("EMPS", *_emps())
    assert found.found == "asymmetric_friction of v"
    assert found.after < 0.4 * found.before  # .057 instead of .169 on the test record
    assert len(found.rungs) == 2 and found.left


@pytest.mark.nightly
@pytest.mark.measured
@pytest.mark.filterwarnings("ignore::UserWarning")  # nothing logged tells the modes
def test_a_compressor_that_nobody_logged_is_two_modes():
    """Agreement, and a time constant more than five times the other, as the README asks."""
    row = modes_by_default.identified("heat pump")
    assert row.verdict == "right" and row.found.startswith("2 modes")
    assert row.after < 0.25 * row.before  # .54 instead of 3.2 K


@pytest.mark.nightly
@pytest.mark.measured
@pytest.mark.filterwarnings("ignore::UserWarning")  # nothing logged tells the modes
def test_gears_are_lines_of_the_engine_speed():
    row = modes_by_default.identified("gears")
    assert row.verdict == "right", row.found


@pytest.mark.nightly
@pytest.mark.measured
def test_a_square_that_fails_in_reverse_is_refuted():
    """A square of the throttle fits the searched part best, where the vehicle never reverses."""
    row = by_default.searched("vehicle")
    assert row.found.startswith("coulomb_friction") and row.verdict == "right"
    assert row.after < 0.55 * row.before  # .061 instead of .135 m/s


@pytest.mark.nightly
@pytest.mark.measured
def test_the_command_line_says_what_python_says():
    row = by_command.commanded("damper")
    assert row.found.startswith("backlash of x_in") and "--quantity" in row.estimator
    assert row.after < 0.4 * row.before  # .54 instead of 1.64 kip
    row = by_command.commanded("incubator")
    assert row.found == "lag of heater_on" and row.verdict == "right"
    assert row.after < 0.2 * row.before  # .073 instead of .55 K
