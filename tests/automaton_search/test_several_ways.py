"""Boxes: a mode that is entered, or left, through any of several faces."""

from dataclasses import replace

import numpy as np
import pytest

from swsysid import HybridAutomaton, HybridAutomatonRegressor
from swsysid._automaton_search.conditions import Exits, taken_by, ways_of
from swsysid._automaton_search.found import FoundGuard
from swsysid.results import PolynomialGuard

ENTERED = HybridAutomaton.stated(  # a spiral into a box, and one out of it
    [{"x": "-0.3 x + 2 y", "y": "-2 x - 0.3 y"}, {"x": "x + 3 y", "y": "-3 x + y"}],
    [(0, 1, "x <= 1 & x >= -1 & y <= 0.8 & y >= -0.8"), (1, 0, "x >= 3")],
    states=["x", "y"],
)
_TURN = {"p": "1.9 q", "q": "-1.9 p"}
LEFT = HybridAutomaton.stated(  # drawn about in a box, and back to its middle for a while
    [{"x": "p + 0.3", "y": "q - 0.2", **_TURN}, {"x": "-2 x", "y": "-1.6 y", **_TURN}],
    [(0, 1, face) for face in ("x >= 1", "y >= 0.8", "y <= -0.9")] + [(1, 0, "dwell >= 0.75")],
    states=["x", "y", "p", "q"],
)


def _fitted(plant, starts):
    t = 0.02 * np.arange(600)
    runs = [plant.simulate(start, t, mode=0) for start in starts]
    found = HybridAutomatonRegressor(2, guard_degree=1, random_state=0)
    return found.fit([{"t": t, "x": run.x} for run in runs]), runs


def _levels(guards, first):
    """Thresholds by column and sign, of guards out of a mode, all of single columns."""
    levels = {}
    for one in guards:
        if one.source == first:
            for condition in one.guard.conditions:
                [column] = np.flatnonzero(condition.powers.any(axis=0))
                slope = condition.coef[condition.powers[:, column] == 1].sum()
                constant = condition.coef[~condition.powers.any(axis=1)].sum()
                levels[int(column), slope > 0.0] = -constant / slope
    return levels


def test_a_mode_that_is_entered_through_the_faces_of_a_box():
    starts = 2.5 * np.array([[1, 0.3], [0.2, 1], [-1, 0.1], [0.5, -1], [0.8, 0.9], [-0.7, -0.9]])
    found, runs = _fitted(ENTERED, starts)
    first = found.modes_[0]
    guards = found.automaton_.transitions
    assert sum(one.source == first for one in guards) == 1
    levels = _levels(guards, first)
    # each face is known from the instants at which it was the last to be passed
    assert levels[0, False] == pytest.approx(1.0, abs=1e-5)
    assert levels[0, True] == pytest.approx(-1.0, abs=1e-5)
    assert levels[1, False] == pytest.approx(0.8, abs=1e-5)
    assert "guards tell all switches" in str(found.report_)
    again = found.simulate(runs[0].x[0], runs[0].t, mode=int(first))
    np.testing.assert_allclose(again.x, runs[0].x, atol=1e-4)


def test_a_mode_that_is_left_through_the_faces_of_a_box():
    rng = np.random.default_rng(0)
    starts = np.column_stack([rng.uniform(-0.3, 0.3, (8, 2)), rng.uniform(-1.5, 1.5, (8, 2))])
    found, runs = _fitted(LEFT, starts)
    first = found.modes_[0]
    guards = [one for one in found.automaton_.transitions if one.source == first]
    levels = _levels(guards, first)
    assert len(guards) == len(levels) == 3
    for face, level in (((0, True), 1.0), ((1, True), 0.8), ((1, False), -0.9)):
        assert levels[face] == pytest.approx(level, abs=1e-5)
    assert len(found.verdicts_) == 4 and all(one.explained == 1.0 for one in found.verdicts_)
    assert sum(one.support for one in guards) == sum((np.diff(r.modes) == 1).sum() for r in runs)
    again = found.simulate(runs[0].x[0], runs[0].t, mode=int(first))
    np.testing.assert_allclose(again.x, runs[0].x, atol=1e-4)


def _stays(*levels):
    rows = np.concatenate(levels)[:, None] * [1.0, 0.0, 0.0]
    lengths = np.array([len(own) for own in levels])
    return Exits(rows, lengths, np.ones(len(levels), dtype=np.intp))


def test_rows_that_leave_an_interval_at_both_ends():
    """By hand: stays of nine rows inside (-1, 1), and one beyond; no threshold tells all."""
    inside = np.linspace(-0.9, 0.9, 9)
    rng = np.random.default_rng(0)
    ends = [1.1, -1.2, 1.3, -1.1, 1.2, -1.3, 1.1, -1.1]
    exits = _stays(*(np.append(rng.permutation(inside), end) for end in ends))
    rises = PolynomialGuard(np.array([1.0, -1.0]), np.array([[1, 0, 0], [0, 0, 0]]))
    found = FoundGuard(rises, 0.0, np.zeros(8), np.array([0]))
    assert exits.missed(1, found) == (4, 0)
    ways = ways_of(found, exits, 1, 1)
    assert len(ways) == 2 and exits.missed(1, *ways) == (0, 0)
    by = taken_by(ways, exits.sides(1)[2])
    assert len(set(by[::2])) == len(set(by[1::2])) == 1 and by[0] != by[1]
    # a guard that tells is left as it is
    bent = PolynomialGuard(np.array([1.0, -1.0]), np.array([[2, 0, 0], [0, 0, 0]]))
    assert ways_of(replace(found, guard=bent), exits, 1, 1)[0].guard is bent
