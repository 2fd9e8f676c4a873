"""A law and the slow force beneath it: dense matrices, and states that remember the force."""

import numpy as np
import pytest
from scipy.signal import lfilter

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._effect_search.coloured_noise import Coloured, Stretches, beneath_a_law
from swsysid.datasets import make_undeclared
from swsysid.effects import Delay, Drift, Lag, UnmeasuredDisturbance


def test_the_inverse_covariance_is_that_of_the_dense_matrix():
    rng = np.random.default_rng(0)
    t, stretch = np.sort(rng.uniform(0.0, 3.0, 12)), np.repeat([0, 1], 6)
    model, where = Coloured(1.3, 0.7, 0.4), Stretches(t, stretch)
    force = 1.3**2 * np.exp(-np.abs(t[:, None] - t) / 0.7) * (stretch[:, None] == stretch)
    columns = rng.standard_normal((12, 3))
    dense = np.linalg.solve(force + 0.4**2 * np.eye(12), columns)
    np.testing.assert_allclose(model.precise(columns, where), dense, rtol=1e-9, atol=1e-12)
    white = Coloured(0.0, 1.0, 0.4)
    np.testing.assert_allclose(white.precise(columns, where), columns / 0.4**2, rtol=1e-12)


def _remembering(seed):
    """Two runs of x(k+1) = 0.7 x(k) + 0.8 u(k) + d(k) + noise; d is forgotten after ten steps."""
    rng = np.random.default_rng(seed)
    kept, x, force = np.exp(-0.1), np.zeros((2, 601)), np.zeros((2, 601))
    u = rng.standard_normal((2, 601))
    for step in range(600):
        shock = np.sqrt(1.0 - kept**2) * rng.standard_normal(2)
        force[:, step + 1] = kept * force[:, step] + shock
        noise = 0.3 * rng.standard_normal(2)
        x[:, step + 1] = 0.7 * x[:, step] + 0.8 * u[:, step] + force[:, step + 1] + noise
    where = Stretches(np.tile(np.arange(600.0), 2), np.repeat([0, 1], 600))
    features = np.column_stack([x[:, :-1].ravel(), u[:, :-1].ravel()])
    return features, x[:, 1:].ravel(), where


@pytest.mark.parametrize("seed", range(4))
def test_states_that_remember_the_force_do_not_bias_the_law(seed):
    features, following, where = _remembering(seed)
    biased = np.linalg.lstsq(features, following, rcond=None)[0]
    model, left = beneath_a_law(features, following, where)
    coef = np.linalg.lstsq(features, following - left, rcond=None)[0]
    # least squares gives the state what the force does; the other has a standard error of 0.03
    assert biased[0] > 0.9
    np.testing.assert_allclose(coef, [0.7, 0.8], atol=0.08)
    assert model.time_constant == pytest.approx(10.0, rel=0.6)
    assert model.noise == pytest.approx(0.3, rel=0.25)


# The states and the input a while ago say what the force was: lags and delays of the input lower
# the held-out error by a third and more, and none of them is there. Of the second record several
# together leave no force behind that is surely slow.
@pytest.mark.parametrize("seed", [60, 80])
@pytest.mark.nightly
def test_inputs_of_the_past_that_only_tell_the_force_are_no_lag(seed):
    data = make_undeclared(unlisted="random_disturbance", system="discrete", random_state=seed)
    library = [Lag(), Delay(), Drift(), UnmeasuredDisturbance()]
    search = EffectSearchCV(data.estimator, effects=library)
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    assert [found.kind for found in search.effects_] == ["unmeasured_disturbance"]


def _with_a_fast_force(seed, filtered):
    """Runs of x(k+1) = 0.8 x(k) + v(k) / 2 + d(k); d is forgotten after two steps.

    v is the input u, or eight times a lag of it of three steps.
    """
    rng, runs = np.random.default_rng(seed), []
    for number in range(6):
        u = lfilter([1.0], [1.0, -0.7], rng.standard_normal(201))
        force = 0.5 * lfilter([1.0], [1.0, -0.6], rng.standard_normal(201))
        acting = lfilter([2.4], [1.0, -0.7], u) if filtered else u
        x = lfilter([0.0, 1.0], [1.0, -0.8], 0.5 * acting + force)
        noisy = x[1:] + 0.1 * rng.standard_normal(200)
        runs.append(
            np.column_stack([x[:-1], u[:-1], noisy, np.arange(200.0), np.full(200, number)])
        )
    return np.vstack(runs)


@pytest.mark.parametrize("seed", [1, 5])
@pytest.mark.parametrize("filtered", [False, True])
def test_a_force_too_fast_to_be_told_from_noise_is_no_lag_either(seed, filtered):
    x, u, following, t, groups = _with_a_fast_force(seed, filtered).T
    declared = SwitchingSystemRegressor(1, discrete_time=True)
    search = EffectSearchCV(declared, effects=[Lag(), Delay(), Drift(), UnmeasuredDisturbance()])
    search.fit(np.column_stack([x, u]), following[:, None], t=t, groups=groups)
    assert [found.kind for found in search.effects_] == (["lag"] if filtered else [])
