"""The one door to the solvers: HiGHS through SciPy, and everything that cvxpy can call.

No other file imports cvxpy or calls an optimiser of linear, conic or integer programs. What
comes back is a record with a `Status`; a solver's own exceptions and warnings stay in here.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import issparse

from swsysid._results import Array, SolverError, Status

# Ends of `solve` after which the variables hold the solver's last point.
HAS_VALUES = (Status.OPTIMAL, Status.INACCURATE, Status.ITERATION_LIMIT)


@dataclass(frozen=True)
class LinearSolution:
    """Solution of a linear program, mixed-integer or not."""

    x: Array  # (n_variables,): the best point found; NaN where there is none, and `status` says why
    objective: float
    dual_ub: Array  # (n_inequalities,): multipliers, not negative
    # (n_equalities,): multipliers. With those of the bounds left out, ``cost + A_ub.T @ dual_ub +
    # A_eq.T @ dual_eq`` is the reduced cost: zero at variables strictly between their bounds.
    dual_eq: Array
    status: Status
    # Proved lower bound on the optimum of a mixed-integer program, which has no multipliers.
    bound: float = -np.inf


def _no_solution(n_variables, status, *, objective=np.nan, n_ub=0, n_eq=0, bound=-np.inf):
    nothing, dual_ub, dual_eq = (np.full(n, np.nan) for n in (n_variables, n_ub, n_eq))
    return LinearSolution(nothing, objective, dual_ub, dual_eq, status, bound)


def linear_program(
    cost, *, A_ub=None, b_ub=None, A_eq=None, b_eq=None, bounds=None, solver: str = "auto"
) -> LinearSolution:
    r"""Solve :math:`\min_x c^T x` s.t. :math:`A_{ub} x \le b_{ub}`, :math:`A_{eq} x = b_{eq}`.

    Matrices may be sparse. `bounds` are (low, high) or one such pair for each variable, infinite
    for no bound; None leaves every variable free. The solvers ``"auto"`` and ``"highs"`` are HiGHS
    through SciPy, any other name is one of cvxpy.

    Examples
    --------
    The least x with x >= 2:

    >>> from swsysid._solvers.conic import linear_program
    >>> solution = linear_program([1.0], A_ub=[[-1.0]], b_ub=[-2.0])
    >>> solution.x, solution.dual_ub
    (array([2.]), array([1.]))
    """
    cost = np.asarray(cost, dtype=float)
    bounds = _full_bounds(bounds, cost.size)
    rows = {
        "A_ub": A_ub if A_ub is None or issparse(A_ub) else np.asarray(A_ub, dtype=float),
        "b_ub": None if b_ub is None else np.asarray(b_ub, dtype=float),
        "A_eq": A_eq if A_eq is None or issparse(A_eq) else np.asarray(A_eq, dtype=float),
        "b_eq": None if b_eq is None else np.asarray(b_eq, dtype=float),
    }
    if solver.lower() in ("auto", "highs"):
        return _linear_program_highs(cost, rows, bounds)
    return _linear_program_cvxpy(cost, rows, bounds, solver)


def solve(problem, solver: str = "auto") -> Status:
    """Solve a cvxpy problem in place, ``"auto"`` with Clarabel, and say how it ended."""
    # Variables hold values of this solve only where the status is in `HAS_VALUES`.
    error, name = modelling().error, _installed(solver)
    # A program that is not convex is a mistake of this package, not of the solver.
    mistakes = (error.DCPError, error.DPPError, error.DGPError, error.ParameterError)
    _, broke = _answer(lambda: problem.solve(solver=name), mistakes)
    if broke:
        return Status.FAILED
    status = _CVXPY_STATUS.get(problem.status, Status.FAILED)
    has_values = all(_is_finite(variable.value) for variable in problem.variables())
    return Status.FAILED if status in HAS_VALUES and not has_values else status


def mixed_integer_program(
    cost, *, matrix, low, high, integrality, bounds, time_limit: float = np.inf
) -> LinearSolution:
    """Solve min cost @ x s.t. low <= matrix @ x <= high, some x integer, with HiGHS."""
    # `integrality` is 1 for an integer variable, 0 for a continuous one; `time_limit` is in s.
    cost = np.asarray(cost, dtype=float)
    answer, broke = _answer(
        lambda: milp(
            cost,
            integrality=integrality,
            bounds=Bounds(*_full_bounds(bounds, cost.size).T),
            constraints=LinearConstraint(matrix, low, high),
            # HiGHS stops at a relative gap of 1e-4 by default; the exact program asks for none.
            options={"time_limit": time_limit, "mip_rel_gap": 0.0},
        )
    )
    if broke:
        return _no_solution(cost.size, Status.FAILED, objective=np.inf)
    status, bound = _MILP_STATUS.get(answer.status, Status.FAILED), answer.get("mip_dual_bound")
    if not _is_finite(answer.x):
        bound = -np.inf if bound is None else bound
        status = Status.FAILED if status in HAS_VALUES else status
        return _no_solution(cost.size, status, objective=np.inf, bound=bound)
    bound = answer.fun if bound is None else bound
    return LinearSolution(answer.x, answer.fun, np.empty(0), np.empty(0), status, bound)


def require_solution(status: Status, program: str) -> None:
    """Raise `SolverError` unless a solver came back with a point."""
    # The programs of this package have solutions: a solver that finds none, whatever it says of the
    # program (`program` is its name, such as ``"margin LP"``), has failed on these numbers.
    if status not in HAS_VALUES:
        raise SolverError(
            f"the solver found no solution of the {program} ({status.value}); rescale the data to "
            "order one, or choose another solver."
        )


def worst_status(statuses: Iterable[Status]) -> Status:
    """`OPTIMAL` if all are, else the first that is not."""
    return next((status for status in statuses if not status.ok), Status.OPTIMAL)


def modelling():
    """Return the cvxpy module, imported at its first use because that takes a second."""
    try:
        return importlib.import_module("cvxpy")
    except ImportError as error:
        raise SolverError(
            "cvxpy is not installed; pip install cvxpy clarabel, or leave solver='auto' and use "
            "the simplex or exact relaxation."
        ) from error


_CVXPY_STATUS = {
    "optimal": Status.OPTIMAL,
    "optimal_inaccurate": Status.INACCURATE,
    "infeasible": Status.INFEASIBLE,
    "infeasible_inaccurate": Status.INFEASIBLE,
    "unbounded": Status.UNBOUNDED,
    "unbounded_inaccurate": Status.UNBOUNDED,
    "infeasible_or_unbounded": Status.INFEASIBLE,
    "user_limit": Status.ITERATION_LIMIT,
}

# The numbers that scipy.optimize.linprog documents; milp's differ in the meaning of 1 only.
_LINPROG_STATUS = {
    0: Status.OPTIMAL,
    1: Status.ITERATION_LIMIT,
    2: Status.INFEASIBLE,
    3: Status.UNBOUNDED,
}
_MILP_STATUS = _LINPROG_STATUS | {1: Status.TIME_LIMIT}


def _full_bounds(bounds, n_variables: int) -> Array:
    pairs = (-np.inf, np.inf) if bounds is None else bounds
    return np.broadcast_to(np.asarray(pairs, dtype=float), (n_variables, 2))


def _n_rows(right_hand_side) -> int:
    return 0 if right_hand_side is None else np.size(right_hand_side)


def _answer(call: Callable[[], Any], mistakes: tuple = ()) -> tuple[Any, bool]:
    """What a solver answers, and whether it broke: accuracy is told by Status, not by warnings."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return call(), False
        except mistakes:
            raise
        except Exception:  # of linear algebra, memory, or the solver's own
            return None, True
        except BaseException as panic:
            # A solver written in Rust panics with what is no Exception (pyo3).
            if type(panic).__name__ != "PanicException":
                raise
            return None, True


