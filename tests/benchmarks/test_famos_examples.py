"""Recorded runs in the folders of FaMoS: read by what its files say, and scored."""

import json

import numpy as np
import pytest
from scipy.io import savemat

from benchmarks.automata.others.__main__ import main
from benchmarks.automata.others.famos import traces

SETTINGS = "Ts = 0.01; Time = false;\nallData = 1:6;\nevalData = [2,5];\n"
STEP, LOW, HIGH = 0.01, 15.0, 25.0


def _run(start, n=900):
    """A room that is heated up to 25 and cools down to 15, as an Euler loop of the tool's own."""
    level, mode, rows, modes, changes = start, 1, [start], [1], [1]
    for k in range(1, n):
        level += STEP * (0.5 * level + 0.5 if mode == 1 else -0.5 * level)
        if (level >= HIGH) if mode == 1 else (level <= LOW):
            mode = 3 - mode
            modes.append(mode)
            changes.append(k)
        rows.append(level)
    columns = {"xout": np.array(rows), "states": np.array(modes), "chpoints": [*changes, n]}
    return {name: np.reshape(told, (-1, 1)) for name, told in columns.items()}


@pytest.fixture
def folder(tmp_path):
    room = tmp_path / "Room"
    room.mkdir()
    (room / "short_main_trace.m").write_text(SETTINGS)
    for k in range(1, 7):
        savemat(room / f"training{k}.mat", _run(16.0 + 1.3 * k))
    return tmp_path


def test_runs_modes_and_what_is_kept_back_are_those_that_its_files_say(folder):
    [room] = traces(folder)
    assert (room.name, room.order, room.numbers) == ("FaMoS-DT/Room", 1, {1: 0, 2: 1})
    assert (len(room.training()), len(room.unseen())) == (4, 2)
    one = room.unseen()[0]
    np.testing.assert_allclose(one.t, STEP * np.arange(900), atol=1e-12)
    # the law of a row's mode makes the next row
    slope = np.where(one.modes == 1, 0.5 * one.x[:, 0] + 0.5, -0.5 * one.x[:, 0])
    np.testing.assert_allclose(np.diff(one.x[:, 0]), STEP * slope[:-1], atol=1e-12)


def test_the_command_finds_the_room(folder, tmp_path, capsys):
    output = tmp_path / "out"
    main(["--famos", str(folder), "--output", str(output)])
    [cell] = json.loads((output / "others.json").read_text())["clean"]["cells"]
    assert cell["mean"] <= 1e-9 and cell["largest"] <= 1e-9  # thresholds are short numbers
    assert cell["switches"] == cell["guards"] == cell["labels"] == 1.0
    assert "1 of 1 within" in capsys.readouterr().out


def test_a_folder_without_examples_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"no short_main_trace\.m"):
        traces(tmp_path)
