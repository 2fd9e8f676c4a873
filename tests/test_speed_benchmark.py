"""The speed benchmark: both sides of a ratio give the same answer, and the figures are kept."""

import json
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def speed(monkeypatch):
    pytest.importorskip("cvxpy")
    monkeypatch.syspath_prepend(str(FOLDER))
    import speed

    yield speed
    for name in ("speed", "speed_parts"):
        sys.modules.pop(name, None)


def test_structured_and_general_solvers_agree(speed, tmp_path):
    options = ["--repeats", "1", "--output", str(tmp_path), "--parts", "assignment", "l1_fit"]
    speed.main(options)
    written = json.loads((tmp_path / "speed.json").read_text())
    assert {"cores", "numpy", "threads"} <= set(written["machine"])
    gaps = [float(one["note"].split()[-1]) for one in written["figures"] if one["note"]]
    assert len(gaps) == 2 and max(map(abs, gaps)) < 1e-7  # Clarabel stops at 1e-8


def test_growth_and_imports_are_measured(speed, tmp_path):
    options = ["--repeats", "1", "--output", str(tmp_path), "--largest", "1.2e4"]
    speed.main([*options, "--parts", "rows", "imports"])
    figures = json.loads((tmp_path / "speed.json").read_text())["figures"]
    assert [one["part"] for one in figures] == ["rows"] * 6 + ["imports"]
    assert all(min(one["seconds"]) > 0.0 for one in figures)
    assert "N to the" in figures[2]["note"]
