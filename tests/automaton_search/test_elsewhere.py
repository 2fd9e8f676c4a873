"""Automata of columns that are counted from an origin, told in the user's own."""

import numpy as np
import pytest

from swsysid import HybridAutomaton, HybridAutomatonRegressor
from swsysid._automaton_search.answer import IdentifiedAutomaton
from swsysid._automaton_search.elsewhere import told_from
from swsysid._stays.given import read_given
from swsysid._stays.origin import Origin

T = np.linspace(0.0, 3.0, 61)


def test_guards_resets_and_laws_told_elsewhere_go_the_same_way():
    near = HybridAutomaton.stated(
        [{"x": "-x + v + u", "v": "1 - 0.3 x"}, {"x": "-2 x", "v": "-1 + 0.2 v"}],
        [
            (0, 1, "x^2 + 0.5 x v >= 1.2", {"v": "0.5 v + 0.1 x - 0.2"}),
            (1, 0, "x + 0.1 dwell <= 0.4"),
        ],
        states=["x", "v"],
        inputs=["u"],
    )
    offset = np.array([40.0, -7.0, 5.0])
    start, u = np.array([0.2, 1.0]), np.sin(T)[:, None]
    run = near.simulate(start, T, u, mode=0)
    assert len(run.events) > 2
    far = {"t": T, "x": run.x + offset[:2], "inputs": u + offset[2]}
    # only the automaton and the states have a place; what is said of them has none
    found = IdentifiedAutomaton(
        near, None, [run.modes], [run.x], [], np.ones(2), None, [], None, [], []
    )
    given = read_given([far], None, None, None)
    there = told_from(Origin(offset), found, given, 1).automaton
    again = there.simulate(start + offset[:2], T, u + offset[2], mode=0)
    np.testing.assert_allclose(again.x - offset[:2], run.x, atol=1e-6)
    assert [one.kind for one in again.events] == [one.kind for one in run.events]
    np.testing.assert_allclose(
        [one.time for one in again.events], [one.time for one in run.events], atol=1e-7
    )


def thermostat():
    plant = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 10)"}, {"T": "-0.1 (T + 10)"}],
        [(0, 1, "T >= 2"), (1, 0, "T <= -2")],
        states=["T"],
    )
    t, rng = np.arange(0.0, 25.0, 0.1), np.random.default_rng(0)
    runs = [plant.simulate([start], t, mode=0).x for start in (-5.0, -3.0, -1.0)]
    return [{"t": t, "x": run + 0.02 * rng.standard_normal(run.shape)} for run in runs]


@pytest.fixture(scope="module")
def near_zero():
    return HybridAutomatonRegressor(random_state=0).fit(thermostat())


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("offset", "unit"), [(300.0, 1.0), (1e4, 1.0), (1e6, 1.0), (0.0, 1e-12), (0.0, 1e12)]
)
def test_a_thermostat_is_the_same_on_any_scale(near_zero, offset, unit):
    found = near_zero
    given = [{**one, "x": (one["x"] + offset) * unit} for one in thermostat()]
    there = HybridAutomatonRegressor(random_state=0).fit(given)
    assert (there.modes_ == found.modes_).mean() > 0.995
    # standard errors of the slopes are 1e-3, those of the levels 2e-3
    np.testing.assert_allclose(there.coef_[:, 0, 1], found.coef_[:, 0, 1], atol=3e-3)
    levels = [
        [-one.guard.coef[0] / one.guard.coef[1] / size - move for one in each.transitions_]
        for each, size, move in ((found, 1.0, 0.0), (there, unit, offset))
    ]
    np.testing.assert_allclose(levels[1], levels[0], atol=5e-3)
    assert there.score(given) == pytest.approx(found.score(thermostat()), abs=1e-4)
