"""Windows within stays: their slopes, their means, and how long they may be."""

import numpy as np
import pytest

from swsysid._data.windows import Windows, stays_of
from swsysid._effect_search.recording import _longest
from swsysid.differentiation._smoothing import local_polynomial


def test_inside_a_stay_the_slopes_are_those_of_savitzky_and_golay():
    t = 0.1 * np.arange(40)
    x = np.random.default_rng(0).standard_normal((40, 2))
    windows = Windows(t, [np.arange(40)], 4)
    jets, half = local_polynomial(9, 2)(x, t, None)
    inner = windows.whole()
    np.testing.assert_array_equal(inner, np.arange(half, 40 - half))
    np.testing.assert_allclose((windows.values @ x)[inner], jets[0], atol=1e-12)
    np.testing.assert_allclose((windows.slopes @ x)[inner], jets[1], atol=1e-11)


@pytest.mark.parametrize("even", [True, False])
def test_no_window_reaches_into_another_stay(even):
    rng = np.random.default_rng(1)
    t = np.arange(30.0) if even else np.cumsum(rng.uniform(0.5, 1.5, 30))
    modes = np.repeat([0, 1, 0], [12, 3, 15])
    windows = Windows(t, stays_of(modes, [np.arange(30)]), 3)
    # a parabola of its own in each stay is kept as it is, however far the stays are apart
    x = 1e3 * modes + (0.2 * t**2 - t) * (1 + modes)
    slope = (0.4 * t - 1.0) * (1 + modes)
    np.testing.assert_allclose(windows.values @ x, x, atol=1e-8)
    np.testing.assert_allclose(windows.slopes @ x, slope, atol=1e-8)
    np.testing.assert_array_equal(windows.whole(), [*range(3, 9), *range(18, 27)])


def test_a_mean_is_the_slope_of_the_integral():
    rng = np.random.default_rng(2)
    t = np.cumsum(rng.uniform(0.5, 1.5, 25))
    column = rng.standard_normal(25)
    integral = np.append(0.0, np.cumsum(0.5 * np.diff(t) * (column[1:] + column[:-1])))
    windows = Windows(t, [np.arange(11), np.arange(11, 25)], 2)
    np.testing.assert_allclose(windows.means @ column, windows.slopes @ integral, atol=1e-12)
    # of a constant the mean is the constant
    np.testing.assert_allclose(windows.means @ np.ones(25), 1.0, atol=1e-12)


def test_samples_alone_in_their_stay_are_left_as_they_are():
    windows = Windows(np.arange(3.0), [np.array([0]), np.array([1]), np.array([2])], 2)
    x = np.array([3.0, -1.0, 5.0])
    np.testing.assert_array_equal(windows.values @ x, x)
    np.testing.assert_array_equal(windows.means @ x, x)
    np.testing.assert_array_equal(windows.slopes @ x, 0.0)
    assert not len(windows.whole())


def test_a_window_of_two_thirds_of_a_stay_knows_most():
    # (L - w + 1) w^2 is largest at w = 2 (L + 1) / 3, if the rows are enough
    many = np.full(200, 29)
    assert _longest([many]) == 20
    # a mode of short stays has its share: (29 - w + 1) w^2 (14 - w + 1) w^2
    w = np.arange(7, 15)
    assert _longest([many, np.full(200, 14)]) == w[np.argmax((30 - w) * (15 - w) * w**4.0)]
    assert _longest([np.array([4])]) == 7
