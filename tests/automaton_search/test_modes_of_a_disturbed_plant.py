"""How many modes a plant has that a slow force disturbs, which no law of it has."""

import numpy as np
import pytest

from swsysid import GuardWarning, HybridAutomatonRegressor


def disturbed(seed, slow=2.5, size=0.3):
    """x' = -x + 2 or -x - 2 for four seconds each, and a force forgotten after `slow` seconds."""
    rng, step, recordings = np.random.default_rng(seed), 0.1, []
    for start in (2.0, -1.0, 1.0, 0.0):
        x, force, rows = start, 0.0, []
        for k in range(400):
            rows.append(x)
            force += -force * step / slow + size * np.sqrt(2.0 * step / slow) * rng.normal()
            goal = (2.0 if k // 40 % 2 == 0 else -2.0) + force
            x = goal + (x - goal) * np.exp(-step)
        noisy = np.array(rows)[:, None] + 0.01 * rng.normal(size=(400, 1))
        recordings.append({"t": step * np.arange(400), "x": noisy})
    return recordings


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore::swsysid.GuardWarning")
def test_waves_of_a_force_are_no_modes():
    """Where each sample counts for itself there are six."""
    found = HybridAutomatonRegressor(random_state=0).fit(disturbed(2))
    assert found.n_modes_ == 2
    goals = np.sort(-found.coef_[:, 0, 0] / found.coef_[:, 0, 1])
    np.testing.assert_allclose(goals, [-2.0, 2.0], atol=0.3)  # the force has a size of 0.3
    np.testing.assert_allclose(found.coef_[:, 0, 1], -1.0, atol=0.15)


def test_nothing_that_was_recorded_tells_these_switches():
    with pytest.warns(GuardWarning, match="a signal that was not logged decides"):
        HybridAutomatonRegressor(2, random_state=0).fit(disturbed(2))
