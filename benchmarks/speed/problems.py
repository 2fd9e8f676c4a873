"""Programs of one fit: by us, through cvxpy and Clarabel, and by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from sklearn.preprocessing import PolynomialFeatures

from benchmarks.goals import Goal
from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid._losses import get_loss
from swsysid.datasets import make_damped_oscillator, make_quartic_oscillator
from swsysid.relaxations import ExactRelaxation, SimplexRelaxation

__all__ = ["N_PAPER", "Problem", "assignments", "l1_fits", "whole_fits"]

N_PAPER = 2000


@dataclass
class Problem:
    """One program and the ways to solve it, each a call without arguments that keeps its answer.

    Attributes
    ----------
    name : str
    ours, general : callable
        By this package, and through cvxpy and Clarabel.
    goal : Goal
        How many times faster ours has to be.
    value : callable
        The objective at an answer; None if the ways give different answers by design.
    data : tuple of ndarray
        What a way by hand is given.
    answers : dict
        The last answer of each way, by its name.
    """

    name: str
    ours: Callable[[], object]
    general: Callable[[], object]
    goal: Goal
    value: Callable[[object], float] | None = None
    data: tuple[np.ndarray, ...] = ()
    answers: dict[str, object] = field(default_factory=dict)

    def call(self, name: str, way: Callable[[], object]) -> Callable[[], None]:
        """A call of one way that keeps its answer."""

        def run() -> None:
            self.answers[name] = way()

        return run

    def difference(self, name: str, reference: str) -> Callable[[], str]:
        """Tells how far the objective of one way is from that of another."""

        def told() -> str:
            if self.value is None:
                return ""
            gap = self.value(self.answers[name]) / self.value(self.answers[reference]) - 1.0
            return f"objective relative to the other's: {gap:+.1e}"

        return told


def assignments() -> Iterator[Problem]:
    """Memberships for given laws, exact and on the simplex, against the vectorised LP."""
    data = make_damped_oscillator(N_PAPER, noise=0.05, random_state=0)
    for dampings in ((0.5, 0.1), (0.5, 0.3, 0.1)):
        laws = np.array([[[0.0, 1.0], [-1.0, -damping]] for damping in dampings])
        candidates = np.matmul(data.X, laws.transpose(0, 2, 1))
        for name, relaxation in (("exact", ExactRelaxation()), ("simplex", SimplexRelaxation())):
            yield _assignment(name, relaxation, candidates, data.Xdot)


def _assignment(name: str, relaxation, candidates, targets) -> Problem:
    reference = SimplexRelaxation()
    reference.solver = "clarabel"

    def value(membership) -> float:
        mixed = np.einsum("im,mik->ik", membership, candidates)
        return float(np.abs(targets - mixed).sum())

    return Problem(
        f"{name} assignment, {len(candidates)} modes, N = {len(targets)}",
        lambda: relaxation.assign(candidates, targets).membership,
        lambda: reference.assign(candidates, targets).membership,
        Goal(at_least=500),
        # the LP's value is that of the simplex
        value if name == "simplex" else None,
        (candidates, targets),
    )


def l1_fits() -> Iterator[Problem]:
    """Least absolute deviations of one mode."""
    data = make_quartic_oscillator(N_PAPER, noise=0.05, random_state=0)
    design = PolynomialFeatures(3).fit_transform(data.X)

    def fit(solver):
        return lambda: get_loss("l1").fit(design, data.Xdot, solver=solver).coef

    yield Problem(
        "l1 fit, N = 2000, 10 columns",
        fit("auto"),
        fit("clarabel"),
        Goal(at_least=10),
        lambda coef: float(np.abs(data.Xdot - design @ coef.T).sum()),
        (design, data.Xdot),
    )


def whole_fits() -> Iterator[Problem]:
    """The paper's algorithm with structured or with general solvers inside."""
    data = make_damped_oscillator(N_PAPER, noise=0.05, random_state=0)

    def fit(solver):
        return lambda: SwitchingSystemRegressor(
            2,
            relaxation="simplex",
            coupling=0.0,
            init="random",
            n_init=3,
            surface=PolynomialSurfaceClassifier(degree=2, standardize=False, solver=solver),
            solver=solver,
            random_state=0,
        ).fit(data.X, data.Xdot)

    yield Problem("whole SLS fit, N = 2000", fit("auto"), fit("clarabel"), Goal(at_least=20))
