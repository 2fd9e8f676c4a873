"""One more mode: the law of the segment that the others explain worst."""

import numpy as np

from swsysid import SwitchingSystemRegressor
from swsysid._stays.given import read_given
from swsysid._stays.merged import grown
from swsysid._stays.search import Search
from swsysid._stays.settings import StaySettings

STEP, NOISE = 0.1, 0.01


def test_one_more_law_has_the_slope_of_the_worst_segment():
    # rises by one a second, and from 12 s to 15 s falls by four
    t = STEP * np.arange(240)
    slope = np.where((t >= 12.0) & (t < 15.0), -4.0, 1.0)
    x = np.concatenate([[0.0], np.cumsum(slope[:-1]) * STEP])
    x = x + NOISE * np.random.default_rng(0).standard_normal(len(x))
    given = read_given(x[:, None], t, None, None)
    estimator = SwitchingSystemRegressor(1, feature_library=0, coupling=0.0)
    search = Search(estimator, given, 1, None, StaySettings(), lambda: None, surfaces=False)
    found = search.identified()
    model, free = grown(found, search.base.recordings)
    assert model.coef_.shape == free.shape == (2, 1, 1) and free.all()
    np.testing.assert_array_equal(model.coef_[0], found.estimate.laws.coef[0])
    # the parts are 3 s long, so that the worst one is the fall and nothing else
    np.testing.assert_allclose(model.coef_[1], -4.0, atol=0.25)
