"""Jumps that only laws show, and where a cut is best."""

import numpy as np
import pytest

from swsysid import HybridAutomaton, HybridAutomatonRegressor, SwitchingSystemRegressor
from swsysid._automaton_search.cutting import Cutting, better_places, hidden_jumps
from swsysid._automaton_search.jumps import jumps_of
from swsysid._stays.given import read_given
from swsysid._stays.pieces import cut_at, whole
from swsysid._stays.search import Search
from swsysid._stays.settings import StaySettings

STEP, NOISE, SLOPE = 0.1, 0.02, 1.0
JUMPED = [60, 170]  # the samples after which it jumps by six deviations of the noise
SETTINGS = StaySettings()


@pytest.fixture(scope="module")
def climbing():
    """Six recordings of one slope, the first with two small jumps."""
    t, generator = STEP * np.arange(240), np.random.default_rng(1)
    x = SLOPE * t + NOISE * generator.standard_normal((6, 240))
    x[0] += 0.12 * (np.arange(240)[:, None] > JUMPED).sum(axis=1)
    return read_given(x.reshape(-1, 1), np.tile(t, 6), np.repeat(range(6), 240), None)


@pytest.fixture(scope="module")
def estimator():
    return SwitchingSystemRegressor(1, feature_library=0, coupling=0.0)


def searched(estimator, given):
    return Search(estimator, given, 1, None, SETTINGS, lambda: None, surfaces=False).identified()


def test_small_jumps_are_seen_by_the_laws_alone(climbing, estimator):
    assert not any(map(len, jumps_of(climbing)))
    found = searched(estimator, climbing)
    jumps, *others = hidden_jumps(found, whole(climbing), 6, SETTINGS)
    np.testing.assert_allclose(jumps, JUMPED, atol=1)  # six deviations: a sample is told nearly
    assert not any(map(len, others))


def test_a_search_cuts_where_it_jumps(climbing, estimator):
    cut = Cutting(estimator, climbing, SETTINGS, lambda: None).identified(jumps_of(climbing))
    assert [len(own) for own in cut.jumps] == [2, 0, 0, 0, 0, 0] and len(cut.pieces.first) == 8
    assert cut.stays.estimate.laws.coef[0, 0, 0] == pytest.approx(SLOPE, abs=0.005)
    assert cut.excess < 1.1


def test_a_cut_goes_to_where_the_laws_part():
    t = STEP * np.arange(200)
    x = np.where(t <= 10.0, t, 15.0 - t)  # from 10 to 5, and then it falls
    x = x + NOISE * np.random.default_rng(0).standard_normal(200)
    given = read_given(x[:, None], t, None, None)
    wrong = cut_at(given, [np.array([106])])
    estimator = SwitchingSystemRegressor(2, feature_library=0, coupling=0.0, random_state=0)
    found = searched(estimator, wrong.given)
    [place] = better_places(given, found, wrong, [np.array([106])])
    assert place.tolist() == [100]


# -- the whole ---------------------------------------------------------------------------------


@pytest.mark.nightly
def test_small_resets_are_found_in_noise():
    plant = HybridAutomaton.stated(
        [{"x": "1 - 0.2 x"}, {"x": "-0.5 - 0.2 x"}],
        [(0, 1, "x >= 2", {"x": "0.94 x"}), (1, 0, "x <= 0.5")],
        states=["x"],
    )
    t = np.arange(0.0, 20.0, 0.05)
    runs = [plant.simulate([start], t, mode=0).x for start in (0.6, 1.2)]
    noise = 0.02 * np.random.default_rng(0).standard_normal((2, len(t), 1))
    data = [{"t": t, "x": x + own} for x, own in zip(runs, noise, strict=True)]
    found = HybridAutomatonRegressor(random_state=0).fit(data)
    assert found.n_modes_ == 2 and len(found.transitions_) == 2
    jumps = [one for one in found.transitions_ if one.reset is not None]
    assert len(jumps) == 1
    # a jump of .12 in noise of .02, at about ten instants
    [jump] = jumps
    assert jump.reset.applied(np.array([[2.0]]))[0, 0] == pytest.approx(1.88, abs=0.02)
