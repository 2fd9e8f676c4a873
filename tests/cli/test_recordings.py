"""Recordings as loggers leave them: read, mended, split, or left out with a count."""

import gzip
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from scipy.io import savemat

from swsysid._cli.masking import sentinels, spikes
from swsysid._cli.measurement import Measurement
from swsysid._cli.samples import measure
from swsysid._cli.text import preparation
from swsysid._tables.readers import read_table
from swsysid._tables.table import Table, TableError
from swsysid.differentiation._strength import deciding_rows

STEP = 0.02
T = STEP * np.arange(300)
X = np.sin(T) + 2.0
V = np.cos(T)
BOTH = Measurement(states=("x", "v"), time="t")


def lines(delimiter=",", decimal="."):
    rows = zip(T.tolist(), X.tolist(), V.tolist(), strict=True)
    return [delimiter.join(f"{value:.6f}".replace(".", decimal) for value in row) for row in rows]


@pytest.fixture
def file(tmp_path):
    def write(rows, name="log.csv", encoding="utf-8"):
        path = tmp_path / name
        path.write_bytes("\n".join(rows).encode(encoding))
        return path

    return write


# --- how files are laid out -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rows", "name", "encoding", "first"),
    [
        (["t,x,v", *lines()], "log.csv", "utf-8", 2),
        (["t\tx\tv", *lines("\t")], "log.tsv", "utf-16", 2),
        (["  t   x   v", *("   " + row for row in lines("   "))], "log.dat", "utf-8", 2),
        (["% made by a rig", "% t x v", *lines(" ")], "log.txt", "utf-8", 3),
        (["Messgerät 7;;", "Datum;12.03.2024;", "", "t;x;v", "s;m;m/s", *lines(";", ",")],
         "log.csv", "latin-1", 6),
        (["sep=;", "t;x;v", *lines(";", ",")], "log.csv", "utf-8-sig", 3),
        (['"t","x","v"', *('"' + row.replace(";", '","') + '"' for row in lines(";", ","))],
         "log.csv", "utf-8", 2),
        (["Rig: A, B, C", "Rate,50", "t,x,v", "[s],[m],[m/s]", *lines()], "log.log", "utf-8", 5),
        (["t|x|v", *lines("|")], "log.txt", "utf-8", 2),
    ],
    ids=["plain", "utf-16 tabs", "blanks", "comments", "preamble and decimal commas in latin-1",
         "sep line", "quoted decimal commas", "preamble and units", "bars"],
)  # fmt: skip
def test_layouts(file, rows, name, encoding, first):
    table = read_table(file(rows, name, encoding))
    assert list(table.columns) == ["t", "x", "v"]
    np.testing.assert_allclose(table.numbers("txv"), np.column_stack([T, X, V]), atol=6e-7)
    assert table.row(0) == first


def test_units_of_a_row_of_their_own(file):
    table = read_table(file(["Rig 7", "t,x,v", "[s],mm,m/s", *lines()]), {"x": "m"})
    assert [table.unit(name) for name in "txv"] == ["s", "m", "m/s"]  # the user's wins
    assert table.remarks == (
        "The names stand in row 2, below a preamble; the row below them holds units.",
    )


def test_compressed_text_and_spreadsheets_are_the_same_table(file, tmp_path):
    import pandas as pd

    plain = read_table(file(["t,x,v", *lines()]))
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress((tmp_path / "log.csv").read_bytes()))
    sheet = pd.DataFrame([["a rig", None, None], ["t", "x", "v"], ["s", "m", "m/s"]])
    values = pd.DataFrame(plain.numbers("txv").tolist())
    pd.concat([sheet, values]).to_excel(tmp_path / "log.xlsx", header=False, index=False)
    for name in ("log.csv.gz", "log.xlsx"):
        table = read_table(tmp_path / name)
        np.testing.assert_array_equal(table.numbers("txv"), plain.numbers("txv"))
    assert table.unit("v") == "m/s" and table.row(0) == 4


