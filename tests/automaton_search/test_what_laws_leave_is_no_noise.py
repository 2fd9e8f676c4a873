"""Laws that lack something are judged by the noise that samples show."""

import numpy as np
import pytest

from swsysid import HybridAutomatonRegressor
from swsysid._results import MisfitWarning


def test_rollouts_of_a_law_that_lacks_a_mode_are_warned_of():
    """x' = -x above 0 and -4 x below, by one law: what it leaves is no noise of the samples."""
    t, noise = np.arange(0.0, 4.0, 0.02), 0.005
    starts = np.array([2.0, 1.5, 1.0, -2.0, -1.5, -1.0])
    rates = np.where(starts > 0.0, 1.0, 4.0)
    x = starts[:, None] * np.exp(-rates[:, None] * t)
    x += noise * np.random.default_rng(0).standard_normal(x.shape)
    recordings = [{"t": t, "x": own[:, None]} for own in x]
    with pytest.warns(MisfitWarning, match="By itself the automaton leaves"):
        found = HybridAutomatonRegressor(1, feature_library=1, random_state=0).fit(recordings)
    report = found.report_
    assert report.excess > 10.0 and not report.rollouts.holds
    # the rollouts leave as many times the noise as the laws, up to a tenth of it
    assert report.rollouts.left[0] == pytest.approx(report.excess, rel=0.1)
