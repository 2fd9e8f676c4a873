"""The quality benchmark runs, resumes, and writes what the documentation shows."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture
def quality(monkeypatch):
    # imported as a script imports it: the benchmark is no package
    monkeypatch.syspath_prepend(str(FOLDER))
    import quality

    yield quality
    for name in [name for name in sys.modules if name.split("_")[0] == "quality"]:
        del sys.modules[name]


ARGUMENTS = "--fast --cases pwarx_band --seeds 1 --methods oracle ours single".split()


def test_tables_and_pictures_are_written(quality, tmp_path, capsys):
    docs = tmp_path / "docs"
    docs.mkdir()
    quality.main([*ARGUMENTS, "--output", str(tmp_path), "--docs", str(docs)])
    text = (tmp_path / "quality.md").read_text(encoding="utf-8")
    assert text in capsys.readouterr().out
    for title in ("## Summary", "## Figures to reach", "## clean", "## 5 % Gaussian noise"):
        assert title in text
    assert "Balanced accuracy within 0.005 of the oracle" in text
    assert "| pwarx_band | " in text
    for name in ("quality_summary.md", "quality_tables.md", "_static/quality.png"):
        assert (docs / name).stat().st_size > 1000, name


def test_a_cell_that_is_there_is_not_run_again(quality, tmp_path):
    output = ["--output", str(tmp_path)]
    quality.main([*ARGUMENTS, *output])
    file = tmp_path / "quality.jsonl"
    lines = file.read_text(encoding="utf-8").splitlines()
    assert len(lines) == 3 * 3  # corruptions times methods
    changed = json.loads(lines[0]) | {"balanced": 0.123}
    file.write_text("\n".join([json.dumps(changed), *lines[1:]]) + "\n", encoding="utf-8")
    quality.main([*ARGUMENTS, *output])
    assert json.loads(file.read_text(encoding="utf-8").splitlines()[0]) == changed


def test_an_unknown_method_is_refused(quality, tmp_path):
    with pytest.raises(SystemExit, match="does not know"):
        quality.main(["--methods", "kplane", "--output", str(tmp_path)])


# 2000 samples: an estimated standard deviation is off by 1.6 %, a share of 5 % by 0.5 %
@pytest.mark.parametrize(
    ("name", "levels"),
    [
        ("noise 5 %", [0.05, 0.05]),
        ("noise 15 %", [0.15, 0.15]),
        ("degrees too high", [0.05, 0.05]),
        ("uneven noise", [0.1, 0.01]),
    ],
)
def test_noise_has_the_size_its_name_says(quality, name, levels):
    errors, _ = _spoilt(quality, name)
    np.testing.assert_allclose(errors.std(axis=0), levels, rtol=0.08)


def test_outliers_are_as_many_and_as_large_as_their_names_say(quality):
    errors, hit = _spoilt(quality, "outliers 5 %")
    assert abs(hit.mean() - 0.05) < 0.02
    np.testing.assert_allclose(errors[hit].std(), 5, rtol=0.2)
    errors, hit = _spoilt(quality, "one-sided 20 %")
    assert abs(hit.mean() - 0.2) < 0.04
    np.testing.assert_allclose(errors[hit].mean(), 50, rtol=0.02)


def test_small_samples_and_high_degrees(quality):
    case = quality.CASES["sectors"]
    scenarios = {scenario.name: scenario for scenario in quality.STRESS}
    assert len(quality.make_data(case, scenarios["N = 400"], 0).X) == 400
    told = quality.make_data(case, scenarios["degrees too high"], 0).case
    assert (told.library, told.surface) == (case.library + 1, case.surface + 2)


def _spoilt(quality, name):
    """Errors of velocities in units of each column's spread, and the rows that have any."""
    scenarios = {scenario.name: scenario for scenario in quality.MAIN + quality.STRESS}
    exact = quality.make_data(quality.CASES["sectors"], scenarios["clean"], 0).Xdot
    errors = quality.make_data(quality.CASES["sectors"], scenarios[name], 0).Xdot - exact
    return errors / exact.std(axis=0), np.any(errors != 0, axis=1)


def test_every_mode_is_visited(quality):
    rng = np.random.default_rng(0)
    for case in quality.CASES.values():
        system = case.make(rng)
        modes = system.modes(system.states(rng, 2000))
        shares = np.bincount(modes, minlength=case.n_modes) / len(modes)
        # SPS, whose trajectories soon settle, has the smallest mode
        assert shares.min() > 0.03, case.name


def test_fields_of_the_published_systems(quality):
    rng = np.random.default_rng(0)

    def velocities(case, states):
        return quality.CASES[case].make(rng).velocities(np.array(states, dtype=float))

    np.testing.assert_allclose(
        velocities("hopper", [[0.8, -0.1], [1.2, 0.3]]), [[-0.1, 3.0], [0.3, -1.0]]
    )
    # (1.5, 0.5) is outside the circle of radius 0.161 round (1, 1), (1.1, 0.9) within
    np.testing.assert_allclose(
        velocities("lv_sphere", [[1.5, 0.5], [1.1, 0.9]]), [[2.25, 0.25], [0.22, 0.045]]
    )
    np.testing.assert_allclose(velocities("track", [[0, 1], [0, -1]]), [[0.1, 0], [-0.35, 0]])
    # 0.6 y + 0.3 u, with the other sign while |u| < 0.8 + 0.2 y
    np.testing.assert_allclose(velocities("pwarx_arx", [[0.5, 1.0], [0.5, 0.5]]), [[0.6], [-0.45]])
