"""The command line: planted systems come back in words, bad input in one sentence."""

import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import swsysid
from swsysid import load_model
from swsysid.__main__ import main
from swsysid._cli.samples import Samples
from swsysid.datasets import make_undeclared


def oscillator(n_runs=8, duration=6.0, step=0.02, noise=0.0, seed=0):
    """x'' = -x - c x', damping c = 0.1 for x > 0 and 0.5 otherwise, exact between the zeros."""
    from scipy.integrate import solve_ivp

    rng = np.random.default_rng(seed)
    times = np.arange(0.0, duration, step)
    columns = {name: [] for name in ("t", "x", "v", "run")}
    for run in range(n_runs):
        solution = solve_ivp(
            lambda _, y: [y[1], -y[0] - (0.1 if y[0] > 0 else 0.5) * y[1]],
            (0.0, duration),
            rng.uniform(-3, 3, 2),
            t_eval=times,
            max_step=0.01,
        )
        x, v = solution.y + noise * rng.standard_normal(solution.y.shape)
        for name, values in zip(columns, (times, x, v, np.full(len(times), run)), strict=True):
            columns[name].append(values)
    return {name: np.concatenate(values) for name, values in columns.items()}


def write_csv(path, columns):
    header = ",".join(columns)
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",", header=header)
    return str(path)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recording")
    return write_csv(folder / "runs.csv", oscillator(noise=1e-4))


NAMES = ["--time", "t", "--groups", "run"]


def coefficients(text, rate):
    """The coefficients of each mode's equation for `rate`, by feature name."""
    found = []
    for line in re.findall(rf"^ *{re.escape(rate)} = (.*?)(?:   \[|$)", text, re.MULTILINE):
        terms = [term.partition(" ") for term in line.replace(" - ", " + -").split(" + ")]
        found.append({name or "1": float(value) for value, _, name in terms})
    return found


def text_of(arguments, capsys):
    """What a run that succeeds prints."""
    assert main(arguments) == 0
    return capsys.readouterr().out


def assert_is_the_oscillator(text, tolerance, rate="v'", speed="v"):
    """The laws of `oscillator`, whose damping is another one in each mode."""
    laws = sorted(coefficients(text, rate), key=lambda law: law[speed])
    assert [law[speed] for law in laws] == pytest.approx([-0.5, -0.1], abs=tolerance)
    assert [law["x"] for law in laws] == pytest.approx([-1.0, -1.0], abs=tolerance)


def test_the_text_is_parsed_by_these_tests_as_it_is_meant():
    text = "    x' = -1.5 x + 2.0e-3 v - 0.25   [m/s]\n"
    assert coefficients(text, "x'") == [{"x": -1.5, "v": 2e-3, "1": -0.25}]


def test_a_csv_becomes_equations_surface_error_model_and_picture(recording, tmp_path, capsys):
    pandas = pytest.importorskip("pandas")
    states = ["--states", "x,v", "--units", "x=m,v=m/s,t=s"]
    text = text_of([recording, *states, *NAMES, "--output", str(tmp_path / "out")], capsys)
    # planted law, in each mode, and the planted surface x = 0
    assert_is_the_oscillator(text, 0.01)
    assert "[m/s^2]" in text and "x [m], v [m/s]" in text
    assert "whole trajectories" in text and "Switching predicts the held-out samples" in text
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "identification.txt",
        "model.json",
        "phase_portrait.png",
        "report.html",
    ]
    model = load_model(tmp_path / "out" / "model.json")
    assert "mode 0 where x < " in text and "mode 1 where x > " in text  # words for the surface
    assert all("v" in law and "x0" not in law for law in model.equations())
    assert model.recording_.source == "runs.csv"
    assert model.recording_.units["v'"] == "m/s^2" and model.recording_.names == ["x", "v"]
    far = pandas.DataFrame([[1.0, 0.3], [1.0, -0.3], [-1.0, 0.3], [-1.0, -0.3]], columns=["x", "v"])
    modes = model.predict_modes(far)
    assert modes[0] == modes[1] != modes[2] == modes[3]
    rates = [[0.3, -1.03], [-0.3, -0.97], [0.3, 0.85], [-0.3, 1.15]]
    np.testing.assert_allclose(model.predict(far), rates, atol=0.02)


