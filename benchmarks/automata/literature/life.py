"""Cells, genes, predators, doses and epidemics."""

from __future__ import annotations

from benchmarks.automata.experiments import drawn
from benchmarks.automata.plant import Edge, Plant

__all__ = ["PLANTS"]

_LOW, _HIGH = (0.0, 0.4), (0.6, 1.0)
# which genes are above their threshold, in the order of the cycle; which one crosses it next
_RING = ((1, 0, 0), (1, 0, 1), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 1, 0))
_OUTSIDE = {"x*x": 1.0, "y*y": 1.0, "x": -2.0, "y": -2.0, "1": 2.0 - 0.161**2}
_RATES, _RECOVERY = (0.43, 0.25, 0.15, 0.09), 0.13  # a day
_INFECTED = [(0.7, 1.0), (0.005, 0.03)]


def _expressed(above: tuple[int, ...]) -> dict[str, dict[str, float]]:
    """Each gene is made while the one before it is below its threshold."""
    return {f"x{k + 1}": {f"x{k + 1}": -1.0, "1": 1.0 - above[k - 1]} for k in range(3)}


def _crossing(place: int) -> Edge:
    above, target = _RING[place], (place + 1) % len(_RING)
    gene = next(k for k in range(3) if above[k] != _RING[target][k])
    sign = -1.0 if above[gene] else 1.0
    return Edge(place, target, {f"x{gene + 1}": sign, "1": -0.5 * sign})


PLANTS = (
    Plant(
        "excitable cell",
        states=("x",),
        laws=[{"x": {"1": rate}} for rate in (-1.52, -0.76, -2.13, 130.02)],
        edges=[
            Edge(0, 1, {"x": -1.0, "1": 36.0}),
            Edge(1, 2, {"x": -1.0, "1": -4.0}),
            Edge(2, 3, {"x": -1.0, "1": -74.0}),
            Edge(3, 0, {"x": 1.0, "1": -44.0}),
        ],
        start=drawn((0, [(37.0, 43.0)]), (1, [(-3.0, 35.0)]), (2, [(-70.0, -5.0)])),
        dt=0.25,
        source="Gurung, Waga, Suenaga, ATVA 2023 (arXiv 2301.03915), excitable cell after Garcia "
        "Soto, Henzinger, Schilling, Zeleznik, CAV 2019; numbers as in the collection of DAINARX, "
        "ATVA/cell",
    ),
    Plant(
        "ring of three genes",
        states=("x1", "x2", "x3"),
        laws=[_expressed(above) for above in _RING],
        edges=[_crossing(place) for place in range(len(_RING))],
        start=drawn(
            *((k, [_HIGH if one else _LOW for one in above]) for k, above in enumerate(_RING))
        ),
        dt=0.02,
        source="Glass, Pasternack: Prediction of limit cycles in mathematical models of biological "
        "oscillations, Bull. Math. Biol. 40, 1978, negative feedback loop of three; thresholds of "
        "one half",
    ),
    Plant(
        "predator and prey",
        states=("x", "y"),
        laws=[
            {"x": {"x": 3.0, "x*y": -3.0}, "y": {"x*y": 1.0, "y": -1.0}},
            {"x": {"x": 2.0, "x*y": -2.0}, "y": {"x*y": 0.5, "y": -0.5}},
        ],
        edges=[
            Edge(0, 1, {term: -value for term, value in _OUTSIDE.items()}),
            Edge(1, 0, _OUTSIDE),
        ],
        start=drawn((0, [(1.2, 1.28), (0.98, 1.02)])),
        dt=0.02,
        degree=2,
        guard_degree=2,
        source="Yu et al.: DAINARX, arXiv 2507.16426, Lotka-Volterra with a circular guard; starts "
        "ours",
    ),
    Plant(
        "repeated doses",
        states=("a", "c"),
        laws=[{"a": {"a": -1.0}, "c": {"a": 1.0, "c": -0.15}}],
        edges=[Edge(0, 0, {"dwell": 1.0, "1": -6.1}, reset={"a": {"a": 1.0, "1": 10.0}})],
        start=drawn((0, [(0.0, 10.0), (0.0, 20.0)])),
        dt=0.23,
        source="Gibaldi, Perrier: Pharmacokinetics, 1982, one compartment with absorption of first "
        "order and repeated doses; numbers ours",
    ),
    Plant(
        "epidemic with interventions",
        states=("s", "i"),
        laws=[
            {"s": {"s*i": -rate}, "i": {"s*i": rate, "i": -_RECOVERY}} for rate in _RATES
        ],
        edges=[Edge(k, k + 1, {"time": 1.0, "1": -7.0 * (k + 1)}) for k in range(3)],
        start=drawn(
            *((mode, _INFECTED) for mode in range(3)),
            times=[(0.0, 5.0), (8.0, 13.0), (15.0, 20.0)],
        ),
        dt=0.07,
        degree=2,
        source="Dehning et al.: Inferring change points in the spread of COVID-19, Science 369, "
        "2020: spreading rates and dates of three interventions; starts ours",
    ),
)  # fmt: skip
