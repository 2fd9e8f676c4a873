"""Courses keep their switches in order, each in an interval of its own."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid._automaton_search.refined import Course, nodes_of
from swsysid._data.recordings import Record

T = np.arange(6.0)
ANYTIME = (-np.inf, np.inf)


def course(instants, windows=None):
    n = len(instants)
    windows = [ANYTIME] * n if windows is None else windows
    return Course(
        np.arange(n + 1), np.array(instants), np.arange(n), np.ones(n, bool), np.array(windows)
    )


@pytest.mark.parametrize(
    ("moves", "expected"),
    [
        ([0.2, 0.2], [1.7, 3.6]),  # within their intervals
        ([1.0, 1.0], [2.5, 4.4]),  # into others
        ([1.7, 0.0], [np.nextafter(2.0, 0.0), 3.4]),  # not into that of the next one
        ([0.0, -1.7], [1.5, 3.0]),
        ([9.0, 9.0], [np.nextafter(2.0, 0.0), np.nextafter(4.0, 0.0)]),
    ],
)
def test_switches_never_meet(moves, expected):
    moved = course([1.5, 3.4]).moved(np.array([1.5, 3.4]) + moves, T)
    np.testing.assert_allclose(moved.instants, expected, rtol=0.0, atol=1e-12)
    assert moved.modes.tolist() == [0, 1, 2]


def test_a_switch_at_the_last_sample_is_before_it():
    at_the_end = course([1.5, 5.0])
    moved = at_the_end.moved(at_the_end.instants + 0.1, T)
    np.testing.assert_allclose(moved.instants, [1.6, 5.0], rtol=0.0, atol=1e-12)
    assert moved.at(T).tolist() == [0, 0, 1, 1, 1, 2]


def test_a_jump_stays_between_the_samples_at_which_it_is_seen():
    seen = course([2.5], [(2.0, 3.0)])
    early, late = (float(seen.moved(np.array([to]), T).instants[0]) for to in (1.0, 4.0))
    assert early == 2.0
    # the later sample is behind the jump
    assert 2.99 < late < 3.0


def test_two_switches_between_two_samples_have_a_node_between_them():
    x = np.column_stack([T, -T])
    record = Record(T, x, np.empty((6, 0)))
    nodes = nodes_of([course([1.2, 1.4])], [record], [x], per_sample=1, first_step=1.0)
    np.testing.assert_allclose(nodes.recordings.times[0], [0.0, 1.0, 1.3, 2.0, 3.0, 4.0, 5.0])
    assert len(set(nodes.at.tolist())) == 2
    assert nodes.modes.tolist() == [0, 0, 1, 2, 2, 2, 2]
    # it has no sample; where the state is between its neighbours is a first guess
    assert np.isnan(nodes.y[2]).all()
    np.testing.assert_allclose(nodes.recordings.guess[2, 0], [1.3, -1.3])


def test_stays_of_one_mode_have_names_of_their_own():
    # a ball that bounces stays in its mode
    bounces = replace(course([1.5, 3.4]), modes=np.zeros(3, dtype=int))
    assert bounces.at(T).tolist() == [0] * 6
    assert bounces.names(T).tolist() == [0, 0, 1, 1, 2, 2]


@pytest.mark.parametrize("to", [[1.3, 3.2], [1.9, 3.2], [1.05, 3.2], [1.2, 3.9], [0.2, 4.4]])
def test_instants_of_nodes_stay_within_their_windows(to):
    """Whether or not they stay in their interval; as each course says by itself."""
    window, own = np.array([[1.1, 1.5], [3.1, 3.7]]), course([1.2, 3.2], [(1.1, 1.5), (3.1, 3.7)])
    record = Record(T, np.zeros((6, 1)), np.empty((6, 0)))
    nodes = nodes_of([own], [record], [record.y], per_sample=1, first_step=1.0)
    found = nodes.moved(np.array(to)).instants
    np.testing.assert_array_equal(found, own.moved(np.array(to), T).instants)
    assert (window[:, 0] <= found).all() and (found < window[:, 1]).all()
