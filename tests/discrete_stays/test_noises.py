"""Noise of the sensor and noise in the equation are told apart."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from swsysid._data.recordings import Record
from swsysid._discrete_stays.identify import DiscreteCertainty, identify_stays


def autoregression(law, n, *, sensor, equation, inputs, seed):
    """x[k + 1] = law . (x[k], x[k - 1], ..., u[k]), with both kinds of noise."""
    rng = np.random.default_rng(seed)
    u = inputs * rng.standard_normal((n, 1))
    order = len(law) - 1
    x = np.zeros(n)
    for k in range(order - 1, n - 1):
        lagged = np.append(x[k - order + 1 : k + 1][::-1], u[k])
        x[k + 1] = law @ lagged + equation * rng.standard_normal()
    return Record(np.arange(float(n)), (x + sensor * rng.standard_normal(n))[:, None], u)


def identified(record, lags=0, library=None):
    found = identify_stays([record], lags, library=library, n_modes=1)
    return found, DiscreteCertainty.of(found)


@pytest.mark.parametrize(
    ("law", "sensor", "equation", "inputs"),
    [
        ([0.5, 0.0], 0.0, 0.1, 0.0),
        ([0.8, 1.0], 0.0, 0.3, 1.0),
        ([0.8, 1.0], 0.3, 0.0, 1.0),
        ([0.9, 1.0], 0.3, 0.3, 1.0),
        ([1.2, -0.5, 0.0], 0.0, 0.1, 0.0),
    ],
)
def test_laws_and_both_noises_are_those_of_the_plant(law, sensor, equation, inputs):
    record = autoregression(
        np.array(law), 600, sensor=sensor, equation=equation, inputs=inputs, seed=3
    )
    found, sure = identified(record, len(law) - 2)
    n_terms = len(law) if inputs else len(law) - 1
    coef, errors = found.coef[0, 0, :n_terms], sure.coef[0, 0, :n_terms]
    if len(law) == 3:
        coef, errors = found.coef[0, 0, :2], sure.coef[0, 0, :2]
    assert (np.abs(coef - law[:n_terms]) < 3.0 * errors).all()
    assert errors.max() < 0.1
    # one of them is a tenth of the other at most where it is absent
    size = max(sensor, equation)
    assert sure.noises.sensor[0] == pytest.approx(sensor, abs=0.2 * size)
    assert sure.noises.equation[0] == pytest.approx(equation, abs=0.2 * size)
    alone = sure.noises.sensor_alone, sure.noises.equation_alone
    assert [nats < 2.0 for nats in alone] == [not equation, not sensor]


def test_the_likelihood_is_that_of_a_normal_vector():
    record = autoregression(np.array([0.7, 0.0]), 120, sensor=0.1, equation=0.1, inputs=0.0, seed=1)
    y = record.y[:, 0]
    found, _ = identified(record)
    states = found.searched.found.states
    unit = found.searched.data.target_unit[0]

    def nats(unknowns):
        # samples of a random walk with a law, the first state free: a wide normal one
        a, r, q = unknowns[0], *np.exp(unknowns[1:])
        n = len(y)
        power = np.tril(a ** np.clip(np.subtract.outer(np.arange(n), np.arange(n)), 0, None))
        wide = np.append(10.0, np.full(n - 1, q))
        covariance = (power * wide**2) @ power.T + r**2 * np.eye(n)
        return -multivariate_normal(np.zeros(n), covariance, allow_singular=True).logpdf(y)

    noises = np.append(states.noise, states.tie * states.noise) * unit
    start = [found.coef[0, 0, 0], *np.log(noises)]
    best = minimize(nats, start, method="Nelder-Mead", options={"maxiter": 2000, "fatol": 1e-6})
    # laws have a wide prior, and the ratio climbs in steps of a third
    assert nats(start) - best.fun < 1.0


def test_a_force_beside_a_sensor_of_places_is_told_by_each_state():
    rng, n = np.random.default_rng(5), 500
    x, u = np.zeros((n, 2)), rng.uniform(-1.0, 1.0, (n, 1))
    for k in range(n - 1):
        force = u[k, 0] + 0.5 * rng.standard_normal()
        x[k + 1] = [x[k, 0] + 0.1 * x[k, 1], 0.97 * x[k, 1] - 0.1 * x[k, 0] + 0.1 * force]
    y = x + np.array([0.02, 0.0]) * rng.standard_normal((n, 2))
    found, sure = identified(Record(np.arange(float(n)), y, u), library=1)
    np.testing.assert_allclose(found.coef[0, 1], [0.0, -0.1, 0.97, 0.1], atol=0.02)
    np.testing.assert_allclose(found.coef[0, 0], [0.0, 1.0, 0.1, 0.0], atol=0.005)
    assert sure.noises.sensor[0] == pytest.approx(0.02, rel=0.1)
    assert sure.noises.equation[1] == pytest.approx(0.05, rel=0.1)
    assert sure.noises.equation[0] < 0.005
    assert sure.noises.sensor[1] < 0.01


def test_a_mode_at_rest_tells_no_rate():
    halved, at_rest = np.array([0.5**k for k in range(20)]), np.full(40, 2.0)
    records = [
        Record(np.arange(len(x)), x[:, None], np.empty((len(x), 0))) for x in (halved, at_rest)
    ]
    found = identify_stays(records, 0, library=1)
    errors = DiscreteCertainty.of(found).coef
    resting = int(np.argmax(np.abs(found.coef[:, 0, 0])))
    assert np.isinf(errors[resting]).all()
    assert np.isfinite(errors[1 - resting]).all()
