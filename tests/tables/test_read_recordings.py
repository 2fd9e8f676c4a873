"""Several files as recordings: runs, channels on one clock or on their own, refusals."""

import numpy as np
import pytest

from swsysid import HybridAutomatonRegressor, read_recordings

T = np.arange(0.0, 1.0, 0.1)


def _write(path, **columns):
    rows, listed = [",".join(columns)], [values.tolist() for values in columns.values()]
    rows += [",".join(map(repr, row)) for row in zip(*listed, strict=True)]
    path.write_text("\n".join(rows) + "\n")
    return path


def test_files_of_a_pattern_are_runs_in_the_order_of_their_numbers(tmp_path):
    for number in (10, 2, 1):
        _write(tmp_path / f"run{number}.csv", t=T, x=T + number, u=-T)
    runs = read_recordings(tmp_path / "run*.csv", states=["x"], inputs=["u"])
    assert [run["x"].loc[0, "x"] for run in runs] == [1.0, 2.0, 10.0]
    np.testing.assert_array_equal(runs[2]["inputs"], -T[:, None])
    assert [one.file for one in runs.columns[::2]] == ["run1.csv", "run2.csv", "run10.csv"]
    assert runs.columns[0].rate == pytest.approx(10.0)
    assert "run10.csv: x" in str(runs)


def test_files_with_a_part_of_the_columns_are_channels_of_one_run(tmp_path):
    _write(tmp_path / "a.csv", time=T, x=T**2)
    _write(tmp_path / "b.csv", time=T, u=np.sin(T))
    [run] = read_recordings([tmp_path / "a.csv", tmp_path / "b.csv"], states=["x"], inputs=["u"])
    np.testing.assert_array_equal(run["t"], T)
    np.testing.assert_array_equal(run["x"]["x"], T**2)
    np.testing.assert_array_equal(run["inputs"]["u"], np.sin(T))


def test_channels_keep_their_own_times(tmp_path):
    slow = T[::2] + 0.03
    _write(tmp_path / "a.csv", t=T, x=T**2)
    _write(tmp_path / "b.csv", t=slow, v=2 * slow)
    [run] = read_recordings([tmp_path / "a.csv", tmp_path / "b.csv"], states=["x", "v"])
    assert len(run["t"]) == 15 and (np.diff(run["t"]) > 0).all()
    x, v = run["x"].to_numpy().T
    np.testing.assert_array_equal(run["t"][np.isfinite(x)], T)
    np.testing.assert_array_equal(v[np.isfinite(v)], 2 * slow)
    assert not (np.isfinite(x) & np.isfinite(v)).any()  # nothing was interpolated


def test_fit_takes_what_was_read(tmp_path):
    t = np.arange(0.0, 4.0, 0.05)
    for number, start in enumerate((2.0, -1.0)):
        _write(tmp_path / f"run{number}.csv", t=t, T=start * np.exp(-0.5 * t))
    runs = read_recordings(str(tmp_path / "run?.csv"), states=["T"])
    found = HybridAutomatonRegressor(n_modes=1).fit(runs)
    assert found.coef_[0, 0, 1] == pytest.approx(-0.5, abs=1e-6)


def test_refusals(tmp_path):
    _write(tmp_path / "a.csv", t=T, x=T)
    _write(tmp_path / "b.csv", t=T, x=T, u=T)
    _write(tmp_path / "c.csv", t=T + 0.05, w=T)
    _write(tmp_path / "d.csv", hours=T, x=T)
    for paths, options, words in (
        ([], {}, "paths is empty"),
        ("nothing*.csv", {}, "no file is called like nothing"),
        ([tmp_path / "a.csv"], {"states": []}, "states names no column"),
        ([tmp_path / "a.csv", tmp_path / "b.csv"], {"inputs": ["u"]}, "a.csv has no column 'u'"),
        ([tmp_path / "a.csv", tmp_path / "c.csv"], {"inputs": ["w"]}, "'w' has no value at 10"),
        ([tmp_path / "d.csv"], {}, "no column called t or time"),
        ([tmp_path / "a.csv"], {"time": "seconds"}, "a.csv has no column 'seconds'"),
        ([tmp_path / "a.csv", tmp_path / "d.csv"], {"states": ["x", "q"]}, "has no column 'q'|sev"),
    ):
        with pytest.raises(ValueError, match=words):
            read_recordings(paths, **{"states": ["x"], **options})
