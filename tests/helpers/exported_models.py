"""Models of every kind that is exported, with a rollout of each."""

from dataclasses import dataclass, field
from functools import cache

import numpy as np

from swsysid import EffectRegressor, FunctionLibrary, HybridAutomaton, SwitchingSystemRegressor
from swsysid.effects import CoulombFriction, PlacedEffect
from swsysid.refinement import StatedModel, StatedSurface


@dataclass(frozen=True)
class Case:
    """A model and what is asked of it."""

    model: object
    x0: tuple[float, ...]
    end: float
    mode: int | None = None
    with_input: bool = False
    hold: str = "zero"
    n_events: int = 0
    options: dict = field(default_factory=dict)

    @property
    def t(self):
        return np.linspace(0.0, self.end, 81)

    @property
    def inputs(self):
        return np.sin(3.0 * self.t)[:, None] if self.with_input else None

    def simulated(self):
        """By the package itself, as exact as it can be."""
        options = {"rtol": 1e-12, "atol": 1e-14, "input_hold": self.hold}
        if self.mode is not None:
            options["mode"] = self.mode
        return self.model.simulate(self.x0, self.t, self.inputs, **options)


@cache
def cases():
    """By name."""
    return {
        "ball": Case(
            HybridAutomaton.stated(
                [{"h": "v", "v": "-9.81"}], [(0, 0, "h <= 0", {"v": "-0.8 v"})], states=["h", "v"]
            ),
            (10.0, 0.0), 4.0, mode=0, n_events=2,
        ),
        "thermostat": Case(
            HybridAutomaton.stated(
                [{"T": "-0.1 (T - 30) + 0.3 u"}, {"T": "-0.1 (T - 10)"}],
                [(0, 1, "T >= 22"), (1, 0, "T <= 20")], states=["T"], inputs=["u"],
            ),
            (21.0,), 20.0, mode=0, with_input=True, hold="linear", n_events=10,
        ),
        "timer": Case(
            HybridAutomaton.stated(
                [{"x": "1"}, {"x": "-1"}], [(0, 1, "dwell >= 2"), (1, 0, "x <= 0.5")], states=["x"]
            ),
            (0.0,), 9.0, mode=0, n_events=4,
        ),
        "two exits": Case(_two_exits(), (0.2, 0.5, 0.3), 12.0, mode=0, n_events=11),
        "oscillator": Case(_oscillator(), (1.0, 0.0), 20.0, n_events=6),
        "sliding": Case(
            StatedModel(
                1, [[[1, 0, 0], [0.2, 0, 0]], [[-1, 0.1, 0], [0.3, 0, 0]]], states=["x", "y"],
                surface=StatedSurface([[0, 1, 0.1]], 1),
            ),
            (-1.0, 0.0), 5.0, n_events=1,
        ),
        "three modes": Case(_three_modes(), (-1.0, 0.0), 12.0, n_events=6),
        "pendulum": Case(
            StatedModel(
                FunctionLibrary([np.sin, lambda x, v: v * np.abs(v)], names=["sin({})", "{}|{}|"]),
                [[[0, 0, 0], [-9.81, 0, -0.1]]], states=["angle", "speed"],
            ),
            (1.0, 0.5), 3.0,
        ),
        "friction": Case(_with_friction(0), (2.0, 0.0), 12.0, n_events=3),
        "driven friction": Case(
            _with_friction(1), (0.2, 0.0), 12.0, with_input=True, hold="linear", n_events=12
        ),
    }  # fmt: skip


def _two_exits():
    """A level that rises, and falls as a valve says that turns by itself."""
    return HybridAutomaton.stated(
        [{"x": rate, "w": "0.7 z", "z": "-0.7 w"} for rate in ("1", "-0.7", "-1.5")],
        [(0, 1, "x >= 1 and w >= 0.1"), (0, 2, "x >= 1 and w <= 0.1"), (1, 0, "x <= 0"),
         (2, 0, "x <= -0.1")],
        states=["x", "w", "z"],
    )  # fmt: skip


def _oscillator():
    X = np.random.default_rng(0).uniform(-1, 1, (300, 2))
    damping = np.where(X[:, 0] > 0, 0.1, 0.5)
    Xdot = np.column_stack([X[:, 1], -X[:, 0] - damping * X[:, 1]])
    return SwitchingSystemRegressor(n_modes=2, random_state=0).fit(X, Xdot)


def _three_modes():
    laws = [[[0, 0, 1], [0, -1, -0.05]], [[0, 0, 1], [0, -3, -0.05]], [[0, 0, 1], [0.5, -1, 0.2]]]
    book = [[-1, -1], [1, -1], [-1, 1]]
    surface = StatedSurface([[0, 1, 0], [0.2, 0, 1]], 1, book)
    return StatedModel(1, laws, states=["x", "v"], surface=surface)


def _with_friction(n_inputs):
    X = np.random.default_rng(0).uniform(-2, 2, (400, 2 + n_inputs))
    force = -X[:, 0] - 0.05 * X[:, 1] - 0.3 * np.sign(X[:, 1]) + X[:, 2:].sum(axis=1)
    friction = PlacedEffect(CoulombFriction(), place=1, target=1)
    model = EffectRegressor(SwitchingSystemRegressor(n_modes=1), [friction])
    return model.fit(X, np.column_stack([X[:, 1], force]))
