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
    for name in ("speed", "speed_parts", "speed_rows", "speed_case"):
        sys.modules.pop(name, None)


def test_structured_and_general_solvers_agree(speed, tmp_path):
    options = ["--repeats", "1", "--output", str(tmp_path), "--parts", "assignment", "l1_fit"]
    speed.main(options)
    written = json.loads((tmp_path / "speed.json").read_text())
    assert {"cores", "numpy", "threads"} <= set(written["machine"])
    gaps = [float(one["note"].split()[-1]) for one in written["figures"] if one["note"]]
    assert len(gaps) == 3 and max(map(abs, gaps)) < 1e-7  # Clarabel stops at 1e-8


def test_rows_growth_memory_and_imports_are_measured(speed, tmp_path):
    options = ["--repeats", "1", "--output", str(tmp_path), "--largest", "1.2e4"]
    parts = ["rows", "growth", "memory", "on_disk", "imports"]
    speed.main([*options, "--on-disk", "4.1e4", "--parts", *parts])
    figures = json.loads((tmp_path / "speed.json").read_text())["figures"]
    counts = [12, 4, 2, 1, 1]
    assert [one["part"] for one in figures] == [
        part for part, count in zip(parts, counts, strict=True) for _ in range(count)
    ]
    assert all(min(one["seconds"]) > 0.0 for one in figures)
    assert "N to the" in figures[13]["note"] and "MB of memory" in figures[18]["note"]
