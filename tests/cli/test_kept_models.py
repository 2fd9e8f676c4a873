"""Models of the command line keep noise, errors and covariance; what they meet is of any format."""

import csv
import zipfile

import numpy as np
import pytest
from pandas import DataFrame

from swsysid import (
    HybridAutomaton,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
    load_model,
    save_model,
)
from swsysid.__main__ import main
from swsysid.refinement import StatedModel, suggest_experiment

PLANT = StatedModel(1, [[[0.2, -0.5, 1.0]]], states=["x"], inputs=["u"])
T = np.arange(0.0, 8.0, 0.1)
SIGMA = 0.02


def recordings():
    rng = np.random.default_rng(0)
    for start in (1.0, -1.0, 2.0):
        u = np.sin(T + start)[:, None]
        x = PLANT.simulate([start], T, u, input_hold="linear").x
        yield {"t": T, "x": x + SIGMA * rng.standard_normal(x.shape), "inputs": u}


@pytest.fixture(scope="module")
def kept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kept")
    rows = [np.column_stack([np.full(len(T), run), *one.values()])
            for run, one in enumerate(recordings())]  # fmt: skip
    np.savetxt(folder / "runs.csv", np.vstack(rows), delimiter=",", header="run,t,x,u", comments="")
    roles = "--states x --inputs u --groups run --modes 1".split()
    assert main([str(folder / "runs.csv"), *roles, "--output", str(folder)]) == 0
    return folder


def test_errors_and_noise_are_in_the_file(kept, capsys):
    model = load_model(kept / "model.json")
    assert isinstance(model, TrajectoryIdentifier)
    assert model.noise_ == pytest.approx([SIGMA], rel=0.2)
    # three standard errors, of a truth that was planted
    assert (np.abs(model.coef_ - PLANT.coef_) < 3.5 * model.coef_errors_).all()
    assert main(["show", str(kept / "model.json")]) == 0
    told = capsys.readouterr().out
    assert told.startswith("Identified from runs.csv.") and str(model.report_) in told
    [law] = [line for line in told.splitlines() if "x' =" in line]
    assert f"({model.coef_errors_[0, 0, 2]:.1g})" in law


def test_experiments_are_suggested_to_a_model_that_was_read(kept):
    model = load_model(kept / "model.json")
    short, long = (
        {"t": t, "x0": [2.0], "inputs": np.sign(np.sin(2.0 * t))[:, None]}
        for t in (np.arange(0.0, 0.3, 0.1), np.arange(0.0, 20.0, 0.1))
    )
    found = suggest_experiment(model, [short, long], list(recordings()), input_hold="linear")
    assert found.best == 1
    # what is known before is what the fit knew, and the longer recording adds to it
    np.testing.assert_allclose(found.before, model.coef_errors_.ravel(), rtol=0.1)
    assert (found.after[1] < found.after[0]).all() and (found.after[0] <= found.before).all()


def test_draws_are_columns(kept):
    t = np.arange(0.0, 3.0, 0.5)
    np.savez(kept / "inputs.npz", t=t, u=np.cos(t))
    given = ["simulate", str(kept / "model.json"), "--x0", "1", "--input", str(kept / "inputs.npz")]
    out = kept / "band.csv"
    assert main([*given, "--hold", "linear", "--draws", "40", "--output", str(out)]) == 0
    with open(out) as file:
        names, *rows = csv.reader(file)
    assert names == ["t", "x", "mode", "x_lower", "x_upper"]
    wanted = load_model(kept / "model.json").simulate(
        [1.0], t, np.cos(t)[:, None], input_hold="linear", n_draws=40, random_state=0
    )
    table = np.array(rows, dtype=float)
    np.testing.assert_array_equal(table[:, 3:], np.hstack([wanted.lower, wanted.upper]))
    true = PLANT.simulate([1.0], t, np.cos(t)[:, None], input_hold="linear").x
    assert (np.abs(true - wanted.x)[1:] < (wanted.upper - wanted.lower)[1:]).all()


def test_without_covariance_draws_are_refused(kept, capsys):
    roles = "--states x --inputs u --groups run --modes 1 --quick".split()
    assert main([str(kept / "runs.csv"), *roles, "--output", str(kept / "quick")]) == 0
    np.savez(kept / "few.npz", t=T[:3], u=T[:3])
    given = ["simulate", str(kept / "quick" / "model.json"), "--x0", "1", "--draws", "40"]
    capsys.readouterr()
    assert main([*given, "--input", str(kept / "few.npz")]) == 2
    told = capsys.readouterr().err
    assert "identify it by TrajectoryIdentifier" in told and told.count("\n") == 1


@pytest.mark.parametrize("to", ["c", "fmu", "matlab", "modelica"])
def test_exports_have_the_errors_as_comments(kept, to):
    model, out = load_model(kept / "model.json"), kept / f"out_{to}"
    assert main(["export", str(kept / "model.json"), "--to", to, "--output", str(out)]) == 0
    if to == "fmu":
        with zipfile.ZipFile(out) as unit:
            [source] = [name for name in unit.namelist() if name.endswith(".c")]
            told = unit.read(source).decode()
    else:
        told = out.read_text(encoding="utf-8")
    [law] = [line for line in str(model.report_).splitlines() if "x' =" in line]
    assert law in told and f"({model.coef_errors_[0, 0, 2]:.1g})" in law


