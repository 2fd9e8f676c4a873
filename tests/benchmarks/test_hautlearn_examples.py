"""Recorded runs in the folders of HAutLearn: read by what its files say, and scored."""

import json

import numpy as np
import pytest
from scipy.io import savemat

from benchmarks.automata.others.__main__ import main
from benchmarks.automata.others.hautlearn import examples

GENERATOR = 'xout = [out.level_out, out.mode_out, out.tout];\nsave("run", "xout");'
MAIN = "PolyDegree = 1;\nfor i = 1:8\n load(['run', int2str(i), '.mat']);\nend"
STEP, LOW, HIGH = 0.07, 0.8, 1.6


def _run(start):
    """A tank that fills to 1.6 and empties to .8, asked at samples; exact in between."""
    level, mode, rows = start, 1, []
    for k in range(200):
        if (level >= HIGH) if mode == 1 else (level <= LOW):
            mode = 3 - mode
        rows.append((level, mode, STEP * k))
        rest = 2.0 if mode == 1 else -0.1
        level = rest + (level - rest) * np.exp(-STEP)
    return np.array(rows)


@pytest.fixture
def folder(tmp_path):
    data = tmp_path / "tank" / "trainingdata"
    (tmp_path / "tank" / "nonlinear").mkdir(parents=True)
    data.mkdir()
    (tmp_path / "tank" / "gen_data.m").write_text(GENERATOR)
    (tmp_path / "tank" / "nonlinear" / "main.m").write_text(MAIN)
    for k in range(1, 13):
        savemat(data / f"run{k}.mat", {"xout": _run(0.3 + 0.037 * k)})
    unknown = tmp_path / "unknown" / "trainingdata"
    unknown.mkdir(parents=True)
    savemat(unknown / "run1.mat", {"xout": _run(0.3)})
    return tmp_path


def test_columns_runs_and_degrees_are_those_that_its_files_say(folder):
    [tank] = examples(folder)  # of the other folder nothing says what its columns are
    assert (tank.name, tank.features, tank.numbers) == ("HAutLearn/tank", "x[?] ** 1", {1: 0, 2: 1})
    assert (len(tank.training()), len(tank.unseen())) == (8, 4)
    last = tank.runs[-1]  # run12, not run9
    np.testing.assert_allclose(last.x[:, 0], _run(0.3 + 0.037 * 12)[:, 0], atol=0.0)
    np.testing.assert_allclose(np.diff(last.t), STEP, atol=1e-12)  # products are rounded
    assert last.u.shape == (200, 0) and set(last.modes) == {1, 2}


def test_where_all_runs_are_trained_with_a_third_is_kept_back(folder):
    (folder / "tank" / "nonlinear" / "main.m").write_text(MAIN.replace("1:8", "1:12"))
    [tank] = examples(folder)
    assert (len(tank.training()), len(tank.unseen())) == (8, 4)


def test_the_command_finds_what_is_asked_at_samples(folder, tmp_path, capsys):
    output = tmp_path / "out"
    main(["--hautlearn", str(folder), "--output", str(output)])
    [cell] = json.loads((output / "others.json").read_text())["clean"]["cells"]
    assert cell["mean"] <= 1e-6  # of rollouts: thresholds are short numbers, and exact
    assert cell["switches"] == 1.0 and cell["labels"] >= 0.999  # nothing follows the last sample
    assert "1 of 1 within" in capsys.readouterr().out


def test_a_folder_without_examples_is_refused(tmp_path):
    with pytest.raises(ValueError, match="no gen_data.m beside trainingdata"):
        examples(tmp_path)
