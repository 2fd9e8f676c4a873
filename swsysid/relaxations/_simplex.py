"""The simplex relaxation: memberships that may be fractional, solved sample by sample.

The samples do not interact, so the linear program (or second-order cone, or quadratic program)
over all of them is N tiny convex programs. Three observations make them cheap:

* a subgradient w of the loss at the best mode's residual with <w, v_best - v_j> >= 0 for all j
  proves that the best mode is optimal over the whole simplex, since for every membership
  L(xdot - V lambda) >= <w, xdot - V lambda> = L(r_best) + sum_j lambda_j <w, v_best - v_j>;
* with two modes the simplex is a segment, and the minimiser on it has a closed form;
* what remains is a projection onto a hull of few points (Euclidean losses) or a block-diagonal
  linear program (l1).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np
from scipy.sparse import bsr_array

from swsysid._results import Array, Assignment, Status
from swsysid._solvers.conic import HAS_VALUES, linear_program, modelling, solve
from swsysid.relaxations._base import Relaxation, on_simplex, one_hot

__all__ = ["SimplexRelaxation"]

# Rounding that an inner product of differences of velocities can carry, relative to their size.
ROUNDING = 1e-12
# Accuracy, relative to the size of the velocities, at which a projection counts as found.
ACCURACY = 1e-10
# Samples in one block-diagonal program: larger ones cost HiGHS more than linearly.
CHUNK = 500


class SimplexRelaxation(Relaxation):
    r"""Memberships on the simplex (paper, section "Further relaxation to simplex constraints").

    .. math:: \min_{\lambda_i} \; \mathcal{L}\Big(\dot x_i - \sum_j \lambda_{ij} v_{ij}\Big)
        \quad\text{s.t.}\quad \lambda_i \ge 0, \; \mathbf{1}^T \lambda_i = 1

    With `solver` at ``"auto"`` the samples are solved one by one in closed form where there is
    one; any other solver gets the whole program through cvxpy, which is slow and serves as the
    reference. Where a one-hot membership is among the minimisers, ``"auto"`` returns it.

    Notes
    -----
    The value is the distance of the measured velocity to the hull of the candidates. Fractional
    minimisers are therefore the rule, not the exception, as soon as the velocity lies inside
    that hull: always possible for three modes or more in the plane, and common for two modes
    with noise. `Assignment.tightness` says where the relaxation was one-hot.

    Examples
    --------
    The measured velocity 0.25 lies between the candidates 0 and 1: the relaxation fits it
    exactly, the best hard assignment costs 0.25.

    >>> import numpy as np
    >>> from swsysid.relaxations import SimplexRelaxation
    >>> candidates = np.array([[[0.0]], [[1.0]]])
    >>> assignment = SimplexRelaxation().assign(candidates, np.array([[0.25]]))
    >>> assignment.membership
    array([[0.75, 0.25]])
    >>> assignment.lower_bound, assignment.objective, assignment.tightness
    (0.0, 0.25, array([False]))
    """

    def assign(self, candidates: Array, targets: Array) -> Assignment:
        """Assign every sample to the modes; see `Relaxation.assign`.

        Raises
        ------
        ValueError
            If the shapes do not match, or there are NaN or infinite entries.
        SolverError
            If the solver is not installed.
        """
        candidates, targets = self.checked(candidates, targets)
        if self.solver == "auto":
            membership, status = self._assign_samples(candidates, targets)
        else:
            membership, status = _assign_whole(candidates, targets, self.loss, self.solver)
        if membership is None:
            return self.unsolved(candidates, targets, status)
        value = self.soft_losses(membership, candidates, targets).sum()
        return self.hardened(candidates, targets, membership, value, status=status)

    def _assign_samples(self, candidates, targets):
        losses = self.mode_losses(candidates, targets)
        best = losses.argmin(axis=1)
        geometry = _GEOMETRIES[self.loss]
        vertices = one_hot(best, len(candidates))
        pending = np.flatnonzero(~_vertex_is_optimal(candidates, targets, best, geometry))
        if not pending.size:
            return vertices, Status.OPTIMAL
        candidates, targets = candidates[:, pending], targets[pending]
        assign = geometry.segment if len(candidates) == 2 else geometry.hull
        membership, status = assign(candidates, targets)
        if membership is None:
            return None, status
        # Of several minimisers keep the one-hot one, if there is one.
        value = self.soft_losses(membership, candidates, targets)
        fractional = losses[pending, best[pending]] > value * (1.0 + ROUNDING)
        vertices[pending[fractional]] = membership[fractional]
        return vertices, status


def _vertex_is_optimal(candidates, targets, best, geometry):
    """Where one subgradient at the best mode's residual proves that mode optimal."""
    chosen = candidates[best, np.arange(len(targets))]
    residuals = targets - chosen
    slack = np.einsum("mik,ik->mi", chosen - candidates, geometry.subgradient(residuals))
    scale = np.abs(targets - candidates).max(axis=(0, 2), initial=0.0)
    return (slack >= -ROUNDING * scale).all(axis=0)


