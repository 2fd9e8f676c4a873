"""Recordings as lists of tables are those as a list of dicts."""

import numpy as np
import pandas as pd
import pytest

from swsysid._stays.given import read_given

CLOCK = np.arange(0.0, 5.0, 0.1)


def tables(seed=0):
    rng = np.random.default_rng(seed)
    lengths = 50, 40, 30
    states = [rng.standard_normal((n, 2)) for n in lengths]
    return states, [CLOCK[:n] for n in lengths], [rng.standard_normal((n, 1)) for n in lengths]


@pytest.mark.parametrize("kind", [np.asarray, pd.DataFrame])
def test_lists_of_tables_are_recordings(kind):
    states, t, inputs = tables()
    dicts = [{"x": x, "t": own, "inputs": u} for x, own, u in zip(states, t, inputs, strict=True)]
    wanted = read_given(dicts, None, None, None)
    given = read_given([kind(x) for x in states], t, None, [kind(u) for u in inputs])
    assert given.labels == wanted.labels
    for one, other in zip(given.records, wanted.records, strict=True):
        np.testing.assert_array_equal(one.y, other.y)
        np.testing.assert_array_equal(one.t, other.t)
        np.testing.assert_array_equal(one.u, other.u)


def test_one_clock_serves_all():
    states = [x[:30] for x in tables()[0]]
    given = read_given(states, CLOCK[:30], None, None)
    assert [len(one.t) for one in given.records] == [30, 30, 30]


def test_a_list_of_rows_is_one_recording():
    states, t, _ = tables()
    assert read_given(states[0].tolist(), t[0], None, None).n_recordings == 1


def test_lists_of_different_lengths_are_refused():
    states, t, inputs = tables()
    with pytest.raises(ValueError, match="list of 3 recordings and inputs is none of as many"):
        read_given(states, t, None, inputs[:2])
    with pytest.raises(ValueError, match="list of 3 recordings and t is none of as many"):
        read_given(states, t[:2], None, inputs)
    with pytest.raises(ValueError, match="leave out groups"):
        read_given(states, t, np.zeros(50), None)