@pytest.mark.nightly
def test_positions_alone_give_the_same_law(recording, tmp_path, capsys):
    arguments = [recording, "--states", "x", "--order", "2", *NAMES, "--output", str(tmp_path)]
    text = text_of(arguments, capsys)
    assert "known: the derivative of x is x'" in text
    assert "kept in the law" in text  # the spring needs the position
    assert_is_the_oscillator(text, 0.02, "x''", "x'")


@pytest.mark.parametrize("kind", ["npz", "mat"])
def test_binary_files_and_measured_derivatives(kind, tmp_path, capsys):
    from scipy.io import savemat

    columns = oscillator(n_runs=2)
    x, v = columns["x"], columns["v"]
    columns |= {"dx": v, "dv": -x - np.where(x > 0, 0.1, 0.5) * v}
    path = tmp_path / f"data.{kind}"
    np.savez(path, **columns) if kind == "npz" else savemat(path, columns)
    arguments = [str(path), *"--states x v --derivatives dx dv --library linear".split()]
    text = text_of([*arguments, "--output", str(tmp_path / "out")], capsys)
    laws = sorted(coefficients(text, "v'"), key=lambda law: law["v"])
    # derivatives without noise: the printed digits are exact
    assert [law["v"] for law in laws] == pytest.approx([-0.5, -0.1], abs=1e-5)
    assert "the last stretch of each trajectory" in text


def test_a_single_law_is_not_sold_as_two(tmp_path, capsys):
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (600, 2))
    rates = np.column_stack([X[:, 1], -X[:, 0]]) + 0.1 * rng.standard_normal((600, 2))
    columns = dict(zip("abcd", np.hstack([X, rates]).T, strict=True))
    path = write_csv(tmp_path / "one.csv", columns)
    arguments = [path, "--states", "a", "b", "--derivatives", "c", "d", "--output", str(tmp_path)]
    assert main(arguments) == 0
    assert "does not predict the held-out samples clearly better" in capsys.readouterr().out


@pytest.mark.nightly
def test_the_built_in_example(tmp_path, capsys):
    text = text_of(["--output", str(tmp_path)], capsys)
    assert "clearly better than one mode" in text
    assert (tmp_path / "phase_portrait.png").stat().st_size > 10_000


@pytest.mark.nightly
def test_the_same_seed_gives_the_same_text(recording, tmp_path, capsys):
    texts = []
    for _ in range(2):
        arguments = [recording, "--states", "x", "v", *NAMES, "--decimate", "4"]
        main([*arguments, "--output", str(tmp_path)])
        texts.append(capsys.readouterr().out)
    assert texts[0] == texts[1]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["absent.csv", "--states", "x", "--time", "t"], "There is no file absent.csv"),
        (["FILE"], "Name the states with --states; the columns are: t, x, v, run"),
        (["FILE", "--states", "y", *NAMES], "has no column 'y'.*columns are: t, x, v, run"),
        (["FILE", "--states", "x", "--inputs", "word", *NAMES], "no column 'word'"),
        (["FILE", "--states", "x", "v", "--derivatives", "v"], "1 derivatives are named; name 2"),
        (["FILE", "--states", "x", *NAMES, "--modes", "none"], "--modes 'none' is neither"),
        (["FILE", "--states", "x", *NAMES, "--units", "x"], "--units 'x' is not of the form"),
        (["FILE", "--states", "x", *NAMES, "--units", "q=m"], "has no column 'q'"),
        (["FILE", "--states", "x", *NAMES, "--test-fraction", "1"], "not between 0 and 1"),
        (["FILE", "--states", "x", *NAMES, "--window", "4"], "window=4 must be odd"),
        (["FILE", "--states", "x", "v", "--time", "t", "--time-step", "1"], "one of them says"),
        (["FILE", "--states", "x", "v", "--time-step", "-1"], "not a positive number of seconds"),
        (["FILE", "--states", "x", "v", "--inputs", "x", *NAMES], "Column 'x' is named twice"),
        (["FILE", "--states", "x", *NAMES, "--output", "FILE"], "cannot be written"),
    ],
)
def test_bad_input_gets_one_sentence_and_exit_code_2(arguments, sentence, tmp_path, capsys):
    path = write_csv(tmp_path / "runs.csv", oscillator(n_runs=2, duration=2.0))
    assert main([path if word == "FILE" else word for word in arguments]) == 2
    error = capsys.readouterr().err
    assert re.search(sentence, error) and error.startswith("swsysid: ") and error.count("\n") == 1


