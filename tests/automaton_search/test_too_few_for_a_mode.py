"""A mode must say more than its law takes, and what cannot be told never runs for ever."""

import numpy as np
import pandas as pd
import pytest

from swsysid import EffectSearchCV, HybridAutomatonRegressor


def frames():
    """Heights of a ball in pixels, rounded, by the number of the frame: one a time unit."""
    t, pixels = np.arange(108.0), []
    begin, up, level = 0.0, 0.0, 900.0
    for k in t:
        while True:
            h = level + up * (k - begin) - 0.5 * 6.54 * (k - begin) ** 2
            if h >= 0.0 or k == begin:
                break
            arrives = np.sqrt(up**2 + 2.0 * 6.54 * level)
            begin, up, level = begin + (up + arrives) / 6.54, 0.8 * arrives, 0.0
        pixels.append(round(1020.0 - h))
    return t, np.array(pixels)[:, None]


@pytest.mark.nightly
def test_a_ball_in_pixels_and_frames():
    t, y = frames()
    found = HybridAutomatonRegressor(order=2, random_state=0).fit(y, t)
    [impact] = found.transitions_
    assert found.n_modes_ == 1
    assert found.coef_[0, 1, 0] == pytest.approx(6.54, abs=0.05)
    assert impact.reset.matrix[1, 1] == pytest.approx(-0.8, abs=0.01)
    assert "6.5" in str(found.report_)  # printed as it is


@pytest.mark.filterwarnings("ignore:By itself")  # one law with few frames between jumps
def test_a_model_of_one_position_refuses_two():
    t, y = frames()
    found = HybridAutomatonRegressor(1, order=2, random_state=0).fit(y, t)
    with pytest.raises(ValueError, match="has 2 columns and the model has 1 measured states"):
        found.score(np.hstack([y, y]), t)


def test_effects_are_not_looked_for_beside_speeds_that_nobody_measures():
    t, y = frames()
    search = EffectSearchCV(HybridAutomatonRegressor(order=2))
    with pytest.raises(ValueError, match="automaton of order 1"):
        search.fit(pd.DataFrame(y, columns=["h"]), t=t)