def _sign(residuals):
    return np.sign(residuals)


def _direction(residuals):
    norms = np.linalg.norm(residuals, axis=-1, keepdims=True)
    return np.divide(residuals, norms, out=np.zeros_like(residuals), where=norms > 0)


def _from_position(position):
    """Memberships of points v_0 + position (v_1 - v_0) of a segment."""
    position = np.clip(position, 0.0, 1.0)
    return np.column_stack([1.0 - position, position]), Status.OPTIMAL


def _segment_l1(candidates, targets):
    # sum_k |a_k - t d_k| = sum_k |d_k| |t - a_k / d_k| is least at the weighted median of the
    # ratios, and convex in t, so that clipping its minimiser to [0, 1] minimises on [0, 1].
    along, offset = candidates[1] - candidates[0], targets - candidates[0]
    with np.errstate(over="ignore"):
        ratios = np.divide(offset, along, out=np.zeros_like(offset), where=along != 0)
    order = ratios.argsort(axis=1)
    weights = np.take_along_axis(np.abs(along), order, axis=1).cumsum(axis=1)
    median = (weights >= 0.5 * weights[:, -1:]).argmax(axis=1)
    median = np.take_along_axis(order, median[:, None], axis=1)
    return _from_position(np.take_along_axis(ratios, median, axis=1)[:, 0])


def _segment_euclidean(candidates, targets):
    along, offset = candidates[1] - candidates[0], targets - candidates[0]
    squares = np.square(along).sum(axis=1)
    products = (along * offset).sum(axis=1)
    return _from_position(
        np.divide(products, squares, out=np.zeros_like(products), where=squares > 0)
    )


def _hull_l1(candidates, targets):
    """Memberships of minimal l1 residual: block-diagonal linear programs."""
    parts = []
    for start in range(0, len(targets), CHUNK):
        rows = slice(start, start + CHUNK)
        membership, status = _hull_l1_chunk(candidates[:, rows], targets[rows])
        if membership is None:
            return None, status
        parts.append(membership)
    return np.concatenate(parts), Status.OPTIMAL


def _hull_l1_chunk(candidates, targets):
    # Unknowns of one sample: lambda (n_modes), p and q (n_states each), all >= 0, with
    #   sum_j lambda_j (v_j - v_0) + p - q = xdot - v_0,   sum_j lambda_j = 1,
    # at the cost sum(p + q) = |residual|_1. Measured from v_0 and in units of its own size every
    # sample is of order one, as the solver's absolute tolerances want it.
    n_modes, n_samples, n_states = candidates.shape
    scale = np.abs(targets - candidates).max(axis=(0, 2))[:, None]
    blocks = np.zeros((n_samples, n_states + 1, n_modes + 2 * n_states))
    blocks[:, :-1, :n_modes] = ((candidates - candidates[0]) / scale).transpose(1, 2, 0)
    blocks[:, :-1, n_modes:] = np.hstack([np.eye(n_states), -np.eye(n_states)])
    blocks[:, -1, :n_modes] = 1.0
    cost = np.concatenate([np.zeros(n_modes), np.ones(2 * n_states)])
    right = np.column_stack([(targets - candidates[0]) / scale, np.ones(n_samples)])
    solution = linear_program(
        np.tile(cost, n_samples),
        A_eq=bsr_array((blocks, np.arange(n_samples), np.arange(n_samples + 1))),
        b_eq=right.ravel(),
        bounds=(0.0, np.inf),
    )
    if not solution.status.ok:
        return None, solution.status
    return on_simplex(solution.x.reshape(n_samples, -1)[:, :n_modes]), solution.status


