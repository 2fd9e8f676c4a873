"""The paper's algorithm to the letter, at N = 2000, from ten starts: what its figures show.

For both systems of the paper (the fields of its text) and both of its relaxations: identified
from equal identity laws, as the paper starts, and from identity laws with 0.1 times standard
normal numbers added, ten draws. Kept of every iteration are the relaxed cost, the cost of the
hardened modes, the share of the samples in a wrong mode, and the tightness; of every answer the
figures of the paper's tables; of the start with the least hardened cost the surface, the rollouts
and their errors over time. Seconds are CPU seconds of the whole fit, surface included.

    python -m benchmarks.paper.algorithm [--starts 10] [--moment-starts 10] [--samples 2000]
                                         [--docs docs]

``--docs`` keeps the results, and writes the tables and pictures of the page "The paper reproduced".
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from time import process_time

import numpy as np

from benchmarks import pages
from benchmarks.paper.cases import CASES, METRICS, Case, figures, split
from benchmarks.paper.picture import draw_iterations, draw_rollouts
from benchmarks.results import add_docs_options, keep, measured_here
from swsysid import MomentRelaxation, PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid.metrics import mode_accuracy

# The paper's numbers of iterations; the size of what is added to equal laws; times of the curves.
ITERATIONS = {"SLS": 10, "SPS": 15}
PERTURBATION = 0.1
N_TIMES, N_ROLLOUTS, N_DRAWN = 101, 12, 3
RELAXATIONS = {"simplex": "simplex", "moment": MomentRelaxation(order=1)}


def main(arguments: list[str] | None = None) -> None:
    """Run all starts and print a line for each; keep and draw them if there is a folder for it."""
    options = parse(arguments)
    origin = measured_here()
    parts = {
        name: {"origin": origin} | system(name, case, options)
        for name, case in (("SLS", CASES[0]), ("SPS", CASES[1]))
    }
    if options.docs:
        write(keep("paper", parts, options.results), options)


def write(parts: dict, options: argparse.Namespace) -> None:
    """The page's tables, and its pictures."""
    pages.write("paper", options.docs, options.results)
    for name in ITERATIONS:
        pictures = Path(options.docs, "_static")
        draw_iterations(name, parts[name], pictures / f"paper_{name}_iterations.png")
        draw_rollouts(parts[name], pictures / f"paper_{name}_rollouts.png")


def parse(arguments: list[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--starts", type=int, default=10, help="of the simplex relaxation")
    parser.add_argument("--moment-starts", type=int, default=10, help="of the SDP (slow)")
    parser.add_argument("--samples", type=int, default=2000)
    add_docs_options(parser)
    return parser.parse_args(arguments)


def system(name: str, case: Case, options: argparse.Namespace) -> dict:
    """All runs of one system, and what is drawn of the best of either relaxation."""
    data, train, test = split(case, 0)
    train = train[: options.samples]
    numbers = {"simplex": options.starts, "moment": options.moment_starts}
    answers = {
        relaxation: [
            run(name, case, relaxation, start, (data, train, test))
            for start in (None, *range(count))
        ]
        for relaxation, count in numbers.items()
    }
    return {
        "n_samples": len(train),
        "runs": {relaxation: [run for run, _ in some] for relaxation, some in answers.items()},
        "best": {
            relaxation: described(case, least_cost(some), data)
            for relaxation, some in answers.items()
        },
    }


def run(name: str, case: Case, relaxation: str, start: int | None, parts) -> tuple[dict, object]:
    """One identification: its history and its figures, and the model."""
    data, train, test = parts
    X, Xdot, modes = data.X[train], data.Xdot[train], data.modes[train]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a poor start warns that it is poor
        began = process_time()
        model = regressor(name, case, relaxation, start).fit(X, Xdot)
        seconds = process_time() - began
        table = figures(case, model, data, test, seed=0)
    history = model.history_
    answer = {
        "start": start,
        "relaxed": [short(record.lower_bound) for record in history],
        "hardened": [short(record.loss) for record in history],
        "wrong": [short(1.0 - mode_accuracy(modes, record.modes)) for record in history],
        "tightness": [short(record.tightness) for record in history],
        "objective": model.objective_,
        "seconds": seconds,
        "seconds_an_iteration": seconds / len(history),
        "accuracy": mode_accuracy(modes, model.modes_),
        "figures": dict(zip(METRICS, table, strict=True)),
    }
    print(
        f"{name} {relaxation:8} start {start}: {len(history)} iterations, cost "
        f"{history[0].lower_bound:.3g} -> {history[-1].lower_bound:.3g}, hardened and refitted "
        f"{model.objective_:.3g}, accuracy {answer['accuracy']:.4f}, tightness "
        f"{history[0].tightness:.3f} -> {history[-1].tightness:.3f}, {seconds:.2f} s",
        flush=True,
    )
    return answer, model


def regressor(
    name: str, case: Case, relaxation: str, start: int | None
) -> SwitchingSystemRegressor:
    """The paper's settings (its bound on coefficients, margin and sparsity) and a start."""
    return SwitchingSystemRegressor(
        2,
        feature_library=case.library,
        relaxation=RELAXATIONS[relaxation],
        loss="l1",
        coef_bound=10.0,
        coupling=0,
        init=initial_laws(case, start),
        max_iter=ITERATIONS[name],
        tol=0.0,
        surface=PolynomialSurfaceClassifier(
            degree=case.guard_degree, margin=1e-2, beta=1e-2, coef_bound=10.0, standardize=False
        ),
        random_state=0,
    )


def initial_laws(case: Case, start: int | None) -> np.ndarray:
    """Identity matrices for both modes, with a draw of random numbers added unless it is None."""
    first, n_features = (0, 2) if case.library is None else (1, 10)
    laws = np.zeros((2, 2, n_features))
    laws[:, [0, 1], [first, first + 1]] = 1.0
    if start is not None:
        laws += PERTURBATION * np.random.default_rng(start).standard_normal(laws.shape)
    return laws


def least_cost(some: list[tuple[dict, object]]) -> tuple[dict, object]:
    """The run that the algorithm itself would prefer: the truth has no say in it."""
    return min(some, key=lambda pair: pair[0]["objective"])


def described(case: Case, best: tuple[dict, object], data) -> dict:
    """Surface, rollouts and their errors over time of one answer."""
    answer, model = best
    t = np.linspace(0.0, case.horizon, N_TIMES)
    starts = np.random.default_rng(1000).uniform(-case.box, case.box, (N_ROLLOUTS, 2))
    truth = np.array([data.system.simulate(x0, t).x for x0 in starts])
    found = np.array([model.simulate(x0, t).x for x0 in starts])
    return {
        "start": answer["start"],
        "t": rounded(t),
        "truth": rounded(truth[:N_DRAWN]),
        "found": rounded(found[:N_DRAWN]),
        "error": [short(e) for e in np.sqrt(np.square(found - truth).sum(2).mean(0))],
        "labels": "".join(map(str, model.modes_.tolist())),
        "coef": model.coef_.tolist(),
        "surface": model.surface_.coef_[0].tolist(),
    }


def short(value: float) -> float:
    """A number to five digits."""
    return float(f"{value:.5g}")


def rounded(values) -> list:
    """Numbers of a picture, to four decimals."""
    return np.round(values, 4).tolist()


if __name__ == "__main__":
    main()
