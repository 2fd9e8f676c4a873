"""Jumps of a state are seen before any law is known, kinks and noise are not taken for them."""

import numpy as np
import pytest

from swsysid._automaton_search.jumps import jumps_of
from swsysid._stays.given import read_given
from swsysid._stays.pieces import cut_at

T = np.arange(0.0, 3.0, 0.01)


def ball(noise=0.0):
    """A ball from 5 m reaches the ground after sqrt(10 / g) s and jumps with .8 of its speed."""
    first = np.sqrt(10.0 / 9.81)
    speed = 0.8 * 9.81 * first
    later = np.maximum(T - first, 0.0)
    h = np.where(T < first, 5.0 - 0.5 * 9.81 * T**2, speed * later - 0.5 * 9.81 * later**2)
    v = np.where(T < first, -9.81 * T, speed - 9.81 * later)
    inside = T < first + 2.0 * speed / 9.81  # one jump
    x = np.column_stack([h, v])[inside]
    x = x + noise * x.std(axis=0) * np.random.default_rng(0).standard_normal(x.shape)
    return read_given([{"t": T[inside], "x": x}], None, None, None), first


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_the_jump_of_a_ball_is_the_interval_of_its_impact(noise):
    given, instant = ball(noise)
    [found] = jumps_of(given)
    np.testing.assert_array_equal(found, [np.floor(instant / 0.01)])


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.9])
def test_a_kink_is_no_jump(noise, share):
    at = T[150] + 0.01 * share
    x = np.where(T < at, T, at + np.exp(3.0 * (T - at)) - 1.0)[:, None]
    x = x + noise * x.std() * np.random.default_rng(1).standard_normal(x.shape)
    [found] = jumps_of(read_given([{"t": T, "x": x}], None, None, None))
    assert not len(found)


def test_pieces_are_cut_after_their_samples_and_short_ones_are_left_out():
    given, _ = ball()
    n = len(given.records[0].t)
    pieces = cut_at(given, [np.array([100, 104])])
    assert list(zip(pieces.first, pieces.last, strict=True)) == [(0, 100), (105, n - 1)]
    assert not pieces.follows.any()  # four samples between the two are in no piece
    assert cut_at(given, [np.array([100])]).follows.tolist() == [False, True]
