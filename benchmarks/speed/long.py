"""One long recording: CPU seconds, memory and what is found, from 1e4 samples on.

    python benchmarks/speed/long.py [--samples 1e4 1e5 1e6] [--noise .01] [--seed 4401]

A mass on a spring that is four times as stiff on one side, pushed by a force that is logged::

    x' = v,   v' = -k x - .2 v + u,   k = 1 for x < 0 and 4 for x >= 0,

sampled ten times in a unit of time, noise on both channels; one of 25 samples is followed by a
switch. Each length is identified in a process of its own with one thread. The exponent is the
slope of log(CPU seconds) over log(samples) from the shortest length to the longest.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import time
import warnings

import numpy as np

STEP, SUBSTEPS = 0.1, 10
STIFFNESS, DAMPING = {False: 1.0, True: 4.0}, 0.2


def main(arguments: list[str] | None = None) -> None:
    """Measure each length in its own process and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", nargs="+", type=float, default=[1e4, 1e5, 1e6])
    parser.add_argument("--noise", type=float, default=0.01, help="part of the spread of a channel")
    parser.add_argument("--seed", type=int, default=4401)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.one:
        print(json.dumps(measured(int(options.samples[0]), options.noise, options.seed)))
        return
    lines = []
    for samples in options.samples:
        line = _in_own_process(samples, options)
        lines.append(line)
        print(
            f"{line['samples']:9,d} samples {line['switches']:7,d} switches "
            f"{line['seconds']:7.1f} CPU s {line['megabytes']:6d} MB   "
            f"modes {line['accuracy']:.4f}   largest error of a coefficient {line['error']:.5f}",
            flush=True,
        )
    if len(lines) > 1:
        seconds, samples = (lines[-1][name] / lines[0][name] for name in ("seconds", "samples"))
        print(f"exponent {np.log(seconds) / np.log(samples):.2f}")


def measured(samples: int, noise: float, seed: int) -> dict[str, float]:
    """CPU seconds of one fit, peak memory of the process, accuracy of modes and coefficients."""
    from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
    from swsysid.metrics import mode_accuracy

    rng = np.random.default_rng(seed)
    t, x, u = recording(samples, rng)
    modes = (x[:, 0] >= 0).astype(int)
    seen = x + noise * x.std(axis=0) * rng.standard_normal(x.shape)
    estimator = SwitchingSystemRegressor(2, feature_library=1, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        begun = time.process_time()
        found = TrajectoryIdentifier(estimator).fit(seen, t, inputs=u)
        seconds = time.process_time() - begun
    return {
        "samples": samples,
        "switches": len(found.switch_times_[0]),
        "seconds": seconds,
        "megabytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "accuracy": float(mode_accuracy(modes, found.modes_)),
        "error": _largest_error(found),
    }


def recording(samples: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (N,), states (N, 2), force (N, 1): explicit midpoint, ten steps a sample."""
    t = STEP * np.arange(samples)
    knots = rng.normal(size=samples // 10 + 2)
    middles = (np.arange(samples * SUBSTEPS) + 0.5) * STEP / SUBSTEPS
    fine = np.interp(middles, np.arange(len(knots)), knots)
    x, step = np.zeros((samples, 2)), STEP / SUBSTEPS
    place, speed = 0.5, 0.0
    for n, forces in enumerate(fine.reshape(samples, SUBSTEPS).tolist()):
        x[n] = place, speed
        for force in forces:
            push = force - STIFFNESS[place >= 0] * place - DAMPING * speed
            half, half_speed = place + 0.5 * step * speed, speed + 0.5 * step * push
            push = force - STIFFNESS[half >= 0] * half - DAMPING * half_speed
            place, speed = place + step * half_speed, speed + step * push
    return t, x, np.interp(t, np.arange(len(knots)), knots)[:, None]


def _largest_error(found) -> float:
    """Of stiffness and damping of the two modes, in units of the larger stiffness."""
    laws = found.estimator_.coef_  # modes, equations, terms
    names = list(found.estimator_.feature_names_out_)
    at = [names.index(name) for name in ("x0", "x1")]
    order = np.argsort(-laws[:, 1, at[0]])
    truth = np.array([[-k, -DAMPING] for k in STIFFNESS.values()])
    return float(np.abs(laws[order][:, 1, at] - truth).max() / max(STIFFNESS.values()))


def _in_own_process(samples: float, options: argparse.Namespace) -> dict[str, float]:
    command = [sys.executable, __file__, "--one", "--samples", str(samples)]
    command += ["--noise", str(options.noise), "--seed", str(options.seed)]
    one_thread = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        command, env=os.environ | one_thread, stdout=subprocess.PIPE, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


if __name__ == "__main__":
    main()
