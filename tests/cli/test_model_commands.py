"""`simulate`, `predict`, `export` and `show` with a model of a file."""

import csv
import subprocess
import sys

import numpy as np
import pytest
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from swsysid import (
    EffectRegressor,
    HybridAutomaton,
    Recording,
    SwitchingSystemRegressor,
    save_model,
)
from swsysid.__main__ import main
from swsysid.effects import CoulombFriction, PlacedEffect


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    X = np.random.default_rng(0).uniform(-1, 1, (300, 3))
    damping = np.where(X[:, 0] > 0, 0.1, 0.5)
    Xdot = np.column_stack([X[:, 1], -X[:, 0] - damping * X[:, 1] + X[:, 2]])
    model = SwitchingSystemRegressor(n_modes=2, random_state=0).fit(X, Xdot)
    save_model(model, folder / "model.json", recording=Recording("runs.csv", names=["x", "v", "u"]))
    ball = HybridAutomaton.stated(
        [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
    )
    save_model(ball, folder / "ball.json")
    t = np.arange(0.0, 3.0, 0.1)
    rows = [f"{time!r},{float(np.sin(time))!r}" for time in t.tolist()]
    (folder / "inputs.csv").write_text("\n".join(["t,u", *rows]))
    np.savetxt(folder / "rows.csv", X[:5], delimiter=",", header="x,v,u", comments="")
    return folder, model, ball, X


def _read(path):
    with open(path) as file:
        names, *rows = csv.reader(file)
    return names, np.array(rows, dtype=float)


def test_simulate_along_inputs_of_a_file(folder, capsys):
    place, model, _, _ = folder
    out = place / "out.csv"
    given = ["simulate", str(place / "model.json"), "--x0=0.5,-0.2", "--hold", "linear"]
    code = main([*given, "--input", str(place / "inputs.csv"), "--output", str(out)])
    assert code == 0 and "30 rows" in capsys.readouterr().out
    names, rows = _read(out)
    assert names == ["t", "x", "v", "mode"]
    t = np.arange(0.0, 3.0, 0.1)
    wanted = model.simulate([0.5, -0.2], t, np.sin(t)[:, None], input_hold="linear")
    np.testing.assert_array_equal(rows[:, 1:3], wanted.x)
    np.testing.assert_array_equal(rows[:, 3], wanted.modes)


@pytest.mark.parametrize("declared", [
    SwitchingSystemRegressor(1), make_pipeline(StandardScaler(), SwitchingSystemRegressor(1)),
    HybridAutomaton.stated([{"x0": "x1", "x1": "-x0"}], states=["x0", "x1"]),
])  # fmt: skip
def test_the_states_of_a_model_with_effects_are_those_of_its_laws(declared, tmp_path, capsys):
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 2))
    Xdot = np.column_stack([X[:, 1], -X[:, 0] - 0.3 * np.sign(X[:, 1])])
    friction = PlacedEffect(CoulombFriction(), place=1, target=1)
    model = EffectRegressor(declared, [friction]).fit(X, Xdot, t=0.01 * np.arange(200))
    save_model(model, tmp_path / "model.json")
    given = ["simulate", str(tmp_path / "model.json"), "--until", "1", "--x0"]
    assert main([*given, "1,0", "--output", str(tmp_path / "out.csv")]) == 0
    assert main([*given, "1"]) == 2
    assert "--x0 holds 1 number; the states are x0, x1." in capsys.readouterr().err


def test_simulate_for_a_time(folder):
    place, _, ball, _ = folder
    out = place / "ball.csv"
    assert main(["simulate", str(place / "ball.json"), "--x0", "10,0", "--until", "2", "--step",
                 "0.5", "--mode", "0", "--output", str(out)]) == 0  # fmt: skip
    names, rows = _read(out)
    assert names == ["t", "h", "v", "mode"]
    wanted = ball.simulate([10.0, 0.0], rows[:, 0], mode=0).x
    np.testing.assert_array_equal(rows[:, 1:3], wanted)


def test_predict(folder):
    place, model, _, X = folder
    out = place / "rates.csv"
    assert main(["predict", str(place / "model.json"), str(place / "rows.csv"),
                 "--output", str(out)]) == 0  # fmt: skip
    names, rows = _read(out)
    assert names == ["x'", "v'", "mode"]
    np.testing.assert_allclose(rows[:, :2], model.predict(X[:5]), rtol=1e-12)


