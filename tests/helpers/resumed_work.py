"""Work that is killed and goes on: five fits and the command line, each as small as it can be.

As a script, ``resumed_work.py NAME FOLDER ANSWER``: do it with a checkpoint in FOLDER ("-" for
none), and write a digest of the answer into the file ANSWER.
"""

import hashlib
import os
import signal
import subprocess
import sys
import time
import warnings
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

import swsysid
from swsysid import (
    EffectSearchCV,
    HybridAutomaton,
    HybridAutomatonRegressor,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)

SCRIPT = Path(__file__)


def _oscillator(n_samples):
    rng = np.random.default_rng(0)
    X = rng.uniform(-3, 3, (n_samples, 2))
    damping = np.where(X[:, 0] > 0.3, 0.1, 0.5)
    Xdot = np.column_stack([X[:, 1], -X[:, 0] - damping * X[:, 1]])
    return X, Xdot + 0.05 * rng.standard_normal(X.shape)


def _answer_of_rows(model):
    return [model.coef_, model.modes_, model.objective_, *model.surface_equations(15)]


class OfMany(SwitchingSystemRegressor):
    """One that takes some thousand rows for many."""

    settings = replace(SwitchingSystemRegressor.settings, whole=1500, sampled=800)


def _model_of_many(folder, **options):
    return OfMany(2, sparsity="auto", checkpoint=folder, **options)


def rows(folder, **options):
    """Many rows in blocks, without a seed: numbers are drawn from numpy's own source."""
    is_begun = folder is not None and Path(folder).exists()
    np.random.seed(int.from_bytes(os.urandom(4)) if is_begun else 0)
    blocks = (np.array_split(each, 12) for each in _oscillator(6000))
    return _answer_of_rows(_model_of_many(folder, **options).fit(*blocks))


def dask(folder):
    """The same rows in Dask arrays."""
    import dask.array as da

    arrays = (da.from_array(each, chunks=(500, 2)) for each in _oscillator(6000))
    return _answer_of_rows(_model_of_many(folder, random_state=0).fit(*arrays))


def trajectory(folder, **options):
    """Noisy recordings of a spring that is softer on one side."""
    t, rng = np.arange(0.0, 10.0, 0.05), np.random.default_rng(0)
    plant = HybridAutomaton.stated(
        [{"x": "v", "v": "-x - 0.1 v"}, {"x": "v", "v": "-4 x - 0.1 v"}],
        [(0, 1, "x >= 0"), (1, 0, "x <= 0")],
        states=["x", "v"],
    )
    starts = ([-1.0, 1.0], [-2.0, 0.0], [-1.5, -1.0])
    runs = [plant.simulate(start, t, mode=0).x for start in starts]
    recordings = [{"t": t, "x": run + 0.01 * rng.standard_normal(run.shape)} for run in runs]
    switching = SwitchingSystemRegressor(sparsity="auto", random_state=0)
    found = TrajectoryIdentifier(switching, checkpoint=folder, **options).fit(recordings)
    errors = found.coef_errors_, found.surface_errors_, *found.switch_time_errors_
    return [found.estimator_.coef_, found.modes_, found.states_, *found.switch_times_, *errors]


def automaton(folder):
    """Noisy recordings of a thermostat."""
    plant = HybridAutomaton.stated(
        [{"T": "-0.1 (T - 30)"}, {"T": "-0.1 (T - 10)"}],
        [(0, 1, "T >= 22"), (1, 0, "T <= 18")],
        states=["T"],
    )
    t, rng = np.arange(0.0, 30.0, 0.2), np.random.default_rng(0)
    runs = [plant.simulate([start], t, mode=0).x for start in (15.0, 17.0, 19.0)]
    recordings = [{"t": t, "x": run + 0.02 * rng.standard_normal(run.shape)} for run in runs]
    found = HybridAutomatonRegressor(2, random_state=0, checkpoint=folder).fit(recordings)
    errors = found.coef_errors_, *found.guard_errors_, found.noise_
    return [found.coef_, found.modes_, found.states_, *errors, *found.equations(15)]


def effects(folder, **options):
    """What a pendulum with dry friction lacks."""
    from swsysid.datasets import make_undeclared
    from swsysid.effects import CoulombFriction, Polynomial, QuadraticDrag

    data = make_undeclared("coulomb_friction", system="pendulum", random_state=0)
    library = [CoulombFriction(), QuadraticDrag(), Polynomial()]
    search = EffectSearchCV(data.estimator, effects=library, checkpoint=folder, **options)
    search.fit(data.X, data.Xdot, t=data.t, groups=data.groups)
    return [*search.equations(15), str(search.report_)]


def command(folder):
    """The built-in example of the command line; a seed of its own keeps it short."""
    from swsysid.__main__ import main

    output = Path(f"{folder}.output" if folder else "plain.output")
    checkpoint = ["--checkpoint", folder] if folder else []
    assert main(["--quick", "--output", str(output), *checkpoint]) == 0
    model = swsysid.load_model(output / "model.json")
    return [model.coef_, (output / "identification.txt").read_text("utf-8")]


WORK = {each.__name__: each for each in (rows, dask, trajectory, automaton, effects, command)}


def digest(answer):
    """The bits of an answer."""
    told = hashlib.sha256()
    for part in answer:
        is_array = isinstance(part, np.ndarray)
        told.update(np.ascontiguousarray(part).tobytes() if is_array else repr(part).encode())
    return told.hexdigest()


def started(name, folder, answer):
    """The work in a process of its own."""
    call = [sys.executable, str(SCRIPT), name, str(folder), str(answer)]
    at = Path(answer).parent
    paths = os.pathsep.join(sys.path)
    return subprocess.Popen(
        call, cwd=at, env={**os.environ, "PYTHONPATH": paths},
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def killed(name, folder, answer, seconds):
    """Kill the work so many seconds after its first step; False if it was done before."""
    process = started(name, folder, answer)
    while process.poll() is None and not list(Path(folder).glob("*.step")):
        time.sleep(0.01)
    with suppress(subprocess.TimeoutExpired):
        process.wait(seconds)
    process.kill()
    told = process.communicate()[1]
    assert process.returncode in (0, -signal.SIGKILL), told
    return process.returncode != 0


def done(name, folder, answer):
    """The digest of its answer, in a process of its own."""
    process = started(name, folder, answer)
    told = process.communicate()[1]
    assert process.returncode == 0, told
    return Path(answer).read_text("utf-8")


if __name__ == "__main__":
    warnings.simplefilter("ignore", UserWarning)
    # what runs in the background inherits that Control-C is ignored; what a user runs does not
    signal.signal(signal.SIGINT, signal.default_int_handler)
    what, where, written = sys.argv[1:]
    Path(written).write_text(digest(WORK[what](None if where == "-" else where)), "utf-8")
