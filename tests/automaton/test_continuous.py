"""Rollouts in continuous time against SciPy's event integration and closed forms."""

from dataclasses import dataclass

import numpy as np
import pytest
from event_integration import integrate_events

from swsysid import HybridAutomaton
from swsysid._results import Status


@dataclass
class Case:
    """One automaton twice: stated for the package, and as functions for SciPy."""

    laws: list
    transitions: list
    states: list
    fields: list
    guards: list
    resets: list
    x0: list
    mode: int
    end: float
    n_events: int
    parameters: dict | None = None

    @property
    def automaton(self):
        return HybridAutomaton.stated(
            self.laws, self.transitions, states=self.states, parameters=self.parameters
        )

    def reference(self, t):
        legs = [
            (told[0], told[1], guard, reset)
            for told, guard, reset in zip(self.transitions, self.guards, self.resets, strict=True)
        ]
        return integrate_events(self.fields, legs, self.mode, self.x0, t)


def stays(x):
    return x


CASES = {
    "ball with restitution": Case(
        laws=[{"h": "v", "v": "-g - 0.05 v"}],
        transitions=[(0, 0, "h <= 0", {"v": "-0.8 v"})],
        states=["h", "v"],
        parameters={"g": 9.81},
        fields=[lambda t, x: [x[1], -9.81 - 0.05 * x[1]]],
        guards=[lambda t, x, entered: -x[0]],
        resets=[lambda x: np.array([x[0], -0.8 * x[1]])],
        x0=[5.0, 1.0],
        mode=0,
        end=6.0,
        n_events=5,
    ),
    "thermostat with hysteresis": Case(
        laws=[{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        transitions=[(0, 1, "T >= 22"), (1, 0, "T <= 20")],
        states=["T"],
        fields=[lambda t, x: -0.1 * (x - 30), lambda t, x: -0.1 * (x - 10)],
        guards=[lambda t, x, entered: x[0] - 22, lambda t, x, entered: 20 - x[0]],
        resets=[stays, stays],
        x0=[19.0],
        mode=0,
        end=30.0,
        n_events=14,
    ),
    "two tanks with thresholds": Case(
        # a valve opens when the first tank is full, the pump stops when the second is
        laws=[
            {"a": "0.5 - 0.1 a", "b": "-0.2 b"},
            {"a": "0.5 - 0.6 a", "b": "0.5 a - 0.2 b"},
            {"a": "-0.6 a", "b": "0.5 a - 0.2 b"},
        ],
        transitions=[(0, 1, "a >= 2"), (1, 2, "b >= 1.0"), (2, 0, "b <= 0.5")],
        states=["a", "b"],
        fields=[
            lambda t, x: [0.5 - 0.1 * x[0], -0.2 * x[1]],
            lambda t, x: [0.5 - 0.6 * x[0], 0.5 * x[0] - 0.2 * x[1]],
            lambda t, x: [-0.6 * x[0], 0.5 * x[0] - 0.2 * x[1]],
        ],
        guards=[
            lambda t, x, entered: x[0] - 2,
            lambda t, x, entered: x[1] - 1,
            lambda t, x, entered: 0.5 - x[1],
        ],
        resets=[stays] * 3,
        x0=[0.5, 0.2],
        mode=0,
        end=40.0,
        n_events=8,
    ),
    "cycle of three states": Case(
        laws=[{"x": "1", "y": "-x"}, {"x": "-0.5 x", "y": "1"}, {"x": "0.3", "y": "-2 y"}],
        transitions=[
            (0, 1, "x >= 2", {"y": "y + 0.5 x"}),
            (1, 2, "y + x >= 3", {"x": "0.5 x + 0.1 y - 0.2"}),
            (2, 0, "y <= 0.5"),
        ],
        states=["x", "y"],
        fields=[
            lambda t, x: [1.0, -x[0]],
            lambda t, x: [-0.5 * x[0], 1.0],
            lambda t, x: [0.3, -2 * x[1]],
        ],
        guards=[
            lambda t, x, entered: x[0] - 2,
            lambda t, x, entered: x[0] + x[1] - 3,
            lambda t, x, entered: 0.5 - x[1],
        ],
        resets=[
            lambda x: np.array([x[0], x[1] + 0.5 * x[0]]),
            lambda x: np.array([0.5 * x[0] + 0.1 * x[1] - 0.2, x[1]]),
            stays,
        ],
        x0=[0.0, 0.0],
        mode=0,
        end=30.0,
        n_events=16,
    ),
    "buck converter with a time guard": Case(
        # on for a given time after each begin of a period, the absolute clock ending the off phase
        laws=[
            {"i": "20 (12 - v)", "v": "10 (i - v)", "next": "0"},
            {"i": "-20 v", "v": "10 (i - v)", "next": "0"},
        ],
        transitions=[(0, 1, "dwell >= 0.04"), (1, 0, "time >= next", {"next": "next + 0.1"})],
        states=["i", "v", "next"],
        fields=[
            lambda t, x: [20 * (12 - x[1]), 10 * (x[0] - x[1]), 0],
            lambda t, x: [-20 * x[1], 10 * (x[0] - x[1]), 0],
        ],
        guards=[lambda t, x, entered: t - entered - 0.04, lambda t, x, entered: t - x[2]],
        resets=[stays, lambda x: np.array([x[0], x[1], x[2] + 0.1])],
        x0=[0.0, 0.0, 0.1],
        mode=0,
        end=1.55,
        n_events=31,
    ),
    "relay with hysteresis on a plant of second order": Case(
        laws=[{"x": "v", "v": "-x - 0.4 v + 1"}, {"x": "v", "v": "-x - 0.4 v - 1"}],
        transitions=[(0, 1, "x >= 0.3"), (1, 0, "x <= -0.3")],
        states=["x", "v"],
        fields=[
            lambda t, x: [x[1], -x[0] - 0.4 * x[1] + 1],
            lambda t, x: [x[1], -x[0] - 0.4 * x[1] - 1],
        ],
        guards=[lambda t, x, entered: x[0] - 0.3, lambda t, x, entered: -0.3 - x[0]],
        resets=[stays, stays],
        x0=[0.0, 0.0],
        mode=0,
        end=30.0,
        n_events=16,
    ),
    "one-legged jumper": Case(
        # flight, stance with a spring that is stiffer on the way up
        laws=[
            {"y": "v", "v": "-9.81"},
            {"y": "v", "v": "-9.81 + 400 (1 - y) - 4 v"},
            {"y": "v", "v": "-9.81 + 500 (1 - y) - 4 v"},
        ],
        transitions=[
            (0, 1, "y <= 1", {"v": "0.95 v"}),
            (1, 2, "v >= 0"),
            (2, 0, "y >= 1"),
        ],
        states=["y", "v"],
        fields=[
            lambda t, x: [x[1], -9.81],
            lambda t, x: [x[1], -9.81 + 400 * (1 - x[0]) - 4 * x[1]],
            lambda t, x: [x[1], -9.81 + 500 * (1 - x[0]) - 4 * x[1]],
        ],
        guards=[
            lambda t, x, entered: 1 - x[0],
            lambda t, x, entered: x[1],
            lambda t, x, entered: x[0] - 1,
        ],
        resets=[lambda x: np.array([x[0], 0.95 * x[1]]), stays, stays],
        x0=[1.5, 0.0],
        mode=0,
        end=5.0,
        n_events=23,
    ),
    "switched Duffing oscillator": Case(
        laws=[{"x": "v", "v": "x - x^3 - 0.2 v"}, {"x": "v", "v": "-2 x - x^3 + 0.3 v"}],
        transitions=[(0, 1, "x^2 + v^2 <= 0.4"), (1, 0, "x^2 + v^2 >= 1.5")],
        states=["x", "v"],
        fields=[
            lambda t, x: [x[1], x[0] - x[0] ** 3 - 0.2 * x[1]],
            lambda t, x: [x[1], -2 * x[0] - x[0] ** 3 + 0.3 * x[1]],
        ],
        guards=[
            lambda t, x, entered: 0.4 - x[0] ** 2 - x[1] ** 2,
            lambda t, x, entered: x[0] ** 2 + x[1] ** 2 - 1.5,
        ],
        resets=[stays, stays],
        x0=[1.2, 0.5],
        mode=0,
        end=40.0,
        n_events=11,
    ),
    "switched Lotka-Volterra system": Case(
        # hunting begins where predators are many and ends where they are few
        laws=[
            {"p": "p (1 - q)", "q": "q (p - 1)"},
            {"p": "p (1 - q)", "q": "q (p - 1.5)"},
        ],
        transitions=[(0, 1, "q >= 1.4"), (1, 0, "q <= 0.7")],
        states=["p", "q"],
        fields=[
            lambda t, x: [x[0] * (1 - x[1]), x[1] * (x[0] - 1)],
            lambda t, x: [x[0] * (1 - x[1]), x[1] * (x[0] - 1.5)],
        ],
        guards=[lambda t, x, entered: x[1] - 1.4, lambda t, x, entered: 0.7 - x[1]],
        resets=[stays, stays],
        x0=[1.5, 1.0],
        mode=0,
        end=40.0,
        n_events=6,
    ),
    "timer": Case(
        laws=[{"x": "-x"}, {"x": "2 - x"}, {"x": "0.5"}],
        transitions=[
            (0, 1, "dwell >= 1.5"),
            (1, 2, "dwell >= 0.7"),
            (2, 0, "dwell >= 0.4", {"x": "x - 0.2"}),
        ],
        states=["x"],
        fields=[lambda t, x: -x, lambda t, x: 2 - x, lambda t, x: 0.5 + 0 * x],
        guards=[
            lambda t, x, entered: t - entered - 1.5,
            lambda t, x, entered: t - entered - 0.7,
            lambda t, x, entered: t - entered - 0.4,
        ],
        resets=[stays, stays, lambda x: x - 0.2],
        x0=[1.0],
        mode=0,
        end=20.0,
        n_events=22,
    ),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_rollouts_are_those_of_scipy(case):
    t = np.linspace(0.0, case.end, 401)
    ours = case.automaton.simulate(case.x0, t, mode=case.mode, rtol=1e-12, atol=1e-12)
    reference = case.reference(t)
    assert ours.status is Status.COMPLETED
    assert len(ours.events) == len(reference.events) == case.n_events
    instants = [event.time for event in ours.events]
    np.testing.assert_allclose(instants, [e[0] for e in reference.events], atol=1e-8, rtol=0)
    assert [(e.before, e.after) for e in ours.events] == [e[1:] for e in reference.events]
    # a row within rounding of an instant may be seen on either side of it
    clear = np.abs(ours.t[:, None] - instants).min(axis=1) > 1e-8
    np.testing.assert_array_equal(ours.modes[clear], np.array(reference.modes)[clear])
    size = np.abs(reference.x).max()
    np.testing.assert_allclose(
        ours.x[clear], np.array(reference.x)[clear], atol=1e-8 * size, rtol=0
    )
