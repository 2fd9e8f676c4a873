"""``--automaton``: a file becomes an automaton that is printed, judged, drawn and saved."""

import json
import re

import numpy as np
import pandas as pd
import pytest

from swsysid import HybridAutomaton
from swsysid.__main__ import main

THERMOSTAT = HybridAutomaton.stated(
    [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
    states=["T"],
)


@pytest.fixture
def file(tmp_path):
    t, rng, runs = np.arange(0.0, 40.0, 0.1), np.random.default_rng(0), []
    for k in range(3):
        states = THERMOSTAT.simulate([14.0 + k], t, mode=0).x[:, 0]
        noisy = states + 0.02 * rng.standard_normal(len(t))
        runs.append(pd.DataFrame({"run": k, "t": t, "T": noisy}))
    path = tmp_path / "thermostat.csv"
    pd.concat(runs).to_csv(path, index=False)
    return str(path)


@pytest.mark.nightly
def test_a_thermostat_is_found_judged_and_saved(file, tmp_path, capsys):
    roles = ["--states", "T", "--time", "t", "--groups", "run"]
    assert main([file, *roles, "--automaton", "--output", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    up, down = re.search(r"T >= (\S+)", text), re.search(r"T <= (\S+)", text)
    assert float(up[1]) == pytest.approx(22.0, abs=0.01)
    assert float(down[1]) == pytest.approx(18.0, abs=0.01)
    score = re.search(r"R2 of (\S+) on 360 samples, the last stretch of each trajectory", text)
    assert float(score[1]) > 0.999
    assert "\nSwitching predicts the held-out samples clearly better than one mode" in text
    saved = HybridAutomaton.from_dict(json.loads((tmp_path / "automaton.json").read_text()))
    assert len(saved.transitions) == 2
    assert (tmp_path / "identification.txt").read_text().strip() in text
    assert (tmp_path / "automaton.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("wishes", "said"),
    [
        (["--quick"], "goes without --diagnose and --quick"),
        (["--diagnose"], "goes without --diagnose and --quick"),
        (["--derivatives", "run"], "takes recorded states alone"),
        (["--known", "T'[u] = 1"], "the terms are 1, T"),
    ],
)
def test_what_an_automaton_cannot_be_found_with_is_said(file, wishes, said, capsys):
    assert main([file, "--states", "T", "--time", "t", "--automaton", *wishes]) == 2
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("wish", ["--automaton", "--diagnose"])
def test_the_heights_of_a_ball_tell_its_impact(wish, tmp_path, capsys, monkeypatch):
    """Two parabolas a bounce, .8 of the speed: one command each, also without --automaton."""
    monkeypatch.chdir(tmp_path)
    rate, bounce, rows, up, level, begin = 30.0, 0.8, [], 0.0, 1.4, 0.0
    while begin < 3.6:
        arrives = np.sqrt(up**2 + 2.0 * 9.81 * level)
        end = begin + (up + arrives) / 9.81
        t = np.arange(np.ceil(begin * rate), np.ceil(end * rate)) / rate
        since = t - begin
        rows.append(np.column_stack([t, level + up * since - 4.905 * since**2]))
        begin, up, level = end, bounce * arrives, 0.0
    table = np.vstack(rows)
    table[:, 1] += 0.003 * np.random.default_rng(0).standard_normal(len(table))
    np.savetxt("ball.csv", table, delimiter=",", header="t_s,y_m", comments="", fmt="%.4f")
    roles = ["--states", "y_m", "--time", "t_s", "--order", "2"]
    assert main(["ball.csv", *roles, wish, "--output", "out"]) == 0
    text = capsys.readouterr().out
    assert "1 mode" in text
    told = re.search(r"y_m <= (\S+) \(\S+\): y_m' := -(\S+) \(\S+\) y_m'", text)
    assert float(told[1]) == pytest.approx(0.0, abs=0.01)
    assert float(told[2]) == pytest.approx(bounce, abs=0.01)
    assert ("States jump." in text) == (wish == "--diagnose")
