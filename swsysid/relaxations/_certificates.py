"""Certificates of a fitted model: how far from optimal each block of the alternation can be.

For the memberships the coefficients are fixed, and conversely; nothing here bounds the joint
problem, which is not convex (`solve_mip` does, on few samples).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array

from swsysid._losses import get_loss
from swsysid._results import Array, Status
from swsysid._solvers.conic import linear_program, worst_status
from swsysid.relaxations import get_relaxation

# Relative to the velocities of the sample: a residual below is rounding and counts as zero, and
# a dual margin must exceed it to count as strict.
ROUNDING = 1e-9
# Samples in one block-diagonal linear program.
CHUNK = 500


@dataclass(frozen=True)
class FitCertificate:
    """How far a fitted model can be from optimal, block by block.

    Attributes
    ----------
    objective : float
        Sum of the losses at the best hard assignment, for the fitted vector fields.
    lower_bound : float
        Value of the simplex relaxation for the same vector fields: a bound over all memberships.
    gap : float
        `objective` - `lower_bound`.
    tightness : float
        Fraction of samples whose relaxed assignment is one-hot.
    dual_certified : ndarray of shape (n_samples,), bool
        Samples for which a dual vector proves that the one-hot assignment is the unique
        minimiser over the whole simplex (paper, one-hot optimality theorem).
    rounding_bound : ndarray of shape (n_samples,)
        Bound on what hardening the relaxed membership costs each sample (paper, rounding
        proposition).
    dynamics_gap : float
        Duality gap of the dynamics program for the final labels.
    status : Status
    """

    objective: float
    lower_bound: float
    gap: float
    tightness: float
    dual_certified: NDArray[np.bool_]
    rounding_bound: Array
    dynamics_gap: float
    status: Status


def certify(
    features,
    targets,
    coef,
    loss,
    *,
    solver: str = "auto",
    sample_weight=None,
    coef_bound=None,
    labels=None,
) -> FitCertificate:
    r"""Certify fitted vector fields on data.

    * The *gap* compares the best hard assignment with the simplex relaxation.
    * The *dual certificate* of a sample is a w in the subdifferential of the norm at the
      residual of its best mode :math:`j^*` with
      :math:`\langle w, v_{j^*} \rangle > \max_{j \ne j^*} \langle w, v_j \rangle`: then
      :math:`e_{j^*}` is the unique minimiser over the simplex (paper, theorem "One-hot
      optimality under a dual certificate"). The search for w is exact.
    * The *rounding bound* of a sample is what hardening the relaxed membership can cost it
      (paper, proposition on rounding): :math:`\sum_j \hat\lambda_j \|v_j - v_{j^*}\|`; for the
      squared loss, by squaring that triangle inequality with the relaxed residual r,
      :math:`2 \|r\| b + b^2` with b the bound of the Euclidean norm.
    * The *dynamics gap* compares the coefficients with a dual bound of the dynamics program of
      each mode at the labels.

    `features` are (n_samples, n_features_out), `coef` (n_modes, n_states, n_features_out).
    `coef_bound` and `labels` are those under which the dynamics gap is meant; by default there is
    no bound, and every sample is in its best mode.

    Examples
    --------
    Velocity x in mode 0 and -x in mode 1, without noise:

    >>> import numpy as np
    >>> from swsysid.relaxations._certificates import certify
    >>> features = np.array([[1.0], [2.0], [3.0]])
    >>> certificate = certify(
    ...     features, np.array([[1.0], [-2.0], [3.0]]), np.array([[[1.0]], [[-1.0]]]), "l1"
    ... )
    >>> certificate.gap, certificate.dual_certified, certificate.rounding_bound
    (0.0, array([ True,  True,  True]), array([0., 0., 0.]))
    """
    features, targets = np.asarray(features, dtype=float), np.asarray(targets, dtype=float)
    coef = np.asarray(coef, dtype=float)
    weights = np.ones(len(targets)) if sample_weight is None else np.asarray(sample_weight)
    if targets.shape[1] != coef.shape[1]:
        raise ValueError(
            f"y has {targets.shape[1]} columns; the model has {coef.shape[1]} velocities, give one "
            "column for each."
        )
    candidates = features @ coef.transpose(0, 2, 1)
    relaxation = get_relaxation("simplex")
    relaxation.loss, relaxation.solver = loss, solver
    relaxed = relaxation.assign(candidates, targets)
    losses = relaxation.mode_losses(candidates, targets)
    modes = losses.argmin(axis=1)
    objective = float(weights @ losses.min(axis=1))
    soft = relaxation.soft_losses(relaxed.membership, candidates, targets)
    # Without a relaxed solution zero is the bound: no loss is negative.
    lower_bound = min(float(weights @ soft), objective) if relaxed.status.ok else 0.0
    dynamics_gap, statuses = _dynamics_gap(
        features, targets, coef, get_loss(loss), weights, coef_bound, modes, labels, solver
    )
    return FitCertificate(
        objective=objective,
        lower_bound=lower_bound,
        gap=objective - lower_bound,
        tightness=float(relaxed.tightness.mean()),
        dual_certified=_dual_certified(candidates, targets, modes, get_loss(loss).norm),
        rounding_bound=_rounding_bound(candidates, targets, relaxed, loss),
        dynamics_gap=dynamics_gap,
        status=worst_status((relaxed.status, *statuses)),
    )


def _dual_certified(candidates, targets, modes, norm):
    """Samples for which some dual vector makes the best mode the unique minimiser."""
    if len(candidates) == 1:
        return np.ones(len(targets), dtype=bool)
    size = np.maximum(np.abs(candidates).max(axis=(0, 2)), np.abs(targets).max(axis=1))[:, None]
    size[size == 0] = 1.0
    chosen = candidates[modes, np.arange(len(targets))]
    fixed, free = _SUBDIFFERENTIALS[norm]((targets - chosen) / size)
    # advantages (n_samples, n_modes, n_states) of the chosen mode over each other one
    advantages = ((chosen - candidates) / size).transpose(1, 0, 2)
    return _dual_margins(advantages, fixed, free, modes) > ROUNDING


def _subdifferential_l1(residuals):
    """Dual vectors of the l1 norm: the sign, free in [-1, 1] where the residual vanishes."""
    free = np.abs(residuals) <= ROUNDING
    return np.where(free, 0.0, np.sign(residuals)), free


def _subdifferential_l2(residuals):
    """Dual vectors of the Euclidean norm: the direction, any short vector at zero."""
    # At zero the unit ball and the box [-1, 1] serve alike, since only the sign of inner products
    # with w matters and both contain a multiple of every vector.
    norms = np.linalg.norm(residuals, axis=1, keepdims=True)
    zero = norms <= ROUNDING
    fixed = np.where(zero, 0.0, residuals / np.where(zero, 1.0, norms))
    return fixed, np.broadcast_to(zero, residuals.shape)


_SUBDIFFERENTIALS = {"l1": _subdifferential_l1, "l2": _subdifferential_l2}


def _dual_margins(advantages, fixed, free, modes):
    """Max over w of min over j != j* of <w, advantage_j>, shape (n_samples,)."""
    margins = np.einsum("imk,ik->im", advantages, fixed)
    margins[np.arange(len(modes)), modes] = np.inf
    if advantages.shape[1] == 2:
        # One rival only: the free coordinates of w take the signs of its advantage.
        reach = np.where(free[:, None, :], np.abs(advantages), 0.0).sum(axis=2)
        return (margins + reach).min(axis=1)
    margins = margins.min(axis=1)
    pending = np.flatnonzero(free.any(axis=1))
    for start in range(0, len(pending), CHUNK):
        rows = pending[start : start + CHUNK]
        margins[rows] = _dual_margins_chunk(advantages[rows], fixed[rows], free[rows], modes[rows])
    return margins


def _dual_margins_chunk(advantages, fixed, free, modes):
    # Unknowns of one sample: w (n_states), t; maximise t subject to t <= <w, advantage_j> for
    # j != j*, with w in [-1, 1] where it is free. The row of j* itself is left empty.
    n_samples, n_modes, n_states = advantages.shape
    blocks = np.concatenate([-advantages, np.ones((n_samples, n_modes, 1))], axis=2)
    blocks[np.arange(n_samples), modes] = 0.0
    bounds = np.empty((n_samples, n_states + 1, 2))
    bounds[:, :-1, 0] = np.where(free, -1.0, fixed)
    bounds[:, :-1, 1] = np.where(free, 1.0, fixed)
    bounds[:, -1] = -np.inf, np.inf
    solution = linear_program(
        np.tile([0.0] * n_states + [-1.0], n_samples),
        A_ub=bsr_array((blocks, np.arange(n_samples), np.arange(n_samples + 1))),
        b_ub=np.zeros(n_samples * n_modes),
        bounds=bounds.reshape(-1, 2),
    )
    # NaN, where the solver failed, exceeds nothing: such a sample is not certified.
    return solution.x.reshape(n_samples, n_states + 1)[:, -1]


def _rounding_bound(candidates, targets, relaxed, loss):
    # The minimisers of a sample's squared norm are those of its norm, while only the norm is
    # homogeneous, as the paper's theorems ask.
    norm = get_loss(get_loss(loss).norm)
    chosen = candidates[relaxed.modes, np.arange(len(targets))]
    dispersion = np.einsum("im,mi->i", relaxed.membership, norm.values(candidates - chosen))
    if loss == norm.name:
        return dispersion
    mixed = np.einsum("im,mik->ik", relaxed.membership, candidates)
    return 2.0 * norm.values(targets - mixed) * dispersion + np.square(dispersion)


def _dynamics_gap(features, targets, coef, loss, weights, coef_bound, modes, labels, solver):
    """Weighted loss at the labels above the dual bounds of the modes' programs."""
    labels = modes if labels is None else np.asarray(labels)
    total, statuses = 0.0, []
    for mode in np.unique(labels):
        rows = labels == mode
        fit = loss.fit(
            features[rows],
            targets[rows],
            sample_weight=weights[rows],
            coef_bound=coef_bound,
            solver=solver,
            start=coef[mode],
        )
        spent = weights[rows] @ loss.values(targets[rows] - features[rows] @ coef[mode].T)
        total += max(float(spent) - fit.lower_bound, 0.0)
        statuses.append(fit.status)
    return total, statuses
