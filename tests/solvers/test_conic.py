"""Programs that reach a solver: hand cases, duality, independent solvers, and every failure."""

import sys
import warnings

import cvxpy as cp
import numpy as np
import pytest
from scipy.optimize import OptimizeResult
from scipy.sparse import csr_array

from swsysid import PolynomialSurfaceClassifier
from swsysid._results import SolverError, Status
from swsysid._solvers import conic


def _random_program(seed):
    """A feasible and bounded linear program with 5 unknowns."""
    rng = np.random.default_rng(seed)
    inside = rng.uniform(-1, 1, size=5)
    A_ub, A_eq = rng.normal(size=(20, 5)), rng.normal(size=(2, 5))
    return rng.normal(size=5), {
        "A_ub": A_ub,
        "b_ub": A_ub @ inside + rng.uniform(0, 0.5, size=20),
        "A_eq": A_eq,
        "b_eq": A_eq @ inside,
        "bounds": (-3.0, 3.0),
    }


def test_linear_program_by_hand():
    # max x + y on x + 2y <= 4, 3x + y <= 6: the vertex (8/5, 6/5), multipliers (2/5, 1/5)
    solution = conic.linear_program([-1.0, -1.0], A_ub=[[1, 2], [3, 1]], b_ub=[4, 6])
    assert solution.status is Status.OPTIMAL
    np.testing.assert_allclose(solution.x, [1.6, 1.2], atol=1e-12)
    np.testing.assert_allclose(solution.dual_ub, [0.4, 0.2], atol=1e-12)
    assert solution.objective == pytest.approx(-2.8, abs=1e-12)


def test_variables_are_free_without_bounds():
    solution = conic.linear_program([1.0], A_ub=[[-1.0]], b_ub=[5.0])
    np.testing.assert_allclose(solution.x, [-5.0], atol=1e-12)


@pytest.mark.parametrize("solver", ["auto", "highs", "clarabel", "SCIPY"])
@pytest.mark.parametrize("seed", range(3))
def test_multipliers_prove_the_optimum(solver, seed):
    cost, program = _random_program(seed)
    solution = conic.linear_program(cost, solver=solver, **program)
    reduced = cost + program["A_ub"].T @ solution.dual_ub + program["A_eq"].T @ solution.dual_eq
    # min over the box of the Lagrangian is a lower bound; it meets the objective
    dual = (
        -program["b_ub"] @ solution.dual_ub
        - program["b_eq"] @ solution.dual_eq
        - 3.0 * np.abs(reduced).sum()
    )
    assert (solution.dual_ub >= -1e-8).all()
    assert (program["A_ub"] @ solution.x <= program["b_ub"] + 1e-7).all()
    np.testing.assert_allclose(program["A_eq"] @ solution.x, program["b_eq"], atol=1e-7)
    assert dual == pytest.approx(solution.objective, abs=1e-6)


def test_solvers_and_matrix_kinds_agree():
    cost, program = _random_program(7)
    sparse = program | {name: csr_array(program[name]) for name in ("A_ub", "A_eq")}
    values = [
        conic.linear_program(cost, solver=solver, **rows).objective
        for solver in ("auto", "clarabel")
        for rows in (program, sparse)
    ]
    np.testing.assert_allclose(values, values[0], atol=1e-7)


@pytest.mark.parametrize("solver", ["auto", "clarabel"])
@pytest.mark.parametrize(
    ("rows", "status"),
    [
        ({}, Status.UNBOUNDED),
        ({"A_ub": [[1.0], [-1.0]], "b_ub": [0.0, -1.0]}, Status.INFEASIBLE),
    ],
)
def test_programs_without_a_solution_say_so(solver, rows, status):
    solution = conic.linear_program([-1.0], solver=solver, **rows)
    assert solution.status is status
    assert np.isnan(solution.x).all()
    assert len(solution.dual_ub) == len(rows.get("b_ub", []))


def test_a_missing_solver_is_named_with_the_installed_ones():
    with pytest.raises(SolverError, match="'nosuch' is not installed.*CLARABEL.*install nosuch"):
        conic.linear_program([1.0], bounds=(0, 1), solver="nosuch")


def test_missing_cvxpy_is_a_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    with pytest.raises(SolverError, match="pip install cvxpy clarabel"):
        conic.modelling()


def test_solve_reports_a_conic_optimum_in_place():
    x = cp.Variable(2)
    problem = cp.Problem(cp.Minimize(cp.norm(x - np.array([3.0, 4.0]))), [cp.norm(x) <= 1])
    assert conic.solve(problem) is Status.OPTIMAL
    np.testing.assert_allclose(x.value, [0.6, 0.8], atol=1e-6)


def test_a_solver_that_cannot_take_the_cone_fails_with_advice():
    matrix = cp.Variable((2, 2), PSD=True)
    problem = cp.Problem(cp.Minimize(cp.trace(matrix)), [matrix[0, 1] == 1])
    status = conic.solve(problem, "osqp")
    assert status is Status.FAILED
    assert "choose another solver" in status.advice


class _Problem:
    """A problem whose solver behaves badly."""

    def __init__(self, status, error=None):
        self.status, self.error = status, error

    def solve(self, solver):
        warnings.warn("Solution may be inaccurate.", UserWarning, stacklevel=2)
        if self.error is not None:
            raise self.error

    def variables(self):
        return []


