"""Several files, folders and files of loggers in one command: the same answer as from one table."""

import re
import zipfile

import numpy as np
import pytest
from documentation import script
from scipy.optimize import brentq

from swsysid import HybridAutomaton, load_model
from swsysid.__main__ import main

T = np.arange(0.0, 24.0, 0.1)
WORDS = (
    [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
    [(0, 1, "T >= 22"), (1, 0, "T <= 20")],
)


def thermostat(start, t=T):
    """Heats towards 30 below 20 and cools towards 10 above 22, exact."""
    return HybridAutomaton.stated(*WORDS, states=["T"]).simulate([start], t, mode=0).x[:, 0]


RUNS = [thermostat(start) for start in (17.0, 18.5, 20.0)]


AUTOMATON = ["--automaton", "--modes", "2"]


def text(path, **columns):
    rows = np.column_stack(list(columns.values()))
    path.parent.mkdir(exist_ok=True)
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="", fmt="%.17g")


def answer(given, capsys, tmp_path, code=0):
    done = main([*map(str, given), "--output", str(tmp_path / "out")])
    told = capsys.readouterr()
    assert done == code, told.err
    return told.out if code == 0 else told.err


def is_the_thermostat(folder):
    """Laws and thresholds, whatever the order of the modes; noise there is none."""
    found = load_model(folder / "out" / "model.json")
    constants = sorted((-row[0, 0] / row[0, 1], row[0, 1]) for row in found.coef_)
    np.testing.assert_allclose(constants, [(10.0, -0.1), (30.0, -0.1)], rtol=1e-3)
    guards = sorted(brentq(lambda x, one=one: one.guard.at(np.array([x])), 0.0, 40.0)
                    for one in found.transitions_)  # fmt: skip
    np.testing.assert_allclose(guards, [20.0, 22.0], atol=0.01)


def is_a_unit_that_runs(folder):
    """Exported by a command, compiled and run by FMPy: the states of `simulate`."""
    fmpy = pytest.importorskip("fmpy")
    model, unit = folder / "out" / "model.json", folder / "found.fmu"
    assert main(["export", str(model), "--to", "fmu", "--output", str(unit)]) == 0
    from fmpy.build import build_platform_binary

    fmpy.extract(unit, folder / "unit")
    (folder / "build").mkdir()
    build_platform_binary(folder / "unit", folder / "build")
    found = load_model(model)
    mode = int(np.argmax(found.coef_[:, 0, 0]))  # the one that heats
    done = fmpy.simulate_fmu(str(folder / "unit"), stop_time=10.0, output_interval=0.1,
                             start_values={"T": 17.0, "mode_start": mode}, output=["T"],
                             relative_tolerance=1e-11, record_events=False)  # fmt: skip
    wanted = found.simulate([17.0], done["time"], mode=mode)
    assert len(wanted.events) >= 2
    np.testing.assert_allclose(done["T"], wanted.x[:, 0], atol=2e-5)  # simulate's rtol is 1e-6


def test_a_folder_of_texts_is_an_automaton_and_a_unit(tmp_path, capsys):
    for number, x in zip((1, 2, 10), RUNS, strict=True):
        text(tmp_path / "runs" / f"run{number}.csv", t=T, T=x)
    told = answer([tmp_path / "runs", "--states", "T", *AUTOMATON], capsys, tmp_path)
    lines = told.splitlines()
    place = lines.index("run channel  unit     rows     rate file")
    assert lines[place + 1].split() == "0-2 T 240 10 run1.csv to run10.csv: T".split()
    assert "run10.csv" not in "".join(lines[place + 2 :])
    is_the_thermostat(tmp_path)
    is_a_unit_that_runs(tmp_path)


def test_files_patterns_and_one_table_are_the_same(tmp_path, capsys):
    for number, x in enumerate(RUNS):
        text(tmp_path / "runs" / f"{number}.csv", t=T, T=x)
    every = np.tile(T, len(RUNS)), np.concatenate(RUNS), np.repeat(range(3), len(T))
    text(tmp_path / "all.csv", **dict(zip(("t", "T", "run"), every, strict=True)))
    named = sorted((tmp_path / "runs").iterdir())
    laws = []
    for given in ([*named], [tmp_path / "runs" / "*.csv"], [tmp_path / "all.csv"]):
        more = ["--groups", "run"] if given == [tmp_path / "all.csv"] else []
        told = answer([*given, "--states", "T", "--quick", *more], capsys, tmp_path)
        laws.append(re.findall(r"T' = .*", told))
    assert laws[0] == laws[1] == laws[2] and laws[0]


def test_trajectories_within_runs(tmp_path, capsys):
    for number in range(2):
        both = np.concatenate(RUNS[number : number + 2])
        text(tmp_path / f"{number}.csv", t=np.tile(T, 2), T=both, day=np.repeat([3, 4], len(T)))
    given = [tmp_path / "0.csv", tmp_path / "1.csv", "--states", "T", "--quick"]
    told = answer([*given, "--groups", "day"], capsys, tmp_path)
    assert "of 4 trajectories" in told


def test_rows_are_those_of_their_file(tmp_path, capsys):
    for number, x in enumerate(RUNS):
        x = x.copy()
        x[6] = np.nan if number == 1 else x[6]
        text(tmp_path / f"{number}.csv", t=T, T=x)
    told = answer([tmp_path / "?.csv", "--states", "T", "--quick"], capsys, tmp_path)
    assert "row 8 of 1.csv" in told  # the names are the first row