def test_parquet_or_a_sentence_about_it(tmp_path, monkeypatch):
    import pandas as pd

    frame = pd.DataFrame({"t": pd.to_datetime(T, unit="s"), "x": X, "run": "a"})
    monkeypatch.setattr(pd, "read_parquet", lambda path: frame)
    (tmp_path / "log.parquet").write_bytes(b"PAR1")
    table = read_table(tmp_path / "log.parquet")
    np.testing.assert_allclose(table.numbers("tx"), np.column_stack([T, X]), atol=1e-8)
    assert table.unit("t") == "s" and table.labels("run")[0] == "a"

    def absent(path):
        raise ImportError("no engine")

    monkeypatch.setattr(pd, "read_parquet", absent)
    with pytest.raises(TableError, match=r'pip install "swsysid\[parquet\]"'):
        read_table(tmp_path / "log.parquet")
    monkeypatch.setattr(pd, "read_excel", lambda path, **options: absent(path))
    (tmp_path / "log.xlsx").write_bytes(b"PK")
    with pytest.raises(TableError, match=r'pip install "swsysid\[excel\]"'):
        read_table(tmp_path / "log.xlsx")


START = datetime(2024, 3, 31, 0, 59, 58, tzinfo=UTC)
ZONES = [timezone(timedelta(hours=hours)) for hours in (1, 2)]


@pytest.mark.parametrize(
    "form",
    [
        lambda time: time.isoformat(),
        # the clocks of Berlin change two seconds after the start
        lambda time: time.astimezone(ZONES[time.hour >= 1]).isoformat(),
        lambda time: f"{time:%Y/%m/%d %H:%M:%S.%f}",
        lambda time: f"{time:%d.%m.%Y %H:%M:%S.%f}",
        lambda time: f"{time:%m/%d/%Y %I:%M:%S.%f %p}",
        lambda time: f"{time:%H:%M:%S.%f}",
    ],
    ids=["iso", "change of zone", "slashes", "dots", "american", "time of day"],
)
def test_times_of_the_clock_are_seconds(file, form):
    times = [form(START + timedelta(seconds=t)) for t in T.tolist()]
    rows = [f"{time},{row}" for time, row in zip(times, lines(), strict=True)]
    table = read_table(file(["time,t,x,v", *rows]))
    np.testing.assert_allclose(table.numbers(["time"])[:, 0], T, atol=1e-5)
    assert table.unit("time") == "s"


def test_midnight_does_not_turn_the_clock_back(file):
    table = read_table(file(["time,x", "23:59:59.5,1", "0:00:00,2", "0:00:00.5,3"]))
    assert table.numbers(["time"])[:, 0].tolist() == [0.0, 0.5, 1.0]


def test_structs_of_matlab(tmp_path):
    savemat(tmp_path / "log.mat", {"log": {"t": T, "x": X, "meta": {"v": V, "by": "me"}}})
    table = read_table(tmp_path / "log.mat")
    assert list(table.columns) == ["log.t", "log.x", "log.meta.v"]
    np.testing.assert_array_equal(table.numbers("txv"), np.column_stack([T, X, V]))
    runs = np.zeros((1, 2), dtype=[("t", object), ("x", object)])
    runs[0, 0], runs[0, 1] = (T, X), (T[:100], X[:100])
    savemat(tmp_path / "runs.mat", {"runs": runs})
    table = read_table(tmp_path / "runs.mat")
    assert table.labels("runs.run").tolist() == [1.0] * 300 + [2.0] * 100
    np.testing.assert_array_equal(table.numbers(["x"])[:, 0], np.r_[X, X[:100]])


# --- what is left out and what is refused -----------------------------------------------------


def test_words_for_a_missing_value(file):
    rows = ["t,x", "0,NA", "1,---", "2,", "3,NaN", "4,null", "5,n/a", "6,#N/A", "7,ERR", "8,2.5"]
    table = read_table(file(rows), missing=["err"])
    assert np.isnan(table.numbers("x")[:-1]).all() and table.numbers("x")[-1, 0] == 2.5
    with pytest.raises(TableError, match="row 9 holds 'ERR'; .*--missing 'ERR'"):
        read_table(file(rows)).numbers("x")


