"""Where the time of a fit goes: the functions of the package that take most of it.

    python -m benchmarks.profile_fit [--system SLS] [--rows 1e6] [--library 4] [--lines 8]

With OMP_NUM_THREADS=1 times are those of one core. The changelog quotes its lines.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
from pathlib import Path

import swsysid
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.datasets import make_damped_oscillator, make_quartic_oscillator

SYSTEMS = {"SLS": (make_damped_oscillator, 2), "SPS": (make_quartic_oscillator, 4)}
PACKAGE = Path(swsysid.__file__).parent


def main() -> None:
    """Fit once to warm up, then under the profiler."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--system", choices=list(SYSTEMS), default="SLS")
    parser.add_argument("--rows", type=float, default=1e6)
    parser.add_argument("--library", type=int, default=4, help="degree of the library")
    parser.add_argument("--lines", type=int, default=8)
    options = parser.parse_args()
    make, degree = SYSTEMS[options.system]
    n_rows = int(options.rows)
    # a trajectory has 1001 points
    data = make(n_rows, n_trajectories=200 + n_rows // 900, noise=0.02, random_state=0)
    model = SwitchingSystemRegressor(
        2,
        feature_library=options.library,
        surface=PolynomialSurfaceClassifier(degree=degree),
        random_state=0,
    )
    model.fit(data.X[:2000], data.Xdot[:2000])
    profile = cProfile.Profile()
    profile.runcall(model.fit, data.X, data.Xdot)
    for name, seconds, own in _lines(pstats.Stats(profile))[: options.lines]:
        print(f"{seconds:6.2f} s, of which {own:5.2f} s its own: {name}")


def _lines(stats: pstats.Stats) -> list[tuple[str, float, float]]:
    """Functions of the package with their times, the longest first."""
    found = []
    for (file, _, name), (_, _, own, total, _) in stats.stats.items():
        if Path(file).is_relative_to(PACKAGE) and not name.startswith("<"):
            found.append((f"{Path(file).relative_to(PACKAGE)} {name}", total, own))
    return sorted(found, key=lambda one: -one[1])


if __name__ == "__main__":
    main()
