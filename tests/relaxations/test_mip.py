"""The exact mixed-integer program against enumeration of all labels."""

from dataclasses import replace
from itertools import product

import cvxpy as cp
import numpy as np
import pandas as pd
import pytest

from swsysid._results import SolverError, Status
from swsysid._solvers.conic import LinearSolution, linear_program
from swsysid.relaxations import _mixed_integer as _mip
from swsysid.relaxations._mixed_integer import solve_mip


def draw(n_samples, n_modes, n_states, noise, seed):
    """Switching linear data: X, y, coefficients, modes numbered by their first sample."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n_samples, n_states))
    coef = rng.uniform(-2, 2, size=(n_modes, n_states, n_states))
    modes = np.concatenate([np.arange(n_modes), rng.integers(n_modes, size=n_samples - n_modes)])
    y = np.einsum("ikp,ip->ik", coef[modes], X)
    return X, y + noise * rng.normal(size=y.shape), coef, modes


def least_absolute(features, targets, bound):
    """Least sum of absolute residuals of one mode, state by state, as linear programs."""
    n_samples, n_features = features.shape
    total = 0.0
    for velocities in targets.T:
        eye = np.eye(n_samples)
        box = [[-bound, bound]] * n_features + [[0, np.inf]] * n_samples
        solution = linear_program(
            [0.0] * n_features + [1.0] * n_samples,
            A_ub=np.block([[features, -eye], [-features, -eye]]),
            b_ub=np.concatenate([velocities, -velocities]),
            bounds=box,
        )
        total += solution.objective
    return total


def enumerated(features, targets, n_modes, bound):
    """Optimum over all labels, the first sample's mode being 0."""
    n_samples = len(features)
    cost = {}
    for members in product([False, True], repeat=n_samples):
        rows = np.array(members)
        empty = not rows.any()
        cost[members] = 0.0 if empty else least_absolute(features[rows], targets[rows], bound)
    return min(
        sum(cost[tuple(mode == label for label in (0, *rest))] for mode in range(n_modes))
        for rest in product(range(n_modes), repeat=n_samples - 1)
    )


@pytest.mark.parametrize(
    ("n_samples", "n_modes", "n_states", "bound"),
    [
        (8, 2, 1, 5.0),
        (7, 2, 2, 5.0),
        (7, 3, 1, 5.0),
        (7, 3, 2, 5.0),
        (7, 2, 1, 0.5),
        (6, 1, 2, 5.0),
    ],
)
def test_optimum_matches_enumeration(n_samples, n_modes, n_states, bound):
    X, y, _, _ = draw(n_samples, n_modes, n_states, 0.5, seed=n_samples)
    result = solve_mip(X, y, n_modes, coef_bound=bound)
    expected = enumerated(X, y, n_modes, bound)
    assert expected > 1e-2
    assert result.status is Status.OPTIMAL
    assert result.objective == pytest.approx(expected, abs=1e-7)
    assert result.bound == pytest.approx(expected, abs=1e-5)
    assert np.abs(result.coef).max() <= bound
    spent = np.abs(y - np.einsum("ikp,ip->ik", result.coef[result.modes], X)).sum()
    assert result.objective == pytest.approx(spent, abs=1e-12)


def test_by_hand():
    # velocities 1, 1, -1, -1 and the outlier 0.5 at x = 1: fields 1 and -1, and 0.5 to pay
    X = np.ones((5, 1))
    y = np.array([1.0, -1.0, 1.0, -1.0, 0.5])
    result = solve_mip(X, y)
    np.testing.assert_allclose(result.coef.ravel(), [1.0, -1.0], atol=1e-9)
    np.testing.assert_array_equal(result.modes, [0, 1, 0, 1, 0])
    assert result.objective == pytest.approx(0.5, abs=1e-9)


@pytest.mark.parametrize(("y", "total"), [([1.0, 1.5, 3.0], 2.0), ([0.0, 0.0, 4.0], 4.0)])
def test_what_the_solver_proves_is_the_sum_itself(y, total, monkeypatch):
    """One mode at x = 1 is a median; the bound is in units of the largest target."""
    proved, solver = [], _mip.mixed_integer_program
    monkeypatch.setattr(
        _mip, "mixed_integer_program", lambda *a, **k: proved.append(solver(*a, **k)) or proved[-1]
    )
    result = solve_mip(np.ones((3, 1)), np.array(y)[:, None], 1)
    assert result.objective == pytest.approx(total, rel=1e-9)
    assert proved[0].bound * max(y) == pytest.approx(total, rel=1e-6)


