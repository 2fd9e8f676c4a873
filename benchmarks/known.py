"""What knowledge is worth, and whether what is wrong in it is found.

    python -m benchmarks.known [--output FOLDER] [--draws 10] [--counts 12 4 1] [--fast]
                               [--plants NAME ...] [--first-seed 0]

Plants are recorded with 2 % noise, 40 samples a period, and identified by `TrajectoryIdentifier`
with nothing known, with what is right, and with one thing wrong: a value by 3 %, a term that exists
said to be missing, or a tie that does not hold. The error is that of the coefficients which the
right knowledge leaves free, each in the units of what its term adds to the velocity; modes are
matched to the truth. A wrong thing counts where the data can show it: it lies more than 5 standard
errors off, by those of the fit with nothing known. The tables go to FOLDER/known.md.
"""

from __future__ import annotations

import argparse
import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from benchmarks.markdown import table
from benchmarks.trajectories.plants import PLANTS, Plant
from benchmarks.trajectories.recordings import Campaign, Scenario, record
from swsysid import (
    Known,
    PolynomialSurfaceClassifier,
    SwitchingSystemRegressor,
    TrajectoryIdentifier,
)

Array = NDArray[np.float64]
_SEEN = 5.0  # standard errors from which data can show that something is wrong


@dataclass(frozen=True)
class Case:
    """A plant, what is known of it, and what is believed wrongly in its place.

    A wrong sentence takes the place of the right one of the same number, or comes as one more.
    """

    plant: Plant
    right: Sequence[str]
    wrong: Sequence[tuple[int, str]]


def _epidemic() -> Plant:
    """Shares of susceptible, infected, recovered; measures halve contacts beyond 10 % infected."""
    laws = [
        [{"s*i": -beta}, {"s*i": beta, "i": -0.5}, {"i": 0.5}] for beta in (2.0, 1.0)
    ]  # fmt: skip

    def start(rng: np.random.Generator) -> Array:
        infected = rng.uniform(0.01, 0.05)
        return np.array([1.0 - infected, infected, 0.0])

    return Plant(
        "epidemic with measures", ("s", "i", "r"), laws, [{"i": 1.0, "1": -0.1}], 10.0, 2.0, start,
        degree=2,
    )  # fmt: skip


def _motor() -> Plant:
    """Current and speed of a motor, which a clutch loads beyond a speed."""
    laws = [
        [{"c": -2.0, "w": -1.0, "u": 2.0}, {"c": 1.5, "w": -drag, "1": level}]
        for drag, level in ((0.2, 0.0), (1.2, 0.6))
    ]

    def inputs(rng: np.random.Generator, t: Array) -> Array:
        phases = rng.uniform(0.0, 2.0 * np.pi, 2)
        return 0.6 + 0.8 * np.sin(2.0 * np.pi * np.outer(t, (0.11, 0.19)) + phases).sum(
            axis=1, keepdims=True
        )

    return Plant(
        "motor with a clutch", ("c", "w"), laws, [{"w": 1.0, "1": -0.6}], 4.0, 4.0,
        lambda rng: rng.uniform(-0.5, 0.5, 2), input_names=("u",), inputs=inputs,
    )  # fmt: skip


CASES = {
    case.plant.name: case
    for case in (
        Case(
            PLANTS["linear oscillator"],
            ["x' = v", "v'[x] = -1", "v' has no 1"],
            [(1, "v'[x] = -1.03"), (3, "v'[v] same in all modes"), (0, "x' = 1.03 v")],
        ),
        Case(
            PLANTS["contact"],
            ["x' = v", "v'[1] = -1", "v'[v] <= 0"],
            [(1, "v'[1] = -1.03"), (3, "v'[v] same in all modes"), (3, "v' has no v")],
        ),
        Case(
            PLANTS["tank with overflow"],
            ["h2' has only h1, h2", "h2' same in all modes", "h1' has no h2", "h1'[u] = 1"],
            [(3, "h1'[u] = 1.03"), (4, "h2' has no h2"), (4, "h1' same in all modes")],
        ),
        Case(
            PLANTS["dry friction, forced"],
            ["x' = v", "v'[x] same in all modes", "v'[v] same in all modes", "v'[u] = 1"],
            [(3, "v'[u] = 1.03"), (4, "v' has no v"), (4, "v'[1] same in all modes")],
        ),
        Case(
            _epidemic(),
            ["s' + i' + r' = 0", "r' has only i", "r'[i] same in all modes", "s' has only s i"],
            [(2, "r'[i] = 0.515"), (4, "s'[s i] same in all modes"), (4, "i'[i] = -0.485")],
        ),
        Case(
            _motor(),
            ["c' = -2 c - w + 2 u", "w'[c] same in all modes", "w' has no u"],
            [(0, "c' = -2 c - w + 2.06 u"), (3, "w' same in all modes"), (3, "w' has no w")],
        ),
    )
}
FAST = ["linear oscillator", "epidemic with measures"]


