"""Things that fall, hop, swing and drive."""

from __future__ import annotations

from benchmarks.automata.experiments import drawn, ramps
from benchmarks.automata.plant import Edge, Plant

__all__ = ["PLANTS"]

_STIFF, _STIFFER = 10.0, 12.0  # natural frequencies of the leg in rad/s
_DAMPED = 0.1
_LOOP = {"y": -80.0, "dy": -80.0, "ddy": -74.0, "dddy": -7.0}
_CHAIN = {"y": {"dy": 1.0}, "dy": {"ddy": 1.0}, "ddy": {"dddy": 1.0}}
_RATIOS = (3.7271, 2.048, 1.321, 0.971)
_WHEEL = 0.28 * 14.0 / 64.0  # m, through the final drive
_MASS, _DRAG, _SLOPE = 1020.0, 25.0, -0.8  # kg, kg/s, m/s^2


def _leg(frequency: float) -> dict[str, float]:
    return {"x": -(frequency**2) * (1.0 + _DAMPED**2), "v": -2.0 * _DAMPED * frequency}


def _shift(gear: int, to: int, speed: float, throttle: float) -> Edge:
    """At an engine speed in rad/s that grows with the torque."""
    metres = _WHEEL / _RATIOS[gear]
    sign = 1.0 if to > gear else -1.0
    return Edge(gear, to, {"v": sign, "1": -sign * metres * speed, "m": -sign * metres * throttle})


PLANTS = (
    Plant(
        "bouncing ball",
        states=("x", "v"),
        laws=[{"x": {"v": 1.0}, "v": {"1": -9.8}}],
        edges=[Edge(0, 0, {"x": -1.0}, reset={"v": {"v": -0.9}})],
        start=drawn((0, [(1.0, 1.5), (-2.0, 0.0)])),
        dt=0.008,
        source="Gurung, Waga, Suenaga: Learning nonlinear hybrid automata from input-output time "
        "series, ATVA 2023 (arXiv 2301.03915), figure 1; numbers as in the collection of DAINARX, "
        "ATVA/ball",
    ),
    Plant(
        "hopping robot",
        states=("x", "v"),
        laws=[
            {"x": {"v": 1.0}, "v": {"1": -9.81}},
            {"x": {"v": 1.0}, "v": _leg(_STIFF)},
            {"x": {"v": 1.0}, "v": {"1": 40.0}},
            {"x": {"v": 1.0}, "v": _leg(_STIFFER)},
        ],
        edges=[
            Edge(0, 1, {"x": -1.0}),
            Edge(1, 2, {"v": 1.0}),
            Edge(2, 3, {"dwell": 1.0, "1": -0.04}),
            Edge(3, 0, {"x": 1.0}),
        ],
        start=drawn((0, [(0.2, 1.0), (-1.0, 1.0)])),
        dt=0.01,
        source="Koditschek, Buehler: Analysis of a simplified hopping robot, IJRR 10, 1991: "
        "flight, compression, thrust of a fixed duration, decompression; numbers ours",
    ),
    Plant(
        "one-legged jumper",
        states=("x", "y", "vx", "vy"),
        laws=[
            {"x": {"vx": 1.0}, "y": {"vy": 1.0}, "vx": {"1": 10.0}, "vy": {"1": 2.0}},
            {"x": {"vx": 1.0}, "y": {"vy": 1.0}, "vy": {"1": -10.0}},
        ],
        edges=[Edge(0, 1, {"y": 1.0, "1": -0.5}), Edge(1, 0, {"y": -1.0, "1": 0.5})],
        start=drawn((0, [(0.5, 2.0), (0.1, 0.4), (0.0, 0.0), (0.0, 0.0)])),
        dt=0.01,
        source="Yu et al.: Derivative-agnostic inference of nonlinear hybrid systems (DAINARX), "
        "arXiv 2507.16426, one-legged jumper; numbers as in its collection",
    ),
    Plant(
        "Duffing oscillator",
        states=("x", "v"),
        laws=[
            {"x": {"v": 1.0}, "v": {"u": 1.0, "v": -0.5, "x": 1.0, "x*x*x": -1.5}},
            {"x": {"v": 1.0}, "v": {"u": 1.0, "v": -0.2, "x": 1.0, "x*x*x": -0.5}},
        ],
        edges=[
            Edge(0, 1, {"x*x": -1.0, "1": 0.8**2}, reset={"v": {"v": 0.95}}),
            Edge(1, 0, {"x*x": 1.0, "1": -(1.2**2)}, reset={"v": {"v": 0.95}}),
        ],
        start=drawn((0, [(1.5, 3.0), (-0.5, 0.5)])),
        dt=0.02,
        degree=3,
        guard_degree=2,
        input_names=("u",),
        inputs=ramps((-1.0, 1.0)),
        knot=20,
        source="Yu et al.: DAINARX, arXiv 2507.16426, Duffing oscillator with hysteresis and "
        "resets; starts and input ours",
    ),
    Plant(
        "relay and PID loop",
        states=("s", "y", "dy", "ddy", "dddy"),
        laws=[
            {"s": {"1": 1.0}, **_CHAIN, "dddy": {**_LOOP, "1": 100.0}},
            {"s": {"1": -1.0}, **_CHAIN, "dddy": _LOOP},
        ],
        edges=[Edge(0, 1, {"s": 1.0, "1": -5.0}), Edge(1, 0, {"s": -1.0})],
        start=drawn(
            *((mode, [(0.5, 4.5), (0.5, 4.0), *[(0.0, 0.0)] * 3]) for mode in range(2))
        ),
        dt=0.04,
        source="Yu et al.: DAINARX, arXiv 2507.16426, DC motor position with PID control, "
        "reference from a relay; numbers as in its collection, linear/dc_motor_position_PID",
    ),
    Plant(
        "automatic gearbox",
        states=("v",),
        laws=[
            {"v": {"m": ratio / _WHEEL / _MASS, "v": -_DRAG / _MASS, "1": _SLOPE}}
            for ratio in _RATIOS
        ],
        edges=[
            *(_shift(gear, gear + 1, 280.0, 1.0) for gear in range(3)),
            *(_shift(gear, gear - 1, 140.0, 0.5) for gear in range(1, 4)),
        ],
        start=drawn((0, [(1.0, 3.0)]), (1, [(5.6, 6.5)]), (3, [(10.0, 12.0)])),
        dt=0.2,
        input_names=("m",),
        inputs=ramps((0.0, 90.0)),
        knot=40,
        source="Torrisi, Bemporad: HYSDEL, IEEE TCST 12, 2004, car with gear shift: mass, drag, "
        "wheel and ratios; slope of the road, and shifts at an engine speed that grows with the "
        "torque, ours",
    ),
    Plant(
        "Van der Pol oscillator",
        states=("x", "v"),
        laws=[{"x": {"v": 1.0}, "v": {"v": 1.0, "x*x*v": -1.0, "x": -1.0}}],
        edges=[],
        start=drawn((0, [(-2.5, 2.5), (-2.5, 2.5)])),
        dt=0.04,
        degree=3,
        source="van der Pol: On relaxation oscillations, 1926; smooth, nothing to find but the law",
    ),
)  # fmt: skip
