"""Guards of several conditions: taken where the last of them rises to zero."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from swsysid import HybridAutomaton
from swsysid.results import ConjunctiveGuard, PolynomialGuard


def _ramps(guard):
    """Two states that run apart, and stop where the guard says."""
    moving, still = {"x": "1", "y": "-1"}, {"x": "0", "y": "0"}
    return HybridAutomaton.stated([moving, still], [(0, 1, guard)], states=["x", "y"])


@pytest.mark.parametrize(
    ("start", "time"),
    [
        ([0.0, 3.0], 2.0),  # x reaches 1 at 1, y reaches 1 at 2
        ([-3.0, 1.5], 4.0),  # y at a half, x at 4
        ([0.0, 2.0], 1.0),  # both at once
    ],
)
@pytest.mark.parametrize(
    "guard", ["x >= 1 & y <= 1", "y <= 1 and x >= 1", "x>=1&&y<=1", "1 <= x AND -9 <= y <= 1"]
)
def test_the_last_condition_tells_when(guard, start, time):
    run = _ramps(guard).simulate(start, [0.0, 5.0], mode=0)
    assert [one.time for one in run.events] == pytest.approx([time], abs=1e-12)


def test_a_condition_that_holds_no_more_tells_nothing():
    run = _ramps("x >= 1 & y >= 2").simulate([0.0, 2.5], [0.0, 5.0], mode=0)
    assert not run.events  # y has fallen below 2 when x reaches 1


def test_against_an_independent_solver():
    """A spiral leaves its mode in a corner of the plane: scipy's events of the least condition."""
    plant = HybridAutomaton.stated(
        [{"x": "y", "y": "-x - 0.1 y"}, {"x": "-x", "y": "-2 y"}],
        [(0, 1, "x^2 >= 0.5 & y >= 0.6 & x >= -0.3")],
        states=["x", "y"],
    )

    def least(_, s):
        return min(s[0] ** 2 - 0.5, s[1] - 0.6, s[0] + 0.3)

    least.terminal, least.direction = True, 1
    for angle in np.linspace(0.0, 6.0, 13):
        start = 1.3 * np.array([np.cos(angle), np.sin(angle)])
        if least(0.0, start) >= 0.0:
            continue
        other = solve_ivp(
            lambda _, s: [s[1], -s[0] - 0.1 * s[1]], (0.0, 8.0), start, events=least,
            rtol=1e-11, atol=1e-12, max_step=0.01,
        )  # fmt: skip
        run = plant.simulate(start, [0.0, 8.0], mode=0, rtol=1e-11)
        times = [one.time for one in run.events]
        assert times == pytest.approx(other.t_events[0].tolist(), abs=1e-8)


def test_in_discrete_time_all_conditions_hold_at_the_row():
    counter = HybridAutomaton.stated(
        [{"k": "k + 1", "y": "y"}, {"k": "k", "y": "y"}],
        [(0, 1, "k >= 3 & y > 0")],
        states=["k", "y"],
        discrete_time=True,
    )
    modes = [counter.simulate([0.0, y], np.arange(6), mode=0).modes.tolist() for y in (1.0, -1.0)]
    assert modes == [[0, 0, 0, 1, 1, 1], [0] * 6]


TANK = HybridAutomaton.stated(
    [{"h": "1 - 0.5 h", "p": "0.2 - p"}, {"h": "-h", "p": "-p"}],
    [(0, 1, "h >= 1.5 & p >= 0.1"), (1, 0, "h <= 0.5")],
    states=["h", "p"],
)


def test_documents_keep_all_conditions():
    again = HybridAutomaton.from_dict(TANK.to_dict())
    assert again.equations() == TANK.equations()
    assert again.to_dict() == TANK.to_dict()


def test_text_and_latex_name_them_all():
    assert "mode 0 -> 1 where h >= 1.500 and p >= 0.100" in TANK.equations()
    assert any(r"h \geq 1.500 \wedge p \geq 0.100" in one for one in TANK.equations(format="latex"))


def test_spaceex_takes_the_transition_as_soon_as_all_hold(tmp_path):
    TANK.to_spaceex(tmp_path / "tank.xml", x0=[0.0, 0.0], t=[0.0, 0.1, 9.0], mode=0)
    assert 'asap="true"' in (tmp_path / "tank.xml").read_text()
    again = HybridAutomaton.from_spaceex(tmp_path / "tank.xml")
    assert again.equations() == TANK.equations()
    runs = [one.simulate([0.0, 0.0], np.linspace(0.0, 9.0, 91), mode=0) for one in (TANK, again)]
    assert np.abs(runs[0].x - runs[1].x).max() < 1e-12 and len(runs[0].events) >= 3
    # the start stands in the settings
    assert again.simulate([0.0, 0.0], [0.0, 9.0]).modes[0] == 0


@pytest.mark.parametrize("guard", ["h >= 1 &", "h >= 1 and h + 2", "& h >= 1"])
def test_a_condition_that_is_none_is_refused(guard):
    with pytest.raises(ValueError, match="is no condition"):
        HybridAutomaton.stated([{"h": "1"}], [(0, 0, guard)], states=["h"])


def test_the_least_condition_is_the_value():
    above = PolynomialGuard(np.array([1.0, -1.0]), np.array([[1, 0, 0, 0], [0, 0, 0, 0]]))
    below = PolynomialGuard(np.array([-3.0]), np.array([[0, 2, 0, 0]]))
    guard, point = ConjunctiveGuard((above, below)), np.array([4.0, 2.0, 0.0, 0.0])
    assert guard.at(point) == -12.0 and guard.terms(point).sum() == -12.0
    assert guard.gradient(point).tolist() == [0.0, -12.0, 0.0, 0.0]
    assert guard.values(np.array([point, [4.0, 0.0, 0.0, 0.0]])).tolist() == [-12.0, 0.0]