def main() -> None:
    """Print the tables, and write them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", default="output/known", help="folder of the tables")
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--counts", type=int, nargs="+", default=[12, 4, 1])
    parser.add_argument("--plants", nargs="+", choices=CASES, help="all by default")
    parser.add_argument("--fast", action="store_true", help="two plants, two draws")
    options = parser.parse_args()
    names = options.plants or (FAST if options.fast else list(CASES))
    seeds = range(options.first_seed, options.first_seed + (2 if options.fast else options.draws))
    found = []
    for name, count, seed in itertools.product(names, options.counts, seeds):
        found.append(one_draw(CASES[name], count, seed))
        print(found[-1], flush=True)
    text = tables(found, names, options.counts)
    print(text)
    folder = Path(options.output)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "known.md").write_text(text, encoding="utf-8")


def one_draw(case: Case, count: int, seed: int) -> dict:
    """Errors with and without knowledge, and what was questioned."""
    campaign = record(case.plant, Scenario(0.02, 40, count), seed)
    free, seconds = identified(case, campaign, None, seed)
    right, of_known = identified(case, campaign, case.right, seed)
    mask = ~_region(case, case.right, free).fixed[0][0]
    told = {"plant": case.plant.name, "count": count, "seed": seed}
    told |= {"free": error(case, campaign, free, mask), "seconds": seconds}
    told |= {"known": error(case, campaign, right, mask), "seconds_known": of_known}
    told["chance"] = chance_of_larger(
        *(_size(case, campaign, fit.coef_errors_, mask) for fit in (right, free))
    )
    told["questioned"] = [one.sentence for one in right.known_ if one.questioned]
    told["wrong"] = []
    for number, sentence in case.wrong:
        sentences = [*case.right]
        sentences[number : number + 1] = [sentence]
        wrong, _ = identified(case, campaign, sentences, seed)
        check = wrong.known_[number]
        seen = _standard_errors(case, free, sentence) > _SEEN
        others = [one.sentence for one in wrong.known_ if one.questioned and one is not check]
        told["wrong"].append((sentence, bool(seen), check.questioned, others))
    return told


def identified(
    case: Case, campaign: Campaign, known: Sequence[str] | None, seed: int
) -> tuple[TrajectoryIdentifier, float]:
    """A fit, and what it takes."""
    plant = case.plant
    names, begun = [*plant.states, *plant.input_names], process_time()
    inputs = campaign.inputs
    estimator = SwitchingSystemRegressor(
        plant.n_modes, feature_library=plant.degree,
        surface=PolynomialSurfaceClassifier(degree=plant.guard_degree), random_state=seed,
    )  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fit = TrajectoryIdentifier(estimator, known=known).fit(
            pd.DataFrame(campaign.x, columns=names[: campaign.x.shape[1]]),
            campaign.t,
            campaign.groups,
            None if inputs is None else pd.DataFrame(inputs, columns=plant.input_names),
        )
    return fit, process_time() - begun


def _region(case: Case, sentences: Sequence[str], fit: TrajectoryIdentifier):
    terms = list(fit.estimator_.feature_names_out_)
    return Known.from_text(sentences).region(case.plant.states, terms, case.plant.n_modes)


def error(case: Case, campaign: Campaign, fit: TrajectoryIdentifier, mask: Array) -> float:
    """Root mean square error of some coefficients, in units of the velocities."""
    coef, wanted = fit.estimator_.coef_, case.plant.truth().coef_
    if len(coef) < len(wanted):  # a mode was not found: its law is that of the other
        coef = np.concatenate([coef, np.repeat(coef[:1], len(wanted) - len(coef), axis=0)])
    return min(
        _size(case, campaign, coef[list(order)] - wanted, mask)
        for order in itertools.permutations(range(len(coef)), len(wanted))
    )


def _size(case: Case, campaign: Campaign, coef: Array, mask: Array) -> float:
    """Root mean square of some coefficients, in units of the velocities."""
    truth = case.plant.truth()
    features = truth.feature_map(campaign.columns)
    sizes = features.std(axis=0) + (features.std(axis=0) == 0.0)
    scaled = sizes / truth.predict(campaign.columns).std(axis=0)[:, None]
    return float(np.sqrt(np.square(coef * scaled)[:, mask].mean()))


def chance_of_larger(known: float, free: float) -> float:
    """Chance that an error within right knowledge is the larger one, by their standard errors.

    Both are normal, and the latter is the former with more that is independent of it, as the most
    likely answers are: with r = known / free the chance is 1/2 - arcsin(q) / pi, where q^2 =
    (1 - r^2) / (1 + 3 r^2). It is that of one coefficient, or of one direction that decides.

    >>> round(chance_of_larger(0.5, 1.0), 3), chance_of_larger(1.0, 1.0)
    (0.273, 0.5)
    """
    square = min(1.0, (known / free) ** 2)
    return float(0.5 - np.arcsin(np.sqrt((1.0 - square) / (1.0 + 3.0 * square))) / np.pi)


def _standard_errors(case: Case, fit: TrajectoryIdentifier, sentence: str) -> float:
    """How many standard errors a sentence lies from the truth, in a fit without."""
    region = _region(case, [sentence], fit)
    if len(fit.estimator_.coef_) != case.plant.n_modes:
        return 0.0
    truth = case.plant.truth().coef_
    own = fit.coef_errors_
    off = np.abs(np.einsum("rmsf,msf->r", region.rows, truth) - region.lower)
    errors = np.sqrt(np.einsum("rmsf,msf->r", region.rows**2, own**2))
    return float(np.divide(off, errors, out=np.full(len(off), np.inf), where=errors > 0)[off > 1e-9]
                 .max(initial=0.0))  # fmt: skip


def tables(found: list[dict], names: Sequence[str], counts: Sequence[int]) -> str:
    """Errors and questions, a plant and number of recordings a row."""
    rows, ratios, wrong, right = [], {count: [] for count in counts}, [], []
    chances = dict.fromkeys(counts, 0.0)
    for name, count in itertools.product(names, counts):
        own = [one for one in found if one["plant"] == name and one["count"] == count]
        shares = [one["known"] / one["free"] for one in own]
        ratios[count] += shares
        chances[count] += sum(one["chance"] for one in own)
        seen = [one for each in own for one in each["wrong"] if one[1]]
        wrong += seen
        right += own
        rows.append([
            name, str(count),
            f"{np.median([one['free'] for one in own]):.2g}",
            f"{np.median([one['known'] for one in own]):.2g}",
            f"{np.median(shares):.2f}",
            f"{sum(share > 1.0 for share in shares)} of {len(shares)}",
            f"{sum(one[2] for one in seen)} of {len(seen)}",
            f"{sum(bool(one['questioned']) for one in own)} of {len(own)}",
            f"{np.median([one['seconds_known'] / one['seconds'] for one in own]):.2f}",
        ])  # fmt: skip
    head = [
        "plant", "recordings", "error, nothing known", "known", "ratio, median", "larger",
        "wrong found", "right questioned", "time",
    ]  # fmt: skip
    lines = [
        f"{count} recordings: ratio of the errors {np.median(own):.2f} in the median, "
        f"larger in {sum(one > 1.0 for one in own)} of {len(own)}, by chance in "
        f"{chances[count]:.1f}"
        for count, own in ratios.items()
    ]
    n_found, blamed = sum(one[2] for one in wrong), sum(bool(one[3]) for one in wrong)
    lines += [
        f"wrong, where data can show it: questioned in {n_found} of {len(wrong)}; others are "
        f"questioned beside it in {blamed}",
        f"right: questioned in {sum(bool(one['questioned']) for one in right)} of {len(right)}",
    ]
    return "\n".join([*table(head, rows), "", *(f"- {line}." for line in lines)]) + "\n"


if __name__ == "__main__":
    main()