def _hull_euclidean(candidates, targets):
    """Memberships of the projection onto the hull, face by face.

    The projection lies inside a simplex spanned by at most n_states + 1 of the candidates
    (Caratheodory) and is the projection onto the affine hull of that simplex. Faces are tried in
    the order of their size; a sample leaves as soon as the residual proves its point optimal:
    with p the point and r = xdot - p, no point of the hull is nearer if <r, v_j - p> <= 0 for
    all j.
    """
    n_modes, n_samples, n_states = candidates.shape
    scale = np.abs(targets - candidates).max(axis=(0, 2))
    membership = np.zeros((n_samples, n_modes))
    nearest = np.full(n_samples, np.inf)
    pending = np.arange(n_samples)
    for size in range(1, min(n_modes, n_states + 1) + 1):
        for face in combinations(range(n_modes), size):
            weights, residuals = _project(candidates[list(face)][:, pending], targets[pending])
            distance = np.linalg.norm(residuals, axis=1)
            better = (weights >= -ROUNDING).all(axis=1) & (distance < nearest[pending])
            found = pending[better]
            nearest[found] = distance[better]
            membership[found] = 0.0
            membership[np.ix_(found, face)] = weights[better]
            # <r, v_j - p> = |r|^2 - <r, xdot - v_j>
            reach = np.einsum("ik,mik->mi", residuals, targets[pending] - candidates[:, pending])
            excess = (np.square(distance) - reach).max(axis=0)
            tolerance = ACCURACY * scale[pending]
            proved = (excess <= tolerance * distance) | (distance <= tolerance)
            pending = pending[~(better & proved)]
            if not pending.size:
                return on_simplex(membership), Status.OPTIMAL
    # Rounding can hide the proof of a nearly degenerate face; the nearest point is kept.
    return on_simplex(membership), Status.OPTIMAL


def _project(corners, targets):
    """Affine weights (n_samples, n_corners) of the projection, and residuals."""
    edges = (corners[1:] - corners[0]).transpose(1, 2, 0)
    offset = targets - corners[0]
    inner = np.einsum("ijk,ik->ij", np.linalg.pinv(edges, rcond=ACCURACY), offset)
    weights = np.column_stack([1.0 - inner.sum(axis=1), inner])
    return weights, offset - np.einsum("ikj,ij->ik", edges, inner)


class _Geometry(NamedTuple):
    """What is particular to the norm behind a loss."""

    subgradient: Callable
    segment: Callable
    hull: Callable


_L1 = _Geometry(_sign, _segment_l1, _hull_l1)
# The square of a norm has the minimisers of the norm.
_EUCLIDEAN = _Geometry(_direction, _segment_euclidean, _hull_euclidean)
_GEOMETRIES = {"l1": _L1, "l2": _EUCLIDEAN, "squared": _EUCLIDEAN}


def _assign_whole(candidates, targets, loss, solver):
    """Memberships from one cvxpy program over all samples, in units of the largest residual."""
    cp = modelling()
    n_modes, n_samples, n_states = candidates.shape
    scale = np.abs(targets - candidates).max(initial=0.0) or 1.0
    membership = cp.Variable((n_samples, n_modes), nonneg=True)
    residuals = cp.vstack(
        [
            (targets[:, k] - candidates[0, :, k]) / scale
            - cp.sum(cp.multiply(((candidates - candidates[0]) / scale)[:, :, k].T, membership), 1)
            for k in range(n_states)
        ]
    )
    cost = {
        "l1": lambda: cp.sum(cp.abs(residuals)),
        "l2": lambda: cp.sum(cp.norm(residuals, 2, axis=0)),
        "squared": lambda: cp.sum_squares(residuals),
    }[loss]()
    problem = cp.Problem(cp.Minimize(cost), [cp.sum(membership, axis=1) == 1])
    status = solve(problem, solver)
    if status not in HAS_VALUES:
        return None, status
    return on_simplex(membership.value), status