def test_marks_between_thousands(file):
    table = read_table(file(["t;x", "0;999,5", "1;1.000,25", "2;12.345.678,0"]))
    assert table.numbers("x")[:, 0].tolist() == [999.5, 1000.25, 12345678.0]
    table = read_table(file(["t;x", "0;999.5", "1;1,000.25"]))
    assert table.numbers("x")[:, 0].tolist() == [999.5, 1000.25]


def test_a_slow_column_costs_no_rows(file):
    rows = [f"{row},{1.5 if k % 10 == 0 else ''}" for k, row in enumerate(lines())]
    table = read_table(file(["t,x,v,gps", *rows]))
    what = Measurement(states=("x", "v"), inputs=("gps",), time="t")
    samples = measure(table, what)
    assert samples.remarks[0].startswith("gps has times of its own (30 rows): it keeps its value")
    assert len(samples.recorded.t) == 300 and (samples.recorded.inputs == 1.5).all()


def test_damaged_rows_and_repeated_headers_are_left_out_and_named(file):
    rows = lines()
    rows = ["t,x,v", *rows[:100], "t,x,v", *rows[100:200], "1,2,3,4", *rows[200:], "End of log"]
    table = read_table(file(rows))
    np.testing.assert_allclose(table.numbers("t")[:, 0], T, atol=1e-9)
    assert table.remarks == (
        "The header is repeated in row 102.",
        "Left out as damaged: rows 203, 304 (2 rows).",
    )
    assert table.row(299) == 303
    with pytest.raises(TableError, match="row 2 has 4 cells and its header 2 names .*semicolons"):
        read_table(file(["t,x", *(row for row in lines(",", ",") if row.count(",") == 5)][:1]
                        + ["0,1,2,3", "0,2,2,4"]))  # fmt: skip


@pytest.mark.parametrize(
    ("name", "content", "sentence"),
    [
        ("log.csv", b"\0\1\2\0\0\3abcdefgh" * 9, "it is not text"),
        ("log.xls", b"x", r"is no .csv, .tsv, .txt, .dat.*\.csv\.gz"),
        ("log.mat", b"MATLAB 7.3 MAT-file" + bytes(105) + b"\x00\x02IM" + bytes(400), "-v7"),
        ("log.csv.gz", b"no gzip", "cannot be read"),
        ("log.xlsx", b"no spreadsheet", "cannot be read"),
    ],
)
def test_unreadable_files_get_a_sentence(tmp_path, name, content, sentence):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(TableError, match=sentence):
        read_table(tmp_path / name)


def test_objects_in_files_are_not_loaded(tmp_path):
    np.savez(tmp_path / "log.npz", t=np.array([1, "a", None], dtype=object))
    with pytest.raises(TableError, match="'t' holds Python objects, which are not loaded"):
        read_table(tmp_path / "log.npz")


def test_a_folder_is_no_recording(tmp_path):
    with pytest.raises(TableError, match="is a folder; name one recording in it"):
        read_table(tmp_path)


def test_a_file_that_is_missing_is_looked_for_beside_it(file):
    path = file(["t,x,v", *lines()], "run_07.csv")
    with pytest.raises(TableError, match=r"did you mean 'run_07.csv'\?"):
        read_table(path.with_name("run07.csv"))


# --- cells that are no measurement ------------------------------------------------------------


@pytest.mark.parametrize("value", [9999.0, -999.0, 1e30, 32767.0, 99999.99])
@pytest.mark.parametrize("place", [[0], [40, 41, 42], [7, 90, 200]])
def test_sentinels_are_found_wherever_they_stand(value, place):
    column = X.copy()
    column[place] = value
    assert np.flatnonzero(sentinels(column)).tolist() == place


def test_values_that_only_look_like_sentinels_are_kept():
    assert not sentinels(np.linspace(0.0, 2000.0, 2001)).any()  # passes through 999
    assert not sentinels(np.where(np.arange(100) % 2, 999.0, 0.0)).any()  # a setpoint


