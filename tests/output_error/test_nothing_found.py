"""What is said where no effect is found."""

import numpy as np
import pytest
from scipy.signal import lsim

from swsysid import EffectSearchCV, SwitchingSystemRegressor
from swsysid.effects import CoulombFriction

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
