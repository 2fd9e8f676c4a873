"""Fits within what is known, for given labels and whole: beside those without, and by cvxpy."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cvxpy as cp
import numpy as np
import pandas as pd
from sklearn.preprocessing import PolynomialFeatures

from benchmarks.goals import Goal
from benchmarks.speed.case import Case
from benchmarks.speed.problems import N_PAPER
from swsysid import Known, SwitchingSystemRegressor
from swsysid._identification.within import Rows, estimate_within
from swsysid._known.region import Region
from swsysid._losses import get_loss
from swsysid.relaxations._base import one_hot

__all__ = ["known"]

_SENTENCES = {
    "a whole law and a tie": ["x' = v", "v'[v] same in all modes"],
    "a relation of two laws": ["x'[1] = v'[1]"],
    "a bound that is not reached": ["v'[v] <= 100"],
    "a bound that is": ["v'[v] >= 0.9"],
}


def known(options) -> Iterator[Case]:
    """Least absolute deviations of two modes and two equations of ten terms."""
    for n_samples in (N_PAPER, int(options.largest)):
        rows, modes = _rows(n_samples)
        membership = one_hot(modes, 2)
        free = _free(rows, modes)
        for name, sentences in _SENTENCES.items():
            region = Known.from_text(sentences).region(["x", "v"], _TERMS, 2)
            within = _within(region, rows, membership)
            what = f"l1 fit within {name}, N = {n_samples:.0g}"
            goal = Goal(at_most=1.5 if n_samples == N_PAPER else 2.0)
            yield Case(f"{what}: without it", within, free, goal, faster=False)
            if n_samples == N_PAPER:
                general = _general(region, rows, modes)
                gap = _gap(rows, modes, within, general)
                yield Case(
                    f"{what}: cvxpy and Clarabel", within, general, Goal(at_least=10), note=gap
                )
    n_samples = int(options.largest)
    yield Case(
        f"whole fit within two laws and a tie, N = {n_samples:.0g}: without it",
        _whole(n_samples, ["x' = v", "v'[v] same in all modes", "v'[u] = 0.5"]),
        _whole(n_samples, None),
        Goal(at_most=2.0),
        faster=False,
    )


_TERMS = ["1", "x", "v", "x^2", "x v", "v^2", "x^3", "x^2 v", "x v^2", "v^3"]


def _rows(n_samples: int) -> tuple[Rows, np.ndarray]:
    """States, velocities with Laplace noise, and the modes; damping is 1 in both."""
    rng = np.random.default_rng(0)
    states = rng.uniform(-2.0, 2.0, (n_samples, 2))
    modes = (states[:, 0] > 0.0).astype(int)
    coef = rng.normal(size=(2, 2, len(_TERMS)))
    coef[:, 0], coef[:, 1, 2] = np.eye(len(_TERMS))[2], 1.0
    coef[0, 1, 0] = coef[1, 1, 0] = 0.0
    features = PolynomialFeatures(3).fit_transform(states)
    targets = np.einsum("isf,if->is", coef[modes], features)
    targets += 0.1 * rng.laplace(size=targets.shape)
    return Rows(features, targets, np.ones(n_samples)), modes


def _whole(n_samples: int, sentences: list[str] | None) -> Callable[[], object]:
    """A fit of an oscillator whose spring is four times as stiff on one side, driven by u."""
    rng = np.random.default_rng(0)
    rows = pd.DataFrame(rng.uniform(-2.0, 2.0, (n_samples, 3)), columns=["x", "v", "u"])
    stiffness = np.where(rows.x > 0.0, 4.0, 1.0)
    rates = np.column_stack([rows.v, 0.5 * rows.u - stiffness * rows.x - 0.1 * rows.v])
    rates += 0.3 * rng.standard_normal(rates.shape)
    return lambda: SwitchingSystemRegressor(known=sentences, random_state=0).fit(rows, rates)


def _free(rows: Rows, modes: np.ndarray) -> Callable[[], object]:
    def run() -> list[np.ndarray]:
        loss = get_loss("l1")
        return [loss.fit(rows.features[modes == m], rows.targets[modes == m]).coef for m in (0, 1)]

    return run


def _within(region: Region, rows: Rows, membership: np.ndarray) -> Callable[[], np.ndarray]:
    return lambda: estimate_within(region, "l1", rows, membership, None, None)


def _general(region: Region, rows: Rows, modes: np.ndarray) -> Callable[[], np.ndarray]:
    def run() -> np.ndarray:
        coef = [cp.Variable((2, len(_TERMS))) for _ in range(2)]
        left = [rows.targets[modes == m] - rows.features[modes == m] @ coef[m].T for m in (0, 1)]
        every = cp.hstack([cp.vec(one, order="C") for one in coef])
        matrix, equal = region.matrix.reshape(len(region.matrix), -1), region.equal
        above, below = np.isfinite(region.upper) & ~equal, np.isfinite(region.lower) & ~equal
        constraints = [matrix[equal] @ every == region.lower[equal]] if equal.any() else []
        constraints += [matrix[above] @ every <= region.upper[above]] if above.any() else []
        constraints += [matrix[below] @ every >= region.lower[below]] if below.any() else []
        objective = sum(cp.sum(cp.abs(one)) for one in left)
        cp.Problem(cp.Minimize(objective), constraints).solve(solver="CLARABEL")
        return np.stack([one.value for one in coef])

    return run


def _gap(rows: Rows, modes: np.ndarray, ours: Callable, other: Callable) -> Callable[[], str]:
    def value(coef: np.ndarray) -> float:
        fitted = np.einsum("isf,if->is", coef[modes], rows.features)
        return float(np.abs(rows.targets - fitted).sum())

    return lambda: f"objective relative to the other's: {value(ours()) / value(other()) - 1:+.1e}"