@pytest.mark.parametrize("n_modes", [2, 3])
def test_planted_modes_come_back_in_canonical_order(n_modes):
    X, y, coef, modes = draw(18, n_modes, 2, 0.0, seed=1)
    result = solve_mip(X, y, n_modes, coef_bound=3.0)
    np.testing.assert_array_equal(result.modes, modes)
    np.testing.assert_allclose(result.coef, coef, atol=1e-8)
    assert result.objective == pytest.approx(0.0, abs=1e-10)


def test_bound_is_below_an_alternation():
    X, y, _, modes = draw(16, 2, 2, 0.3, seed=2)
    result = solve_mip(X, y, coef_bound=3.0)
    values = []
    for seed in range(3):
        labels = np.random.default_rng(seed).integers(2, size=len(X))
        values.append(_alternated(X, y, labels, 3.0))
    values.append(_alternated(X, y, modes, 3.0))
    assert result.bound <= min(values) + 1e-9
    assert result.objective <= min(values) + 1e-9


def _alternated(X, y, labels, bound):
    value = np.inf
    for _ in range(10):
        new = sum(least_absolute(X[labels == j], y[labels == j], bound) for j in set(labels))
        if new >= value - 1e-9:
            break
        value = new
        fits = [np.linalg.lstsq(X[labels == j], y[labels == j])[0] for j in sorted(set(labels))]
        labels = np.array([np.abs(y - X @ fit).sum(axis=1) for fit in fits]).argmin(axis=0)
    return value


KNOWN = ["x' has no w", "w'[x] same in all modes", "w'[w] + w'[x] <= 0.1"]


def constrained(features, targets, modes):
    """Coefficients and least sum of absolute residuals within `KNOWN`, by Clarabel."""
    coef = [cp.Variable((2, 2)) for _ in range(2)]
    left = [cp.abs(targets[i] - coef[mode] @ features[i]) for i, mode in enumerate(modes)]
    rules = [coef[0][1, 0] == coef[1][1, 0]]
    for one in coef:
        rules += [one[0, 1] == 0, one[1, 0] + one[1, 1] <= 0.1, cp.abs(one) <= 5.0]
    value = cp.Problem(cp.Minimize(cp.sum(cp.hstack(left))), rules).solve(solver="CLARABEL")
    return np.array([one.value for one in coef]), value


def test_what_is_known_holds_and_the_optimum_is_that_of_enumeration():
    X, y, _, _ = draw(6, 2, 2, 0.5, seed=3)
    named = pd.DataFrame(X, columns=["x", "w"])
    free = solve_mip(named, y, coef_bound=5.0)
    result = solve_mip(named, y, coef_bound=5.0, known=KNOWN)
    assert result.status is Status.OPTIMAL
    coef = result.coef
    np.testing.assert_allclose(coef[:, 0, 1], 0.0, atol=1e-12)
    assert coef[0, 1, 0] == pytest.approx(coef[1, 1, 0], abs=1e-9)
    assert (coef[:, 1].sum(axis=1) <= 0.1 + 1e-9).all()
    labels = [(0, *rest) for rest in product(range(2), repeat=5)]
    least = min(constrained(X, y, one)[1] for one in labels)
    # Clarabel is 1e-8 off; and the optimum at the labels found is the one found
    assert result.objective == pytest.approx(least, abs=1e-6)
    assert result.objective == pytest.approx(constrained(X, y, result.modes)[1], abs=1e-6)
    assert result.objective > free.objective + 0.01  # it costs something
    with pytest.raises(ValueError, match=r"known allows no coefficients up to coef_bound=5.0"):
        solve_mip(named, y, coef_bound=5.0, known="x'[x] = 6")
    with pytest.raises(ValueError, match="known names the term v"):
        solve_mip(named, y, known="x'[v] = 1")
    with pytest.raises(ValueError, match="of which y has more than X"):
        solve_mip(named[["x"]], y, known="x'[x] = 1")


def test_what_is_known_holds_when_the_time_is_up():
    X, y, _, _ = draw(60, 3, 2, 0.5, seed=6)
    result = solve_mip(X, y, 3, time_limit=0.01, known=["x0'[x0] = 1.5", "x1' same in all modes"])
    assert result.status is Status.TIME_LIMIT
    np.testing.assert_allclose(result.coef[:, 0, 0], 1.5)
    np.testing.assert_allclose(result.coef[:, 1], result.coef[:1, 1].repeat(3, axis=0), atol=1e-9)


