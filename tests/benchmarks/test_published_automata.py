"""Automata read from the files of others, and the figures that a method gets on them."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.automata.others.__main__ import main
from benchmarks.automata.others.dainarx import N_UNSEEN, published
from benchmarks.automata.others.scoring import score
from benchmarks.automata.others.tables import RIGHT

SAW = {  # rises by .1 a sample to 1, and begins at 0 again
    "automaton": {
        "var": "x",
        "input": "u",
        "mode": [{"id": 3, "eq": "x[1] = 10 + 0 * u"}],
        "edge": [{"direction": "3 -> 3", "condition": "x >= 0.999", "reset": {"x": [0]}}],
    },
    "init_state": [{"mode": 3, "x": [0.1 * k], "u": "2 * t"} for k in range(9)],
    "config": {"dt": 0.01, "total_time": 0.4},
}
FALL = {  # twice x'' = -1, from rest at 2 and 1; mode 2 below 0, where x'' is 1
    "automaton": {
        "var": "x, y",
        "mode": [
            {"id": 1, "eq": "x[2] = -1, y[2] = -1"},
            {"id": 2, "eq": "x[2] = 1, y[2] = 1 ** 2"},
        ],
        "edge": [{"direction": "1 -> 2", "condition": "y < 0 and abs(x) < 9",
                  "reset": {"y": ["", "-0.5 * y[1]"]}}],
    },
    "init_state": [{"mode": 1, "x": [2], "y": [1]} for _ in range(9)],
    "config": {"dt": 0.01, "total_time": 2.0, "order": 2},
}  # fmt: skip


def _read(tmp_path, told, name="one"):
    folder = tmp_path / "set"
    folder.mkdir(exist_ok=True)
    (folder / f"{name}.json").write_text(json.dumps(told))
    return published(tmp_path)[0]


def test_a_sample_is_what_stood_before_a_reset(tmp_path):
    automaton = _read(tmp_path, SAW)
    done = automaton.recorded(SAW["init_state"][0])
    saw = 0.1 * (1 + np.arange(len(done.t)) % 10)
    np.testing.assert_allclose(done.x[:, 0], saw, atol=1e-12)  # sums of rounded tenths
    np.testing.assert_allclose(done.u[:, 0], 2.0 * done.t, atol=1e-12)
    assert automaton.name == "set/one"
    assert (len(automaton.training()), len(automaton.unseen())) == (9 - N_UNSEEN, N_UNSEEN)


def test_derivatives_are_states_and_modes_are_of_the_next_sample(tmp_path):
    done = _read(tmp_path, FALL).recorded(FALL["init_state"][0])
    before = done.modes == 1
    np.testing.assert_allclose(done.x[before, 1], 1.0 - 0.5 * done.t[before] ** 2, atol=1e-12)
    first = np.flatnonzero(~before)[0]
    assert done.x[first, 1] < 0.0 <= done.x[first - 1, 1]
    speed = (done.x[first + 1, 1] - done.x[first, 1]) / 0.01 - 0.005
    assert speed == pytest.approx(0.5 * done.t[first], abs=1e-9)  # by rounding over 0.01


def test_what_is_more_than_arithmetic_is_refused(tmp_path):
    told = json.loads(json.dumps(SAW))
    told["automaton"]["edge"][0]["condition"] = "__import__('os').getcwd()"
    with pytest.raises(ValueError, match="more than arithmetic"):
        _read(tmp_path, told)


def _truth(automaton, late=0, beyond=0.0):
    """A method that knows all, rolls out so many samples late, and has guards so far beyond."""

    def method(training, _):
        modes = np.concatenate([one.modes for one in training]) - 1

        def rollout(seen, mode):
            wait = np.maximum(np.arange(len(seen.t)) - late, 0)
            return seen.x[wait], seen.modes[wait] - 1

        def passed(seen, source, target):
            y = np.concatenate([one.x[:, 1] for one in seen])
            return (
                -y / np.ptp(y) - beyond if (source, target) == (0, 1) else np.full(len(y), np.nan)
            )

        return SimpleNamespace(
            n_modes=2, modes=modes, n_first=1, doubts=False, rollout=rollout, passed=passed
        )

    return score(method, automaton, noise=0.1)


def test_the_truth_has_no_deviation_and_a_late_one_misses_switches(tmp_path):
    automaton = _read(tmp_path, FALL)
    right, late = _truth(automaton), _truth(automaton, late=3)
    assert (right["mean"], right["labels"], right["switches"], right["modes"]) == (0, 1, 1, 0)
    assert late["switches"] == 0.0
    assert 0.0 < late["mean"] < late["largest"]


def test_guards_are_right_up_to_a_hundredth_of_the_ranges(tmp_path):
    automaton = _read(tmp_path, FALL)
    # y falls by about a hundredth of its range in a sample, so that the last before is as near
    shares = [_truth(automaton, beyond=beyond)["guards"] for beyond in (0.0, 0.03, -0.03)]
    assert shares == [1.0, 0.0, 0.0]


def test_a_refusal_in_words_is_a_result(tmp_path):
    def method(training, _):
        raise ValueError("no.")

    assert score(method, _read(tmp_path, FALL))["refused"] == "no."


def test_the_command_finds_a_thermostat(tmp_path, capsys):
    told = {
        "automaton": {
            "var": "T",
            "mode": [{"id": 1, "eq": "T[1] = 3 - 0.1 * T[0]"}, {"id": 2, "eq": "T[1] = -0.1*T[0]"}],
            "edge": [{"direction": "1 -> 2", "condition": "T >= 22"},
                     {"direction": "2 -> 1", "condition": "T <= 18"}],
        },
        "init_state": [{"mode": 1, "T": [14 + 0.5 * k]} for k in range(9)],
        "config": {"dt": 0.1, "total_time": 20, "order": 1},
    }  # fmt: skip
    _read(tmp_path, told)
    output = tmp_path / "out"
    main([str(tmp_path), "--output", str(output)])
    [cell] = json.loads((output / "others.json").read_text())["clean"]["cells"]
    assert cell["mean"] <= RIGHT  # a guard lies between two samples: a switch comes one late
    assert cell["switches"] == cell["labels"] == cell["guards"] == 1.0
    assert "1 of 1 within" in capsys.readouterr().out


def test_modes_of_one_law_are_one_and_those_never_seen_none(tmp_path):
    told = json.loads(json.dumps(FALL))
    told["automaton"]["mode"] += [
        {"id": 3, "eq": "x[2] = -1,  y[2]=-1"},
        {"id": 4, "eq": "x[2] = 7, y[2] = 7"},
    ]
    automaton = _read(tmp_path, told)
    assert automaton.numbers == {1: 0, 2: 1, 3: 0, 4: 2}
    assert _truth(automaton)["modes"] == 0.0  # the truth of two modes, of which both are seen
