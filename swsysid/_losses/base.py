"""What a loss of a residual is: its values, its dynamics program, and a summary of many rows.

A loss is one class in a file of its own. It values residuals, fits coefficients (the C-step,
paper problem "Dynamics estimation as LP" for l1), and says with which `Summary` many rows are
told in a few numbers.

Every fit carries a lower bound from Lagrange duality. With R = Y - D C^T,

    min_{|C| <= B} f(R) >= <U, Y> - f*(U) - B sum |U^T D|    for every U of the shape of R,

where f* is the conjugate; for a weighted sum of norms it is the condition that w_i bounds the
dual norm of U_i, for weighted squares the sum of |U_i|^2 / (4 w_i).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from swsysid._losses.program import DynamicsProgram
from swsysid._losses.trust_region import TrustRegion
from swsysid._results import Array, Status
from swsysid._solvers.conic import modelling, require_solution, solve

PROVED = 1e-7  # relative gap up to which a fit counts as optimal; conic solvers reach 1e-8
ROUNDING = 1e-12  # of the loss of the targets themselves


class Summary(Protocol):
    """What many rows say about the coefficients of one regression, in a few numbers.

    A summary is made of a block of rows at given coefficients, summaries of blocks are joined,
    and the joined one leads to better coefficients. It is `exact` if it equals the sum over all
    rows while no residual leaves its trust region.
    """

    exact: bool

    @classmethod
    def of(
        cls, design: Array, targets: Array, weight: Array, coef: Array, region: TrustRegion
    ) -> Self:
        """Summary of a block at coefficients (n_outputs, n_features)."""

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """Summary of several blocks."""

    def fit(self, coef: Array, bound: float, support: NDArray[np.bool_]) -> Array:
        """Better coefficients in the box, those off the support zero, from given ones."""


@dataclass(frozen=True)
class DynamicsFit:
    """Coefficients that minimise a loss for given memberships."""

    coef: Array  # (n_outputs, n_features)
    objective: float  # weighted sum of the losses
    # Value of a dual feasible point: no coefficients in the box have a smaller objective.
    lower_bound: float
    status: Status


class Loss(ABC):
    """A convex loss of a residual vector, summed over samples."""

    name: str
    norm: str  # name of the norm that has the same minimisers
    separable = True  # a sum over outputs
    summary: type[Summary]  # what many rows say about coefficients
    additive = False  # rows can be added to a summary, and taken away, at any coefficients

    @abstractmethod
    def values(self, residuals: Array) -> Array:
        """Loss of each residual: (..., n_outputs) -> (...)."""

    @abstractmethod
    def subgradient(self, residuals: Array) -> Array:
        """An element of the subdifferential at each residual, of the same shape."""

    @abstractmethod
    def expression(self, cp, residuals):
        """Loss of each row of a matrix of the modelling language `cp`."""

    @abstractmethod
    def dual_norm(self, vectors: Array) -> Array:
        """Dual of the norm that the loss is, or is the square of: (..., n_outputs) -> (...)."""

    @abstractmethod
    def extra_coordinate(self, values: Array, penalty: Array) -> Array:
        """Coordinate e >= 0 to append to a residual so that its loss grows by `penalty`.

        A relaxation then needs to know nothing about surfaces.
        """

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

        Coefficients off the `support`, (n_outputs, n_features), are exactly zero; they are of
        least norm among those with the same residuals where the features are dependent and the
        box allows it, and zeros where there are no rows. The solver ``"auto"`` is the method made
        for this loss; any other name poses the program to that solver (``"highs"`` for l1,
        ``"clarabel"``, ... for all), as a reference. A `start` saves time and does not change the
        optimum.

        Examples
        --------
        One gross error in three samples of y = 2 x:

        >>> import numpy as np
        >>> from swsysid._losses import get_loss
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

    def _minimise(self, program: DynamicsProgram, solver: str) -> tuple[Array, float]:
        if solver in ("auto", "structured"):
            return self._structured(program)
        coef, dual = self._posed(program, solver)
        return coef, self._dual_value(program, coef, dual)

    @abstractmethod
    def _structured(self, program: DynamicsProgram) -> tuple[Array, float]:
        """Coefficients and a lower bound by the method made for the loss."""

    @abstractmethod
    def _feasible(self, dual: Array, weight: Array) -> tuple[Array, float]:
        """A multiple of the dual where the conjugate is finite, and the conjugate there."""

    def _dual_value(self, program: DynamicsProgram, coef: Array, dual: Array) -> float:
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

    def _posed(self, program: DynamicsProgram, solver: str) -> tuple[Array, Array]:
        """Coefficients and dual U of the program posed to a solver."""
        cp = modelling()
        coef = cp.Variable(program.support.shape)
        residuals = cp.Variable(program.targets.shape)
        definition = residuals == program.targets - program.design @ coef.T
        constraints = [definition]
        if np.isfinite(program.bound):
            constraints += [coef <= program.bound, coef >= -program.bound]
        if not program.support.all():
            constraints += [coef[np.nonzero(~program.support)] == 0]
        losses = program.weight @ self.expression(cp, residuals)
        problem = cp.Problem(cp.Minimize(losses), constraints)
        require_solution(solve(problem, solver), f"{self.name} dynamics program")
        return np.where(program.support, coef.value, 0.0), -definition.dual_value


class NormLoss(Loss):
    """A loss that is a norm: U is feasible where its dual norm is at most the weight."""

    def _feasible(self, dual, weight):
        return dual / max(1.0, float((self.dual_norm(dual) / weight).max())), 0.0