def test_spikes_of_a_state_are_isolated():
    column = X.copy()
    column[[40, 41, 90]] = 1e4, -1e4, 55.5
    one = np.zeros(len(column), dtype=int)
    assert np.flatnonzero(spikes(column, one)).tolist() == [40, 41, 90]
    assert not spikes(column[40:], one[40:])[:2].any()  # at an end it may be where a run starts


@pytest.mark.parametrize(
    "extreme",
    [
        1e3 * np.exp(-50 * T),  # a decay from far away
        1e3 * np.exp(-((T - 3.0) ** 2) / 2e-3),  # an impact of a few samples
        np.where(T > 5.9, 1e3, 0.0),  # a step at the end
    ],
    ids=["decay", "impact", "step"],
)
def test_true_extremes_are_kept(extreme):
    assert not spikes(X + extreme, np.zeros(len(T), dtype=int)).any()


def test_noise_around_a_limit_is_no_spike():
    """Most of a ringing is quiet; noise lifts single samples of its crests over any limit."""
    t = np.arange(0.0, 60.0, 1e-3)
    x = np.exp(-0.2 * t) * np.cos(9.0 * t) + 5e-3 * np.random.default_rng(0).standard_normal(len(t))
    assert not spikes(x, np.zeros(len(t), dtype=int)).any()


def test_what_is_masked_is_named_and_may_be_kept(file):
    rows = lines()
    rows[10], rows[20] = rows[10].replace(rows[10].split(",")[1], "9999"), "0.4,2.38,777.7"
    path = file(["t,x,v", *rows])
    told = preparation(measure(read_table(path), BOTH))
    assert told[0] == (
        "Masked as no measurement: 1 cell of x (9999; row 12); --keep-spikes uses them."
    )
    assert told[1].startswith("Masked as no measurement: 1 cell of v (777.7; row 22)")
    assert told[2] == (
        "Kept where no derivative is needed: 2 of 300 rows, with missing values "
        "(x 1, v 1; rows 12, 22)."
    )
    kept = Measurement(states=("x", "v"), time="t", keep_spikes=True)
    samples = measure(read_table(path), kept)
    assert not samples.remarks and np.abs(samples.X).max() > 1e3


# --- times ------------------------------------------------------------------------------------


def measured(t, x, **options):
    columns = {"t": np.asarray(t, dtype=float), "x": np.asarray(x, dtype=float)}
    columns |= {name: options.pop(name) for name in ("run",) if name in options}
    roles = {"time": "t", "groups": "run" if "run" in columns else None} | options
    table = Table("log", columns, {}, rows=np.arange(len(t)) + 2)
    return measure(table, Measurement(states=("x",), **roles))


def test_the_time_starts_again():
    samples = measured(np.r_[T, T[:200]], np.r_[X, X[:200] + 1.0])
    assert samples.remarks == ("The time starts again, and a new run with it: row 302.",)
    assert set(samples.groups.tolist()) == {0, 1}
    alone = measured(T, X)
    np.testing.assert_allclose(samples.Xdot[samples.groups == 0], alone.Xdot, atol=1e-9)


def test_runs_within_named_trajectories_get_names_of_their_own():
    run = np.repeat(["a", "b"], 300).astype(object)
    samples = measured(np.r_[T[:150], T[:150], T], np.r_[X[:150], X[:150], X], run=run)
    assert list(dict.fromkeys(samples.groups.tolist())) == ["a", "a.2", "b"]


def test_gaps_repeats_late_rows_and_short_runs():
    t, x = np.delete(T, np.s_[200:240]), np.delete(X, np.s_[200:240])
    t, x = np.insert(t, 100, t[99]), np.insert(x, 100, x[99])
    t[[50, 51]], x[[50, 51]] = t[[51, 50]], x[[51, 50]]
    t, x = np.r_[t, 100.0 + T[:4]], np.r_[x, X[:4]]
    samples = measured(t, x)
    assert samples.remarks == (
        "Rows that stood out of time order were moved: row 53.",
        "Left out: 1 row with a time that was there before (row 102).",
        "A gap in time, and a new run after it: rows 203, 263.",
        f"Left out: 1 run shorter than the {samples.smoothing.window} samples of the window "
        "(4 rows).",
    )
    np.testing.assert_allclose(samples.Xdot[:, 0], np.cos(samples.t), atol=1e-5)