def _is_finite(values) -> bool:
    """Whether a solver has given numbers: it may call a point optimal that has none."""
    return values is not None and bool(np.isfinite(values).all())


def _linear_program_highs(cost, rows, bounds) -> LinearSolution:
    status = Status.FAILED
    # Where the simplex method fails, the interior point of HiGHS may not.
    for method in ("highs", "highs-ipm"):
        answer, broke = _answer(partial(linprog, cost, bounds=bounds, method=method, **rows))
        status = Status.FAILED if broke else _LINPROG_STATUS.get(answer.status, Status.FAILED)
        if status in HAS_VALUES and not (status is Status.OPTIMAL and _is_finite(answer.x)):
            status = Status.FAILED
        if status is not Status.FAILED:
            break
    if status is not Status.OPTIMAL:
        return _no_solution(
            cost.size, status, n_ub=_n_rows(rows["b_ub"]), n_eq=_n_rows(rows["b_eq"])
        )
    # SciPy's marginals are d objective / d right-hand side, the negative of the multipliers.
    return LinearSolution(
        answer.x, answer.fun, -answer.ineqlin.marginals, -answer.eqlin.marginals, status
    )


def _linear_program_cvxpy(cost, rows, bounds, solver) -> LinearSolution:
    cp = modelling()
    x = cp.Variable(cost.size)
    inequalities = [rows["A_ub"] @ x <= rows["b_ub"]] if _n_rows(rows["b_ub"]) else []
    equalities = [rows["A_eq"] @ x == rows["b_eq"]] if _n_rows(rows["b_eq"]) else []
    has_low, has_high = np.isfinite(bounds).T
    box = [x[has_low] >= bounds[has_low, 0]] if has_low.any() else []
    box += [x[has_high] <= bounds[has_high, 1]] if has_high.any() else []
    problem = cp.Problem(cp.Minimize(cost @ x), inequalities + equalities + box)
    status = solve(problem, solver)
    if status not in HAS_VALUES:
        return _no_solution(
            cost.size, status, n_ub=_n_rows(rows["b_ub"]), n_eq=_n_rows(rows["b_eq"])
        )
    dual_ub, dual_eq = (
        np.concatenate([np.atleast_1d(constraint.dual_value) for constraint in constraints])
        if constraints
        else np.empty(0)
        for constraints in (inequalities, equalities)
    )
    return LinearSolution(x.value, float(problem.value), dual_ub, dual_eq, status)


def _installed(solver: str) -> str:
    cp = modelling()
    name = "CLARABEL" if solver.lower() == "auto" else solver.upper()
    available = cp.installed_solvers()
    if name not in available:
        raise SolverError(
            f"solver={solver!r} is not installed; the installed solvers are "
            f"{', '.join(available)}. Choose one of them, or install {name.lower()} with pip."
        )
    return name
