"""Works of hours, each killed once in the middle and gone on with: seconds, memory, truth.

    python -m benchmarks.long_runs search|rows|recordings FOLDER [--size N] [--kill SECONDS]

``search``: `EffectSearchCV` over the whole library for noisy recordings of a pendulum whose law
lacks dry friction and a drag; ``rows``: `SwitchingSystemRegressor` on 1e8 rows of the damped
oscillator, mapped into memory in blocks; ``recordings``: `TrajectoryIdentifier` on 2,000 recordings
of a spring that is softer on one side. Each runs in a process of its own, with a checkpoint in
FOLDER, is ended by SIGKILL after so many seconds, started again, and ends with what it has found
beside the truth. FOLDER/memory.csv has seconds, the number of the process, its resident memory in
MB and the age of its last step in s, every thirty seconds.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
import warnings
from functools import partial
from pathlib import Path

import numpy as np

from swsysid import EffectSearchCV, HybridAutomaton, SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid.datasets import make_undeclared
from swsysid.metrics import mode_accuracy

EVERY = 30.0  # seconds between two looks at the memory
SIZES = {"search": 40_000, "rows": 100_000_000, "recordings": 2000}
BLOCK = 1_000_000  # rows
TIMES = np.arange(0.0, 10.0, 0.05)


def main(arguments: list[str] | None = None) -> None:
    """Run one work to its end, killed once, or do it in this process."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", choices=SIZES)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--size", type=float, help="rows, or recordings")
    parser.add_argument("--kill", type=float, default=3000.0, help="seconds until it is killed")
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    size = int(options.size or SIZES[options.work])
    if options.one:
        warnings.simplefilter("ignore")
        answer = WORKS[options.work](options.folder, size)
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
        print(json.dumps(answer | {"peak MB": peak, "CPU s": round(time.process_time())}))
        return
    options.folder.mkdir(parents=True, exist_ok=True)
    if options.work != "search":
        {"rows": write_rows, "recordings": write_recordings}[options.work](options.folder, size)
    print(json.dumps(watched(options.work, options.folder, size, options.kill), indent=1))


def watched(work: str, folder: Path, size: int, kill: float) -> dict:
    """Answer of a work that is killed once, with all its seconds; CPU and peak are the last's."""
    command = [sys.executable, "-m", "benchmarks.long_runs", work, str(folder), "--one"]
    command += ["--size", str(size)]
    begun, seen = time.monotonic(), []
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    with open(folder / "memory.csv", "w", encoding="utf-8") as file:
        while True:
            passed, n_killed = time.monotonic() - begun, len({row[1] for row in seen}) - 1
            if process.poll() is not None:
                break
            seen.append((round(passed), process.pid, _resident(process.pid), _age(folder)))
            print(*seen[-1], sep=",", file=file, flush=True)
            if passed > kill and n_killed < 1:
                process.kill()
                process.wait()
                process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
                seen.append((round(passed), process.pid, 0, 0.0))
            left = kill - passed if n_killed < 1 else EVERY
            _ended_within(process, min(EVERY, max(left, 0.0) + 0.1))
    answer = json.loads(process.communicate()[0].splitlines()[-1])
    return {"work": work, "size": size, "seconds": round(passed), "kills": n_killed, **answer}


def search_done(folder: Path, size: int) -> dict:
    """What the search names, beside what was planted."""
    planted = ["coulomb_friction", "quadratic_drag"]
    data = make_undeclared(
        planted, system="pendulum", n_samples=size, n_trajectories=size // 250, random_state=0
    )
    n_states = data.Xdot.shape[1]
    x, inputs = np.split(data.X, [n_states], axis=1)
    x = x + 0.01 * x.std(axis=0) * np.random.default_rng(0).standard_normal(x.shape)
    search = EffectSearchCV(data.estimator, random_state=0, checkpoint=folder / "checkpoint")
    search.fit(x, t=data.t, groups=data.groups, inputs=inputs)
    found = [effect.kind for effect in search.effects_]
    return {"planted": planted, "found": found, "first line": str(search.report_).splitlines()[0]}


