"""Brief stays in other modes, and two laws that become one: a saw tooth of known slopes."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid import SwitchingSystemRegressor
from swsysid._stays.count import surprise_of_switches
from swsysid._stays.descent import most_likely
from swsysid._stays.given import read_given
from swsysid._stays.merged import Pair, merged
from swsysid._stays.retold import retold
from swsysid._stays.search import Search
from swsysid._stays.settings import StaySettings
from swsysid._stays.stays import Stays

STEP, NOISE, PRICE = 0.1, 0.02, 5.0
RISES, FALLS = 1.0, -2.0
SETTINGS = StaySettings()


def turning(instants, slopes):
    """Identification of a state that changes its slope at some instants, one mode for each."""
    t = STEP * np.arange(300)
    at = np.searchsorted(instants, t, side="right")
    edges = np.concatenate([[0.0], instants])
    begins = np.concatenate([[0.0], np.cumsum(np.diff(edges) * np.array(slopes)[:-1])])
    x = begins[at] + np.array(slopes)[at] * (t - edges[at])
    x = x + NOISE * np.random.default_rng(0).standard_normal(len(x))
    estimator = SwitchingSystemRegressor(2, feature_library=0, coupling=0.0, random_state=0)
    given = read_given(x[:, None], t, None, None)
    return Search(estimator, given, 1, None, SETTINGS, lambda: None, surfaces=False).identified()


def with_stays(found, modes, instants, coef=None):
    """The estimate with other stays, and with other laws if they are given."""
    estimate = found.estimate
    if coef is not None:
        laws = replace(estimate.laws, coef=coef, free=np.ones(coef.shape, dtype=bool))
        estimate = replace(estimate, laws=laws)
    stays = [Stays(np.array(modes), np.array(instants))]
    return replace(estimate, nodes=estimate.nodes.with_stays(stays))


def settled(found, estimate):
    """An identification at the maximum for these stays."""
    reached = most_likely(estimate, found.reached.noise, SETTINGS, near=True)
    return replace(found, reached=reached)


@pytest.fixture(scope="module")
def tooth():
    """It rises for 10 s, falls for 8 s, and rises again."""
    return turning([10.0, 18.0], [RISES, FALLS, RISES])


def test_stays_that_are_right_stay(tooth):
    [stays] = tooth.estimate.nodes.stays
    np.testing.assert_allclose(stays.instants, [10.0, 18.0], atol=0.05)
    prices = np.full((2, 2), PRICE)
    assert retold(tooth.estimate, tooth.reached.noise, SETTINGS, prices) is None


def test_a_false_visit_goes_and_a_wrong_mode_is_another(tooth):
    rises, falls = np.argsort(-tooth.estimate.laws.coef[:, 0, 0])
    prices = np.full((2, 2), PRICE)
    visited = with_stays(tooth, [rises, falls, rises, falls, rises], [4.03, 4.21, 10.0, 18.0])
    told = retold(visited, tooth.reached.noise, SETTINGS, prices)
    [stays] = told.nodes.stays
    assert stays.modes.tolist() == [rises, falls, rises]
    # a third law that nothing needs: 2 s of the fall were taken for it
    coef = np.concatenate([tooth.estimate.laws.coef, [[[FALLS - 0.02]]]])
    third = with_stays(tooth, [rises, falls, 2, rises], [10.0, 16.0, 18.0], coef)
    told = retold(third, tooth.reached.noise, SETTINGS, np.full((3, 3), PRICE))
    assert told.nodes.stays[0].modes.tolist() == [rises, falls, rises]


def test_trials_that_loose_ties_refute_would_not_have_been_taken(tooth):
    rises, falls = np.argsort(-tooth.estimate.laws.coef[:, 0, 0])
    visited = with_stays(tooth, [rises, falls, rises, falls, rises], [4.03, 4.21, 10.0, 12.0])
    told = [
        retold(visited, tooth.reached.noise, settings, np.full((2, 2), PRICE)).nodes.stays[0]
        for settings in (SETTINGS, replace(SETTINGS, hopeless=np.inf))  # all of them to the end
    ]
    np.testing.assert_array_equal(told[0].modes, told[1].modes)
    np.testing.assert_array_equal(told[0].instants, told[1].instants)


def test_a_trial_that_the_sum_of_all_made_worse_begins_again(tooth, monkeypatch):
    """Trials descend side by side, by their sum: what was near may end far off.

    Here every one does; none was left then, and the search ended in an empty sequence.
    """

    def spoilt(estimate, noise, settings):
        reached = most_likely(estimate, noise, settings)
        states = reached.estimate.states + 1e3
        return replace(reached, estimate=replace(reached.estimate, states=states))

    monkeypatch.setattr("swsysid._stays.retold.most_likely", spoilt)
    rises, falls = np.argsort(-tooth.estimate.laws.coef[:, 0, 0])
    visited = with_stays(tooth, [rises, falls, rises, falls, rises], [4.03, 4.21, 10.0, 18.0])
    told = retold(visited, tooth.reached.noise, SETTINGS, np.full((2, 2), PRICE))
    assert told.nodes.stays[0].modes.tolist() == [rises, falls, rises]


def test_a_rare_switch_surprises_more():
    stays = [Stays(np.array([0, 1, 0, 1, 0, 2, 0]), np.arange(1.0, 7.0))]
    surprise = surprise_of_switches(stays)
    # half a switch of each kind has been seen before: 2.5 and 1.5 of 4.5
    np.testing.assert_allclose(surprise[0, 1:], np.log(4.5 / np.array([2.5, 1.5])), rtol=1e-12)
    assert surprise[0, 0] == pytest.approx(np.log(4.5 / 0.5), rel=1e-12)


def test_the_closest_laws_become_their_weighted_mean(tooth):
    rises, falls = np.argsort(-tooth.estimate.laws.coef[:, 0, 0])
    coef = np.empty((3, 1, 1))
    coef[[rises, falls, 2], 0, 0] = RISES, FALLS, RISES
    # both rises, each a mode
    parted = settled(tooth, with_stays(tooth, [rises, falls, 2], [10.0, 18.0], coef))
    own = parted.estimate.laws.coef[:, 0, 0]
    model, free = merged(parted, most=1000.0)
    assert model.coef_.shape == free.shape == (2, 1, 1)
    law = model.coef_[:, 0, 0].max()
    # slopes of 10 and of 12 s: variances go with the third power of the duration
    weights = np.array([10.0, 12.0]) ** 3
    mean = weights @ own[[rises, 2]] / weights.sum()
    assert law == pytest.approx(mean, abs=0.2 * abs(own[rises] - own[2]))
    assert merged(parted, most=0.0) is None
    assert merged(tooth, most=1000.0) is None  # a rise and a fall


def test_what_is_known_to_be_the_same_costs_nothing_to_make_equal(tooth):
    """Tied coefficients differ by rounding, whose variance may even be negative."""
    coef, free = np.array([[[1.0], [3.0]], [[1.5], [3.0]]]), np.ones((2, 2, 1), dtype=bool)
    estimate = replace(tooth.estimate, laws=replace(tooth.estimate.laws, coef=coef, free=free))
    found = replace(tooth, reached=replace(tooth.reached, estimate=estimate))
    for variance, rounding in ((0.0, 0.0), (0.0, 1e-17), (0.0, -1e-17), (-1e-17, 1e-17)):
        covariance = np.diag([0.02, 0.01, 0.03, 0.01])
        covariance[1, 3] = covariance[3, 1] = 0.01 - variance
        covariance[0, 1] = covariance[1, 0] = 0.004
        covariance[0, 3] = covariance[3, 0] = 0.004 - rounding
        pair = Pair.of(found, 0, 1, covariance)
        # the others are independent: a difference of 0.5 with the variance 0.02 + 0.03
        assert pair.cost == pytest.approx(0.5 * 0.5**2 / 0.05, rel=1e-9)
        assert pair.law[0, 0] == pytest.approx(1.0 + 0.5 * 0.02 / 0.05, rel=1e-9)