@pytest.mark.parametrize(("to", "words"), [
    ("c", b"int ball_step("), ("fmu --fmi-version 3", b"buildDescription"),
    ("fmu", b"PK"), ("modelica", b"reinit("), ("sympy", b"mode 0 -> 0"),
    ("matlab", b"function model = ball()"),
])  # fmt: skip
def test_export(folder, to, words):
    if to == "sympy":
        pytest.importorskip("sympy")
    place = folder[0]
    out = place / "ball.out"
    assert (
        main(["export", str(place / "ball.json"), "--to", *to.split(), "--output", str(out)]) == 0
    )
    assert words in out.read_bytes()


def test_show(folder, capsys):
    place, model, _, _ = folder
    assert main(["show", str(place / "model.json")]) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[0] == "Identified from runs.csv."
    assert told[1:] == [*model.equations(), *model.surface_equations()]


@pytest.mark.parametrize(("given", "words"), [
    (["simulate", "ball.json", "--x0", "1,0"], "give --until T, or --input FILE"),
    (["simulate", "model.json", "--x0", "0.5", "--input", "inputs.csv"],
     "--x0 holds 1 number; the states are x, v."),
    (["simulate", "ball.json", "--x0", "1,0,2", "--until", "2"],
     "--x0 holds 3 numbers; the states are h, v."),
    (["simulate", "model.json", "--x0", "1,0", "--input", "rows.csv"], "name the time with --time"),
    (["simulate", "model.json", "--x0", "1,0", "--until", "2"], "the input u; give --input FILE"),
    (["simulate", "model.json", "--x0", "1,0", "--input", "inputs.csv", "--mode", "1"],
     "the state tells the mode of this model; leave out --mode"),
    (["simulate", "model.json", "--x0", "1,0", "--input", "inputs.csv", "--step", "1"],
     "the times are those of --input; leave out --until and --step"),
    (["simulate", "model.json", "--x0", "1,0", "--input", "rows.csv", "--time", "x"],
     "goes back in time: give the rows of one run"),
    (["predict", "ball.json", "rows.csv"], "use simulate"),
    (["predict", "model.json", "inputs.csv"], "has no column 'x'"),
    (["export", "nothing.json", "--to", "c", "--output", "a.c"],
     "There is no file nothing.json; check its name."),
    (["export", "ball.json", "--to", "c", "--fmi-version", "3", "--output", "a.c"],
     "--fmi-version is that of an fmu; leave it out with --to c."),
    (["show", "nofile.json"], "There is no file nofile.json; check its name."),
    (["show", "."], ". is a folder; name a file in it."),
    (["export", "ball.json", "--to", "c", "--output", "no/folder/a.c"],
     "There is no folder no/folder."),
])  # fmt: skip
def test_refusals_are_one_sentence(folder, given, words, monkeypatch, capsys):
    monkeypatch.chdir(folder[0])
    assert main(given) == 2
    told = capsys.readouterr().err
    assert words in told and told.startswith("swsysid: ") and told.count("\n") == 1


@pytest.mark.parametrize(("option", "value", "words"), [
    ("--x0", "a", "'a' is no list of numbers"), ("--until", "0", "'0' is no time above zero"),
    ("--step", "-1", "'-1' is no time above zero"), ("--step", "nan", "is no time above zero"),
])  # fmt: skip
def test_numbers_that_are_none_are_refused_by_name(folder, option, value, words, capsys):
    given = ["simulate", str(folder[0] / "ball.json"), "--x0", "1,0", f"{option}={value}"]
    with pytest.raises(SystemExit):
        main(given)
    told = capsys.readouterr().err
    assert words in told and option in told


def test_files_are_read_as_before(folder):
    done = subprocess.run(
        [sys.executable, "-m", "swsysid", "simulate"], capture_output=True, text=True, cwd=folder[0]
    )
    assert done.returncode == 2 and "arguments are required: model, --x0" in done.stderr
    done = subprocess.run(
        [sys.executable, "-m", "swsysid", "./simulate"], capture_output=True, text=True,
        cwd=folder[0],
    )  # fmt: skip
    assert done.returncode == 2 and "simulate" in done.stderr and "--x0" not in done.stderr