def test_newest_first():
    samples = measured(T[::-1], X[::-1])
    assert samples.remarks == ("The rows run backward in time; they were reversed.",)
    np.testing.assert_array_equal(samples.Xdot, measured(T, X).Xdot)


def test_rows_in_no_order_are_sorted_and_a_clock_that_starts_again_is_not():
    order = np.random.default_rng(0).permutation(len(T))
    samples = measured(T[order], X[order])
    assert samples.remarks == ("The rows stand in no order of time; they were sorted (300 rows).",)
    np.testing.assert_array_equal(samples.Xdot, measured(T, X).Xdot)


def test_rows_that_lack_a_state_count_in_recordings_only(file):
    rows = [row if k % 3 else row.rsplit(",", 1)[0] + "," for k, row in enumerate(lines())]
    samples = measure(read_table(file(["t,x,v", *rows])), BOTH)
    recorded = samples.recorded
    assert len(recorded.t) == 300 and np.isnan(recorded.states[:, 1]).sum() == 100
    np.testing.assert_allclose(recorded.states[:, 0], X, atol=6e-7)
    np.testing.assert_allclose(samples.Xdot[:, 0], np.cos(samples.t), atol=1e-3)
    assert len(samples.X) <= 200


def test_a_run_ends_for_derivatives_alone_where_a_state_is_lost_for_long():
    x = np.column_stack([X, V])
    x[100:180, 1] = np.nan
    table = Table("log", {"t": T, "x": x[:, 0], "v": x[:, 1]}, {}, rows=np.arange(300) + 2)
    samples = measure(table, BOTH)
    assert len(np.unique(samples.groups)) == 2 and len(samples.recorded.labels) == 1


@pytest.mark.parametrize(
    ("columns", "options", "sentence"),
    [
        ({"x": 0 * T + 3.0}, {}, "'x' of log is 3 in all 300 rows; .* never moves, leave it out"),
        ({"x": X, "v": V}, {"order": 2}, "'v' is the rate of 'x'; with --order 2 name the pos"),
    ],
)
def test_states_that_have_no_law_of_their_own_are_refused(columns, options, sentence):
    table = Table("log", {"t": T, **columns}, {})
    with pytest.raises(TableError, match=sentence):
        measure(table, Measurement(states=tuple(columns), time="t", **options))


def test_a_constant_input_is_named():
    table = Table("log", {"t": T, "x": X, "u": 0 * T + 2.0}, {})
    samples = measure(table, Measurement(states=("x",), inputs=("u",), time="t"))
    assert samples.remarks == (
        "Column 'u' of log is 2 in all 300 rows: what it does cannot be told from a constant, "
        "leave it out.",
    )


def test_noise_alone_is_told_to_be_so():
    samples = measured(T, np.random.default_rng(0).standard_normal(300))
    assert samples.remarks == (
        "Neighbouring samples of x have little in common: that is noise, or a motion faster than "
        "its sampling; record at least ten samples between two switches.",
    )


def test_a_clock_in_whole_seconds_is_refused_and_a_time_step_helps():
    with pytest.raises(TableError, match="Column 't' repeats its times in 294 of 300.*--time-step"):
        measured(np.floor(T), X)
    by_step = measured(np.floor(T), X, time=None, time_step=STEP)
    np.testing.assert_allclose(by_step.Xdot, measured(T, X).Xdot, atol=1e-9)
    assert by_step.time_unit == "s"


def test_a_filter_that_needs_even_times_starts_again_after_a_missing_row():
    x = X.copy()
    x[150] = np.nan
    samples = measured(T, x, method="butterworth", cutoff=5.0)
    assert "A gap in time, and a new run after it: row 153." in samples.remarks
    assert preparation(samples)[-1].startswith("Smoothed by a low-pass of 5 Hz; noise of one")
    np.testing.assert_allclose(samples.Xdot[:, 0], np.cos(samples.t), atol=0.01)


