"""Margins of guards, and the largest that there can be: thresholds of one column by hand."""

import numpy as np
import pytest

from swsysid import HybridAutomaton, HybridAutomatonRegressor
from swsysid._automaton.transitions import PolynomialGuard
from swsysid._automaton_search.certificates import certificate

BELOW = np.array([[0.2, 0.0, 0.0], [0.8, 0.0, 0.0]])
LAST, REACHED = np.array([[0.9, 0.0, 0.0]]), np.array([[1.1, 0.0, 0.0]])


def threshold(value, scale=1.0):
    """The guard x >= value."""
    return PolynomialGuard(scale * np.array([1.0, -value]), np.array([[1, 0, 0], [0, 0, 0]]))


@pytest.mark.parametrize("scale", [1.0, 40.0])
@pytest.mark.parametrize(("value", "margin"), [(1.0, 0.5), (0.95, 0.25), (1.2, -0.5)])
def test_a_threshold_is_as_far_as_its_nearest_sample(value, margin, scale):
    # it rises by .2 from the last sample to the one reached
    told = certificate(threshold(value, scale), BELOW, LAST, REACHED)
    assert told.margin == pytest.approx(margin, abs=1e-12)
    assert told.largest == pytest.approx(0.5, abs=1e-9)


def test_a_program_that_fails_leaves_the_margin_and_no_largest_one(monkeypatch):
    def fails(*_, **__):
        raise RuntimeError("HiGHS has lost its way")

    monkeypatch.setattr("swsysid._solvers.conic.linprog", fails)
    told = certificate(threshold(1.0), BELOW, LAST, REACHED)
    assert told.margin == pytest.approx(0.5, abs=1e-12) and np.isnan(told.largest)


def test_a_sample_beyond_the_guard_is_on_the_wrong_side():
    beyond = np.vstack([BELOW, [[1.02, 0.0, 0.0]]])
    told = certificate(threshold(1.0), beyond, LAST, REACHED)
    assert told.margin == pytest.approx(-0.1, abs=1e-12)
    # in the middle between 1.02 and 1.1
    assert told.largest == pytest.approx(0.2, abs=1e-9)
    # no threshold has 1.3 below and 1.1 above
    nowhere = certificate(threshold(1.0), np.array([[1.3, 0.0, 0.0]]), LAST, REACHED)
    assert nowhere.largest == pytest.approx(-0.5, abs=1e-9)


def test_a_clock_that_nobody_knows_has_no_margin():
    guard = PolynomialGuard(np.array([1.0, -2.0]), np.array([[0, 1, 0], [0, 0, 0]]))
    unknown = np.array([[0.9, np.nan, 0.0]])
    assert np.isnan(certificate(guard, BELOW, unknown, unknown)).all()


@pytest.mark.parametrize("discrete", [False, True])
def test_no_guard_has_a_larger_margin_than_the_largest(discrete):
    if discrete:
        laws, dt = [{"x": "0.8 x + 0.5"}, {"x": "0.7 x"}], 1.0
    else:
        laws, dt = [{"x": "1 - 0.2 x"}, {"x": "-0.5 x"}], 0.1
    plant = HybridAutomaton.stated(
        laws, [(0, 1, "x >= 2"), (1, 0, "x <= 0.6")], states=["x"], discrete_time=discrete
    )
    t = dt * np.arange(200)
    data = [{"t": t, "x": plant.simulate([x0], t, mode=0).x} for x0 in (0.7, 0.9, 1.1)]
    found = HybridAutomatonRegressor(2, discrete_time=discrete, random_state=0).fit(data)
    assert len(found.verdicts_) == 2
    for verdict in found.verdicts_:
        assert 0.0 < verdict.margin <= verdict.largest_margin + 1e-9 <= 0.5 + 2e-9
        if discrete:  # it is the answer of that program
            assert verdict.margin == pytest.approx(verdict.largest_margin, abs=1e-7)
