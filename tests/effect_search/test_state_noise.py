"""Recordings: what the noise of the states makes of the errors is nobody's effect."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from swsysid import SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._effect_model.models import declared_model
from swsysid._effect_search.recording import from_states

# A box and its heater, coarsely sampled: T' = -.1 T + .07 H, H' = .08 (T - H) + .3 u.
BOX = np.array([[-0.1, 0.07], [0.08, -0.08]])
HEAT = np.array([[0.0], [0.3]])
STEP, NOISE = 3.6, (0.03, 0.05)


def declared():
    return SwitchingSystemRegressor(1, feature_library=1, random_state=0)


def recording(seed, n_samples=6000):
    """Measured T and H, the input, and the times."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.0, 6.0, n_samples // 20), 20)
    u = lfilter([0.3], [1.0, -0.7], u)  # no steps between samples
    A, B, C, D, _ = cont2discrete((BOX, HEAT, np.eye(2), np.zeros((2, 1))), STEP, method="foh")
    x, states = np.zeros((n_samples, 2)), np.zeros(2)
    for place, value in enumerate(u):
        x[place] = C @ states + D[:, 0] * value
        states = A @ states + B[:, 0] * value
    return x + NOISE * rng.standard_normal(x.shape), u[:, None], STEP * np.arange(n_samples)


@pytest.fixture(scope="module")
def measured():
    x, u, t = recording(0)
    records = make_records(np.hstack([x, u]), 2, t=t, names=["T", "H", "u"])
    model = declared_model(declared(), records)
    found = from_states(model, records)
    return model, found


def test_the_noise_is_that_of_the_record(measured):
    np.testing.assert_allclose(measured[1].noise.states, NOISE, rtol=0.05)
