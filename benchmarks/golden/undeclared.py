"""What the effect search finds, and that it finds nothing: records of four families.

A cell is (family, what makes its record in its own room): `listed` effects and `unlisted` shapes of
`benchmarks.undeclared`, `fresh` records there of plants drawn by chance, and `null` records of
`benchmarks.calibration`, in which nothing is missing. Left out are what costs as much as all
others: the system of two masses, and fresh records of more than 2500 rows.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from benchmarks.calibration.__main__ import run_null
from benchmarks.calibration.nulls import NULLS
from benchmarks.golden.record import estimate, short, took, yardstick
from benchmarks.results import measured_here
from benchmarks.undeclared.cells import Cell, run_cell
from benchmarks.undeclared.fresh import run_fresh
from benchmarks.undeclared.tables import first_right
from benchmarks.undeclared.unlisted import UnlistedCell, run_unlisted
from swsysid.datasets import undeclared_kinds, unlisted_kinds
from swsysid.effects import all_effects

__all__ = ["cells", "run"]

SYSTEMS = ("oscillator", "quartic", "pendulum", "tanks", "discrete")
SEED = 7701
# The first numbers from 77000 on whose records have at most 2500 rows.
FRESH = [
    *(77002, 77005, 77010, 77018, 77020, 77023, 77024, 77029, 77030, 77031),
    *(77032, 77035, 77039, 77042, 77043, 77046, 77047, 77049, 77052, 77056),
    *(77057, 77059, 77060, 77061, 77065, 77066, 77067, 77069, 77070, 77077),
    *(77078, 77081, 77088, 77091, 77096, 77097, 77099, 77100, 77101, 77102),
]
MANY = {"fresh": 40, "null": 30, "listed": 44, "unlisted": 8}
QUICK = {"fresh": 6, "null": 10, "listed": 1, "unlisted": 0}
NORMAL = 1.96  # half an interval of 95 % in standard errors


def cells(part: str) -> list[list]:
    """So many of each family; those of the quick part are the first ones."""
    many = QUICK if part == "quick" else MANY
    return [[family, *one] for family, of in FAMILIES.items() for one in of(many[family])]


def _listed(number: int) -> list[list]:
    kinds = {effect.kind for effect in all_effects()}
    every = [[system, kind] for system in SYSTEMS for kind in undeclared_kinds(system)
             if kind in kinds]  # fmt: skip
    return [[*one, SEED] for one in _drawn(every, number)]


def _unlisted(number: int) -> list[list]:
    return [[*one, SEED] for one in _drawn(list(product(SYSTEMS, unlisted_kinds())), number)]


def _fresh(number: int) -> list[list]:
    return [[one] for one in FRESH[:number]]


def _null(number: int) -> list[list]:
    seeds = range(SEED, SEED + number)
    return [[name, seed] for seed, name in product(seeds, NULLS)][:number]


def _drawn(every: list, number: int) -> list:
    order = np.random.RandomState(SEED).permutation(len(every))
    return [every[place] for place in order[:number]]


FAMILIES = {"fresh": _fresh, "null": _null, "listed": _listed, "unlisted": _unlisted}


def run(family: str, *one) -> dict:
    """The record of one search."""
    unit = yardstick()
    told, right, error, n_planted = RUNS[family](*one)
    found = [effect["name"] for effect in told["effects"]]
    figures = {"effects": max(len(told["found"]) - n_planted, 0)}
    if error is not None:
        figures["error"] = short([error])[0]
    return {
        "cell": [family, *one],
        "commit": measured_here()["commit"],
        "data": [],
        **took(told["seconds"], unit),
        "right": bool(right),
        "alarm": n_planted == 0 and bool(told["found"]),
        "found": found,
        "p_values": short([effect["p_value"] for effect in told["effects"]], 2),
        "figures": figures,
        "estimates": {
            effect["name"]: estimate(
                list(effect["parameters"].values()),
                np.ptp(list(effect["intervals"].values()), axis=1) / (2.0 * NORMAL),
            )
            for effect in told["effects"]
            if effect["parameters"]
        },
    }


# The record, whether it is right, the error on fresh rows, and how many effects were planted.


def _run_listed(system: str, kind: str, seed: int) -> tuple[dict, bool, float | None, int]:
    [told] = run_cell(Cell(system, (kind,), "gaussian", seed))
    return told, first_right(told), told["trimmed_ratio"], 1


def _run_unlisted(system: str, kind: str, seed: int) -> tuple[dict, bool, float | None, int]:
    [told] = run_unlisted(UnlistedCell(system, kind, seed))
    return told, told["verdict"] == "right", told["inside_ratio"], 1


def _run_fresh(number: int) -> tuple[dict, bool, float | None, int]:
    [told] = run_fresh(number)
    return told, told["verdict"] == "right", told["errors"][0], int(told["missing"] != "nothing")


def _run_null(name: str, seed: int) -> tuple[dict, bool, float | None, int]:
    [told] = [run_null(name, seed)]
    return told, not told["found"], None, 0


RUNS = {"listed": _run_listed, "unlisted": _run_unlisted, "fresh": _run_fresh, "null": _run_null}
