"""What drives states is noise, or a law that is missing."""

import warnings

import numpy as np
import pytest
from scipy.signal import lfilter

from swsysid import HybridAutomatonRegressor, MisfitWarning
from swsysid._discrete_stays.persistence import goes_on

NO_BEGINS = np.arange(4000) == 0


@pytest.mark.parametrize("scale", [1e-6, 1.0])
def test_what_goes_on_is_no_noise_in_any_unit(scale):
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((4000, 2))
    slow = 0.3 * np.sign(np.sin(np.arange(4000) / 40.0))
    tie = np.ones(2)
    assert not goes_on(scale * noise, NO_BEGINS, 1, tie)
    assert goes_on(scale * (noise + np.outer(slow, [0.0, 1.0])), NO_BEGINS, 1, tie)


def test_noise_goes_on_in_one_of_a_thousand():
    """Of 200 draws at most 3: more have a probability of 6e-5 at a level of 1e-3."""
    draws = np.random.default_rng(1).standard_normal((200, 4000, 1))
    assert sum(goes_on(one, NO_BEGINS, 1, np.ones(1)) for one in draws) <= 3


def test_what_a_sensor_leaves_in_states_does_not_go_on():
    """Noise that is remembered for ten rows: of sums of eighty neighbours are alike, by .06."""
    noise = np.random.default_rng(4).standard_normal(1_000_000)
    left = lfilter([1.0], [1.0, -np.exp(-0.1)], noise)[:, None]
    assert not goes_on(left, np.arange(len(left)) == 0, 1, np.array([0.01]))


def test_few_rows_tell_nothing():
    assert not goes_on(np.ones((60, 1)), NO_BEGINS[:60], 1, np.ones(1))


def spring(switched, noise):
    """A mass on a spring that pulls to one side or, with memory, to the other; its position."""
    x, v, side, rows = 0.5, 0.0, 1.0, []
    for _ in range(6000):
        rows.append(x)
        if switched and abs(x) > 1.0:
            side = -np.sign(x)
        v += 0.01 * (2.0 * side - 0.5 * v)
        x += 0.01 * v
    rows = np.array(rows)
    return rows[:, None] + noise * rows.std() * np.random.default_rng(2).normal(size=(6000, 1))


def test_a_missing_mode_is_no_noise_that_drives():
    """One law of two: noise in the equation stands for the other, and rollouts leave."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        found = HybridAutomatonRegressor(1, lags=1, discrete_time=True).fit(spring(True, 0.01))
    noises = found.report_.noises
    assert noises.drives and noises.goes_on
    [told] = [one for one in said if issubclass(one.category, MisfitWarning)]
    assert "mode 0" in str(told.message)


def test_noise_that_drives_is_held_against_no_law():
    rng, y = np.random.default_rng(3), np.zeros(1500)
    for k in range(2, 1500):
        y[k] = 1.6 * y[k - 1] - 0.7 * y[k - 2] + 0.1 * rng.standard_normal()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = HybridAutomatonRegressor(1, lags=1, discrete_time=True).fit(y[:, None])
    assert found.report_.noises.drives and not found.report_.noises.goes_on
