"""What is said where no effect is found."""

import numpy as np
import pytest
from scipy.signal import lsim

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid.effects import CoulombFriction, QuadraticDrag

NOISE = 0.5


def test_velocities_may_leave_more_than_rollouts_do():
    """A lag of two samples, of an input that jumps: what smooths velocities blurs the jumps."""
    t, rng, lag = 0.005 * np.arange(400), np.random.default_rng(0), 0.01
    recordings = []
    for _ in range(6):
        u = 100.0 * np.repeat(rng.uniform(-1.0, 1.0, 8), 50)
        _, x, _ = lsim(([1.0], [lag, 1.0]), u, t, interp=True)
        x = x + NOISE * rng.standard_normal(len(t))
        recordings.append({"t": t, "x": x[:, None], "inputs": u[:, None]})
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)
    report = EffectSearchCV(declared, effects=[CoulombFriction()]).fit(recordings).report_
    assert "free rollouts of the model leave nothing but noise, but velocities" in report.summary
    assert report.errors[0]["held_out"][0] == pytest.approx(NOISE, rel=0.1)
    assert not report.residual_before.clean


def test_what_chance_may_explain_is_told_with_how_much_more_would_tell():
    """v' = u - .5 v - .3 v |v|, asked for certainty that so short a record cannot give."""
    rng, step = np.random.default_rng(0), 0.02
    u, v = np.repeat(rng.uniform(-2.0, 2.0, 12), 50), np.zeros(600)
    for k in range(len(v) - 1):
        v[k + 1] = v[k] + step * (u[k] - 0.5 * v[k] - 0.3 * v[k] * abs(v[k]))
    v += 0.01 * rng.standard_normal(len(v))
    declared = SwitchingSystemRegressor(1, feature_library=1, random_state=0)

    def asked(significance):
        search = EffectSearchCV(
            declared, effects=[QuadraticDrag()], significance=significance, input_hold="zero"
        )
        return search.fit(v[:, None], t=step * np.arange(len(v)), inputs=u[:, None])

    found, most = asked(0.01), 1e-300
    assert [effect.kind for effect in found.effects_] == ["quadratic_drag"]
    assert found.report_.unsure is None
    report = asked(most).report_
    near = report.unsure
    assert not report.effects
    assert near["effect"] == "quadratic drag of x0 in x0'"
    nats = np.log(2.0) - np.log(near["p_value"])  # of one kind and place, by two disturbances
    assert near["longer"] == pytest.approx(1.0 + (np.log(near["p_value"]) - np.log(most)) / nats)
    assert 0.5 < near["share"] < 1.0
    assert report.summary.startswith("No effect is sure. Nearest is quadratic drag of x0 in x0'")
