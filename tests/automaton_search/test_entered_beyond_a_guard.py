"""Maps of which one transition is taken at a sample: a mode may be entered beyond its own guard."""

import numpy as np
import pytest

from swsysid import HybridAutomatonRegressor

STARTS = ((3.0, 3.5, 4.0), (2.2, 3.9, 3.0), (3.8, 2.1, 2.5), (3.1, 2.6, 4.5))
TIMES = np.arange(800.0)
FILL, KEPT = np.array([0.2, 0.22, 0.21]), np.array([0.99, 0.987, 0.992])


def pumped(levels):
    """Three leaking tanks and one pump, which fills one from 2 to 5 while others may run low.

    Then it is off for one sample, for nobody asks before the next one what is below 2; first what
    is below in the third one.
    """
    filled, rows = None, []
    for _ in TIMES:
        rows.append(levels)
        levels = KEPT * levels + FILL * (np.arange(3) == filled)
        if filled is None:
            filled = max(np.flatnonzero(levels <= 2.0), default=None)
        elif levels[filled] >= 5.0:
            filled = None
    return np.array(rows)


def test_guards_have_one_condition_and_rollouts_are_right():
    """A third of the stays without the pump are one sample long, entered with a tank below 2."""
    recordings = [{"t": TIMES, "x": pumped(np.array(start))} for start in STARTS]
    found = HybridAutomatonRegressor(discrete_time=True, random_state=0).fit(recordings)
    assert found.n_modes_ == 4 and found.report_.rollouts.holds
    low = []
    for one in found.transitions_:
        (guard,) = one.guard.conditions
        column = guard.powers.any(axis=1)
        assert column.sum() == 1
        low.append(float(-guard.coef[~column][0] / guard.coef[column][0]))
    # thresholds are short numbers where a gap is small beside them; a filled tank rises by .2
    assert sorted(low)[:3] == pytest.approx([2.0] * 3, abs=1e-9)
    assert sorted(low)[3:] == pytest.approx([5.0] * 3, abs=0.05)
    unseen = pumped(np.array([2.7, 2.9, 3.3]))
    [idle] = {one.target for one in found.transitions_ if one.guard.values(
        np.append(unseen[0] + 9.0, (0.0, 0.0))[None])[0] >= 0.0}  # fmt: skip
    rolled = found.simulate(unseen[0], TIMES, mode=idle)
    np.testing.assert_allclose(rolled.x, unseen, atol=1e-9)
