"""What recordings lack, told by one command: CPU seconds until the answer, and the answer.

    python benchmarks/speed/searches.py [--cases joint drone states ...] [--limit 300]
                                        [--beside FOLDER]

Each recording is written to a file and given to ``python -m swsysid FILE ... --diagnose`` in a
process of its own with one thread, which may take ``--limit`` CPU seconds; FOLDER holds another
commit (``git worktree add FOLDER f96a6f0``) that is asked the same. Recordings:

- *joint*: position of a robot joint, 6 x 1200 rows of an encoder with 16,384 steps a turn; dry
  friction and an end stop, of which the law knows nothing, nor of the speed;
- *drone*: angle of an arm with a propeller, 1,000 rows in steps of .1 degree, moved by a throttle;
  gravity, dry friction and a lag of the propeller;
- *states*: 10,000 rows of position and speed with quadratic drag, 1 % noise;
- *speed*: 10,000 rows of one state with quadratic drag, 1 % noise.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

HERE = Path(__file__).resolve().parents[2]


def main(arguments: list[str] | None = None) -> None:
    """Ask one side or both about each recording and print a line for each."""
    options = parse(arguments)
    for name in options.cases:
        data, words = CASES[name]
        for folder in (HERE, *([options.beside] if options.beside else [])):
            seconds, answer = asked(folder, data(), words, options.limit)
            side = "here" if folder == HERE else "beside"
            print(f"{name:8} {side:7} {seconds:7.1f} CPU s   {answer}", flush=True)


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--limit", type=int, default=300, help="CPU seconds")
    parser.add_argument("--beside", type=Path, help="folder with another commit")
    return parser.parse_args(arguments)


def asked(folder: Path, table: pd.DataFrame, words: str, limit: int) -> tuple[float, str]:
    """CPU seconds of one command, and the first sentences of its answer."""
    environment = dict(os.environ, PYTHONPATH=str(folder), OMP_NUM_THREADS="1",
                       OPENBLAS_NUM_THREADS="1")  # fmt: skip
    begun = resource.getrusage(resource.RUSAGE_CHILDREN)
    with TemporaryDirectory() as place:
        table.to_csv(f"{place}/recording.csv", index=False)
        command = [sys.executable, "-W", "ignore", "-m", "swsysid", "recording.csv",
                   *words.split(), "--time", "t", "--diagnose", "--output", "out"]  # fmt: skip
        done = subprocess.run(
            command, cwd=place, env=environment, capture_output=True, text=True,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (limit, limit)),
        )  # fmt: skip
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = ended.ru_utime + ended.ru_stime - begun.ru_utime - begun.ru_stime
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:]
        return seconds, f"no answer ({' '.join(last)})"
    lines = done.stdout.splitlines()
    told = [k for k, line in enumerate(lines) if line.startswith("Effect search:")]
    return seconds, lines[told[0] + 1] if told else "several laws"


def joint() -> pd.DataFrame:
    """A joint that sticks, and springs back from its end stop."""
    inertia, damping, friction, stop, step = 0.05, 0.08, 0.25, 0.8, 2.0 * np.pi / 16384
    runs = [(1.0, 2.0, 0.3), (1.4, 3.0, 1.0), (0.9, 1.5, -0.5), (1.6, 4.0, 0.1), (1.2, 2.5, 2.0),
            (1.8, 3.5, -1.0)]  # fmt: skip
    t, frames = np.arange(0.0, 6.0, 0.005), []
    for number, (size, rate, phase) in enumerate(runs):

        def torque(s: float, size: float = size, rate: float = rate, phase: float = phase):
            return size * (np.sin(rate * s + phase) + 0.35 * np.sin(2.7 * rate * s))

        def rates(s: float, x, torque: Callable = torque):
            contact = (-12.0 * (x[0] - stop) - 0.15 * x[1]) * (x[0] > stop)
            held = friction * np.tanh(x[1] / 1e-3)
            return [x[1], (torque(s) - damping * x[1] - held + contact) / inertia]

        options = {"rtol": 1e-8, "atol": 1e-10, "max_step": 0.005}
        found = solve_ivp(rates, (0.0, 6.0), (0.0, 0.0), method="LSODA", t_eval=t, **options)
        angle = np.round(found.y[0] / step) * step
        frames.append(pd.DataFrame({"run": number, "t": t, "q": angle, "tau": torque(t)}))
    return pd.concat(frames, ignore_index=True)


def drone() -> pd.DataFrame:
    """An arm that a propeller lifts: its thrust follows the throttle late."""

    def rates(x, u):
        held = 0.15 * np.tanh(x[1] / 1e-2)
        lifted = -4.0 * np.sin(x[0]) - 0.4 * x[1] - held + x[2]
        return np.array([x[1], lifted, (0.04 * u - x[2]) / 0.3])

    t = np.arange(1000) * 0.05
    throttle = 40.0 + 15.0 * _drawn(t, 1.5, seed=3)
    angle = np.degrees(_rolled_out(rates, np.zeros(3), t, throttle)[:, 0])
    return pd.DataFrame({"t": t, "theta_deg": np.round(angle, 1), "u_pct": throttle})


def states() -> pd.DataFrame:
    """A mass on a spring, its speed measured as well."""
    t = np.arange(10_000) * 0.1
    force = 2.0 * _drawn(t, 1.5, seed=7)

    def rates(x, u):
        return np.array([x[1], -2.0 * x[0] - 0.3 * x[1] - 0.25 * x[1] * abs(x[1]) + u])

    x = _noisy(_rolled_out(rates, np.zeros(2), t, force))
    return pd.DataFrame({"t": t, "x": x[:, 0], "v": x[:, 1], "u": force})


def speed() -> pd.DataFrame:
    """A wheel in air."""
    t = np.arange(10_000) * 0.1
    torque = 2.0 * _drawn(t, 1.5, seed=7)

    def rates(x, u):
        return -0.4 * x - 0.3 * x * abs(x) + u

    x = _noisy(_rolled_out(rates, np.zeros(1), t, torque))
    return pd.DataFrame({"t": t, "w": x[:, 0], "u": torque})


def _drawn(t, knot: float, seed: int):
    knots = np.arange(0.0, t[-1] + 2.0 * knot, knot)
    return np.interp(t, knots, np.random.default_rng(seed).normal(size=len(knots)))


def _noisy(x):
    return x + 0.01 * x.std(axis=0) * np.random.default_rng(1).normal(size=x.shape)


def _rolled_out(rates: Callable, x, t, u, substeps: int = 20):
    """The method of Heun in small steps, the input on lines between samples."""
    x, course, h = x.copy(), [x.copy()], (t[1] - t[0]) / substeps
    for first, last in zip(u[:-1], u[1:], strict=True):
        inputs = np.linspace(first, last, substeps + 1)
        for before, after in zip(inputs[:-1], inputs[1:], strict=True):
            slope = rates(x, before)
            x = x + 0.5 * h * (slope + rates(x + h * slope, after))
        course.append(x.copy())
    return np.array(course)


CASES: dict[str, tuple[Callable[[], pd.DataFrame], str]] = {
    "joint": (joint, "--states q --order 2 --inputs tau --groups run"),
    "drone": (drone, "--states theta_deg --order 2 --inputs u_pct"),
    "states": (states, "--states x v --inputs u"),
    "speed": (speed, "--states w --inputs u"),
}


if __name__ == "__main__":
    main()