def rows_done(folder: Path, size: int) -> dict:
    """The largest error of a coefficient, and the share of right modes."""
    blocks, targets = _Blocks(folder, "X", size), _Blocks(folder, "Xdot", size)
    model = SwitchingSystemRegressor(
        2, sparsity="auto", random_state=0, checkpoint=folder / "checkpoint"
    ).fit(blocks, targets)
    truth = np.array([[[0.0, 1.0], [-1.0, -0.1]], [[0.0, 1.0], [-1.0, -0.5]]])
    order = np.argsort(-model.coef_[:, 1, -1])
    right = 0
    for number, block in enumerate(blocks):
        modes = (np.asarray(block)[:, 0] < 0).astype(int)
        found = order.argsort()[model.modes_[number * BLOCK : number * BLOCK + len(modes)]]
        right += int((modes == found).sum())
    error = np.abs(model.coef_[order][..., -2:] - truth).max()
    return {"largest error": float(error), "right modes": right / size}


def recordings_done(folder: Path, size: int) -> dict:
    """The largest error of a coefficient, also in standard errors, and the share of right modes."""
    found = TrajectoryIdentifier(
        SwitchingSystemRegressor(2, feature_library=1, random_state=0),
        checkpoint=folder / "checkpoint",
    ).fit([partial(_recording, folder, number) for number in range(size)])
    order = np.argsort(found.estimator_.coef_[:, 1, 1])
    laws, errors = found.estimator_.coef_[order], found.coef_errors_[order]
    off = np.abs(laws - [[[0.0, 0.0, 1.0], [0.0, -k, -0.1]] for k in (4.0, 1.0)])
    modes = (np.load(folder / "states.npy")[..., 0].ravel() >= 0).astype(int)
    return {
        "largest error": float(off.max()),
        "in standard errors": float((off / errors).max()),
        "surface": found.surface_equations(3),
        "right modes": float(mode_accuracy(modes, found.modes_)),
    }


def write_recordings(folder: Path, size: int) -> None:
    """States of a spring that is softer on one side, with noise and without."""
    if (folder / "noisy.npy").exists():
        return
    rng = np.random.default_rng(0)
    plant = HybridAutomaton.stated(
        [{"x": "v", "v": "-x - 0.1 v"}, {"x": "v", "v": "-4 x - 0.1 v"}],
        [(0, 1, "x >= 0"), (1, 0, "x <= 0")],
        states=["x", "v"],
    )
    starts = np.column_stack([rng.uniform(-2.0, -0.5, size), rng.uniform(-1.0, 1.0, size)])
    runs = np.array([plant.simulate(start, TIMES, mode=0).x for start in starts])
    np.save(folder / "states.npy", runs)
    np.save(folder / "noisy.npy", runs + 0.01 * rng.standard_normal(runs.shape))


def _recording(folder: Path, number: int) -> dict[str, np.ndarray]:
    """One of them, read where it is worked on."""
    return {"t": TIMES, "x": np.array(np.load(folder / "noisy.npy", mmap_mode="r")[number])}


def write_rows(folder: Path, size: int) -> None:
    """Noisy rows of the damped oscillator, a file for each block and side."""
    for number, begin in enumerate(range(0, size, BLOCK)):
        if _file(folder, "Xdot", number).exists():
            continue
        rng = np.random.default_rng(number)
        X = rng.uniform(-3.0, 3.0, (min(BLOCK, size - begin), 2))
        Xdot = np.column_stack([X[:, 1], -X[:, 0] - np.where(X[:, 0] < 0, 0.5, 0.1) * X[:, 1]])
        np.save(_file(folder, "X", number), X)
        np.save(_file(folder, "Xdot", number), Xdot + 0.05 * rng.standard_normal(X.shape))


class _Blocks:
    """One block of rows for each file."""

    def __init__(self, folder: Path, name: str, size: int) -> None:
        self.folder, self.name, self.size = folder, name, size

    def __len__(self) -> int:
        return -(-self.size // BLOCK)

    def __getitem__(self, number: int) -> np.ndarray:
        if number >= len(self):
            raise IndexError(number)
        return np.load(_file(self.folder, self.name, number), mmap_mode="r")


def _file(folder: Path, name: str, number: int) -> Path:
    return folder / f"{name}{number}.npy"


def _resident(pid: int) -> int:
    """Resident memory of a process in MB."""
    for line in Path(f"/proc/{pid}/status").read_text("utf-8").splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) // 1024
    return 0


def _age(folder: Path) -> float:
    """Seconds since the last step was written."""
    steps = list((folder / "checkpoint").rglob("*.step"))
    changed = [path.stat().st_mtime for path in steps if path.exists()]
    return round(time.time() - max(changed), 1) if changed else -1.0


def _ended_within(process: subprocess.Popen, seconds: float) -> None:
    try:
        process.wait(seconds)
    except subprocess.TimeoutExpired:
        pass


WORKS = {"search": search_done, "rows": rows_done, "recordings": recordings_done}

if __name__ == "__main__":
    main()
