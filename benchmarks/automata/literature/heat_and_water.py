"""Rooms that are heated, tanks that are filled."""

from __future__ import annotations

from benchmarks.automata.experiments import drawn, ramps
from benchmarks.automata.plant import Edge, Plant

__all__ = ["PLANTS"]

_ROOM = {"x1": -0.2, "x2": 0.1, "u": 0.1}
_OTHER_ROOM = {"x1": 0.1, "x2": -0.2, "u": 0.1}
_HEATERS = [(6.0, 5.0), (0.0, 5.0), (6.0, 0.0), (0.0, 0.0)]
_ON, _COLD, _WARM = (18.0, 20.9), 20.0, 21.0
_OFF = (20.1, 22.0)
_DRAINS = {"x1": 0.2, "x2": 0.5, "x3": 0.3}

PLANTS = (
    Plant(
        "thermostat",
        states=("x",),
        laws=[{"x": {"x": 0.5, "1": 0.5}}, {"x": {"x": -0.5}}],
        edges=[Edge(0, 1, {"x": 1.0, "1": -25.0}), Edge(1, 0, {"x": -1.0, "1": 20.0})],
        start=drawn((0, [(10.0, 24.0)]), (1, [(21.0, 25.0)])),
        dt=0.01,
        source="Plambeck, Bracht, Hranisavljevic, Fey: FaMoS, HSCC 2024, simple heating system; "
        "numbers as in the collection of DAINARX (arXiv 2507.16426), FaMoS/simple_heating_system",
    ),
    Plant(
        "two rooms",
        states=("x1", "x2"),
        laws=[
            {"x1": {**_ROOM, "1": first}, "x2": {**_OTHER_ROOM, "1": second}}
            for first, second in _HEATERS
        ],
        edges=[
            Edge(0, 1, {"x1": 1.0, "1": -_WARM}),
            Edge(0, 2, {"x2": 1.0, "1": -_WARM}),
            Edge(1, 0, {"x1": -1.0, "1": _COLD}),
            Edge(1, 3, {"x2": 1.0, "1": -_WARM}),
            Edge(2, 3, {"x1": 1.0, "1": -_WARM}),
            Edge(2, 0, {"x2": -1.0, "1": _COLD}),
            Edge(3, 2, {"x1": -1.0, "1": _COLD}),
            Edge(3, 1, {"x2": -1.0, "1": _COLD}),
        ],
        start=drawn((0, [_ON, _ON]), (1, [_OFF, _ON]), (2, [_ON, _OFF]), (3, [_OFF, _OFF])),
        dt=0.01,
        input_names=("u",),
        inputs=ramps((0.0, 6.0)),
        knot=50,
        source="Fehnker, Ivancic: Benchmarks for hybrid systems verification, HSCC 2004, room "
        "heating; two rooms with a heater each and the numbers of RHA/TwoRoomHeater in a public "
        "collection of automata; ambient temperature ours",
    ),
    Plant(
        "variable heating",
        states=("x1", "x2"),
        laws=[
            {"x1": {"x1": 0.5, "1": 0.5}, "x2": {"x2": 0.3}},
            {"x1": {"x1": -0.5}, "x2": {"x2": 0.3}},
            {"x1": {"x1": -0.5}, "x2": {"x2": -0.5}},
        ],
        edges=[
            Edge(0, 1, {"x1": 1.0, "1": -25.0}),
            Edge(1, 2, {"x1": -1.0, "1": 20.0}),
            Edge(2, 0, {"x2": -1.0, "1": 10.0}),
        ],
        start=drawn(
            (0, [(10.0, 20.0), (10.0, 12.0)]),
            (1, [(22.0, 24.0), (13.0, 14.0)]),
            (2, [(18.0, 19.5), (11.0, 13.0)]),
        ),
        dt=0.02,
        source="Plambeck, Bracht, Hranisavljevic, Fey: FaMoS, HSCC 2024, variable heating system; "
        "numbers as in the collection of DAINARX, FaMoS/variable_heating_system",
    ),
    Plant(
        "two tanks",
        states=("x1", "x2"),
        laws=[{"x1": {"1": 8.0}, "x2": {"1": -3.0}}, {"x1": {"1": -2.0}, "x2": {"1": 7.0}}],
        edges=[Edge(0, 1, {"x2": -1.0, "1": 4.0}), Edge(1, 0, {"x1": -1.0, "1": 5.0})],
        start=drawn((0, [(4.0, 8.0), (5.0, 8.0)]), (1, [(5.5, 8.0), (4.0, 7.0)])),
        dt=0.02,
        source="Johansson, Egerstedt, Lygeros, Sastry: On the regularization of Zeno hybrid "
        "automata, 1999, water tanks with an inflow of 10 and outflows 2 and 3, so not Zeno; "
        "thresholds 5 and 4 as in the collection of DAINARX, linear/two_tank",
    ),
    Plant(
        "tanks with valves",
        states=("x1", "x2"),
        laws=[
            {"x1": {"x1": -1.0, "1": valve, "u": 1.0}, "x2": second}
            for valve, second in (
                (-2.0, {"x1": 1.0, "u": 1.0}),
                (3.0, {"x1": 1.0, "u": 1.0}),
                (3.0, {"x1": 1.0, "x2": -1.0, "1": -5.0, "u": 1.0}),
                (-2.0, {"x1": 1.0, "x2": -1.0, "1": -5.0, "u": 1.0}),
            )
        ],
        edges=[
            Edge(0, 1, {"x1": -1.0, "1": -1.0}),
            Edge(0, 3, {"x2": 1.0, "1": -1.0}),
            Edge(1, 3, {"x2": 1.0, "1": -1.0}),
            Edge(2, 1, {"x2": -1.0}),
            Edge(2, 3, {"x1": 1.0, "1": -1.0}),
            Edge(3, 0, {"x2": -1.0}),
            Edge(3, 2, {"x1": -1.0, "1": -1.0}),
        ],
        start=drawn((0, [(2.0, 4.0), (0.0, 0.9)]), (2, [(0.3, 0.9), (17.0, 21.0)])),
        dt=0.02,
        input_names=("u",),
        inputs=ramps((-0.5, 0.5)),
        knot=40,
        source="Hiskens: Stability of hybrid system limit cycles, CDC 2001, two tanks; in the form "
        "of Gurung, Waga, Suenaga, ATVA 2023 (arXiv 2301.03915), numbers as in the collection of "
        "DAINARX, ATVA/tanks; input ours",
    ),
    Plant(
        "three tanks",
        states=("x1", "x2", "x3"),
        laws=[
            {tank: {"1": (tank == filled) - drain} for tank, drain in _DRAINS.items()}
            for filled in _DRAINS
        ],
        edges=[
            Edge(filled, empty, {f"x{empty + 1}": -1.0})
            for filled in range(3)
            for empty in range(3)
            if empty != filled
        ],
        start=drawn(*((mode, [(0.1, 0.6)] * 3) for mode in range(3))),
        dt=0.025,
        source="Chase, Serrano, Ramadge: Periodicity and chaos from switched flow systems, IEEE "
        "TAC 38, 1993, switched arrival system with three buffers; drains 0.2, 0.5, 0.3 as in "
        "RHA/FillingTanks of a public collection of automata; total content ours",
    ),
)  # fmt: skip
