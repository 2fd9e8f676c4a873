"""What is looked for in recordings of one law."""

import numpy as np
import pytest

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid._output_error.scan import is_sought
from swsysid.effects import CoulombFriction, UnknownFunction, all_effects


def test_all_is_sought_but_what_needs_switches_or_predicts_nothing():
    left = {effect.kind for effect in all_effects() if not is_sought(effect)}
    assert left == {"guard_hysteresis", "reset", "extra_mode", "unmeasured_disturbance"}


def test_a_function_without_a_name_is_found_in_a_recording():
    """x' = u - 0.5 x - 2 exp(-(4 (x - 1))^2): what holds the state back about one."""
    rng, step = np.random.default_rng(0), 0.02
    u = np.repeat(rng.uniform(-1.0, 2.0, 60), 40)
    x = np.zeros(len(u))
    for k in range(len(u) - 1):
        held = 2.0 * np.exp(-((4.0 * (x[k] - 1.0)) ** 2))
        x[k + 1] = x[k] + step * (u[k] - 0.5 * x[k] - held)
    x += 0.01 * rng.standard_normal(len(x))
    plain = SwitchingSystemRegressor(n_modes=1, feature_library=1)
    search = EffectSearchCV(plain, effects=[CoulombFriction(), UnknownFunction()], random_state=0)
    search.fit(x[:, None], t=step * np.arange(len(x)), inputs=u[:, None])
    assert [(effect.kind, effect.place) for effect in search.effects_] == [
        ("unknown_function", "x0")
    ]
    before, after = (model["held_out"][0] for model in search.report_["errors"])
    assert after < 0.3 * before
    assert after == pytest.approx(0.01, abs=0.003)  # the noise, and what few knots leave


@pytest.mark.nightly
def test_what_drains_from_a_tank_goes_with_the_root_of_its_level():
    """x' = .35 u - .05 sqrt(x) (Torricelli), empty at times, where noise has both signs."""
    rng, n_samples, parts = np.random.default_rng(0), 1200, 5
    u, x, levels = np.repeat(rng.uniform(0.0, 1.0, 12), n_samples // 12), 20.0, []
    u[800:1200] = 0.0
    for pumped in u:
        levels.append(x)
        for _ in range(parts):
            x = max(x + (0.35 * pumped - 0.05 * np.sqrt(x)) / parts, 0.0)
    seen = np.array(levels) + 0.03 * rng.standard_normal(n_samples)
    assert seen.min() < 0.0
    plain = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    search = EffectSearchCV(plain).fit(seen[:, None], t=np.arange(1200.0), inputs=u[:, None])
    first = search.effects_[0]
    assert (first.kind, first.place) == ("power_law", "x0")
    assert first.parameters["exponent"] == pytest.approx(0.5, abs=0.05)  # a grid of 17 is coarser
    before, after = (search.report_["errors"][k]["held_out"][0] for k in (0, 1))
    assert after < 0.2 * before