def test_a_row_of_no_trajectory_is_left_out():
    run = np.repeat(["a", "b"], 150).astype(object)
    run[40] = ""
    samples = measured(T, X, run=run)
    assert samples.remarks == ("Left out: 1 of 300 rows, with missing values (run 1; row 42).",)
    assert set(samples.groups.tolist()) == {"a", "b"}


def test_nothing_long_enough_is_a_sentence():
    with pytest.raises(ValueError, match="the longest of 60 has 5 samples, and 8 are the least"):
        measured(np.tile(T[:5], 60), X)


# --- smoothing --------------------------------------------------------------------------------


def noisy(seed, size, n=300):
    return X[:n] + size * np.random.default_rng(seed).standard_normal(n)


def test_all_runs_choose_the_window_in_any_order():
    parts = [noisy(1, 1e-6), *(noisy(seed, 0.05) for seed in range(2, 7))]
    windows = set()
    for order in ([0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0], [2, 0, 1, 5, 4, 3]):
        samples = measured(np.tile(T, 6), np.concatenate([parts[k] for k in order]))
        windows.add(samples.smoothing.window)
    alone = measured(T, parts[0]).smoothing.window
    assert len(windows) == 1 and windows.pop() > 1.5 * alone


def test_one_short_run_does_not_keep_the_window_of_the_others_small():
    x = np.concatenate([noisy(1, 0.05), noisy(2, 0.05), X[:20]])
    samples = measured(np.r_[T, T, T[:20]], x)
    assert samples.smoothing.window > 20
    assert samples.remarks[-1].startswith("Left out: 1 run shorter than")


def test_window_and_noise_are_printed():
    samples = measured(T, noisy(0, 0.01))
    window = samples.smoothing.window
    line = preparation(samples)[-1]
    assert line.startswith(f"Smoothed over windows of {window} samples ({window * STEP:.2g})")
    assert "noise of one sample: x 0.01" in line


def test_many_rows_are_smoothed_and_kept():
    """Sixty seconds at 2 kHz: every row is used, and the window grows with the rate."""
    t = np.arange(0, 60, 5e-4)
    x = np.sin(t) + 0.01 * np.random.default_rng(0).standard_normal(len(t))
    samples = measured(t, x)
    assert len(samples.X) > 0.95 * len(t) and samples.decimate == 1
    assert samples.smoothing.window > 500
    # raw differences would be wrong by 28 here
    assert np.abs(samples.Xdot[:, 0] - np.cos(samples.t)).max() < 0.03


def test_the_rows_that_choose_the_window_of_a_long_record_are_not_those_that_it_trims():
    """A decay is largest where it begins, which long windows never see: they would look exact."""
    t = np.arange(600_000.0)
    ((_, _, rows),) = deciding_rows([(np.zeros((len(t), 1)), t)])
    assert len(rows) == pytest.approx(50_000, rel=0.01)
    edge = min(rows[0], len(t) - 1 - rows[-1])
    assert edge > 5_000 and np.diff(rows).max() < 20_000  # spread over the record


def test_two_rows_at_one_time_are_limits_and_a_repeated_row_is_left_out():
    t, x = (
        np.insert(T, [100, 200, 200], T[[100, 200, 200]]),
        np.insert(X, [100, 200, 200], X[[100, 200, 200]]),
    )
    u = np.where(T < T[100], 1.0, -1.0)
    u = np.insert(u, [100, 200, 200], [1.0, -1.0, -1.0])
    table = Table("log", {"t": t, "x": x, "u": u}, {}, rows=np.arange(303) + 2)
    samples = measure(table, Measurement(states=("x",), inputs=("u",), time="t"))
    assert samples.remarks == (
        "Left out: 2 rows with a time that was there before (rows 204, 205).",
        "Two rows at one time are read as the left and the right limit of an event: row 103.",
    )
    assert len(samples.recorded.t) == 301