class PanicException(BaseException):
    """What a panic of a solver in Rust arrives as (pyo3): no Exception."""


BROKEN = [
    cp.error.SolverError("broke"),
    ZeroDivisionError(),
    RuntimeError("panic"),
    np.linalg.LinAlgError("SVD did not converge"),
    MemoryError(),
    PanicException("index out of bounds"),
]


@pytest.mark.parametrize("error", BROKEN, ids=lambda error: type(error).__name__)
def test_exceptions_of_a_solver_become_a_status(error):
    assert conic.solve(_Problem("optimal", error)) is Status.FAILED


@pytest.mark.parametrize("error", BROKEN, ids=lambda error: type(error).__name__)
def test_exceptions_of_highs_become_a_status(monkeypatch, error):
    def broken(*_, **__):
        raise error

    monkeypatch.setattr(conic, "linprog", broken)
    monkeypatch.setattr(conic, "milp", broken)
    solution = conic.linear_program([1.0], bounds=(0, 1))
    assert solution.status is Status.FAILED
    assert np.isnan(solution.x).all()
    one = {"matrix": [[1.0]], "low": [0.0], "high": [1.0], "integrality": [1], "bounds": (0, 1)}
    assert conic.mixed_integer_program([1.0], **one).status is Status.FAILED


def test_an_interruption_is_not_taken_for_a_fault_of_the_solver():
    with pytest.raises(KeyboardInterrupt):
        conic.solve(_Problem("optimal", KeyboardInterrupt()))


def test_where_the_simplex_method_fails_the_interior_point_is_asked(monkeypatch):
    asked, linprog = [], conic.linprog

    def fails_at_first(*arguments, method, **options):
        asked.append(method)
        if len(asked) == 1:
            raise RuntimeError("numerical difficulties")
        return linprog(*arguments, method=method, **options)

    monkeypatch.setattr(conic, "linprog", fails_at_first)
    solution = conic.linear_program([1.0], A_ub=[[-1.0]], b_ub=[-2.0])
    assert asked == ["highs", "highs-ipm"]
    assert solution.status is Status.OPTIMAL
    assert solution.x[0] == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize("said", [0, 1])  # optimal, and out of time
def test_a_point_without_numbers_is_no_solution_whatever_the_solver_says(monkeypatch, said):
    def nothing(cost, **_):
        return OptimizeResult(x=np.full(len(cost), np.nan), fun=np.nan, status=said)

    monkeypatch.setattr(conic, "linprog", nothing)
    monkeypatch.setattr(conic, "milp", lambda cost, **_: nothing(cost))
    assert conic.linear_program([1.0], bounds=(0, 1)).status is Status.FAILED
    one = {"matrix": [[1.0]], "low": [0.0], "high": [1.0], "integrality": [1], "bounds": (0, 1)}
    ended = conic.mixed_integer_program([1.0], **one)
    assert np.isnan(ended.x).all() and ended.status is [Status.FAILED, Status.TIME_LIMIT][said]
    X = np.linspace(-1.0, 1.0, 20)[:, None]
    with pytest.raises(SolverError, match=r"no solution of the margin LP"):
        PolynomialSurfaceClassifier(1).fit(X, X[:, 0] > 0.0)


@pytest.mark.parametrize("status", [Status.INFEASIBLE, Status.UNBOUNDED, Status.FAILED])
def test_no_solution_is_an_error_with_advice(status):
    with pytest.raises(SolverError, match=r"margin LP .*; rescale the data .* another solver\.$"):
        conic.require_solution(status, "margin LP")


@pytest.mark.parametrize("status", conic.HAS_VALUES)
def test_a_point_of_the_solver_passes(status):
    conic.require_solution(status, "margin LP")


def test_warnings_of_a_solver_become_a_status():
    assert conic.solve(_Problem("optimal_inaccurate")) is Status.INACCURATE
    assert conic.solve(_Problem("user_limit")) is Status.ITERATION_LIMIT
    assert conic.solve(_Problem("solver_error")) is Status.FAILED


def test_an_invalid_model_is_not_hidden():
    x = cp.Variable()
    with pytest.raises(cp.error.DCPError):
        conic.solve(cp.Problem(cp.Minimize(-cp.square(x))))


def test_integer_program_matches_enumeration():
    rng = np.random.default_rng(3)
    value, weight = rng.integers(1, 20, size=(2, 8)).astype(float)
    capacity = 0.4 * weight.sum()
    subsets = (np.arange(2**8)[:, None] >> np.arange(8)) & 1
    best = (subsets @ value)[subsets @ weight <= capacity].max()
    solution = conic.mixed_integer_program(
        -value,
        matrix=csr_array(weight[None]),
        low=[-np.inf],
        high=[capacity],
        integrality=np.ones(8),
        bounds=(0, 1),
    )
    assert solution.status is Status.OPTIMAL
    assert solution.objective == pytest.approx(-best, abs=1e-9)
    assert solution.bound == pytest.approx(-best, abs=1e-6)


def test_an_infeasible_integer_program_says_so():
    solution = conic.mixed_integer_program(
        [1.0], matrix=[[2.0]], low=[1.0], high=[1.0], integrality=[1], bounds=(0, 1)
    )
    assert solution.status is Status.INFEASIBLE
    assert np.isnan(solution.x).all()