def test_times_of_no_usual_name_are_asked_for(tmp_path, capsys):
    columns = oscillator(n_runs=1, duration=2.0)
    path = write_csv(tmp_path / "runs.csv", {"tick": columns["t"], "x": columns["x"]})
    assert main([path, "--states", "x"]) == 2
    assert "name the column of the times (--time t)" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("column", "words", "sentence"),
    [
        (2, {4: "NA", 50: "---", 51: ""}, "3 of 2,400 rows, with missing values (v 3; rows 5, 51"),
        (
            1,
            dict.fromkeys((100, 700, 701), "9999"),
            "Masked as no measurement: 3 cells of x (9999; rows 101, 701, 702)",
        ),
    ],
    ids=["missing", "sentinels"],
)
def test_cells_without_a_measurement_are_counted(
    column, words, sentence, recording, tmp_path, capsys
):
    rows = [line.split(",") for line in Path(recording).read_text(encoding="utf-8").splitlines()]
    for row, word in words.items():
        rows[row][column] = word
    path = tmp_path / "gaps.csv"
    path.write_text("\n".join(map(",".join, rows)), encoding="utf-8")
    arguments = [str(path), "--states", "x", "v", *NAMES, "--output", str(tmp_path)]
    text = text_of(arguments, capsys)
    assert sentence in text
    assert_is_the_oscillator(text, 0.01)


@pytest.mark.nightly
def test_runs_that_are_not_named_are_found_where_the_time_starts_again(recording, tmp_path, capsys):
    named = [recording, "--states", "x", "v", "--time", "t", "--output", str(tmp_path)]
    assert main([*named, "--groups", "run"]) == 0
    expected = capsys.readouterr().out
    text = text_of(named, capsys)
    assert "The time starts again, and a new run with it: rows 302, 602, 902" in text
    assert coefficients(text, "v'") == coefficients(expected, "v'")


