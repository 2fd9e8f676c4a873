"""What is true of the alternation: monotone cost, blockwise optimal limits, and no more."""

import numpy as np
import pytest
from scipy.optimize import linprog

from swsysid import PolynomialSurfaceClassifier, SwitchingSystemRegressor
from swsysid._identification.problem import SwitchingProblem
from swsysid._losses import get_loss
from swsysid.datasets import make_damped_oscillator, make_quartic_oscillator
from swsysid.relaxations import get_relaxation

BOX = 10.0


def problem(data, relaxation="simplex"):
    """The paper's problem: two modes, linear laws in a box, the l1 loss, no coupling."""
    return SwitchingProblem(
        features=data.X,
        targets=data.Xdot,
        coordinates=data.X,
        weight=np.ones(len(data.X)),
        n_modes=2,
        loss=get_loss("l1"),
        relaxation=get_relaxation(relaxation),
        surface=PolynomialSurfaceClassifier(),
        coupling=0.0,
        scale=np.ones(2),
        outlying=np.zeros(len(data.X), dtype=bool),
        coef_bound=BOX,
    )


def oscillator(n_samples=120, noise=0.05):
    return make_damped_oscillator(n_samples, noise=noise, random_state=0)


def best_memberships(given, coef):
    """Least cost over all memberships on the simplex, by one linear program."""
    velocities = given.velocities(coef)
    n_modes, n_samples, n_states = velocities.shape
    total = 0.0
    for sample in range(n_samples):
        # variables lambda, delta; -delta <= xdot - V lambda <= delta
        design, eye = velocities[:, sample].T, np.eye(n_states)
        target = given.targets[sample]
        total += linprog(
            np.r_[np.zeros(n_modes), np.ones(n_states)],
            A_ub=np.block([[design, -eye], [-design, -eye]]),
            b_ub=np.r_[target, -target],
            A_eq=np.r_[np.ones(n_modes), np.zeros(n_states)][None],
            b_eq=[1.0],
        ).fun
    return total


def best_laws(given, membership):
    """Least cost over all laws in the box, by one linear program for each state."""
    design = (membership[:, :, None] * given.features[:, None, :]).reshape(len(membership), -1)
    eye = np.eye(len(design))
    return sum(
        linprog(
            np.r_[np.zeros(design.shape[1]), np.ones(len(design))],
            A_ub=np.block([[design, -eye], [-design, -eye]]),
            b_ub=np.r_[target, -target],
            bounds=[(-BOX, BOX)] * design.shape[1] + [(0, None)] * len(design),
        ).fun
        for target in given.targets.T
    )


@pytest.mark.parametrize("relaxation", ["simplex", "exact"])
@pytest.mark.parametrize("seed", range(3))
def test_the_cost_never_increases_and_its_limit_is_blockwise_optimal(relaxation, seed):
    given = problem(oscillator(), relaxation)
    coef, costs = np.random.default_rng(seed).normal(size=(2, 2, 2)), []
    for _ in range(30):
        membership = given.assign(coef).membership
        costs.append(given.relaxed_loss(given.velocities(coef), membership))
        coef = given.estimate(membership)
        costs.append(given.relaxed_loss(given.velocities(coef), membership))
    # 1e-9: the relative gap up to which the programs are solved
    assert (np.diff(costs) <= 1e-9 * costs[0]).all()
    assert costs[-3] - costs[-1] <= 1e-9 * costs[0]  # it has settled
    assert best_laws(given, membership) == pytest.approx(costs[-1], rel=1e-7)
    least = {
        "simplex": lambda: best_memberships(given, coef),
        "exact": lambda: given.hard_loss(coef, given.assign(coef).modes),
    }[relaxation]()
    assert least == pytest.approx(costs[-1], rel=1e-7)


def test_equal_laws_are_blockwise_optimal_and_not_optimal():
    # the start of the paper's experiments: an alternation that takes them exactly cannot leave
    given = problem(oscillator(noise=0.0))
    half = np.full((len(given.features), 2), 0.5)
    one = get_loss("l1").fit(given.features, given.targets, coef_bound=BOX).coef
    equal = np.stack([one, one])
    cost = given.relaxed_loss(given.velocities(equal), half)
    assert best_laws(given, half) == pytest.approx(cost, rel=1e-7)
    assert best_memberships(given, equal) == pytest.approx(cost, rel=1e-7)
    assert cost > 10.0  # and the truth has cost zero


def test_the_cost_of_hardened_modes_may_increase():
    data = make_quartic_oscillator(400, random_state=0)
    laws = np.zeros((2, 2, 10))
    laws[:, [0, 1], [1, 2]] = 1.0
    costs = []
    for seed in range(6):
        start = laws + 0.1 * np.random.default_rng(seed).standard_normal(laws.shape)
        model = SwitchingSystemRegressor(
            feature_library=3,
            relaxation="simplex",
            coupling=0,
            init=start,
            coef_bound=BOX,
            max_iter=15,
            surface=PolynomialSurfaceClassifier(degree=4),
        ).fit(data.X, data.Xdot)
        relaxed = np.array([record.lower_bound for record in model.history_])
        assert (np.diff(relaxed) <= 1e-9 * relaxed[0]).all()
        costs.append([record.loss for record in model.history_])
    assert any((np.diff(hardened) > 1e-3 * hardened[0]).any() for hardened in costs)


@pytest.mark.parametrize("loss", ["l1", "l2", "squared"])
def test_the_joint_objective_of_hard_assignments_never_increases(loss):
    data = make_damped_oscillator(400, noise=0.1, outliers=0.05, random_state=1)
    start = np.random.default_rng(0).integers(0, 2, 400)
    model = SwitchingSystemRegressor(loss=loss, init=start, random_state=0).fit(data.X, data.Xdot)
    objective = np.array([record.objective for record in model.history_])
    # l2 and squared losses in a box are solved to 1e-7 of the objective
    assert (np.diff(objective) <= 1e-7 * objective[:-1]).all()
