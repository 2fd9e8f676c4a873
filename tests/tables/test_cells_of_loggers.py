"""Cells as loggers write them: words, quantities, durations and infinities are what they mean."""

import numpy as np
import pytest

from swsysid._tables.cells import column_of
from swsysid._tables.readers import read_table
from swsysid._tables.table import TableError


def table(tmp_path, rows):
    path = tmp_path / "log.csv"
    path.write_text("\n".join(rows), encoding="utf-8")
    return read_table(path)


@pytest.mark.parametrize(
    ("zero", "one"),
    [("OFF", "ON"), ("closed", "open"), ("No", "Yes"), ("b'OFF'", "b'ON'"), ("LOW", "high")],
)
def test_two_words_that_everybody_reads_alike_are_0_and_1_and_said(tmp_path, zero, one):
    found = table(tmp_path, ["t,u,x", f"0,{one},1", "1,,2", f"2,{zero},3", f"3,{one},4"])
    spelled = found.spelled(["u", "x"])
    np.testing.assert_array_equal(spelled.numbers("u")[:, 0], [1.0, np.nan, 0.0, 1.0])
    bare = [word.removeprefix("b").strip("'") if "'" in word else word for word in (zero, one)]
    assert spelled.remarks == (f"Words of u: {bare[0]} is 0, {bare[1]} is 1.",)
    assert found.labels("u")[0] == one  # a name of a trajectory stays what it is


def test_other_words_are_refused_and_listed(tmp_path):
    found = table(tmp_path, ["t,u", "0,up", "1,down", "2,up", "3,up"]).spelled("u")
    with pytest.raises(TableError, match="its words are 'up', 'down', and which number each"):
        found.numbers("u")


@pytest.mark.parametrize("mark", [".", ","])
def test_marks_between_thousands_alone_are_told_by_a_number_that_has_two(tmp_path, mark):
    cells = [number.replace(".", mark) for number in ("0.000", "101.000", "1.002.000")]
    found = table(tmp_path, ["t;x", *(f"{cell};{k}" for k, cell in enumerate(cells))])
    assert found.numbers(["t"])[:, 0].tolist() == [0.0, 101e3, 1002e3]
    assert column_of(cells[:2], mark)[0].tolist() == [0.0, 101.0]
    assert column_of([*cells, f"1{mark}5"])[0].dtype == object


def test_a_garbled_line_amid_two_words_is_what_is_asked_about(tmp_path):
    found = table(tmp_path, ["t,u", "0,ON", "1,OFF", "2,60.0\u00b0C", "3,ON"]).spelled(["u"])
    with pytest.raises(TableError, match="row 4 holds '60.0.C'; if that means a missing"):
        found.numbers("u")


def test_bytes_of_an_archive_are_words(tmp_path):
    np.savez(tmp_path / "log.npz", u=np.array([b"ON", b"OFF", b"ON"]), x=np.arange(3.0))
    found = read_table(tmp_path / "log.npz").spelled("u")
    assert found.numbers("u")[:, 0].tolist() == [1.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (["0 sec", "0.01 sec", "1e-05 sec"], [0.0, 0.01, 1e-5]),
        (["999 us", "1 ms", "1.5ms"], [999e-6, 1e-3, 1.5e-3]),
        (["PT0.5S", "PT1M0S"], [0.5, 60.0]),
        (["0 days 00:00:00.250000", "1 days 00:00:01"], [0.25, 86401.0]),
        (["0:01:02.5", "0:01:03"], [0.0, 0.5]),  # as a clock: since the first
        (["59:59.5", "00:00.5"], [0.0, 1.0]),  # of which a spreadsheet shows no hours
    ],
)
def test_durations_are_seconds(cells, seconds):
    values, unit, _ = column_of(cells)
    np.testing.assert_allclose(values, seconds, rtol=1e-12, atol=1e-12)
    assert unit == "s"


@pytest.mark.parametrize(
    "cells",
    [
        ["Dec 02 2018 23:59:00", "Dec 03 2018 00:00:00.5"],  # a fermenter's controller
        ["Sun Dec  2 23:59:00 2018", "Mon Dec  3 00:00:00.5 2018"],  # ctime of C
        ["Sun Dec  2 23:59:00 UTC 2018", "Mon Dec  3 00:00:00.5 UTC 2018"],  # date of Unix
        ["Sun, 02 Dec 2018 23:59:00 +0000", "Mon, 03 Dec 2018 01:00:00.5 +0100"],  # of mails
        ["02-Dec-2018 23:59:00", "03-Dec-2018 00:00:00,5"],  # datestr of MATLAB
        ["02-Dec-18 11:59:00 PM", "03-Dec-18 00:00:00.5"],
        ["Dec 2, 2018 23:59:00", "December 3, 2018 00:00:00.5"],
        ["2018/12/2 23:59", "2018/12/3 00:00:00.5"],  # spreadsheets, where the year leads
    ],
)
def test_dates_with_a_word_or_a_year_that_leads_are_those_days(cells):
    values, unit, start = column_of(cells)
    np.testing.assert_allclose(values, [0.0, 60.5], rtol=0.0, atol=1e-9)
    assert unit == "s"
    assert start == pytest.approx(1543795140.0, abs=1e-6)  # 2 December 2018, 23:59


def test_words_with_numbers_are_no_dates():
    cells = ["March 5", "Mar 5 2", "decay 2 2018"]
    assert column_of(cells)[0].tolist() == cells


def test_a_file_of_quantities_has_their_units(tmp_path):
    rows = [f"{0.5 * k:g} sec,{k} mV,run {k}" for k in range(9)]
    found = table(tmp_path, ["t,u,label", *rows])
    np.testing.assert_allclose(found.numbers("tu"), [[0.5 * k, k] for k in range(9)])
    assert (found.unit("t"), found.unit("u")) == ("s", "mV")
    german = table(tmp_path, ["t;u", *(f"0,{k} s;{k},5 V" for k in range(9))])
    np.testing.assert_allclose(german.numbers("tu"), [[0.1 * k, k + 0.5] for k in range(9)])


def test_infinities_of_oscilloscopes_are_numbers(tmp_path):
    found = table(tmp_path, ["t,u", "0,∞", "1,-∞", "2,inf", "3,-1.#INF", "4,2.5"])
    assert found.numbers("u")[:, 0].tolist() == [np.inf, -np.inf, np.inf, -np.inf, 2.5]


def test_nanoseconds_of_the_calendar_lose_no_digit(tmp_path):
    start = 1_772_366_400_000_000_000
    found = table(tmp_path, ["t,x", *(f"{start + 1000 * k + k % 2},{k}" for k in range(9))])
    steps = np.diff(found.columns["t"])  # floats are 256 ns apart here
    assert steps.tolist() == [1001, 999] * 4