def test_equivariance_to_units_and_rows():
    X, y, _, _ = draw(10, 2, 2, 0.3, seed=3)
    reference = solve_mip(X, y, coef_bound=3.0)
    units = solve_mip(1e3 * X, 1e-4 * y, coef_bound=3e-7)
    assert units.objective == pytest.approx(1e-4 * reference.objective, rel=1e-6)
    np.testing.assert_array_equal(units.modes, reference.modes)
    rows = np.r_[0, np.random.default_rng(0).permutation(np.arange(1, 10))]
    permuted = solve_mip(X[rows], y[rows], coef_bound=3.0)
    assert permuted.objective == pytest.approx(reference.objective, rel=1e-6)
    np.testing.assert_array_equal(permuted.modes, reference.modes[rows])


def test_columns_of_any_size_are_seen():
    X, y, _, _ = draw(10, 2, 2, 0.3, seed=3)
    reference = solve_mip(X, y, coef_bound=3.0)
    small = solve_mip(1e-10 * X, y, coef_bound=3e10)  # HiGHS by itself leaves such columns out
    np.testing.assert_allclose(1e-10 * small.coef, reference.coef, atol=1e-9)
    assert small.objective == pytest.approx(reference.objective, rel=1e-9)


def test_a_library_supplies_the_features():
    X = np.linspace(-2, 2, 12)[:, None]
    y = np.where(X > 0, 1.0 + X**2, -X)
    result = solve_mip(X, y, feature_library=2, coef_bound=2.0)
    assert result.coef.shape == (2, 1, 3)
    np.testing.assert_allclose(result.coef[:, 0], [[0, -1, 0], [1, 0, 1]], atol=1e-8)


def test_more_modes_than_needed_leave_no_nan():
    X, y, _, _ = draw(6, 1, 1, 0.0, seed=5)
    result = solve_mip(X, y, 3)
    assert result.objective == pytest.approx(0.0, abs=1e-10)
    assert np.isfinite(result.coef).all()


def test_the_time_limit_leaves_a_true_bound():
    X, y, _, _ = draw(60, 3, 2, 0.5, seed=6)
    result = solve_mip(X, y, 3, time_limit=0.3)
    assert result.status is Status.TIME_LIMIT
    assert "time_limit" in result.status.advice
    assert 0.0 <= result.bound <= result.objective
    assert result.gap == pytest.approx(result.objective - result.bound)
    assert result.objective <= np.abs(y).sum() + 1e-9
    assert np.isfinite(result.coef).all()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"n_modes": 0}, "n_modes=0 must be a positive integer"),
        ({"n_modes": 1.5}, "n_modes=1.5 must be a positive integer"),
        ({"coef_bound": None}, "coef_bound=None must be a positive number"),
        ({"coef_bound": -1.0}, "coef_bound=-1.0 must be a positive number"),
        ({"time_limit": 0.0}, "time_limit=0.0 must be a positive number"),
        ({"X": [[np.nan], [1.0]]}, "X contains NaN"),
        ({"y": [np.nan, 1.0]}, "y contains NaN"),
        ({"y": [1.0, 2.0, 3.0]}, "one row for each of the 2 samples"),
    ],
)
def test_bad_input_gets_a_sentence(arguments, sentence):
    with pytest.raises(ValueError, match=sentence):
        solve_mip(**({"X": [[1.0], [2.0]], "y": [1.0, 2.0]} | arguments))


X_TWO = np.array([[1.0], [2.0], [-1.0], [-2.0]])


@pytest.mark.parametrize("status", [Status.INFEASIBLE, Status.UNBOUNDED, Status.FAILED])
def test_a_fault_of_the_solver_is_no_result(monkeypatch, status):
    # all coefficients zero is feasible and no residual is below zero: such an answer is a fault
    nothing = LinearSolution(np.full(1, np.nan), np.inf, np.empty(0), np.empty(0), status)
    monkeypatch.setattr(_mip, "mixed_integer_program", lambda *_, **__: nothing)
    with pytest.raises(SolverError, match="mixed-integer program .* choose another solver"):
        solve_mip(X_TWO, np.abs(X_TWO))


def test_optimal_is_said_only_with_a_proof(monkeypatch):
    def without_bound(*arguments, **options):
        found = solver(*arguments, **options)
        return replace(found, bound=-1.0, status=Status.OPTIMAL)

    solver, y = _mip.mixed_integer_program, np.array([1.0, 2.5, 1.0, 3.0])
    assert solve_mip(X_TWO, y, 1).status is Status.OPTIMAL
    monkeypatch.setattr(_mip, "mixed_integer_program", without_bound)
    result = solve_mip(X_TWO, y, 1)
    assert result.status is Status.INACCURATE
    assert result.bound == 0.0 < result.objective
