"""Automata of `benchmarks.automata`: what `HybridAutomatonRegressor` makes of their recordings.

A cell is (plant, noise, number of recordings, seed): all plants from 8 recordings of 400 samples,
clean, which is the quick part, and from 4 at 1 % noise. One that has used up its CPU seconds is
given up, and that is its answer.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.automata.__main__ import UNSEEN, limited
from benchmarks.automata.figures import figures, matched
from benchmarks.automata.methods import as_found, automaton
from benchmarks.automata.plant import Plant
from benchmarks.automata.plants import PLANTS
from benchmarks.automata.recordings import HELD_OUT, Campaign, Scenario, record
from benchmarks.golden.record import answered, estimate
from swsysid import HybridAutomatonRegressor
from swsysid.results import PolynomialGuard

__all__ = ["cells", "run"]

SEED = 7701
LIMIT = 200.0  # CPU s


def cells(part: str) -> list[list]:
    """Plants, noises, numbers of recordings, and seeds."""
    clean = [[name, 0.0, 8, SEED] for name in PLANTS]
    return clean if part == "quick" else clean + [[name, 0.01, 4, SEED] for name in PLANTS]


def run(name: str, noise: float, n_recordings: int, seed: int) -> dict:
    """The record of one plant."""
    plant, scenario = PLANTS[name], Scenario(noise, n_recordings)
    seen = record(plant, scenario, seed)
    unseen = record(plant, Scenario(0.0, UNSEEN, scenario.n_samples), HELD_OUT + seed)

    def identify() -> HybridAutomatonRegressor:
        with limited(LIMIT):
            return automaton(plant, seen, seed)

    return answered(
        [name, noise, n_recordings, seed],
        seen.x,
        identify,
        lambda found: _kept(plant, seen, unseen, found),
        (ValueError, TimeoutError),
    )


def _kept(plant: Plant, seen: Campaign, unseen: Campaign, model: HybridAutomatonRegressor) -> dict:
    found = as_found(plant, model)
    told = figures(plant, found, seen, unseen)
    order = matched(seen.modes, found.modes, plant.n_modes, found.n_modes)
    # the true mode of each one found, where modes have partners one to one
    names = {int(own): true for true, own in enumerate(order)}
    right = told["modes"] == 0.0 and told["edges"] == 1.0 and told["ended"] == 0.0
    laws = sorted(range(found.n_modes), key=lambda own: names.get(own, plant.n_modes))
    return {
        "n_modes": found.n_modes,
        "right": right,
        "figures": {
            "modes": abs(told["modes"]),
            "unbalanced": 1.0 - told["share"],
            "no transition": 1.0 - told["edges"],
            "missed": 1.0 - told["near"],
            "spurious": told["spurious"],
            "ended": told["ended"],
            "mean": told["mean"],
            "guard": told["guard"],
        },
        "estimates": {
            "laws": estimate(model.coef_[laws], model.coef_errors_[laws]),
            **dict(_transitions(model, names)),
        },
    }


def _transitions(
    model: HybridAutomatonRegressor, names: dict[int, int]
) -> Iterator[tuple[str, dict]]:
    """Guards in units of their largest coefficient, and resets, by the true modes between which."""
    for one, errors, reset_errors in zip(
        model.transitions_, model.guard_errors_, model.reset_errors_, strict=True
    ):
        between = "-".join(str(names.get(mode, "?")) for mode in (one.source, one.target))
        parts = np.split(errors, np.cumsum([len(own.coef) for own in one.guard.conditions])[:-1])
        for own, of_own in zip(one.guard.conditions, parts, strict=True):
            size = np.abs(own.coef).max()
            yield f"guard {between}, {_terms(own)}", estimate(own.coef / size, of_own / size)
        if one.reset is not None:
            values = np.column_stack([one.reset.offset, one.reset.matrix])
            yield f"reset {between}", estimate(values, reset_errors)


def _terms(condition: PolynomialGuard) -> str:
    """The powers of the columns in each monomial."""
    return " ".join("".join(map(str, powers)) for powers in condition.powers)
