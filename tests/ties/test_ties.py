"""Values that rounding has parted are ties, and the first of them is taken."""

import numpy as np
import pytest

from swsysid._ties import first_largest, first_least, largest_first, least_of

EPS = np.finfo(float).eps


@pytest.mark.parametrize("rounding", [-4.0 * EPS, 0.0, 4.0 * EPS])
def test_the_first_of_equal_values_is_taken_whatever_their_last_bits(rounding):
    values = np.array([2.0, 1.0, 1.0 + rounding, 3.0, 3.0 - rounding])
    for scale in (1e-12, 1.0, 1e12):
        assert first_least(scale * values) == 1
        assert first_largest(scale * values) == 3
        assert largest_first(scale * values).tolist() == [3, 4, 0, 1, 2]
    assert least_of("abcde", lambda one: values["abcde".index(one)]) == "b"


def test_values_that_differ_are_told_apart():
    values = np.array([1.0, 1.0 - 1e-8, 1.0 + 1e-8])  # ten times what counts as rounding
    assert (first_least(values), first_largest(values)) == (1, 2)
    assert largest_first(values).tolist() == [2, 0, 1]


def test_of_ties_the_next_value_decides():
    options = [(1.0, 5), (1.0 + EPS, 2), (1.0 - EPS, 2), (2.0, 0)]
    assert least_of(options, lambda one: one[0], lambda one: one[1]) == (1.0 + EPS, 2)


def test_tables_are_read_along_an_axis():
    table = np.array([[1.0, 4.0], [1.0 + EPS, 2.0], [0.0, 4.0]])
    assert first_largest(table, axis=0).tolist() == [0, 0]
    assert first_least(table, axis=1).tolist() == [0, 0, 0]


def test_what_is_no_number_never_wins_against_one():
    values = [np.nan, np.inf, 2.0, -np.inf]
    assert (first_least(values), first_largest(values)) == (3, 1)
    assert first_least([np.nan, np.inf, 2.0]) == 2
    assert least_of([np.nan, 1.0], float) == 1.0
    assert first_least([np.inf, np.inf]) == 0
