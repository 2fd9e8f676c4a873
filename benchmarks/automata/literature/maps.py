"""Automata in discrete time, with and without lags."""

from __future__ import annotations

from benchmarks.automata.experiments import drawn, ramps
from benchmarks.automata.plant import Edge, Plant

__all__ = ["PLANTS"]

_HINGE = {"y": -0.3, "u": 0.6, "1": 0.3}
_LINE = {"y": 0.8, "u": 0.4, "1": -0.1}
_STEP = 0.25  # ms

PLANTS = (
    Plant(
        "hinging ARX",
        states=("y",),
        laws=[{"y": _LINE}, {"y": {name: _LINE[name] + _HINGE[name] for name in _LINE}}],
        edges=[Edge(0, 1, _HINGE), Edge(1, 0, {name: -value for name, value in _HINGE.items()})],
        start=drawn((0, [(-1.0, 1.0)])),
        dt=1.0,
        input_names=("u",),
        inputs=ramps((-2.0, 2.0)),
        is_map=True,
        source="Roll, Bemporad, Ljung: Identification of piecewise affine systems via "
        "mixed-integer programming, Automatica 40, 2004, example of a hinging hyperplane ARX",
    ),
    Plant(
        "lynx",
        states=("y",),
        laws=[
            {"y": {"1": 0.62, "y": 1.25, "y[-1]": -0.43}},
            {"y": {"1": 2.25, "y": 1.52, "y[-1]": -1.24}},
        ],
        edges=[Edge(0, 1, {"y[-1]": 1.0, "1": -3.25}), Edge(1, 0, {"y[-1]": -1.0, "1": 3.25})],
        start=drawn((0, [(2.0, 3.2)]), (1, [(3.3, 3.8)]), lags=1),
        dt=1.0,
        is_map=True,
        lags=1,
        source="Tong: Non-linear time series, 1990, threshold autoregression of the logarithm of "
        "the Canadian lynx, without its noise",
    ),
    Plant(
        "relay and ARX plant",
        states=("y",),
        laws=[{"y": {"y": 1.5, "y[-1]": -0.7, "1": relay}} for relay in (0.2, -0.2)],
        edges=[
            Edge(0, 1, {"y": 1.0, "r": -1.0, "1": -0.3}),
            Edge(1, 0, {"y": -1.0, "r": 1.0, "1": -0.3}),
        ],
        start=drawn((0, [(-0.5, -0.2)]), (1, [(0.8, 0.9)]), lags=1),
        dt=1.0,
        input_names=("r",),
        inputs=ramps((-0.5, 0.5)),
        knot=10,
        is_map=True,
        lags=1,
        source="Soderstrom, Stoica: System identification, 1989, second-order system with 1, -1.5, "
        "0.7; relay with hysteresis of Astrom, Hagglund, Automatica 20, 1984; its numbers ours",
    ),
    Plant(
        "delayed logistic harvest",
        states=("x",),
        laws=[{"x": {"x": rate, "x*x[-1]": -rate}} for rate in (2.2, 1.8)],
        edges=[Edge(0, 1, {"x": 1.0, "1": -0.6}), Edge(1, 0, {"x": -1.0, "1": 0.45})],
        start=drawn((0, [(0.3, 0.55)]), (1, [(0.5, 0.65)]), lags=1),
        dt=1.0,
        degree=2,
        is_map=True,
        lags=1,
        source="Maynard Smith: Mathematical ideas in biology, 1968, delayed logistic map; "
        "harvested from one size of the population down to another, numbers ours",
    ),
    Plant(
        "spiking neuron",
        states=("v", "w"),
        laws=[
            {
                "v": {
                    "v": 1.0 + 5.0 * _STEP,
                    "v*v": 0.04 * _STEP,
                    "1": 140.0 * _STEP,
                    "w": -_STEP,
                    "i": _STEP,
                },
                "w": {"v": 0.1 * 0.2 * _STEP, "w": 1.0 - 0.1 * _STEP},
            }
        ],
        edges=[
            Edge(0, 0, {"v": 1.0, "1": -30.0}, reset={"v": {"1": -65.0}, "w": {"w": 1.0, "1": 2.0}})
        ],
        start=drawn((0, [(-70.0, -60.0), (-14.0, -12.0)])),
        dt=1.0,
        degree=2,
        input_names=("i",),
        inputs=ramps((5.0, 15.0)),
        knot=20,
        is_map=True,
        source="Izhikevich: Simple model of spiking neurons, IEEE TNN 14, 2003, fast spiking, in "
        "Euler steps of a quarter of a millisecond; current ours",
    ),
)
