"""Locations of SpaceEx models in which nothing can be, or in which no time passes."""

import numpy as np
import pytest
from test_spaceex_settings import _edge, _location, _param, _write

from swsysid import HybridAutomaton

# x rises to 1, is doubled and then lowered by 3 at that instant, and rises from -1 again
THROUGH = (
    _param("x") + _location(1, "rising", "x' == 1", "x <= 1") + _location(2, "instant", "false")
    + _location(3, "after", "x' == 2")
    + _edge(1, 2, "x >= 1", "x := 2*x") + _edge(2, 3, "", "x := x - 3")
)  # fmt: skip


def test_a_location_of_no_time_is_a_part_of_the_transitions_through_it(tmp_path):
    read = HybridAutomaton.from_spaceex(_write(tmp_path, THROUGH))
    assert read.equations() == [
        "mode 0: x' = 1.000",
        "mode 1: x' = 2.000",
        "mode 0 -> 1 where x >= 1.000: x := -3.000 + 2.000 x",
    ]
    run = read.simulate([0.0], [0.0, 0.5, 2.0], mode=0)
    np.testing.assert_allclose(run.x[:, 0], [0.0, 0.5, 1.0], atol=1e-12)


def test_a_run_that_begins_in_one_begins_where_it_leads(tmp_path):
    settings = 'system = tank\ninitially = "x == 5 & loc()==instant"\n'
    read = HybridAutomaton.from_spaceex(_write(tmp_path, THROUGH, settings))
    assert (read.first_modes.states.tolist(), read.first_modes.modes.tolist()) == ([[2.0]], [1])


def test_one_that_nothing_enters_is_left_out(tmp_path):
    body = _param("x") + _location(1, "on", "x' == -x") + _location(2, "never", "false")
    assert HybridAutomaton.from_spaceex(_write(tmp_path, body)).n_modes == 1


@pytest.mark.parametrize(
    "change",
    [
        lambda body: body + _edge(2, 1, ""),  # two ways out
        lambda body: body.replace(_edge(2, 3, "", "x := x - 3"), ""),  # none
        lambda body: body.replace(_edge(2, 3, "", "x := x - 3"), _edge(2, 3, "x >= 0")),
        lambda body: body.replace(
            _location(2, "instant", "false"), _location(2, "instant", "false", "x <= 9")
        ),
    ],
)
def test_one_that_is_not_left_at_once_is_refused(change, tmp_path):
    with pytest.raises(ValueError, match="instant, and it has not one way out that is always open"):
        HybridAutomaton.from_spaceex(_write(tmp_path, change(THROUGH)), urgent=True)


def test_locations_whose_invariants_contradict_each_other_are_left_out(tmp_path):
    """A mode number that an invariant fixes: what holds for no number is no location."""
    body = (
        _param("x") + _param("n")
        + _location(1, "up", "x' == 1 & n' == 0", "n == 1 & x <= 2")
        + _location(2, "down", "x' == -1 & n' == 0", "n == 2 & x >= 0")
        + _location(3, "nowhere", "x' == 7 & n' == 0", "n == 1 & n == 2")
        + _edge(1, 2, "x >= 2", "n := 2") + _edge(2, 1, "x <= 0", "n := 1")
        + _edge(1, 3, "x >= 1")
    )  # fmt: skip
    read = HybridAutomaton.from_spaceex(_write(tmp_path, body))
    assert read.n_modes == 2 and len(read.transitions) == 2
    run = read.simulate([0.0, 1.0], [0.0, 3.0, 5.0], mode=0)
    np.testing.assert_allclose(run.x[:, 0], [0.0, 1.0, 1.0], atol=1e-12)
