"""What is measured of many rows: time, growth and memory of whole fits, also from disk."""

from __future__ import annotations

import tempfile
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Event, Thread
from time import perf_counter

import numpy as np
from sklearn.preprocessing import PolynomialFeatures

from benchmarks.goals import Goal
from benchmarks.speed.case import Case
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_damped_oscillator, make_quartic_oscillator

__all__ = ["growth", "memory", "on_disk", "rows"]

# Degree of a library of 15 features of two states.
_FIFTEEN = 4
_BLOCK = 1_000_000


@dataclass(frozen=True)
class System:
    """A system of the paper, and what a fit of it is told."""

    name: str
    make: object
    library: int
    surface: int

    def data(self, n_rows: int, noise: float):
        """Rows of trajectories of 1001 points each."""
        return self.make(n_rows, n_trajectories=200 + n_rows // 900, noise=noise, random_state=0)

    def model(self, library: int) -> SwitchingSystemRegressor:
        """What is fitted, with a library of that degree."""
        surface = PolynomialSurfaceClassifier(degree=self.surface)
        return SwitchingSystemRegressor(2, feature_library=library, surface=surface, random_state=0)


SYSTEMS = (
    System("SLS", make_damped_oscillator, 1, 2),
    System("SPS", make_quartic_oscillator, 3, 4),
)


def rows(options) -> Iterator[Case]:
    """Whole fits, against least squares per mode with known labels and a given library matrix."""
    for system in SYSTEMS:
        for noise in (0.0, 0.02, 0.05):
            data = system.data(int(options.largest), noise)
            for library in (_FIFTEEN, system.library):
                yield _row_case(system, data, noise, library)


def _row_case(system: System, data, noise: float, library: int) -> Case:
    design = PolynomialFeatures(library).fit_transform(data.X)
    fitted: list[SwitchingSystemRegressor] = []

    def fit():
        fitted[:] = [system.model(library).fit(data.X, data.Xdot)]

    def least_squares():
        for mode in range(2):
            some = data.modes == mode
            np.linalg.lstsq(design[some], data.Xdot[some], rcond=None)

    def wrong():
        found = np.count_nonzero(fitted[0].modes_ != data.modes)
        return f"{min(found, len(data.X) - found)} labels wrong"

    name = (
        f"{system.name}, N = {len(data.X):.0e}, {design.shape[1]} features, "
        f"noise {100 * noise:.0f} %"
    )
    return Case(name, fit, least_squares, Goal(at_most=8), faster=False, note=wrong)


def growth(options) -> Iterator[Case]:
    """Whole fits of more and more rows, and how their time grows."""
    for system in SYSTEMS:
        taken: list[tuple[int, float]] = []
        n_sizes = max(round(np.log10(options.largest) - 4.0), 1) + 1
        for n_rows in np.geomspace(1e4, options.largest, n_sizes).astype(int).tolist():
            yield _growth_case(system, system.data(n_rows, 0.02), taken)


def _growth_case(system: System, data, taken) -> Case:
    n_rows = len(data.X)
    small = system.data(10_000, 0.02)

    def seconds(some):
        started = perf_counter()
        system.model(_FIFTEEN).fit(some.X, some.Xdot)
        return perf_counter() - started

    def fit():
        spent = seconds(data)
        taken.append((n_rows, spent))
        return spent / n_rows

    def exponent():
        sizes, spent = np.log(np.array(taken)).T
        if np.ptp(sizes) == 0.0:
            return "as many rows on both sides: how far the turns scatter"
        return f"time grows as N to the {np.polyfit(sizes, spent, 1)[0]:.2f} up to here"

    return Case(
        f"{system.name}, time of a row at N = {n_rows:.0e} against 1e+04",
        fit,
        lambda: seconds(small) / len(small.X),
        # as many rows on both sides show how far the turns scatter
        Goal() if n_rows == len(small.X) else Goal(at_most=1),
        faster=False,
        note=exponent,
        unit="s a row",
    )


def memory(options) -> Iterator[Case]:
    """Largest memory of a fit beyond its data, against the library matrix of all rows, in bytes."""
    for system in SYSTEMS:
        data = system.data(int(options.largest), 0.02)

        def peak(system=system, data=data):
            tracemalloc.start()
            system.model(_FIFTEEN).fit(data.X, data.Xdot)
            bytes_used = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            return float(bytes_used)

        library = 15.0 * 8.0 * len(data.X)
        name = f"{system.name}, N = {len(data.X):.0e}, memory in library matrices"
        yield Case(name, peak, lambda library=library: library, Goal(at_most=3), False, unit="B")


def on_disk(options) -> Iterator[Case]:
    """Fits of memory maps: the time of a row, against that of the largest fit in memory."""
    for system in SYSTEMS[:1]:
        with tempfile.TemporaryDirectory() as folder:
            few, many = (
                _written(system, Path(folder), n_rows)
                for n_rows in (int(options.largest), int(options.on_disk))
            )
            peaks: list[float] = []

            def fit(paths, peaks=peaks, system=system):
                X, Xdot = (np.load(path, mmap_mode="r") for path in paths)
                started = perf_counter()
                with _Watched(peaks):
                    system.model(_FIFTEEN).fit(X, Xdot)
                return (perf_counter() - started) / len(X)

            def said(peaks=peaks, many=many):
                size = sum(path.stat().st_size for path in many)
                return f"{size / 1e6:.0f} MB of data, {max(peaks):.0f} MB of memory for the fit"

            yield Case(
                f"{system.name}, N = {options.on_disk:.0e} from disk, time of a row",
                lambda fit=fit, many=many: fit(many),
                lambda fit=fit, few=few: fit(few),
                Goal(at_most=2),
                faster=False,
                note=said,
                unit="s a row",
            )


def _written(system: System, folder: Path, n_rows: int) -> tuple[Path, Path]:
    """Files of states and velocities: points of trajectories, moved a little, and new noise."""
    paths = tuple(folder / f"{name}_{n_rows}.npy" for name in ("X", "Xdot"))
    states, velocities = (
        np.lib.format.open_memmap(path, "w+", np.float64, (n_rows, 2)) for path in paths
    )
    base, random = system.data(min(n_rows, _BLOCK), 0.0), np.random.default_rng(0)
    noise = 0.02 * base.Xdot.std(axis=0)
    for start in range(0, n_rows, _BLOCK):
        block = slice(start, min(start + _BLOCK, n_rows))
        shape = states[block].shape
        moved = base.X[: shape[0]] + 1e-3 * base.X.std(axis=0) * random.normal(size=shape)
        states[block] = moved
        velocities[block] = base.system.velocities(moved) + noise * random.normal(size=shape)
    return paths


class _Watched:
    """Watch how much more memory of its own the process has than at the start, in MB.

    Pages of a mapped file are not its own. Where the system does not tell, it is NaN.
    """

    def __init__(self, peaks: list[float]):
        self.peaks, self.stop = peaks, Event()
        self.thread = Thread(target=self._watch)

    def __enter__(self):
        self.start = self._now()
        self.peaks.append(0.0)
        self.thread.start()

    def __exit__(self, *exception):
        self.stop.set()
        self.thread.join()

    def _watch(self):
        while not self.stop.wait(0.02):
            self.peaks[-1] = max(self.peaks[-1], self._now() - self.start)

    def _now(self) -> float:
        try:
            lines = Path("/proc/self/status").read_text().splitlines()
        except OSError:
            return float("nan")
        own = next(line for line in lines if line.startswith("RssAnon"))
        return int(own.split()[1]) / 1e3
