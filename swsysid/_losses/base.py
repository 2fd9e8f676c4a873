"""What a loss of a residual is: its values, its dynamics program, and a summary of many rows.

A loss is one class in a file of its own. It values residuals, fits coefficients (the C-step,
paper problem "Dynamics estimation as LP" for l1), and says with which `Summary` many rows are
told in a few numbers.

Every fit carries a lower bound from Lagrange duality. With R = Y - D C^T,

    min_{|C| <= B} f(R) >= <U, Y> - f*(U) - B sum |U^T D|    for every U of the shape of R,

where f* is the conjugate; for a weighted sum of norms it is the condition that w_i bounds the
dual norm of U_i, for weighted squares the sum of |U_i|^2 / (4 w_i).

Whatever the loss, a dynamics program has rows, a box and free coefficients; and a `TrustRegion`
says how far the residuals of rows may move while coefficients move a little.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr
from scipy.optimize import lsq_linear

from swsysid._results import Array, Status
from swsysid._solvers.conic import modelling, require_solution, solve
from swsysid._solvers.row_space import RowSpace

PROVED = 1e-7  # relative gap up to which a fit counts as optimal; conic solvers reach 1e-8
ROUNDING = 1e-12  # of the loss of the targets themselves
# Indices of outputs (k, 1) and of features (1, p): together they pick a block of coefficients.
Place = tuple[NDArray[np.intp], NDArray[np.intp]]


class Regression(NamedTuple):
    """What a summary says, as rows of each output and a smooth part beside their loss."""

    rows: tuple[tuple[Array, Array], ...]  # features (n_rows, n_features), targets (n_rows,)
    n_heavy: int = 0  # so many of them, the last, stand for many others
    gradient: Array | None = None  # (n_outputs, n_features): of the smooth part, none if None
    hessian: Array | None = None  # (n_outputs, n_features, n_outputs, n_features)


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

    @property
    def regression(self) -> Regression:
        """The same as rows, to be joined with those of other summaries."""


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


@dataclass(frozen=True)
class DynamicsProgram:
    """One dynamics program: min_C sum_i w_i L(y_i - C d_i), |C| <= B, C zero off the support."""

    design: Array  # (n_samples, n_features)
    targets: Array  # (n_samples, n_outputs)
    weight: Array  # (n_samples,), positive
    bound: float  # B, infinite for none
    support: NDArray[np.bool_]  # (n_outputs, n_features)
    start: Array | None

    @property
    def coupled(self) -> bool:
        """True if the outputs do not all have the same free features."""
        return bool((self.support != self.support[:1]).any())

    def part(self, place: Place) -> DynamicsProgram:
        """The program of some outputs and features."""
        outputs, features = place
        return replace(
            self,
            design=self.design
            if self.support.shape[1] == features.size
            else self.design[:, features.ravel()],
            targets=self.targets[:, outputs.ravel()],
            support=self.support[place],
            start=None if self.start is None else self.start[place],
        )

    def places(self) -> Iterator[Place]:
        """Outputs that share their free features, with these features."""
        patterns, owner = np.unique(self.support, axis=0, return_inverse=True)
        for index, columns in enumerate(patterns):
            outputs = np.flatnonzero(owner.ravel() == index)
            yield outputs[:, None], np.flatnonzero(columns)[None, :]

    def everything(self) -> Place:
        """All outputs and all features."""
        n_outputs, n_features = self.support.shape
        return np.arange(n_outputs)[:, None], np.arange(n_features)[None, :]

    def residuals(self, coef: Array) -> Array:
        return self.targets - self.design @ coef.T

    def orthogonal(self, dual: Array) -> Array:
        """The dual nearest to `dual` with U^T D = 0 on the support."""
        dual = dual.copy()
        for outputs, features in self.places():
            if features.size:
                space = RowSpace(self.design[:, features.ravel()])
                coef = space.least_squares(dual[:, outputs.ravel()].T)
                dual[:, outputs.ravel()] -= space.design @ coef.T
        return dual


def boxed_least_squares(design: Array, targets: Array, bound: float) -> Array:
    """Least squares with |C| <= bound, by the active-set method on the triangular factor."""
    n_features = design.shape[1]
    # D = Q T and Q^T Y from one factorisation: the rows beyond play no further part.
    factor = qr(np.hstack([design, targets]), mode="r")[0][: n_features + targets.shape[1]]
    scale = np.abs(factor[:, :n_features]).max(axis=0)
    scale[scale == 0] = 1.0
    coef = [
        lsq_linear(
            factor[:, :n_features] / scale,
            right,
            (-bound * scale, bound * scale),
            method="bvls",
            tol=1e-15,
            max_iter=100 * n_features,
        ).x
        for right in factor[:, n_features:].T
    ]
    return (np.stack(coef) / scale).clip(-bound, bound)


@dataclass(frozen=True)
class TrustRegion:
    r"""Within which distance the residual of a row may move: rows of much leverage move most.

    A change :math:`\Delta` of the coefficients with :math:`\Delta^T G \Delta \le s^2` moves the
    residual of a row d by at most :math:`s \, (d^T G^{-1} d)^{1/2}`, with equality for one of them.
    """

    # (n_features, rank): a root of the inverse of G, the Gram matrix of the rows that the
    # coefficients are known from.
    metric: Array
    size: Array  # (n_outputs,): the number s of each; negative where the coefficients stay
    most: float = np.inf  # leverage of a row that no row is expected to exceed

    def near(self, design: Array, residuals: Array) -> list[NDArray[np.intp]]:
        """For each output the rows whose residual, (n_outputs, n_rows), may change its sign."""
        # Leverages are not computed for residuals beyond the distance of any expected row.
        sizes = np.abs(residuals)
        some = np.flatnonzero(np.any(sizes <= self.farthest[:, None], axis=0))
        inside = sizes[:, some] <= self.of(design[some]).T
        return [some[chosen] for chosen in inside]

    def of(self, design: Array) -> Array:
        """The distance of every row for every output, (n_rows, n_outputs)."""
        whitened = design @ self.metric
        return np.sqrt(np.einsum("ij,ij->i", whitened, whitened))[:, None] * self.size

    @property
    def farthest(self) -> Array:
        """What no row is expected to move beyond, (n_outputs,); where nothing moves, nothing."""
        return self.size * np.where(self.size == 0.0, 1.0, self.most)

    def scaled(self, factor: float) -> TrustRegion:
        """The trust region of changes that are so many times as large."""
        return replace(self, size=factor * self.size)

    @property
    def of_any_row(self) -> TrustRegion:
        """The same for rows of any leverage."""
        return replace(self, most=np.inf)
