"""Identification from recordings, beside another checkout: CPU seconds and what is found.

    python benchmarks/speed/recorded.py --beside FOLDER [--plants "contact" ...] [--samples 500]
                                        [--recordings 12] [--noise .01] [--seed 4401] [--auto]
                                        [--automata] [--shares] [--output FILE]

FOLDER holds another commit (``git worktree add FOLDER f96a6f0``). Both commits identify the same
recordings in turn, each in a process of its own with one thread and without parallel starts; this
file is run by its path, so that each process imports the plants and the package of its folder.
With ``--automata`` the plants are those of benchmarks.automata (``--recordings 8 --samples 400``).
``--shares`` prints what the beam and the flow take of a fit instead: were they compiled and took no
time at all, fits would take 1.3 to 1.4 times less (contact, two masses, predator), so that numba,
which was to be worth two times, is no extra.
Seconds are CPU seconds of the fit alone; a ratio is how many times as long the other one takes.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import subprocess
import sys
import time
import warnings
from pathlib import Path

HERE = Path(__file__).resolve().parents[2]


def main(arguments: list[str] | None = None) -> None:
    """Measure both sides plant by plant and print a line for each."""
    options = parse(arguments)
    if options.shares:
        for plant in options.plants or _plants(automata=False):
            print(f"{plant:28} {shares(plant, options)}", flush=True)
        return
    if options.plant:
        print(json.dumps((automaton if options.automata else measured)(options)))
        return
    lines = []
    for plant in options.plants or _plants(options.automata):
        sides = [_beside(folder, plant, options) for folder in (HERE, options.beside)]
        ours, other = sides
        lines.append({"plant": plant, "ours": ours, "other": other})
        ratio = other["seconds"] / ours["seconds"]
        print(
            f"{plant:28} {ratio:6.1f} times  {ours['seconds']:7.2f} s  {other['seconds']:7.2f} s   "
            f"modes {ours['accuracy']:.4f} {other['accuracy']:.4f}   "
            f"held out {ours['score']:.5f} {other['score']:.5f}",
            flush=True,
        )
    ratios = sorted(line["other"]["seconds"] / line["ours"]["seconds"] for line in lines)
    print(f"median {ratios[len(ratios) // 2]:.1f}, least {ratios[0]:.1f} times less CPU")
    if options.output:
        Path(options.output).write_text(json.dumps(lines, indent=1), encoding="utf-8")


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line; ``--plant`` is how a side is called."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--beside", type=Path, help="folder with the other commit")
    parser.add_argument("--plants", nargs="+")
    parser.add_argument("--plant", help=argparse.SUPPRESS)
    parser.add_argument("--samples", type=int, default=500, help="of a recording")
    parser.add_argument("--recordings", type=int, default=12)
    parser.add_argument("--noise", type=float, default=0.01, help="part of the spread of a state")
    parser.add_argument("--seed", type=int, default=4401, help="not one that was tuned on")
    parser.add_argument("--auto", action="store_true", help='n_modes="auto"')
    parser.add_argument("--shares", action="store_true", help="of the beam and the flow")
    parser.add_argument("--automata", action="store_true", help="hybrid automata")
    parser.add_argument("--output", help="file of the results")
    return parser.parse_args(arguments)


def measured(options: argparse.Namespace) -> dict[str, float]:
    """CPU seconds of one fit, accuracy of its modes, score on recordings of another seed."""
    from benchmarks.trajectories.methods import identified
    from benchmarks.trajectories.plants import PLANTS
    from benchmarks.trajectories.recordings import Scenario, record
    from swsysid.metrics import mode_accuracy

    plant = PLANTS[options.plant]
    per_period = round(options.samples / plant.duration)
    scenario = Scenario(options.noise, per_period, options.recordings)
    campaign = record(plant, scenario, options.seed)
    n_modes = "auto" if options.auto else None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        begun = time.process_time()
        found = identified(plant, campaign, options.seed, n_modes)
        seconds = time.process_time() - begun
        held_out = record(plant, Scenario(0.0, per_period, 4), options.seed + 1)
        score = found.score(held_out.recordings())
    accuracy = mode_accuracy(campaign.modes, found.modes_)
    return {"seconds": seconds, "accuracy": float(accuracy), "score": float(score)}


def shares(name: str, options: argparse.Namespace) -> str:
    """What a compiler could save: the time of assigning modes and of flows, in a second fit."""
    from benchmarks.trajectories.methods import identified
    from benchmarks.trajectories.plants import PLANTS
    from benchmarks.trajectories.recordings import Scenario, record

    plant = PLANTS[name]
    scenario = Scenario(options.noise, round(options.samples / plant.duration), options.recordings)
    campaign, profile = record(plant, scenario, options.seed), cProfile.Profile()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        identified(plant, campaign, options.seed, None)
        profile.runcall(identified, plant, campaign, options.seed, None)
    functions = pstats.Stats(profile).stats  # calls, calls, own time, time with what it calls
    whole = sum(one[2] for one in functions.values())
    compiled = {("assign.py", "assign"), ("flow.py", "_steady"), ("flow.py", "switching")}
    part = sum(
        one[3] for (file, _, function), one in functions.items()
        if (Path(file).name, function) in compiled
    )  # fmt: skip
    return f"{part / whole:.0%} of a fit, {whole / (whole - part):.2f} times less without"


def automaton(options: argparse.Namespace) -> dict[str, float]:
    """The same of an automaton, its number of modes not told."""
    from benchmarks.automata.plants import PLANTS
    from benchmarks.automata.recordings import Scenario, record
    from swsysid import HybridAutomatonRegressor
    from swsysid.metrics import mode_accuracy

    plant = PLANTS[options.plant]
    scenario = Scenario(options.noise, options.recordings, options.samples)
    seen, unseen = record(plant, scenario, options.seed), record(plant, scenario, options.seed + 1)
    model = HybridAutomatonRegressor(
        lags=plant.lags,
        discrete_time=plant.is_map,
        feature_library=plant.degree,
        guard_degree=plant.guard_degree,
        random_state=options.seed,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        begun = time.process_time()
        found = model.fit(seen.x, seen.t, groups=seen.groups, inputs=seen.inputs)
        seconds = time.process_time() - begun
        score = found.score(unseen.x, unseen.t, groups=unseen.groups, inputs=unseen.inputs)
    accuracy = mode_accuracy(seen.modes, found.modes_)
    return {"seconds": seconds, "accuracy": float(accuracy), "score": float(score)}


def _plants(automata: bool) -> list[str]:
    sys.path.insert(0, str(HERE))
    from benchmarks.automata.plants import PLANTS as AUTOMATA
    from benchmarks.trajectories.plants import PLANTS

    return list(AUTOMATA if automata else PLANTS)


def _beside(folder: Path, plant: str, options: argparse.Namespace) -> dict[str, float]:
    """What a process in a folder measures."""
    command = [sys.executable, str(Path(__file__).resolve()), "--plant", plant]
    for name in ("samples", "recordings", "noise", "seed"):
        command += [f"--{name}", str(getattr(options, name))]
    command += ["--auto"] * options.auto + ["--automata"] * options.automata
    one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        command,
        env=os.environ | one_thread | {"PYTHONPATH": str(folder.resolve())},
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    main()