def test_channels_of_one_run_by_dates(tmp_path, capsys):
    """The second file begins a second later, and its dates say so."""
    moments = np.datetime64("2024-05-01T10:00:00") + (T * 1000).astype(int).astype("m8[ms]")
    x = np.sin(T)
    rows = [f"{moment},{value!r}" for moment, value in zip(moments, x.tolist(), strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["time,x", *rows]))
    later = moments + np.timedelta64(1000, "ms")
    rows = [f"{m},{v!r}" for m, v in zip(later, np.cos(T + 1.0).tolist(), strict=True)]
    (tmp_path / "b.csv").write_text("\n".join(["time,v", *rows]))
    given = [tmp_path / "a.csv", tmp_path / "b.csv", "--states", "x", "v", "--modes", "1"]
    answer([*given, "--library", "linear"], capsys, tmp_path)
    found = load_model(tmp_path / "out" / "model.json").coef_[0]
    np.testing.assert_allclose(found, [[0.0, 1.0], [-1.0, 0.0]], atol=1e-3)
    (tmp_path / "b.csv").write_text("time,v\n" + "".join(f"{t},{t}\n" for t in T))
    assert "dates in the one, numbers" in answer(given, capsys, tmp_path, 2)


def _mdf(path):
    asammdf = pytest.importorskip("asammdf")
    fast, slow = np.arange(0.0, 24.0, 0.1), np.arange(0.0, 24.0, 0.3)
    with asammdf.MDF(version="4.10") as file:
        x = asammdf.Signal(thermostat(17.0, t=fast), fast, name="T", unit="degC")
        file.append([x])
        file.append([asammdf.Signal(np.sin(slow), slow, name="other")])
        file.save(path, overwrite=True)


def _formats():
    """The script of the page, which writes files as tools do."""
    for tool in ("asammdf", "fmpy"):
        pytest.importorskip(tool)
    return script("formats")


def _ulog(path):
    _formats().ulog(path, RUNS[0])


def _dymola(path):
    _formats().dymola(path, RUNS[0])


def _unit(path):
    """A unit with an experiment of its own."""
    pytest.importorskip("fmpy")
    HybridAutomaton.stated(*WORDS, states=["T"]).to_fmu(path)
    with zipfile.ZipFile(path) as unit:
        content = {name: unit.read(name).decode() for name in unit.namelist()}
    told = content["modelDescription.xml"]
    told = re.sub(r'(name="T".*?start=")[^"]*', r"\g<1>17.0", told, flags=re.S)
    wish = '<DefaultExperiment startTime="0" stopTime="24" stepSize="0.1"/>'
    content["modelDescription.xml"] = told.replace("<ModelVariables>", wish + "<ModelVariables>")
    with zipfile.ZipFile(path, "w") as unit:
        for name, text in content.items():
            unit.writestr(name, text)


@pytest.mark.parametrize(("write", "name", "states"), [
    (_mdf, "log.mf4", ["--states", "T"]), (_ulog, "flight.ulg", ["--states", "T"]),
    (_dymola, "plant.mat", ["--states", "T"]), (_unit, "plant.fmu", []),
])  # fmt: skip
def test_a_file_of_each_tool_to_a_right_answer(write, name, states, tmp_path, capsys):
    write(tmp_path / name)
    told = answer([tmp_path / name, *states, *AUTOMATON], capsys, tmp_path)
    assert f"{name}: " in told
    is_the_thermostat(tmp_path)
    is_a_unit_that_runs(tmp_path)


def test_refusals(tmp_path, capsys):
    text(tmp_path / "a.csv", t=T, T=RUNS[0])
    text(tmp_path / "b.csv", t_ms=1e3 * T, v=RUNS[0])
    text(tmp_path / "c.csv", t=T + 100.0, w=T)
    text(tmp_path / "d.csv", t=T, T=RUNS[1])
    text(tmp_path / "e.csv", t=T[:1], T=RUNS[1][:1])
    (tmp_path / "empty").mkdir()
    for given, words in (
        ([tmp_path / "empty", "--states", "T"], "holds no recording"),
        ([tmp_path / "none*.csv", "--states", "T"], "no file is called like"),
        ([tmp_path / "a.csv", tmp_path / "c.csv", "--states", "T", "w"], "nothing in common"),
        ([tmp_path / "a.csv", tmp_path / "b.csv", "--states", "T", "v"], "no column called t or"),
        ([tmp_path / "a.csv", tmp_path / "c.csv", "--states", "q"], "has no column 'q'"),
        ([tmp_path / "a.csv", tmp_path / "c.csv"], "Name the states with --states; the columns"),
        ([tmp_path / "a.csv", tmp_path / "c.csv", "--states", "T"], "c.csv has no column 'T'"),
        ([tmp_path / "e.csv", "--states", "T"], "'T' of e.csv holds one number; no law can be"),
        ([tmp_path / "a.csv", tmp_path / "d.csv", "--states", "T", "T"], "'T' is named twice"),
        (
            [tmp_path / "a.csv", tmp_path / "d.csv", "--states", "TT"],
            "has no column 'TT'. Did you mean 'T'? Its columns are: t, T.\n",
        ),
    ):
        told = answer(given, capsys, tmp_path, 2)
        assert words in told and told.count("\n") == 1, told
