"""Converters, and automata of order two that were made to try tools on."""

from __future__ import annotations

from benchmarks.automata.experiments import drawn, ramps
from benchmarks.automata.plant import Edge, Plant

__all__ = ["PLANTS"]

_LOAD = {"i": 454.5455, "v": -45.4545}
# boost converter in units of its period: capacitor, coil, their resistances, load, source
_C, _L, _RC, _RL, _RO, _VS = 70.0, 3.0, 0.005, 0.05, 1.0, 1.0
_SHARED = _RO / (_RO + _RC)
_PERIOD = 2.0
_LEAK = {"v": -1.0 / (_C * (_RO + _RC))}
_UP, _DOWN = {"x": 0.5, "v": -0.5}, {"x": -0.5, "v": -0.5}

PLANTS = (
    Plant(
        "buck converter",
        states=("i", "v"),
        laws=[
            {"i": {"i": -271.6981, "v": -377.3585, "1": 377.3585 * 24.0}, "v": _LOAD},
            {"i": {"i": -196.2264, "v": -377.3585}, "v": _LOAD},
            {"v": {"v": -45.4545}},
        ],
        edges=[
            Edge(0, 1, {"v": 1.0, "1": -12.1}),
            Edge(1, 2, {"i": -1.0}),
            Edge(1, 0, {"v": -1.0, "1": 11.9}),
            Edge(2, 0, {"v": -1.0, "1": 11.9}),
        ],
        start=drawn(
            (0, [(2.0, 14.0), (6.0, 11.0)]),
            (1, [(0.5, 1.0), (11.905, 11.93)]),
            (2, [(0.0, 0.0), (12.0, 12.2)]),
        ),
        dt=1e-5,
        source="Beg, Abbas, Johnson, Davoudi: Model validation of PWM DC-DC converters, IEEE TIE "
        "64, 2017, hysteresis control of a buck converter; numbers as in the collection of "
        "DAINARX, FaMoS/buck_converter",
    ),
    Plant(
        "boost converter",
        states=("i", "v", "c"),
        laws=[
            {"i": {"i": -_RL / _L, "1": _VS / _L}, "v": _LEAK, "c": {"1": 1.0}},
            {
                "i": {"i": -(_RL + _SHARED * _RC) / _L, "v": -_SHARED / _L, "1": _VS / _L},
                "v": {"i": _SHARED / _C, **_LEAK},
                "c": {"1": 1.0},
            },
        ],
        edges=[
            Edge(0, 1, {"i": 1.0, "r": -1.0}),
            Edge(0, 0, {"c": 1.0, "1": -_PERIOD}, reset={"c": {}}),
            Edge(1, 0, {"c": 1.0, "1": -_PERIOD}, reset={"c": {}}),
        ],
        start=drawn((0, [(0.5, 1.2), (1.1, 1.6), (0.0, 1.9)])),
        dt=0.11,
        input_names=("r",),
        inputs=ramps((1.6, 2.2)),
        knot=80,
        source="Beccuti, Papafotiou, Morari: Optimal control of the boost dc-dc converter, CDC "
        "2005; numbers of Girard, Pola, Tabuada, IEEE TAC 55, 2010; switched on by a clock and "
        "off by a current reference as in Deane, IEEE TCAS 39, 1992; period and reference ours",
    ),
    Plant(
        "two-state automaton",
        states=("x", "v"),
        laws=[{"x": {"v": 1.0}, "v": _UP}, {"x": {"v": 1.0}, "v": _DOWN}],
        edges=[Edge(0, 1, {"x": 1.0, "1": -25.0}), Edge(1, 0, {"x": -1.0, "1": 15.0})],
        start=drawn((0, [(10.0, 22.0), (0.0, 8.0)]), (1, [(22.0, 26.0), (-8.0, 6.0)])),
        dt=0.05,
        source="Plambeck, Bracht, Hranisavljevic, Fey: FaMoS, HSCC 2024, two-state automaton; "
        "numbers as in the collection of DAINARX, FaMoS/two_state_ha",
    ),
    Plant(
        "three-state automaton",
        states=("x", "v"),
        laws=[
            {"x": {"v": 1.0}, "v": _UP},
            {"x": {"v": 1.0}, "v": _DOWN},
            {"x": {"v": 1.0}, "v": {"x": -0.5}},
        ],
        edges=[
            Edge(0, 1, {"x": 1.0, "1": -25.0}),
            Edge(1, 2, {"x": -1.0, "1": 20.0}),
            Edge(2, 0, {"x": -1.0, "1": 15.0}),
        ],
        start=drawn(
            (0, [(10.0, 20.0), (0.0, 8.0)]),
            (1, [(22.0, 25.0), (-2.0, 8.0)]),
            (2, [(18.0, 20.0), (0.0, 0.0)]),
        ),
        dt=0.02,
        source="Plambeck, Bracht, Hranisavljevic, Fey: FaMoS, HSCC 2024, three-state automaton; "
        "numbers as in the collection of DAINARX, FaMoS/three_state_ha",
    ),
)