def test_show_draws_graphs_and_modes(kept, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    timer = HybridAutomaton.stated(
        [{"x": "1"}, {"x": "-1"}], [(0, 1, "x >= 1"), (1, 0, "x <= 0")], states=["x"]
    )
    save_model(timer, tmp_path / "timer.json")
    plant = StatedModel(None, [[0.0, 1.0], [-1.0, -0.2]], states=["x", "v"])
    x = plant.simulate([1.0, 0.0], T).x + 0.01 * np.random.default_rng(0).standard_normal((80, 2))
    law = SwitchingSystemRegressor(1, random_state=0)
    save_model(TrajectoryIdentifier(law).fit(DataFrame(x, columns=["x", "v"]), T),
               tmp_path / "spring.json")  # fmt: skip
    for name in ("timer", "spring"):
        out = tmp_path / f"{name}.png"
        assert main(["show", str(tmp_path / f"{name}.json"), "--picture", str(out)]) == 0
        assert capsys.readouterr().out.splitlines()[-1] == f"Picture: {out}"
        assert out.read_bytes().startswith(b"\x89PNG")
    wrong = (
        (kept / "model.json", "a.png", "no samples of all columns"),
        (tmp_path / "timer.json", "a.docx", "a.docx cannot be drawn"),
        (tmp_path / "timer.json", "no/a.png", "There is no folder"),
    )
    for model, out, words in wrong:
        assert main(["show", str(model), "--picture", str(tmp_path / out)]) == 2
        told = capsys.readouterr().err
        assert words in told and told.count("\n") == 1


def hdf5(path, **groups):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        for name, columns in groups.items():
            for column, values in columns.items():
                file[f"{name}/{column}"] = values


def test_inputs_and_rows_come_from_the_formats_of_loggers(kept):
    x, u = np.linspace(-1.0, 1.0, len(T)), np.sin(T)
    hdf5(kept / "log.h5", all={"t": T, "x": x, "u": u})
    out, model = kept / "out.csv", load_model(kept / "model.json")
    assert main(["predict", str(kept / "model.json"), str(kept / "log.h5"),
                 "--output", str(out)]) == 0  # fmt: skip
    found = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_allclose(found[:, :1], model.predict(DataFrame({"x": x, "u": u})), rtol=1e-12)
    given = ["simulate", str(kept / "model.json"), "--x0", "1", "--input", str(kept / "log.h5")]
    assert main([*given, "--hold", "zero", "--output", str(out)]) == 0
    wanted = model.simulate([1.0], T, u[:, None], input_hold="zero").x
    found = np.loadtxt(out, delimiter=",", skiprows=1)
    np.testing.assert_array_equal(found[:, 1:2], wanted)


@pytest.mark.parametrize("hold", ["zero", "linear", "next", None])
def test_inputs_with_clocks_of_their_own_act_as_they_are_held(hold, tmp_path, capsys):
    """Of whole times one input knows every third, the other every second, each as it is held."""
    plant = HybridAutomaton.stated([{"x": "a + 10 b - x"}], states=["x"], inputs=["a", "b"])
    save_model(plant, tmp_path / "plant.json")
    slow, fast = np.arange(0.0, 13.0, 3.0), np.arange(1.0, 12.0, 2.0)
    a, b = slow**2, np.cos(fast)
    hdf5(tmp_path / "log.h5", slow={"t": slow, "a": a}, fast={"t": fast, "b": b})
    out = tmp_path / "out.csv"
    given = ["simulate", str(tmp_path / "plant.json"), "--x0", "0", "--mode", "0", "--output",
             str(out), "--input", str(tmp_path / "log.h5")]  # fmt: skip
    if hold is None:
        assert main(given) == 2
        assert "have clocks of their own; say what they do" in capsys.readouterr().err
        return
    assert main([*given, "--hold", hold]) == 0
    found = np.loadtxt(out, delimiter=",", skiprows=1)
    t = found[:, 0]
    np.testing.assert_array_equal(t, [1, 3, 5, 6, 7, 9, 11])  # both have begun, none has ended
    dense = np.union1d(t, np.linspace(1.0, 11.0, 4001))
    if hold == "linear":
        u = np.column_stack([np.interp(dense, slow, a), np.interp(dense, fast, b)])
    elif hold == "next":
        u = np.column_stack([a[np.searchsorted(slow, dense)], b[np.searchsorted(fast, dense)]])
    else:
        u = np.column_stack([a[(dense // 3).astype(int)], b[((dense - 1) // 2).astype(int)]])
    wanted = plant.simulate([0.0], dense, u, mode=0, input_hold=hold).x[np.searchsorted(dense, t)]
    np.testing.assert_allclose(found[:, 1:2], wanted, atol=1e-6)


@pytest.mark.parametrize(("given", "words"), [
    (["predict", "model.json", "gaps.h5"], "1 of 3 rows of gaps.h5 lack a value of x, u"),
    (["predict", "model.json", "clocks.h5"], "4 of 5 rows of clocks.h5 lack a value of x, u"),
    (["simulate", "model.json", "--x0", "1", "--input", "two.h5"], "two.h5 holds 2 runs"),
    (["simulate", "model.json", "--x0", "1", "--input", "wrong.h5"], "no column 'u'"),
    (["simulate", "model.json", "--x0", "1", "--input", "runs.csv", "--draws", "3"],
     "goes back in time"),
])  # fmt: skip
def test_refusals_are_one_sentence(kept, given, words, monkeypatch, capsys):
    monkeypatch.chdir(kept)
    three = np.arange(3.0)
    hdf5("gaps.h5", all={"t": three, "x": [1.0, np.nan, 2.0], "u": three})
    hdf5("clocks.h5", a={"t": three, "x": three}, b={"t": three + 0.5 * (three > 0), "u": three})
    hdf5("two.h5", a={"t": three, "u": three}, b={"t": three, "u": three})
    hdf5("wrong.h5", a={"t": three, "v": three, "w": three})
    assert main(given) == 2
    told = capsys.readouterr().err
    assert words in told and told.startswith("swsysid: ") and told.count("\n") == 1
