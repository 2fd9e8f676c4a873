"""Rows of recordings with their lags."""

import numpy as np
import pytest

from swsysid._data.recordings import Record
from swsysid._discrete_stays.lagged import lagged_rows


def record(x, u=None):
    x = np.asarray(x, dtype=float).reshape(len(x), -1)
    u = np.empty((len(x), 0)) if u is None else np.asarray(u, dtype=float).reshape(len(x), -1)
    return Record(np.arange(len(x)) * 1.0, x, u)


def test_columns_are_newest_first_and_targets_come_next():
    rows = lagged_rows([record([[1, 10], [2, 20], [3, 30]], [7, 8, 9])], lags=1)
    assert rows.names == ("x0[k]", "x1[k]", "x0[k-1]", "x1[k-1]", "u0[k]", "u0[k-1]")
    np.testing.assert_array_equal(rows.columns, [[2, 20, 1, 10, 8, 7]])
    np.testing.assert_array_equal(rows.targets, [[3, 30]])


def test_no_row_reaches_across_two_recordings():
    rows = lagged_rows([record([1, 2, 3]), record([10, 20, 30, 40])], lags=1)
    np.testing.assert_array_equal(rows.columns, [[2, 1], [20, 10], [30, 20]])
    np.testing.assert_array_equal(rows.recording, [0, 1, 1])
    np.testing.assert_array_equal(rows.sample, [1, 1, 2])
    np.testing.assert_array_equal(rows.begins, [True, True, False])


def test_rows_with_a_missing_value_are_left_out():
    rows = lagged_rows([record([1, 2, np.nan, 4, 5, 6, 7])], lags=1)
    np.testing.assert_array_equal(rows.sample, [4, 5])
    missing = lagged_rows([record([1, 2, 3, np.nan, 5, 6, 7, 8])], lags=1)
    np.testing.assert_array_equal(missing.sample, [1, 5, 6])
    np.testing.assert_array_equal(missing.begins, [True, True, False])


def test_names_of_channels_are_kept():
    rows = lagged_rows([record([1, 2, 3], [4, 5, 6])], lags=0, channels=["level", "valve"])
    assert rows.names == ("level[k]", "valve[k]")


def test_recordings_that_are_too_short_are_refused():
    with pytest.raises(ValueError, match="no recording has 4 samples"):
        lagged_rows([record([1, 2, 3]), record([1, np.nan, 2, 3])], lags=2)