HEAVY = ("sklearn", "scipy", "cvxpy", "pysindy", "statsmodels", "matplotlib", "joblib")


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--help"], 0, "usage: python -m swsysid"),
        (["--version"], 0, f"swsysid {swsysid.__version__}"),
        (["--sates", "x"], 2, "--sates is no option. Did you mean --states?"),
        (["one.csv", "--order", "2", "two.csv"], 2, "'two.csv' belongs to no option"),
        (["absent.csv", "--states", "x"], 2, "There is no file absent.csv"),
        (["FILE", "--states", "spede"], 2, "no column 'spede'. Did you mean 'speed'?"),
        (["FILE", "--states", "speed", "--time", "speed"], 2, "'speed' is named twice"),
    ],
)
def test_help_and_refusals_do_not_wait_for_heavy_imports(arguments, code, sentence, tmp_path):
    (tmp_path / "runs.csv").write_text("t,speed\n0,1\n1,2\n", encoding="utf-8")
    words = ["runs.csv" if word == "FILE" else word for word in arguments]
    script = (
        "import sys\nfrom swsysid.__main__ import main\n"
        f"try: code = main({words})\nexcept SystemExit as end: code = end.code\n"
        f"print(sorted({set(HEAVY)} & set(sys.modules)))\nsys.exit(code)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == code and sentence in done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.nightly
def test_many_rows_are_all_used_and_give_the_right_law(tmp_path, capsys):
    """Noisy samples at 1 kHz, whose raw differences are nothing but noise."""
    path = write_csv(tmp_path / "fast.csv", oscillator(n_runs=4, step=1e-3, noise=1e-2))
    arguments = [path, "--states", "x", "v", *NAMES, "--output", str(tmp_path)]
    text = text_of(arguments, capsys)
    assert "every" not in text and "noise of one sample: x 0.01, v 0.01" in text
    n_samples = int(re.search(r"^([\d,]+) samples", text).group(1).replace(",", ""))
    assert n_samples > 0.75 * 24_000  # ends of the window apart
    assert_is_the_oscillator(text, 0.03)


@pytest.mark.nightly
def test_progress_is_shown_on_request_and_goes_to_standard_error(recording, tmp_path, capsys):
    arguments = [recording, "--states", "x", "v", *NAMES, "--decimate", "4"]
    assert main([*arguments, "--output", str(tmp_path)]) == 0
    quiet = capsys.readouterr()
    assert re.fullmatch(r"(.+ \.\.\. \d+ s\n)*", quiet.err)  # a long stage goes on
    assert main([*arguments, "--output", str(tmp_path), "--verbose"]) == 0
    told = capsys.readouterr()
    assert told.out == quiet.out
    assert f"Reading {recording} ...\nSmoothing, and identifying modes ...\n" in told.err
    assert "rounds: 100%" in told.err


@pytest.mark.parametrize(("fault", "code"), [(KeyboardInterrupt, 130), (BrokenPipeError, 1)])
def test_stopped_from_outside(fault, code, tmp_path):
    script = (
        "import sys, swsysid._cli.run as run\nfrom swsysid.__main__ import main\n"
        f"def stop(*arguments): raise {fault.__name__}\n"
        "run.run = stop\nsys.exit(main([]))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == code
    assert done.stderr == ("swsysid: stopped.\n" if code == 130 else "")


def test_help_shows_two_examples(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    assert capsys.readouterr().out.count("python -m swsysid ") >= 3  # usage and two examples


@pytest.mark.parametrize("columns", [80, 120])
def test_no_line_of_the_help_is_wider_than_the_terminal(columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", str(columns))
    with pytest.raises(SystemExit):
        main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    # argparse leaves two columns free, and paragraphs use the rest
    assert columns - 10 < max(map(len, lines)) < columns


def test_a_portrait_is_drawn_at_values_that_an_input_has():
    """What a filter makes of a switch between its two positions is none of them."""
    inputs = np.repeat([[0.0], [1.0]], 5, axis=0)
    filtered = np.column_stack([np.arange(4.0), [-0.02, 0.2, 0.7, 1.0]])
    with_recorded_inputs = Samples.with_recorded_inputs.fget
    recorded = SimpleNamespace(inputs=inputs)
    drawn = with_recorded_inputs(SimpleNamespace(X=filtered, recorded=recorded))
    np.testing.assert_array_equal(drawn, np.column_stack([np.arange(4.0), [0, 0, 1, 1]]))
    measured = with_recorded_inputs(SimpleNamespace(X=filtered, recorded=None))
    np.testing.assert_array_equal(measured, filtered)


def test_modes_that_no_state_separates_are_called_so(tmp_path, capsys):
    """Two laws drawn by a coin: two modes fit better in sample, and the text must not be proud."""
    rng = np.random.default_rng(0)
    x, u = rng.uniform(-1, 1, (2, 600))
    rate = np.where(rng.random(600) < 0.7, -x + u, 2.0 + x) + 0.01 * rng.standard_normal(600)
    path = write_csv(tmp_path / "coin.csv", {"x": x, "u": u, "dx": rate})
    arguments = [path, "--states", "x", "--inputs", "u", "--derivatives", "dx"]
    text = text_of([*arguments, "--output", str(tmp_path)], capsys)
    assert "does not predict the held-out samples clearly better" in text
    assert "these columns do not tell the modes apart" in text


# --- what the model lacks ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def rubbing(tmp_path_factory):
    """An oscillator with dry friction, its derivatives, and a signal that means nothing."""
    data = make_undeclared("coulomb_friction", n_samples=1000, random_state=1)
    columns = dict(zip(["x_m", "v", "u"], data.X.T, strict=True))
    columns |= dict(zip(["dx", "dv"], data.Xdot.T, strict=True))
    load = np.random.default_rng(0).standard_normal(len(data.X))
    columns |= {"t_s": data.t, "run": data.groups, "load": load}
    return write_csv(tmp_path_factory.mktemp("rubbing") / "rubbing.csv", columns)


ROLES = ["--states", "x_m,v", "--inputs", "u", "--derivatives", "dx,dv", "--groups", "run"]


@pytest.mark.nightly
def test_diagnosis_of_a_file(rubbing, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = [rubbing, *ROLES, "--time", "t_s", "--library", "linear", "--diagnose"]
    wishes = ["--effects", "coulomb_friction,polynomial", "input_coupling", "--signals", "load"]
    text = text_of([*arguments, *wishes, "--html", "rubbing.html", "--units", "v=m/s"], capsys)
    assert "1. coulomb friction of v in v'" in text and "Rollout of trajectory" in text
    assert "input_coupling" not in text.partition("Not looked for")[2]  # the signal was there
    before, after = (
        float(re.search(rf"^{model}.* (\S+)$", text, re.MULTILINE).group(1))
        for model in ("declared model", r"\+ coulomb friction of v")
    )
    assert after < 0.25 * before
    assert str(tmp_path / "rubbing.html") in text
    page = (tmp_path / "rubbing.html").read_text(encoding="utf-8")
    assert "Effect search: rubbing.csv" in page and "v (m/s)" not in page  # in pictures only
    assert '<th scope="col">x_m&#x27; [m/s]</th>' in page
    laws = text.partition("model with effects")[2]
    assert re.search(r"mode \d: v' = .* sign\(v\)", laws) and "f0(x_m, v, u) = " in laws
    output = tmp_path / "swsysid_output"
    assert "coulomb friction" in (output / "identification.txt").read_text(encoding="utf-8")
    model = load_model(output / "model_with_effects.json")
    assert [term.effect.kind for term in model.effects_] == ["coulomb_friction"]


def test_diagnosis_without_times_says_what_it_could_not_do(rubbing, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = [rubbing, *ROLES, "--library", "linear", "--diagnose", "--effects", "drift,bias"]
    text = text_of(arguments, capsys)
    assert "drift: needs the times of the rows: give t" in text
    assert (tmp_path / "swsysid_output" / "swsysid_diagnosis.html").stat().st_size > 10_000


def test_the_built_in_example_of_diagnosis(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ["--diagnose", "--effects", "coulomb_friction", "polynomial", "--output", "there"]
    text = text_of(arguments, capsys)
    assert "Coulomb friction of v in v', p < 1e-16: with it the held-out error of v' is" in text
    assert (tmp_path / "there" / "swsysid_diagnosis.html").exists()
    assert not (tmp_path / "swsysid_diagnosis.html").exists()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--html", "a.html"], "--html belongs to --diagnose"),
        (["--signals", "load"], "--signals belongs to --diagnose"),
        (["--effects", "bias"], "--effects belongs to --diagnose"),
        (["--diagnose", "--effects", "backlsh"], "Did you mean 'backlash'.*coulomb_friction"),
        (["--diagnose", "--html", "absent/a.html"], "cannot be written; name a file in a folder"),
        (["--diagnose", "--signals", "load"], "built-in example has no signals"),
        (
            ["FILE", *ROLES, "--diagnose", "--signals", "lod"],
            "no column 'lod'. Did you mean 'load'",
        ),
        (["FILE", *ROLES, "--diagnose", "--signals", "u"], "Column 'u' is named twice"),
    ],
)
def test_wrong_wishes_for_a_diagnosis(arguments, sentence, rubbing, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([rubbing if word == "FILE" else word for word in arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    assert re.search(sentence, captured.err)
