"""The folder of the results holds one run: all of it, or what was there before."""

import json
import os
import resource
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from swsysid import HybridAutomaton, SwitchingSystemRegressor, load_model, save_model
from swsysid.__main__ import main
from swsysid._cli.output import prepare, results
from swsysid._tables.table import TableError

MODEL, TEXT, PORTRAIT = "model.json", "identification.txt", "phase_portrait.png"


def write(path, rate=-1.0):
    t = np.arange(0.0, 4.0, 0.05)
    x = np.exp(rate * t) + 1e-3 * np.random.default_rng(0).standard_normal(len(t))
    table = np.column_stack([t, x, rate * x])
    np.savetxt(path, table, delimiter=",", header="t,x,dx", comments="")
    return str(path)


def run(path, folder):
    words = "--states x --derivatives dx --modes 1 --library linear --output".split()
    return main([path, *words, str(folder)])


def test_a_rerun_is_silent_and_other_results_are_announced(tmp_path, capsys):
    folder = tmp_path / "out"
    first = write(tmp_path / "first.csv")
    assert run(first, folder) == 0 and run(first, folder) == 0
    assert capsys.readouterr().err == ""
    assert run(write(tmp_path / "second.csv"), folder) == 0
    told = capsys.readouterr().err
    assert told.startswith(f"swsysid: the results of first.csv in {folder} will be replaced")
    assert told.count("\n") == 1
    # another recording of the same name
    (tmp_path / "other").mkdir()
    assert run(write(tmp_path / "other" / "second.csv", rate=-0.5), folder) == 0
    assert "the results of another second.csv" in capsys.readouterr().err
    assert load_model(folder / MODEL).coef_.item() == pytest.approx(-0.5)


def test_files_that_no_run_has_written_are_not_touched(tmp_path, capsys):
    path, folder = write(tmp_path / "first.csv"), tmp_path / "out"
    folder.mkdir()
    for name, content in ((MODEL, '{"layers": 3}'), (TEXT, "notes of a user")):
        (folder / name).write_text(content, encoding="utf-8")
        assert run(path, folder) == 2
        error = capsys.readouterr().err
        assert f"holds {name} that this command has not written" in error and error.count("\n") == 1
        assert (folder / name).read_text(encoding="utf-8") == content
        (folder / name).unlink()
    (folder / "notes.md").write_text("mine", encoding="utf-8")
    assert run(path, folder) == 0
    assert (folder / "notes.md").read_text(encoding="utf-8") == "mine"


def test_a_folder_that_cannot_be_written_is_refused_before_the_work():
    with pytest.raises(TableError, match="--output /proc cannot be written"):
        prepare(Path("/proc"), "a.csv", "")


def test_nothing_of_an_earlier_run_stays(tmp_path):
    automaton = HybridAutomaton.stated([{"x": "-x"}], [], states=["x"])
    (tmp_path / "automaton.json").write_text(json.dumps(automaton.to_dict()), encoding="utf-8")
    for name in ("automaton.png", "model_with_effects.json", "mine.txt"):
        (tmp_path / name).write_text("", encoding="utf-8")
    prepare(tmp_path, "a.csv", "")
    with results(tmp_path) as draft:
        save_model(automaton, draft / MODEL)
    assert sorted(os.listdir(tmp_path)) == ["mine.txt", MODEL]


def test_a_failed_run_leaves_what_was_there(tmp_path):
    (tmp_path / MODEL).write_text("as it was", encoding="utf-8")
    with pytest.raises(OSError, match="full"), results(tmp_path) as draft:
        (draft / MODEL).write_text("half", encoding="utf-8")
        raise OSError("the disk is full")
    assert os.listdir(tmp_path) == [MODEL]
    assert (tmp_path / MODEL).read_text(encoding="utf-8") == "as it was"


def test_two_runs_into_one_folder_do_not_mix(tmp_path):
    """Each run writes its number into three files; they are equal whenever one looks."""
    names = (MODEL, TEXT, PORTRAIT)

    def many(number):
        for _ in range(30):
            with results(tmp_path) as draft:
                for name in names:
                    (draft / name).write_text(str(number), encoding="utf-8")

    threads = [threading.Thread(target=many, args=[number]) for number in range(3)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert len({(tmp_path / name).read_text(encoding="utf-8") for name in names}) == 1
    assert sorted(os.listdir(tmp_path)) == sorted(names)


def test_a_full_disk_keeps_the_results_that_were_there(tmp_path):
    path, folder = write(tmp_path / "first.csv"), tmp_path / "out"
    assert run(path, folder) == 0
    before = {name: (folder / name).read_bytes() for name in os.listdir(folder)}

    def full():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))

    words = "--states x --derivatives dx --modes 1 --library affine --output".split()
    done = subprocess.run(
        [sys.executable, "-m", "swsysid", path, *words, str(folder)],
        capture_output=True,
        text=True,
        preexec_fn=full,
    )
    assert done.returncode == 2
    assert done.stderr == f"swsysid: {folder} cannot be written: File too large.\n"
    assert {name: (folder / name).read_bytes() for name in os.listdir(folder)} == before


