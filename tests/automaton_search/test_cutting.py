"""Jumps that only laws show, where a cut is best, and transitions that cannot be taken."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid import HybridAutomaton, HybridAutomatonRegressor, SwitchingSystemRegressor
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.cutting import Cutting, better_places, hidden_jumps
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.instants import Settled
from swsysid._automaton_search.jumps import jumps_of
from swsysid._automaton_search.switches import Switches
from swsysid._automaton_search.transitions import possible, with_brief_stays
from swsysid._stays.given import read_given
from swsysid._stays.pieces import cut_at, whole
from swsysid._stays.search import Search
from swsysid._stays.settings import StaySettings
from swsysid._stays.stays import Stays

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


# -- transitions that another one forestalls ---------------------------------------------------


def settled(source, target, times, x, above):
    """A transition that was taken at some states, with the guard x >= above."""
    n = len(times)
    column, unknown = np.array(x, dtype=float)[:, None], np.full(n, np.nan)
    modes = np.zeros(n, dtype=np.intp)
    switches = Switches(
        modes, modes + source, modes + target, unknown, np.array(times), np.full(n, 0.01),
        np.zeros(n, dtype=bool), np.column_stack([times, times]), column, column, column[:, 1:],
        modes - 1, np.zeros(n, dtype=bool), modes,
    )  # fmt: skip
    guard = PolynomialGuard(np.array([1.0, -above]), np.array([[1, 0, 0], [0, 0, 0]]))
    return Settled(switches, FoundGuard(guard, 0.0, np.zeros(n), np.array([0])), None)


@pytest.fixture(scope="module")
def rising(climbing, estimator):
    """Laws of three modes, known ones; the second one rises a little faster."""
    found = searched(estimator, climbing)
    coef = np.array([SLOPE, 1.3 * SLOPE, SLOPE])[:, None, None]
    laws = replace(found.estimate.laws, coef=coef, free=np.zeros((3, 1, 1), dtype=bool))
    stays = [Stays(np.array([0, 2]), np.array([12.05])), *found.estimate.nodes.stays[1:]]
    nodes = found.estimate.nodes.with_stays(stays)
    estimate = replace(found.estimate, laws=laws, nodes=nodes)
    return replace(found, reached=replace(found.reached, estimate=estimate))


def test_what_is_forestalled_is_no_transition(rising):
    often = settled(0, 1, [1.0, 2.0, 3.0, 4.0], [1.0] * 4, above=1.0)
    later = settled(0, 2, [12.05], [1.3], above=1.3)  # the other guard had been passed
    earlier = settled(0, 2, [12.05], [0.5], above=0.5)  # half a second before
    told = possible([often, later], rising)
    assert [one.forestalled for one in told] == [False, True] and told[1].guard is None
    assert not any(one.forestalled for one in possible([often, earlier], rising))


def test_the_stay_in_between_is_told(rising):
    often = settled(0, 1, [1.0, 2.0, 3.0, 4.0], [1.0] * 4, above=1.0)
    onward = settled(1, 2, [1.5, 2.5, 3.5, 4.5], [1.5] * 4, above=1.5)
    later = settled(0, 2, [12.05], [1.3], above=1.3)
    assert with_brief_stays([often, onward], rising, SETTINGS) is None
    assert with_brief_stays([often, later], rising, SETTINGS) is None  # there is no way on
    told = with_brief_stays([often, onward, later], rising, SETTINGS)
    stays = told.estimate.nodes.stays[0]
    assert stays.modes.tolist() == [0, 1, 2]
    np.testing.assert_allclose(stays.instants, [12.0, 12.1], atol=0.5)  # laws nearly alike


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
