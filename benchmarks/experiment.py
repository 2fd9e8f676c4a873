"""Whether the recording that `suggest_experiment` names tells more than random ones.

    python -m benchmarks.experiment [--draws 50] [--random 20] [--output FOLDER]

README's oscillator is identified from two recordings with noise of 0.02. Of 100 candidates, starts
within the largest ones seen, the one is suggested that tells most of one coefficient, drawn at
random. The error is that which the true laws say is left by it, and by 20 further random ones.
The table goes to FOLDER/experiment.md.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np

from benchmarks.markdown import table
from swsysid import SwitchingSystemRegressor, TrajectoryIdentifier
from swsysid.refinement import StatedModel, StatedSurface, suggest_experiment

_T, _NOISE, _REACH, _CANDIDATES = np.linspace(0.0, 6.0, 121), 0.02, 2.0, 100
_PLANT = StatedModel(
    None, [[[0, 1], [-1, -0.1]], [[0, 1], [-1, -0.5]]],
    states=["x", "v"], surface=StatedSurface([[0, 1, 0]], 1),
)  # fmt: skip


def main() -> None:
    """Print the table, and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/experiment", help="folder of the table")
    parser.add_argument("--draws", type=int, default=50)
    parser.add_argument("--random", type=int, default=20)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    for seed in range(options.draws):
        rows.append(one_draw(seed, options.random))
        print(rows[-1], flush=True)
    before, suggested, best, median = np.array([row[2:] for row in rows], dtype=float).T
    text = "\n".join(
        table(
            ["suggested at least as good as", "draws"],
            [
                [f"the best of {options.random} random ones", f"{share(suggested, best)}"],
                ["the best, within 5 %", f"{share(suggested, 1.05 * best)}"],
                ["their median", f"{share(suggested, median)}"],
            ],
        )
    )
    text += (
        f"\n\nError in the median, of what it was: suggested {np.median(suggested / before):.2f}, "
        f"best random one {np.median(best / before):.2f}, "
        f"median random one {np.median(median / before):.2f}.\n"
    )
    print(text)
    folder = Path(options.output)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "experiment.md").write_text(text, encoding="utf-8")


def share(one: np.ndarray, other: np.ndarray) -> str:
    """In how many draws one is not larger."""
    return f"{(one <= other).sum()} of {len(one)}"


def one_draw(seed: int, n_random: int) -> tuple:
    """Seed, the coefficient, its error now, with the suggested, best and median recording more."""
    rng = np.random.default_rng(seed)
    given = [recorded(rng.uniform(-_REACH, _REACH, 2), rng) for _ in range(2)]
    found = identified(given)
    told = (found.coef_errors_ > 0.0) & np.isfinite(found.coef_errors_)
    places = np.argwhere(told & (_PLANT.coef_[:1] != 0.0))
    mode, state, term = places[rng.integers(len(places))]
    names = ["x0", "x1"]
    about = f"mode {mode}: {names[state]}', {names[term]}"
    starts = rng.uniform(-_REACH, _REACH, (_CANDIDATES, 2))
    candidates = [{"t": _T, "x0": start} for start in starts]
    chosen = suggest_experiment(found, candidates, given, about=about)
    others = [{"t": _T, "x0": start} for start in rng.uniform(-_REACH, _REACH, (n_random, 2))]
    laws = _PLANT.coef_[:, 1]
    mode = np.abs(laws - found.estimator_.coef_[mode, 1]).sum(axis=1).argmin()
    about = f"mode {mode}: {'xv'[state]}', {'xv'[term]}"
    tried = [candidates[chosen.best], *others]
    truly = suggest_experiment(_PLANT, tried, given, about=about, noise=_NOISE)
    place = truly.names.index(about)
    suggested, *after = truly.after[:, place]
    return seed, about, truly.before[place], suggested, min(after), np.median(after)


def recorded(start: np.ndarray, rng: np.random.Generator) -> dict:
    """A recording with noise."""
    run = _PLANT.simulate(start, _T).x
    return {"t": _T, "x": run + _NOISE * rng.standard_normal(run.shape)}


def identified(recordings: list[dict]) -> TrajectoryIdentifier:
    """Two modes, linear laws."""
    return TrajectoryIdentifier(SwitchingSystemRegressor(2, sparsity="auto", random_state=0)).fit(
        recordings
    )


if __name__ == "__main__":
    main()
