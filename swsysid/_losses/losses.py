"""The losses of a residual: values, dual norm, and the dynamics program each leads to.

A loss is one class. It knows how to value a residual, how to fit coefficients (the C-step,
paper problem "Dynamics estimation as LP" for l1), and how a surface's penalty can be written
as *one more coordinate of the residual*, so that a relaxation needs to know nothing about
surfaces.

Every fit carries a lower bound from Lagrange duality. With R = Y - D C^T,

    min_{|C| <= B} f(R) >= <U, Y> - f*(U) - B sum |U^T D|    for every U of the shape of R,

where f* is the conjugate; for a weighted sum of norms it is the condition that w_i bounds the
dual norm of U_i, for weighted squares the sum of |U_i|^2 / (4 w_i).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, eye_array, hstack, vstack

from swsysid._checks.parameters import one_of
from swsysid._losses.dynamics_program import DynamicsProgram, boxed_least_squares
from swsysid._losses.norm_summary import NormSummary
from swsysid._losses.summaries import GramSummary, SignSummary
from swsysid._results import Array, Status
from swsysid._solvers.conic import linear_program, modelling, require_solution, solve
from swsysid._solvers.euclidean import least_euclidean_norms
from swsysid._solvers.lad import least_absolute_deviations
from swsysid._solvers.row_space import RowSpace

__all__ = ["LOSSES", "DynamicsFit", "L1Loss", "L2Loss", "Loss", "SquaredLoss", "get_loss"]

STRUCTURED = ("auto", "structured")
PROVED = 1e-7  # relative gap up to which a fit counts as optimal; conic solvers reach 1e-8
ROUNDING = 1e-12  # of the loss of the targets themselves


@dataclass(frozen=True)
class DynamicsFit:
    """Coefficients that minimise a loss for given memberships.

    Attributes
    ----------
    coef : ndarray of shape (n_outputs, n_features)
    objective : float
        Weighted sum of the losses.
    lower_bound : float
        Value of a dual feasible point: no coefficients in the box have a smaller objective.
    status : Status
    """

    coef: Array
    objective: float
    lower_bound: float
    status: Status


class Loss(ABC):
    """A convex loss of a residual vector, summed over samples."""

    name: str
    separable = True  # a sum over outputs
    summary: Any  # class of `_solvers.summaries`: what many rows say about coefficients
    additive = False  # rows can be added to a summary, and taken away, at any coefficients

    @abstractmethod
    def values(self, residuals: Array) -> Array:
        """Loss of each residual: (..., n_outputs) -> (...)."""

    @abstractmethod
    def subgradient(self, residuals: Array) -> Array:
        """An element of the subdifferential at each residual, of the same shape."""

    @abstractmethod
    def dual_norm(self, vectors: Array) -> Array:
        """Dual of the norm that the loss is, or is the square of: (..., n_outputs) -> (...)."""

    @abstractmethod
    def extra_coordinate(self, values: Array, penalty: Array) -> Array:
        """Coordinate e >= 0 to append to a residual so that its loss grows by `penalty`."""

    def fit(
        self,
        design: Array,
        targets: Array,
        *,
        sample_weight: Array | None = None,
        coef_bound: float | None = None,
        solver: str = "auto",
        start: Array | None = None,
        support: NDArray[np.bool_] | None = None,
    ) -> DynamicsFit:
        r"""Solve :math:`\min_C \sum_i w_i L(y_i - C d_i)` subject to :math:`|C| \le B`.

        Parameters
        ----------
        design : ndarray of shape (n_samples, n_features)
        targets : ndarray of shape (n_samples, n_outputs)
        sample_weight : ndarray of shape (n_samples,), default=None
            Nonnegative; a row of weight 2 counts as two rows, of weight 0 as none.
        coef_bound : float, default=None
            The bound B; infinite by default.
        solver : str, default="auto"
            ``"auto"`` is the method made for this program. Any other name poses the program to
            that solver (``"highs"`` for l1, ``"clarabel"``, ... for all), as a reference.
        start : ndarray of shape (n_outputs, n_features), default=None
            Coefficients of a similar program: saves time, does not change the optimum.
        support : ndarray of shape (n_outputs, n_features), bool, default=None
            Coefficients outside are exactly zero.

        Returns
        -------
        DynamicsFit
            Of minimum norm among the coefficients with the same residuals where the features
            are dependent and the box allows it; zeros where there are no rows.

        Raises
        ------
        SolverError
            If `solver` is not installed or found no solution.

        Examples
        --------
        One gross error in three samples of y = 2 x:

        >>> import numpy as np
        >>> from swsysid._losses.losses import get_loss
        >>> x, y = np.array([[1.0], [2.0], [3.0]]), np.array([[2.0], [4.0], [60.0]])
        >>> fit = get_loss("l1").fit(x, y, coef_bound=5.0)
        >>> fit.coef.round(9), round(fit.objective, 9), fit.status.value
        (array([[5.]]), 54.0, 'optimal')
        """
        shape = (targets.shape[1], design.shape[1])
        weight = np.ones(len(design)) if sample_weight is None else np.asarray(sample_weight)
        if not (weight > 0).all():
            kept = weight > 0
            design, targets, weight = design[kept], targets[kept], weight[kept]
        program = DynamicsProgram(
            np.asarray(design, dtype=float),
            np.asarray(targets, dtype=float),
            weight,
            np.inf if coef_bound is None else float(coef_bound),
            np.ones(shape, dtype=bool) if support is None else np.asarray(support, dtype=bool),
            None if start is None else np.asarray(start, dtype=float),
        )
        coef, lower_bound = np.zeros(shape), 0.0
        whole = program.coupled and not self.separable
        for place in [program.everything()] if whole else program.places():
            part = program.part(place)
            if part.design.size:
                fitted, value = self._minimise(part, solver.lower())
                coef[place] = fitted.clip(-part.bound, part.bound)
                lower_bound += value
            else:
                lower_bound += float(part.weight @ self.values(part.targets))
        objective = float(weight @ self.values(program.residuals(coef)))
        rounding = ROUNDING * float(weight @ self.values(program.targets))
        proved = objective - lower_bound <= PROVED * objective + rounding
        return DynamicsFit(
            coef,
            objective,
            min(max(lower_bound, 0.0), objective),
            Status.OPTIMAL if proved else Status.INACCURATE,
        )

    def _minimise(self, program, solver) -> tuple[Array, float]:
        if solver in STRUCTURED:
            return self._structured(program)
        coef, dual = self._posed(program, solver)
        return coef, self._dual_value(program, coef, dual)

    @abstractmethod
    def _structured(self, program) -> tuple[Array, float]:
        """Coefficients and a lower bound by the method made for the loss."""

    @abstractmethod
    def _feasible(self, dual, weight) -> tuple[Array, float]:
        """A multiple of the dual where the conjugate is finite, and the conjugate there."""

    def _dual_value(self, program, coef, dual) -> float:
        """The lower bound of Lagrange duality by a dual that need not be feasible."""
        bounded = np.isfinite(program.bound)
        dual, conjugate = self._feasible(
            dual if bounded else program.orthogonal(dual), program.weight
        )
        # <U, Y> = <U, R> + <U^T D, C>, without the cancellation of large targets.
        value = float((dual * program.residuals(coef)).sum()) - conjugate
        if bounded:
            slope = np.where(program.support, dual.T @ program.design, 0.0)
            value += float((slope * coef - program.bound * np.abs(slope)).sum())
        return value

    @abstractmethod
    def _posed(self, program, solver) -> tuple[Array, Array]:
        """Coefficients and dual U of the program posed to a solver."""

    def _posed_conic(self, program, solver, expression) -> tuple[Array, Array]:
        """The program in the modelling language; `expression` values a matrix of residuals."""
        cp = modelling()
        coef = cp.Variable(program.support.shape)
        residuals = cp.Variable(program.targets.shape)
        definition = residuals == program.targets - program.design @ coef.T
        constraints = [definition]
        if np.isfinite(program.bound):
            constraints += [coef <= program.bound, coef >= -program.bound]
        if not program.support.all():
            constraints += [coef[np.nonzero(~program.support)] == 0]
        losses = program.weight @ expression(cp, residuals)
        problem = cp.Problem(cp.Minimize(losses), constraints)
        require_solution(solve(problem, solver), f"{self.name} dynamics program")
        return np.where(program.support, coef.value, 0.0), -definition.dual_value


class _NormLoss(Loss):
    """A loss that is a norm: U is feasible where its dual norm is at most the weight."""

    def _feasible(self, dual, weight):
        return dual / max(1.0, float((self.dual_norm(dual) / weight).max())), 0.0


class L1Loss(_NormLoss):
    """Sum of absolute residuals: sum_k |r_k| (the paper's p = 1)."""

    name = "l1"
    summary = SignSummary

    def values(self, residuals):
        # a product with ones is many times as fast as a sum along a short axis
        return np.abs(residuals) @ np.ones(np.shape(residuals)[-1])

    def subgradient(self, residuals):
        return np.sign(residuals)

    def dual_norm(self, vectors):
        return np.abs(vectors).max(axis=-1)

    def extra_coordinate(self, values, penalty):
        return penalty

    def _structured(self, program):
        fit = least_absolute_deviations(
            program.design,
            program.targets,
            sample_weight=program.weight,
            coef_bound=program.bound,
            start=program.start,
        )
        return fit.coef, float(fit.lower_bound.sum())

    def _posed(self, program, solver):
        # The paper's linear program, one output at a time, over (c, delta):
        #   min w.delta   s.t.   D c - delta <= y,   -D c - delta <= -y,   |c| <= B
        # whose multipliers l, m >= 0 have l + m = w, so that u = m - l is the dual.
        design, slack = csr_array(program.design), -eye_array(len(program.design))
        n_samples, n_features = design.shape
        box = np.full((n_features + n_samples, 2), (-np.inf, np.inf))
        box[:n_features] = -program.bound, program.bound
        coef, dual = [], []
        for target in program.targets.T:
            solution = linear_program(
                np.concatenate([np.zeros(n_features), program.weight]),
                A_ub=vstack([hstack([design, slack]), hstack([-design, slack])]),
                b_ub=np.concatenate([target, -target]),
                bounds=box,
                solver=solver,
            )
            require_solution(solution.status, f"{self.name} dynamics program")
            coef.append(solution.x[:n_features])
            dual.append(solution.dual_ub[n_samples:] - solution.dual_ub[:n_samples])
        return np.stack(coef), np.stack(dual, axis=1)


class L2Loss(_NormLoss):
    """Euclidean norm of the residual: (sum_k r_k^2)^(1/2) (the paper's p = 2)."""

    name = "l2"
    summary = NormSummary
    separable = False

    def values(self, residuals):
        return np.linalg.norm(residuals, axis=-1)

    def subgradient(self, residuals):
        lengths = np.linalg.norm(residuals, axis=-1, keepdims=True)
        return residuals / np.where(lengths > 0, lengths, 1.0)

    def dual_norm(self, vectors):
        return np.linalg.norm(vectors, axis=-1)

    def extra_coordinate(self, values, penalty):
        # (value + penalty)^2 = value^2 + e^2
        return np.sqrt(penalty * (2.0 * values + penalty))

    def _structured(self, program):
        scale = program.weight[:, None]
        design, targets = program.design * scale, program.targets * scale
        least_squares = np.zeros(program.support.shape)
        for outputs, features in program.places():
            space = RowSpace(design[:, features.ravel()])
            part = space.coef(space.least_squares(targets[:, outputs.ravel()].T))
            least_squares[outputs, features] = part
        if program.coupled:
            fit = least_euclidean_norms(design, targets, least_squares, program.support)
            coef = fit.coef
        else:
            free = np.ones((len(least_squares), space.rank), dtype=bool)
            inner = space.inner(least_squares)
            fit = least_euclidean_norms(space.design, targets, inner, free)
            coef = space.coef(fit.coef)
        if np.abs(coef).max(initial=0.0) > program.bound:
            return self._minimise(program, "clarabel")
        return coef, fit.lower_bound

    def _posed(self, program, solver):
        return self._posed_conic(program, solver, lambda cp, rows: cp.norm(rows, 2, axis=1))


class SquaredLoss(Loss):
    """Sum of squared residuals: sum_k r_k^2."""

    name = "squared"
    summary, additive = GramSummary, True

    def values(self, residuals):
        return np.square(residuals).sum(axis=-1)

    def subgradient(self, residuals):
        return 2.0 * residuals

    def dual_norm(self, vectors):
        return np.linalg.norm(vectors, axis=-1)

    def extra_coordinate(self, values, penalty):
        return np.sqrt(penalty)

    def _structured(self, program):
        root = np.sqrt(program.weight)[:, None]
        design, targets = program.design * root, program.targets * root
        space = RowSpace(design)
        coef = space.coef(space.least_squares(targets.T))
        if np.abs(coef).max() > program.bound:
            coef = boxed_least_squares(design, targets, program.bound)
        dual = self.subgradient(program.residuals(coef)) * program.weight[:, None]
        return coef, self._dual_value(program, coef, dual)

    def _feasible(self, dual, weight):
        return dual, float((np.square(dual).sum(axis=1) / (4.0 * weight)).sum())

    def _posed(self, program, solver):
        return self._posed_conic(program, solver, lambda cp, rows: cp.sum(cp.square(rows), axis=1))


LOSSES = {loss.name: loss for loss in (L1Loss, L2Loss, SquaredLoss)}


def get_loss(name: str) -> Loss:
    """The loss called `name`."""
    return LOSSES[one_of("loss", name, LOSSES)]()
