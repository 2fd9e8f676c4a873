"""A few samples that follow no law are counted, and not in the noise that is told beside them."""

import numpy as np
import pytest

from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier

NOISE = 0.01


def test_noise_is_that_of_the_samples_that_follow_the_law():
    t = 0.05 * np.arange(600)
    x = np.column_stack([np.cos(t), -np.sin(t)])
    x = x + NOISE * np.random.default_rng(0).standard_normal(x.shape)
    x[[100, 250, 400], 0] += 0.5
    estimator = SwitchingSystemRegressor(n_modes=1, random_state=0)
    report = TrajectoryIdentifier(estimator).fit(x, t).report_
    assert any(said.startswith("3 samples of 600 follow no law") for said in report.doubts)
    # with the three the root mean square of the first channel would be .037
    assert report.noise == pytest.approx([NOISE, NOISE], rel=0.1)
    assert (report.excess < 1.1).all()
