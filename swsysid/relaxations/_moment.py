"""The moment (Lasserre) relaxation as the semidefinite program it is, of order 1, 2, ...

It is here for certificates and for teaching: `SimplexRelaxation` has the value of order 1 and
`ExactRelaxation` that of order 2, both without solving anything (docs/mathematics.md). All
programs are written in the displacements u_j = v_j - xdot, in units of the longest one: on
sum_j lambda_j = 1 the residual is c = xdot - sum_j lambda_j v_j = -sum_j lambda_j u_j.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations_with_replacement
from math import comb
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from swsysid._checks.parameters import whole
from swsysid._losses import get_loss
from swsysid._results import Array, Assignment
from swsysid._solvers.conic import modelling, require_solution, solve, worst_status
from swsysid.relaxations._base import Relaxation
from swsysid.relaxations._hulls import on_simplex

if TYPE_CHECKING:
    from cvxpy import Problem


@dataclass(frozen=True)
class MomentSettings:
    """How moment relaxations are posed."""

    # Second over first singular value below which a moment matrix counts as rank one; the paper's
    # own experiments use this number.
    rank_one: float = 1e-6
    # Samples in one semidefinite program of order 1. cvxpy compiles it once for all of them; twice
    # as many take four times as long to compile and gain nothing in the solver.
    chunk: int = 50
    # The slacks are bounded, as a compact set of moments needs it. In units of the longest
    # displacement no residual exceeds 1, so that the bound is never active.
    slack_bound: float = 1.25
    # Rows of a semidefinite matrix beyond which a sample takes minutes, or the memory runs out.
    largest_side: int = 300


class MomentRelaxation(Relaxation):
    r"""Moment relaxation of the mode constraint (paper, problem "Mode assignment as SDP").

    Order 1, Shor's relaxation, is the paper's program,

    .. math:: \min_{\lambda_i, \Lambda_i} \;
        \mathcal{L}\Big(\dot x_i - \sum_j \lambda_{ij} v_{ij}\Big) \quad\text{s.t.}\quad
        \begin{bmatrix} 1 & \lambda_i^T \\ \lambda_i & \Lambda_i \end{bmatrix} \succeq 0, \;
        \operatorname{diag}(\Lambda_i) = \lambda_i, \; \mathbf{1}^T \lambda_i = 1.

    From order 2 on the slacks :math:`\delta \ge |c(\lambda)|` of the norm are variables of the
    moment problem and their inequalities are localizing matrices; the Euclidean norm enters as
    the matrix inequality of its second-order cone, and a squared loss as second moments of
    :math:`\lambda` alone.

    Parameters
    ----------
    order : int, default=1
        Half the degree of the highest moment. Order 1 takes about a second for 2000 samples,
        order 2 some hundredths of a second *a sample*, and the semidefinite matrices grow with
        the order as the binomial of (variables + order) over order.

    Notes
    -----
    `Assignment.tightness` is the rank test on the moment matrix of :math:`\lambda`: the second
    singular value below 1e-6 of the first. Order 1 has the value of the simplex relaxation and
    order 2 that of the hard assignment, so a higher order has nothing to add.

    Examples
    --------
    The measured velocity 0.25 lies between the candidates 0 and 1. Order 1 mixes them and fits
    it exactly, order 2 knows that the best single mode misses it by 0.25.

    >>> import numpy as np
    >>> from swsysid.relaxations import MomentRelaxation
    >>> candidates, targets = np.array([[[0.0]], [[1.0]]]), np.array([[0.25]])
    >>> [round(MomentRelaxation(order).assign(candidates, targets).lower_bound, 4) + 0.0
    ...  for order in (1, 2)]
    [0.0, 0.25]
    """

    settings = MomentSettings()

    def __init__(self, order: int = 1):
        self.order = order

    def assign(self, candidates: Array, targets: Array) -> Assignment:
        """Assign every sample to the modes; see `Relaxation.assign`.

        Raises
        ------
        ValueError
            If the shapes do not match, there are NaN or infinite entries, or `order` is not a
            positive integer.
        SolverError
            If the solver is not installed.
        """
        candidates, targets = self.checked(candidates, targets)
        whole("order", self.order)
        if self.order > 1:
            self._refuse_many_moments(*candidates.shape[::2])
        displacements = (candidates - targets).transpose(1, 0, 2)
        scale = np.linalg.norm(displacements, axis=2).max(axis=1)
        scale[scale == 0] = 1.0
        shape = self.loss, len(candidates), targets.shape[1]
        if self.order == 1:
            chunk = min(self.settings.chunk, max(len(targets), 1))
            program = _shor(*shape, chunk)
        else:
            chunk = 1
            program = _lasserre(*shape, self.order, self.settings.slack_bound)
        moments, values, statuses = _solve_chunks(
            program, displacements / scale[:, None, None], chunk, self.solver
        )
        status = worst_status(statuses)
        membership = on_simplex(moments[:, 0, 1:])
        units = np.square(scale) if self.loss == "squared" else scale
        value = float((values * units).sum())
        singular = np.linalg.svd(moments, compute_uv=False)
        rank_one = singular[:, 1] < self.settings.rank_one * singular[:, 0]
        return self.hardened(candidates, targets, membership, value, rank_one, status)

    def _refuse_many_moments(self, n_modes: int, n_states: int) -> None:
        """Refuse matrices that no solver gets through, before they are built."""
        order, largest = self.order, self.settings.largest_side
        n_variables = n_modes + _NORM_CONES[self.loss][0](n_states)
        side = comb(n_variables + order, order) if order <= largest else order
        if side > largest:
            raise ValueError(
                f"order={order} has moment matrices of {side} rows; choose order=2, whose value is "
                "exact already."
            )


class _Program(NamedTuple):
    """A parametrised cvxpy problem over a few samples, and how to fill and to read it."""

    problem: Problem
    set_data: Callable  # displacements (n_samples, n_modes, n_states) -> None
    moments: Callable  # () -> moment matrices of lambda (n_samples, n_modes + 1, n_modes + 1)
    values: Callable  # () -> relaxed loss of each sample (n_samples,)


def _solve_chunks(program, displacements, chunk, solver):
    """Moment matrices and values of all samples, and the statuses met."""
    n_samples, n_modes, _ = displacements.shape
    moments = np.full((n_samples, n_modes + 1, n_modes + 1), np.nan)
    values = np.full(n_samples, np.nan)
    statuses = []
    for start in range(0, n_samples, chunk):
        # The last chunk repeats the last sample, to have the size that was compiled.
        rows = np.minimum(np.arange(start, start + chunk), n_samples - 1)
        program.set_data(displacements[rows])
        statuses.append(solve(program.problem, solver))
        require_solution(statuses[-1], "moment relaxation")
        moments[rows], values[rows] = program.moments(), program.values()
    return moments, values, statuses


def _shor(loss, n_modes, n_states, n_samples):
    """Order 1: the loss stays a convex function of the first moments."""
    cp = modelling()
    data = [cp.Parameter((n_samples, n_modes)) for _ in range(n_states)]
    membership = cp.Variable((n_samples, n_modes))
    matrices = [cp.Variable((n_modes + 1, n_modes + 1), PSD=True) for _ in range(n_samples)]
    constraints = [cp.sum(membership, axis=1) == 1]
    for sample, matrix in enumerate(matrices):
        first = membership[sample]
        constraints += [matrix[0, 0] == 1, matrix[0, 1:] == first, cp.diag(matrix)[1:] == first]
    residuals = cp.vstack([cp.sum(cp.multiply(u, membership), axis=1) for u in data])
    # A sample's squared norm and its norm have the same minimisers, and the norm, which does not
    # flatten near zero, lets the solver find them more exactly.
    norms = get_loss(get_loss(loss).norm).expression(cp, residuals.T)

    def set_data(displacements):
        for state, parameter in enumerate(data):
            parameter.value = displacements[:, :, state]

    return _Program(
        cp.Problem(cp.Minimize(cp.sum(norms)), constraints),
        set_data,
        lambda: np.stack([matrix.value for matrix in matrices]),
        lambda: np.square(norms.value) if loss == "squared" else norms.value,
    )


class _Moments:
    """Moments L(m) of the monomials m of degree <= 2 order in (lambda, delta).

    lambda_j^2 = lambda_j is used to write every monomial with exponents of lambda of at most
    one. That is the constraint M_{r-1}((lambda_j^2 - lambda_j) y) = 0 of the paper, solved: it
    says L(m lambda_j^2) = L(m lambda_j) for all m with m lambda_j^2 of degree <= 2r.
    """

    def __init__(self, n_modes, n_slacks, order):
        self.n_modes, self.n_variables = n_modes, n_modes + n_slacks
        self.index = {m: i for i, m in enumerate(self.monomials(2 * order))}
        self.variable = modelling().Variable(len(self.index))

    def monomials(self, degree):
        """All reduced monomials up to `degree`, as sorted tuples of variable numbers."""
        products = (
            self.reduced(product)
            for d in range(degree + 1)
            for product in combinations_with_replacement(range(self.n_variables), d)
        )
        return list(dict.fromkeys(products))

    def reduced(self, product):
        modes = {variable for variable in product if variable < self.n_modes}
        return tuple(sorted([*modes, *(v for v in product if v >= self.n_modes)]))

    def vector(self, monomials):
        """L of each monomial."""
        return self.variable[[self.index[self.reduced(m)] for m in monomials]]

    def matrix(self, basis, factor=()):
        """Matrix L(factor a b) over a, b in `basis`."""
        entries = self.vector([a + b + factor for a in basis for b in basis])
        return modelling().reshape(entries, (len(basis), len(basis)), order="C")


def _lasserre(loss, n_modes, n_states, order, slack_bound):
    """Order >= 2, one sample at a time: moments of (lambda, delta) and localizing matrices."""
    cp = modelling()
    n_slacks, cones = _NORM_CONES[loss]
    moments = _Moments(n_modes, n_slacks(n_states), order)
    modes, slacks = range(n_modes), range(n_modes, moments.n_variables)
    data = cp.Parameter((n_modes, n_states))
    gram = cp.Parameter((n_modes, n_modes))
    basis = moments.monomials(order - 1)
    # Localizing matrices of every component of the residual, up to its sign, and of the slacks.
    residuals = [
        sum(data[j, state] * moments.matrix(basis, (j,)) for j in modes)
        for state in range(n_states)
    ]
    bounds = [moments.matrix(basis, (slack,)) for slack in slacks]
    # L(m (sum_j lambda_j - 1)) = 0 for every m that keeps within the localizing matrix.
    multipliers = moments.monomials(2 * order - 2)
    unit_sum = sum(moments.vector([m + (j,) for m in multipliers]) for j in modes)
    semidefinite = [
        moments.matrix(moments.monomials(order)),
        *cones(bounds, residuals),
        *(slack_bound * moments.matrix(basis) - bound for bound in bounds),
    ]
    constraints = [moments.vector([()]) == 1, unit_sum == moments.vector(multipliers)]
    constraints += [matrix >> 0 for matrix in semidefinite]
    value = (
        cp.sum(moments.vector([(slack,) for slack in slacks]))
        if slacks
        else cp.sum(cp.multiply(gram, moments.matrix([(j,) for j in modes])))
    )
    first_order = moments.matrix(moments.monomials(1)[: n_modes + 1])

    def set_data(displacements):
        data.value = displacements[0]
        gram.value = displacements[0] @ displacements[0].T

    return _Program(
        cp.Problem(cp.Minimize(value), constraints),
        set_data,
        lambda: first_order.value[None],
        lambda: np.atleast_1d(value.value),
    )


def _l1_cones(bounds, residuals):
    """-delta_k <= c_k <= delta_k, localized."""
    for bound, residual in zip(bounds, residuals, strict=True):
        yield from (bound - residual, bound + residual)


def _l2_cones(bounds, residuals):
    """|c| <= delta, that is [[delta, c^T], [c, delta I]] >= 0, localized as a matrix."""
    (bound,) = bounds
    zero = np.zeros(bound.shape)
    rows = [
        [residual, *(bound if other == state else zero for other in range(len(residuals)))]
        for state, residual in enumerate(residuals)
    ]
    yield modelling().bmat([[bound, *residuals], *rows])


# How many slacks a loss needs in n_states states, and the inequalities that bind them.
_NORM_CONES = {
    "l1": (lambda n_states: n_states, _l1_cones),
    "l2": (lambda n_states: 1, _l2_cones),
    "squared": (lambda n_states: 0, lambda bounds, residuals: ()),
}
