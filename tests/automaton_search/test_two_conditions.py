"""Guards of two conditions, in rows and in samples, and which exit of two is taken."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid import HybridAutomaton, HybridAutomatonRegressor, MisfitWarning
from swsysid._automaton_search.conditions import Exits, of_exits, ways_of, with_teller
from swsysid._automaton_search.found import FoundGuard
from swsysid._automaton_search.guards import met, share_risen, where_it_rises
from swsysid.results import PolynomialGuard

TURN = (
    f"{np.cos(0.035):.15f} w + {np.sin(0.035):.15f} z",
    (f"{np.cos(0.035):.15f} z - {np.sin(0.035):.15f} w"),
)  # an oscillator that turns a valve


def _rows(*levels):
    """A level that rises and falls, by steps of a map, beside the valve."""
    return [{"x": level, "w": TURN[0], "z": TURN[1]} for level in levels]


VALVE = HybridAutomaton.stated(
    _rows("0.975 x + 0.05", "0.985 x - 0.035"),
    [(0, 1, "x >= 1 & w <= 0.2"), (1, 0, "x <= 0")],
    states=["x", "w", "z"],
    discrete_time=True,
)
TWO_EXITS = HybridAutomaton.stated(
    [
        {"x": rate, "w": "0.7 z", "z": "-0.7 w"} for rate in ("1", "-0.7", "-1.5")
    ],
    [(0, 1, "x >= 1 & w >= 0.1"), (0, 2, "x >= 1 & w <= 0.1"), (1, 0, "x <= 0"),
     (2, 0, "x <= -0.1")],
    states=["x", "w", "z"],
)  # fmt: skip


def _recordings(plant, t, noise, count, seed=0):
    generator, found = np.random.default_rng(seed), []
    for _ in range(count):
        start = np.append(generator.uniform(0.0, 0.9), generator.uniform(-1.0, 1.0, 2))
        run = plant.simulate(start, t, mode=0)
        sizes = noise * run.x.std(axis=0)
        found.append((run, {"t": t, "x": run.x + sizes * generator.normal(size=run.x.shape)}))
    return found


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_one_exit_of_two_conditions(noise):
    """Either may be the last to hold: the level while the valve is open, or the valve."""
    made = _recordings(VALVE, np.arange(500), noise, 5)
    found = HybridAutomatonRegressor(2, discrete_time=True, random_state=0)
    found.fit([one for _, one in made[:4]])
    up, down = found.automaton_.transitions
    assert (up.source, down.source) == (0, 1)
    x, w = sorted(up.guard.conditions, key=lambda one: np.flatnonzero(one.powers.any(axis=0))[0])
    # thresholds are known to where the rows lie: less than two steps of .03
    assert _threshold(x, 0) == pytest.approx(1.0, abs=0.01)
    assert _threshold(w, 1) == pytest.approx(0.2, abs=0.01)
    run, _ = made[4]
    own = found.simulate(run.x[0], np.arange(500.0), mode=0)
    # each of its 13 switches may be one row off, where a row lies between the known ones
    assert np.mean(own.modes == run.modes) > 1.0 - 13.5 / 500
    assert "guards tell all switches" in str(found.report_)


def _threshold(condition, column):
    """Where a condition of one column is zero."""
    used = np.flatnonzero(condition.powers.any(axis=0))
    assert used.tolist() == [column]
    constant = condition.coef[~condition.powers.any(axis=1)].sum()
    return -constant / condition.coef[condition.powers[:, column] == 1].sum()


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_what_tells_two_exits_of_one_surface(noise):
    made = _recordings(TWO_EXITS, np.arange(500) * 0.02, noise, 7, seed=1)
    found = HybridAutomatonRegressor(3, random_state=0).fit([one for _, one in made[:6]])
    names = np.array([np.argmin(np.abs(found.coef_[:, 0, 0] - rate)) for rate in (1, -0.7, -1.5)])
    out = {one.target: one.guard for one in found.automaton_.transitions if one.source == names[0]}
    for target, sign in ((names[1], 1.0), (names[2], -1.0)):
        x, w = out[target].conditions
        assert _threshold(x, 0) == pytest.approx(1.0, abs=1e-6 + noise)
        # about thirty crossings lie .07 apart in the mean
        assert _threshold(w, 1) == pytest.approx(0.1, abs=0.15)
        assert sign * w.coef[w.powers[:, 1] == 1].sum() > 0.0
    assert not [line for line in found.report_.doubts if "is left for mode" in line]
    run, _ = made[6]
    own = found.simulate(run.x[0], run.t, mode=int(names[0]))
    assert np.mean(own.modes == names[run.modes]) > 0.9


def test_exits_that_nothing_tells_apart_are_said():
    """The exit is drawn by lot: no column may be made to tell it."""
    generator, recordings = np.random.default_rng(3), []
    for _ in range(6):
        x, mode, rows = generator.uniform(0.0, 0.9), 0, []
        w = generator.normal(size=300)
        for k in range(300):
            rows.append([x, w[k]])
            if mode == 0 and x >= 1.0:
                mode = 1 + generator.integers(2)
            elif mode and x <= 0.0:
                mode = 0
            x += (0.05, -0.035, -0.075)[mode]
        recordings.append({"t": np.arange(300), "x": np.array(rows)[:, :1],
                           "inputs": np.array(rows)[:, 1:]})  # fmt: skip
    # the way out that is taken more often is asked first
    with pytest.warns(MisfitWarning, match="where mode 0 -> 2 happens in the model only"):
        found = HybridAutomatonRegressor(3, discrete_time=True, random_state=0).fit(recordings)
    assert all(len(one.guard.conditions) == 1 for one in found.automaton_.transitions)
    assert "nothing that was recorded tells which" in str(found.report_)


def test_nats_of_ends_that_a_guard_leaves_unsaid():
    """Three stays of four rows, by hand: one ends rightly, one too early, one for another mode."""
    guard = PolynomialGuard(np.array([1.0, -1.0]), np.array([[1, 0, 0], [0, 0, 0]]))  # x >= 1
    x = [0.0, 0.3, 0.6, 1.0], [0.0, 1.2, 0.8, 1.1], [0.0, 0.3, 0.9, 1.3]
    rows = np.column_stack([np.concatenate(x), np.tile(np.arange(4.0), 3), np.arange(12.0)])
    exits = Exits(rows, np.array([4, 4, 4]), np.array([1, 1, 2]))
    # one coefficient beside the scale, one wrong end, and which of three exits is not its own
    found = FoundGuard(guard, 0.0, np.zeros(3), np.array([0]))
    assert exits.missed(1, found) == (1, 1)
    assert exits.nats(1, found) == pytest.approx(np.log(4.0) * 2 + np.log(3.0), rel=1e-12)
    # ways in which 1,500 of 3,000 switches are the wrong ones, by Stirling's formula
    assert of_exits(1500, 3000) == pytest.approx(
        3000 * np.log(2) - 0.5 * np.log(1500 * np.pi), 1e-6
    )
    never, ends, reached = exits.sides(1)
    assert len(never) == 10 and ends.tolist() == [False] * 9 + [True]
    assert reached[:, 0].tolist() == [1.0, 1.1]


def test_a_transition_that_follows_no_row_keeps_its_guard():
    """With lags a brief stay may have no row of its own: nothing tells a second condition then."""
    guard = PolynomialGuard(np.array([1.0, -1.0]), np.array([[1, 0, 0], [0, 0, 0]]))
    found = FoundGuard(guard, 1.0, np.zeros(3), np.array([0]))
    rows = np.column_stack([np.arange(4.0), np.arange(4.0), np.arange(4.0)])
    for stays in (
        Exits(rows, np.array([4]), np.array([2])),
        Exits(rows[:0], *np.zeros((2, 0), int)),
    ):
        assert ways_of(found, stays, 1, 1) == (found,)


def test_the_share_of_switches_at_which_a_guard_rises():
    """Of three switches whose clock is known x - 1 rises at one while c - 2 holds; one is far."""
    level, clock = (
        FoundGuard(PolynomialGuard(np.array([-own, 1.0]), powers), 0.0, np.zeros(3), np.arange(2))
        for own, powers in ((1.0, np.array([[0, 0], [1, 0]])), (2.0, np.array([[0, 0], [0, 1]])))
    )
    columns = np.array([[1.0, 3.0], [1.0, 1.0], [5.0, 3.0]])
    rates = np.ones(columns.shape)
    assert share_risen(level, columns, rates, 0.1) == pytest.approx(2 / 3)
    assert share_risen(replace(level, also=(clock,)), columns, rates, 0.1) == pytest.approx(1 / 3)
    columns[0, 1], columns[1, 1] = np.nan, 2.0
    assert share_risen(clock, columns, rates, 0.1) == pytest.approx(1 / 2)  # of two that are known


def _below(level):
    """A guard that rises where the first of four columns falls: height, speed, and clocks."""
    powers = np.array([[0, 0, 0, 0], [1, 0, 0, 0]])
    return FoundGuard(PolynomialGuard(np.array([level, -1.0]), powers), 0.0, np.zeros(20), [0])


def test_conditions_are_judged_where_the_guard_rises():
    """Noise moves the heights of two exits of one surface: by itself a height tells them apart."""
    rng, found = np.random.default_rng(0), _below(0.0054)
    heights = np.concatenate([rng.uniform(0.0058, 0.007, 20), rng.uniform(0.003, 0.005, 20)])
    columns = np.column_stack([heights, rng.normal(-2.0, 0.1, 40), np.full((40, 2), np.nan)])
    rates = np.column_stack([columns[:, 1], np.full(40, -9.81), np.ones((40, 2))])
    reached, never = columns[:20], columns[20:]
    apart = with_teller(found, never, reached, 1)
    assert not (apart.whole.values(np.linspace(0.0, 0.01, 99)[:, None] * [1, 0, 0, 0]) >= 0).any()
    at = where_it_rises(found, columns, rates)
    np.testing.assert_allclose(at[:, 0], 0.0054, rtol=0, atol=1e-15)
    # a speed of v falls by g for the time in which the height changes at v
    falls = columns[:, 1] - 9.81 * (0.0054 - heights) / columns[:, 1]
    np.testing.assert_allclose(at[:, 1], falls, rtol=1e-12)
    assert not with_teller(found, at[20:], at[:20], 1).also


def test_a_condition_that_holds_nowhere_where_a_refined_guard_rises_goes():
    columns = np.column_stack([np.zeros(3), [-2.0, -2.5, -3.0], np.zeros((3, 2))])
    rates = np.column_stack([columns[:, 1], np.full(3, -9.81), np.ones((3, 2))])
    above = FoundGuard(
        PolynomialGuard(np.array([-0.001, 1.0]), np.array([[0, 0, 0, 0], [1, 0, 0, 0]])),
        0.0, np.zeros(3), [0],
    )  # fmt: skip
    assert met(replace(_below(0.002), also=(above,)), columns, rates).also == (above,)
    assert met(replace(_below(0.0), also=(above,)), columns, rates).also == ()
