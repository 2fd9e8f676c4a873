"""Modes of maps whose rates differ by much less than the noise of a sample."""

import numpy as np
import pytest

from swsysid import HybridAutomatonRegressor

RATES, THRESHOLD, NOISE, N_SAMPLES = (0.0152, 0.0076), 20.0, 0.3, 3000


@pytest.fixture(scope="module")
def filled():
    """A tank that is filled half as fast from its threshold on; and the fit of six recordings."""
    rng, recordings, modes = np.random.default_rng(0), [], []
    for _ in range(6):
        x = [rng.uniform(0.0, 8.0)]
        for _ in range(N_SAMPLES - 1):
            x.append(x[-1] + RATES[int(x[-1] >= THRESHOLD)])
        x = np.array(x)
        modes.append((x >= THRESHOLD).astype(int))
        noisy = x + NOISE * rng.standard_normal(N_SAMPLES)
        recordings.append({"t": np.arange(float(N_SAMPLES)), "x": noisy[:, None]})
    fitted = HybridAutomatonRegressor(discrete_time=True, feature_library=1, random_state=0)
    return fitted.fit(recordings), np.concatenate(modes)


def test_rates_that_go_on_are_modes_and_no_noise_in_the_equation(filled):
    fitted, modes = filled
    # one law with noise in the equation was likelier in the pieces that are searched
    assert fitted.n_modes_ == 2
    same = np.mean(fitted.modes_ == modes)
    # a switch is known to about the noise over the difference of the rates, 40 samples of 3,000
    assert max(same, 1.0 - same) > 1.0 - 40.0 / N_SAMPLES
    rates = [float(law[0] @ [1.0, THRESHOLD]) - THRESHOLD for law in fitted.coef_]
    assert sorted(rates) == pytest.approx(sorted(RATES), abs=3e-4)


def test_their_guard_lies_where_they_surely_were_on_both_sides(filled):
    [transition] = filled[0].automaton_.transitions
    below, above = transition.guard.values(np.array([[19.7, 0.0, 0.0], [20.3, 0.0, 0.0]]))
    # the noise of one sample
    assert below < 0.0 < above
