"""Told nothing, beside CasADi with IPOPT told the modes, and dynamax told the laws: CPU seconds.

    python -m benchmarks.speed.peers [--plants "contact" ...] [--turns 3] [--samples 500]
                                     [--recordings 12] [--noise .01] [--seed 4401] [--docs docs]

All are given the same recordings of plants of `benchmarks.trajectories`, and take turns in one
process with one thread; seconds are medians of the turns, imports not counted.

- *ours*: `TrajectoryIdentifier`, told the library, the degree of the surface and how many modes
  there are. It finds laws, modes, instants and surface, with standard errors and a verdict.
- *CasADi with IPOPT* (`told_modes`) is told the mode of every sample and finds laws and instants.
  Of the ways to state it this one is the fastest: with the exact Hessian, or expanded to SX,
  building alone takes longer than all of it.
- *dynamax* (`told_laws`) is told the true laws and finds the modes, with its particle filter of
  switching linear systems and with its hidden Markov model, which no law is too curved for.
"""

from __future__ import annotations

import argparse
import os
import warnings
from collections.abc import Callable
from time import process_time

from benchmarks import pages
from benchmarks.results import add_docs_options, keep, measured_here, place
from benchmarks.speed.peers_table import PEERS, table
from benchmarks.speed.told import Figures, Told
from benchmarks.trajectories.methods import identified
from benchmarks.trajectories.plants import PLANTS
from benchmarks.trajectories.recordings import Scenario, record
from swsysid.metrics import mode_accuracy
from swsysid.metrics._modes import best_matching, contingency

__all__ = ["ours", "sides"]

_PLANTS = ["contact", "backlash, three modes", "two masses, four states", "predator and prey"]


def ours(told: Told) -> Figures:
    """Laws, modes, instants and surface from the samples alone."""
    begun, n_modes = process_time(), told.plant.n_modes
    found = identified(told.plant, told.campaign, told.seed)
    seconds = process_time() - begun
    joint = contingency(told.campaign.modes, found.modes_, shape=(n_modes, n_modes))
    laws = found.estimator_.coef_[best_matching(joint)[1]]
    accuracy = mode_accuracy(told.campaign.modes, found.modes_)
    return {"running": seconds, "laws": told.error(laws), "modes": float(accuracy)}


def sides(affine: bool) -> dict[str, Callable[[Told], Figures]]:
    """All that can be run; the packages of others are imported here, no table needs them."""
    one_thread = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ.setdefault("XLA_FLAGS", one_thread)
    from benchmarks.speed import told_laws, told_modes

    runs = [told_modes.most_likely, told_laws.particles, told_laws.hidden_markov]
    peers = dict(zip(PEERS, runs, strict=True))
    if not affine:
        del peers["dynamax, particles"]
    return {"ours": ours, **peers}


def main(arguments: list[str] | None = None) -> None:
    """Measure plant by plant, print, and keep."""
    options = parse(arguments)
    parts = {}
    for name in options.plants:
        plant = PLANTS[name]
        per_period = round(options.samples / plant.duration)
        scenario = Scenario(options.noise, per_period, options.recordings)
        told = Told(plant, record(plant, scenario, options.seed), options.seed)
        runs = sides(affine=plant.degree == 1)
        turns: dict[str, list[Figures]] = {side: [] for side in runs}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            for _ in range(options.turns):
                for side, run in runs.items():
                    turns[side].append(run(told))
        parts[name] = {"origin": measured_here(), "turns": turns}
        print(table({name: parts[name]}), flush=True)
    keep("peers", parts, place(options))
    if options.docs:
        pages.write("peers", options.docs, options.results)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--plants", nargs="+", choices=PLANTS, default=_PLANTS)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--samples", type=int, default=500, help="of a recording")
    parser.add_argument("--recordings", type=int, default=12)
    parser.add_argument("--noise", type=float, default=0.01, help="part of the spread of a state")
    parser.add_argument("--seed", type=int, default=4401, help="not one that was tuned on")
    parser.add_argument("--output", default="output/peers", help="folder of the results")
    add_docs_options(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    main()
