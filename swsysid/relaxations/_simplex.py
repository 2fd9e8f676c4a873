"""The simplex relaxation: memberships that may be fractional, solved sample by sample.

The samples do not interact, so the linear program (or second-order cone, or quadratic program)
over all of them is N tiny convex programs. Three observations make them cheap:

* with two modes the simplex is a segment, and the loss on it is least at one of its ends or at
  one of a few places in closed form;
* a subgradient w of the loss at the best mode's residual with <w, v_best - v_j> >= 0 for all j
  proves that the best mode is optimal over the whole simplex, since for every membership
  L(xdot - V lambda) >= <w, xdot - V lambda> = L(r_best) + sum_j lambda_j <w, v_best - v_j>;
* what remains are the points of small hulls nearest to the origin (`hulls`).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from swsysid._losses import get_loss
from swsysid._results import Array, Assignment, Status
from swsysid._solvers.conic import modelling, require_solution, solve
from swsysid.relaxations._base import Relaxation, first_least, hardened, one_hot
from swsysid.relaxations._hulls import HullSettings, nearest_euclidean, nearest_l1, on_simplex

# Rounding that an inner product of differences of velocities can carry, relative to their size.
ROUNDING = 1e-12


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

    settings = HullSettings()

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
            residuals = self.residuals(candidates, targets)
            losses = get_loss(self.loss).values(residuals)
            assign = self._on_segments if len(candidates) == 2 else self._on_hulls
            membership, bounds, status = assign(residuals, losses)
        else:
            membership, status = _assign_whole(candidates, targets, self.loss, self.solver)
            losses = self.mode_losses(candidates, targets).T
            bounds = self.soft_losses(membership, candidates, targets)
        return hardened(losses.T, membership, bounds.sum(), status=status)

    def _on_segments(self, residuals, losses):
        """Memberships, their losses and the status for two modes."""
        loss = get_loss(self.loss)
        best, value = first_least(losses.T)
        place = best.astype(float)
        offset, along = residuals[0], residuals[0] - residuals[1]
        # Of several minimisers the end is kept, if it is one of them.
        for trial in _PLACES[loss.norm](offset, along):
            found = loss.values(offset - trial[:, None] * along)
            place = np.where(found < value * (1.0 - ROUNDING), trial, place)
            value = np.fmin(value, found)
        membership = np.empty(losses.shape)
        np.subtract(1.0, place, out=membership[0])
        membership[1] = place
        return membership.T, value, Status.OPTIMAL

    def _on_hulls(self, residuals, losses):
        """Memberships, bounds on their losses and the status for any number of modes."""
        loss = get_loss(self.loss)
        norm = get_loss(loss.norm)
        best, value = first_least(losses.T)
        membership, status = one_hot(best, len(losses)), Status.OPTIMAL
        pending = np.flatnonzero(~_vertex_is_optimal(residuals, best, norm))
        if pending.size:
            residuals = residuals[:, pending]
            weights, least, status = _HULLS[norm.name](residuals, self.settings)
            mixed = (weights.T[..., None] * residuals).sum(axis=0)
            found = loss.values(mixed)
            # Of several minimisers keep the one-hot one, if there is one.
            better = found < value[pending] * (1.0 - ROUNDING)
            membership[pending[better]] = weights[better]
            value[pending[better]] = found[better]
            if not status.ok:  # what is proved of the norm is all that is known
                least = loss.values(least[:, None])
                value[pending] = np.minimum(value[pending], least)
        return membership, value, status


def _vertex_is_optimal(residuals, best, norm):
    """Where one subgradient at the best mode's residual proves that mode optimal."""
    chosen = residuals[best, np.arange(len(best))]
    slack = ((residuals - chosen) * norm.subgradient(chosen)).sum(axis=2)
    scale = np.abs(residuals).max(axis=(0, 2), initial=0.0)
    return (slack >= -ROUNDING * scale).all(axis=0)


def _kinks(offset: Array, along: Array) -> Iterator[Array]:
    # sum_k |a_k - t d_k| is convex and piecewise linear: least at an end or a kink a_k / d_k.
    # Where d_k is zero there is no kink; what comes out is an end, or NaN and better than nothing.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        ratios = offset / along
    yield from ratios.clip(0.0, 1.0).T


def _projections(offset: Array, along: Array) -> Iterator[Array]:
    squares = np.square(along).sum(axis=1)
    products = (along * offset).sum(axis=1)
    foot = np.divide(products, squares, out=np.zeros_like(products), where=squares > 0)
    yield foot.clip(0.0, 1.0)


# Where a norm can be least on a segment, and how its nearest points of hulls are found.
_PLACES = {"l1": _kinks, "l2": _projections}
_HULLS = {"l1": nearest_l1, "l2": nearest_euclidean}


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
    cost = cp.sum(get_loss(loss).expression(cp, residuals.T))
    problem = cp.Problem(cp.Minimize(cost), [cp.sum(membership, axis=1) == 1])
    status = solve(problem, solver)
    require_solution(status, "simplex relaxation")
    return on_simplex(membership.value), status
