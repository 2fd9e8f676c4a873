"""The speed benchmark: both sides of a ratio give the same answer, and the figures are kept."""

import json
from time import process_time

import numpy as np
import pytest

from benchmarks.speed.__main__ import main
from benchmarks.speed.direct import l1_by_dual, nearest_modes, without_modelling
from benchmarks.speed.problems import assignments
from benchmarks.speed.tables import table
from swsysid._losses import get_loss


def test_structured_and_general_solvers_agree(tmp_path):
    options = ["--repeats", "1", "--output", str(tmp_path), "--parts", "assignment", "l1_fit"]
    main(options)
    written = json.loads((tmp_path / "speed.json").read_text())
    for part in written.values():
        assert {"commit", "cores", "numpy", "threads"} <= set(part["origin"])
    figures = [figure for part in written.values() for figure in part["figures"]]
    gaps = [float(one["note"].split()[-1]) for one in figures if one["note"]]
    assert len(gaps) == 3 and max(map(abs, gaps)) < 1e-7  # Clarabel stops at 1e-8


def test_ratios_are_those_of_the_turns(tmp_path):
    main(["--repeats", "3", "--output", str(tmp_path), "--parts", "l1_fit"])
    figures = json.loads((tmp_path / "speed.json").read_text())["l1_fit"]["figures"]
    for figure in figures:
        ratios = np.array([other / ours for ours, other in figure["turns"]])
        assert figure["ratio"] == pytest.approx(np.median(ratios), rel=1e-12)
        assert figure["spread"] == [ratios.min(), ratios.max()]


def test_the_dual_gives_the_same_fit():
    rng = np.random.default_rng(0)
    design, coef = rng.normal(size=(200, 3)), np.array([[1.0, -2.0, 0.5], [0.0, 3.0, 1.0]])
    targets = design @ coef.T + rng.laplace(size=(200, 2))
    found = l1_by_dual(design, targets)
    # a unique optimum of least absolute deviations leaves one residual a coefficient at zero
    residuals = np.abs(targets - design @ found.T)
    assert (residuals < 1e-8).sum(axis=0).tolist() == [3, 3]
    np.testing.assert_allclose(found, get_loss("l1").fit(design, targets).coef, atol=1e-7)


def test_nearest_modes_are_those_of_the_exact_assignment():
    for problem in assignments():
        if "exact" in problem.name:
            np.testing.assert_array_equal(nearest_modes(*problem.data), problem.ours())


def test_modelling_is_not_counted():
    import cvxpy

    x = cvxpy.Variable(200)
    problem = cvxpy.Problem(cvxpy.Minimize(cvxpy.norm1(x - np.arange(200.0))))
    started = process_time()
    seconds = without_modelling(lambda: problem.solve(solver="CLARABEL"))()
    whole = process_time() - started
    # a problem of some kilobytes takes cvxpy longer to state than Clarabel to solve
    assert 0.0 < seconds < 0.9 * whole


def test_direct_equals_stand_beside_what_they_equal():
    def part(*names):
        figure = {"ratio": 1700.0, "spread": [0.5, 2000.0], "sides": [24.8e-6, 0.0418], "unit": "s"}
        asked = {"better": "larger", "goal": {"at_least": 500}, "note": ""}
        figures = [{"name": name, **figure, **asked} for name in names]
        return {"origin": {"commit": "abc", "day": "2026-11-22"}, "figures": figures}

    general = part("fit, N = 1: cvxpy", "fit, N = 2: cvxpy")
    direct = part("fit, N = 1: by hand", "fit, N = 3: by hand")
    lines = table({"general": general, "direct": direct}).splitlines()[2:6]
    assert [line.split(" | ")[0] for line in lines] == [
        "| fit, N = 1: cvxpy",
        "| ... by hand",
        "| fit, N = 2: cvxpy",
        "| fit, N = 3: by hand",
    ]
    assert "| 1700 (0.5 to 2000) | 24.8 µs / 41.8 ms | at least 500, reached |" in lines[0]


@pytest.mark.nightly
def test_rows_growth_memory_and_imports_are_measured(tmp_path):
    options = ["--repeats", "1", "--output", str(tmp_path), "--largest", "1.2e4"]
    parts = ["rows", "growth", "memory", "on_disk", "imports"]
    main([*options, "--on-disk", "4.1e4", "--parts", *parts])
    written = json.loads((tmp_path / "speed.json").read_text())
    counts = {name: len(part["figures"]) for name, part in written.items()}
    assert counts == {"rows": 12, "growth": 4, "memory": 2, "on_disk": 1, "imports": 1}
    figures = [figure for part in written.values() for figure in part["figures"]]
    assert all(min(one["sides"]) > 0.0 for one in figures)
    assert "N to the" in written["growth"]["figures"][1]["note"]
    assert "MB of memory" in written["on_disk"]["figures"][0]["note"]
