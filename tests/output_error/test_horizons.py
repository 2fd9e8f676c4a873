"""Over how long effects are told: rollouts that something leads astray, and those that diverge."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._data.records import make_records
from swsysid._output_error.criterion import Left, go_astray
from swsysid.effects import RateLimit, Stick

STEP, TAU = 3.0, 40.0


def box(seed, n_samples=2400):
    """T' = -(.0015 + .02 lid) (T - 21) + .24 z, z' = (u - z) / 40: a thermostat, five open lids.

    The heater is on for 36 s at a time below 31 K, and the lid is open for 90 s at a time.
    """
    rng = np.random.default_rng(seed)
    t, T, u = STEP * np.arange(n_samples), np.empty(n_samples), np.zeros(n_samples)
    opened = np.linspace(700.0, 6300.0, 5) + rng.uniform(-150.0, 150.0, 5)
    x, z, wait, parts = 24.0, 0.0, 0, 6
    for k, now in enumerate(t):
        T[k] = x
        if wait == 0:
            u[k] = x < 31.0 and not u[k - 1]
            wait = 12 if u[k] else 30 if x < 31.0 else 5
        else:
            u[k] = u[k - 1]
        wait -= 1
        loss = 0.0015 + 0.02 * ((opened <= now) & (now < opened + 90.0)).any()
        for _ in range(parts):
            z += STEP / parts * (u[k] - z) / TAU
            x += STEP / parts * (0.24 * z - loss * (x - 21.0))
    return t, T + 0.03 * rng.standard_normal(n_samples), u


@pytest.mark.nightly
def test_a_lag_is_told_where_what_happens_leads_rollouts_astray():
    t, T, u = box(1)
    search = EffectSearchCV(SwitchingSystemRegressor(1, feature_library=1, random_state=0))
    search.fit(T[:, None], t=t, inputs=u[:, None])
    lag = next(one for one in search.effects_ if one.kind == "lag")
    assert lag.p_value < 1e-6
    # a law that knows of no lid is told 30 s for 40
    assert lag.parameters["time_constant"] == pytest.approx(TAU, rel=0.35)


def left(samples):
    return Left(np.asarray(samples)[:, None], (np.arange(len(samples)),))


def test_rollouts_go_astray_where_they_surely_leave_more_or_diverge():
    noise = np.random.default_rng(0).standard_normal(400)
    assert go_astray(left(noise), left(2.0 * noise), 0.01)
    assert not go_astray(left(2.0 * noise), left(noise), 0.01)
    diverged = np.where(np.arange(400) < 390, noise, np.inf)
    assert go_astray(left(noise), left(diverged), 0.01)
    # a single stretch that is worse by chance decides nothing
    once = noise * np.where(np.arange(400) < 20, 1.3, 1.0)
    assert not go_astray(left(noise), left(once), 0.01)


@pytest.mark.parametrize("effect", [Stick(), RateLimit()], ids=lambda one: one.kind)
def test_the_rate_of_a_velocity_is_a_force_that_neither_sticks_nor_has_a_limit(effect):
    t = np.linspace(0.0, 10.0, 500)
    records = make_records(np.column_stack([np.cos(t), -np.sin(t)]), 2, t=t, names="xv")
    assert list(effect.places(records)) == [0, 1]
    assert list(effect.places(replace(records, positions={0: 1}))) == [0]