def test_a_reader_that_ends_early_loses_no_results(tmp_path):
    path, folder = write(tmp_path / "first.csv"), tmp_path / "out"
    words = f"--states x --derivatives dx --modes 1 --library linear --output {folder}"
    command = f"{sys.executable} -m swsysid {path} {words} | true"
    assert subprocess.run(command, shell=True, capture_output=True).stderr == b""
    assert MODEL in os.listdir(folder) and TEXT in os.listdir(folder)


# -- files that are no recordings ------------------------------------------------------------------


def _npz_of_two_billion_rows(path):
    np.savez(path, x=np.zeros(8))
    content = path.read_bytes().replace(b"(8,), }" + 10 * b" ", b"(2000000000,), } ", 1)
    path.write_bytes(content)


def _mat_in_disguise(path):
    path.write_bytes(bytes(range(256)) * 8)


@pytest.mark.parametrize(
    ("name", "write_it"),
    [
        ("a" * 5000 + ".csv", None),
        ("nul\0.csv", None),
        ("empty.mat", lambda path: path.write_bytes(b"")),
        ("other.mat", _mat_in_disguise),
        ("huge.npz", _npz_of_two_billion_rows),
        ("other.npz", lambda path: path.write_bytes(b"PK\3\4" + bytes(100))),
        ("other.xlsx", lambda path: path.write_bytes(b"PK\3\4" + bytes(100))),
        ("cut.mf4", lambda path: path.write_bytes(b"MDF     4.10    " + bytes(100))),
        ("other.parquet", lambda path: path.write_bytes(b"PAR1" + bytes(100))),
    ],
    ids=lambda value: value[:20] if isinstance(value, str) else "",
)
def test_a_file_that_cannot_be_read_is_a_sentence(name, write_it, tmp_path, capsys):
    needed = {"parquet": "pyarrow", "mf4": "asammdf"}.get(name.rpartition(".")[2])
    if needed is not None:
        pytest.importorskip(needed)
    path = tmp_path / name
    if write_it is not None:
        write_it(path)
    assert main([str(path), "--states", "x", "--output", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("swsysid: ") and error.count("\n") == 1 and len(error) < 400


def test_letters_that_the_font_lacks_are_no_warning(tmp_path, capsys):
    t = np.arange(0.0, 4.0, 0.05)
    table = np.column_stack([t, np.exp(-t), np.exp(-t), -np.exp(-t), -np.exp(-t)])
    path = tmp_path / "letters.csv"
    header = "t,温度,\U0001f321,a,b"
    path.write_text(header + "\n" + "\n".join(",".join(map(str, row)) for row in table), "utf-8")
    words = ["--states", "温度", "\U0001f321", "--derivatives", "a", "b", "--modes", "1"]
    assert main([str(path), *words, "--output", str(tmp_path / "out")]) == 0
    told = capsys.readouterr()
    assert told.err == "" and "boxes for letters that its font lacks" in told.out


def test_a_solver_that_fails_ends_an_automaton_with_a_sentence(tmp_path, capsys, monkeypatch):
    def fails(*_, **__):
        raise np.linalg.LinAlgError("SVD did not converge")

    monkeypatch.setattr("swsysid._automaton_search.continuous.identified", fails)
    path = write(tmp_path / "first.csv")
    words = ["--states", "x", "--time", "t", "--automaton", "--output", str(tmp_path / "out")]
    assert main([path, *words]) == 1
    assert "linear algebra failed" in capsys.readouterr().err


def test_the_folder_of_an_older_version_is_known(tmp_path):
    """Before, an automaton had no model file and a model file no checksum of its recording."""
    save_model(SwitchingSystemRegressor(1).fit([[1.0], [2.0]], [1.0, 2.0]), tmp_path / MODEL)
    prepare(tmp_path, "a.csv", "0" * 64)
    (tmp_path / MODEL).write_text('{"format": "swsysid model", "recording": {}}', "utf-8")
    prepare(tmp_path, "a.csv", "0" * 64)
    (tmp_path / MODEL).write_text("[]", encoding="utf-8")
    with pytest.raises(TableError, match="has not written"):
        prepare(tmp_path, "a.csv", "0" * 64)
