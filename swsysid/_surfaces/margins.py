"""What can be promised about a margin: the largest one, and what the margin LP does with it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array, Status
from swsysid._solvers.conic import linear_program, require_solution, worst_status
from swsysid._surfaces.hinge import least_squares
from swsysid._surfaces.margin_program import SurfaceFit, fit_surface
from swsysid._surfaces.settings import MARGIN, MarginSettings


@dataclass(frozen=True)
class MarginCertificate:
    """What the margin LP's theorem really certifies (see docs/mathematics.md).

    Attributes
    ----------
    margin : ndarray of shape (n_surfaces,)
        t*, the largest margin that a surface inside the coefficient box can have on the data;
        not positive where the classes cannot be separated at all.
    coef : ndarray of shape (n_surfaces, n_surface_features)
        The surfaces that reach it.
    nonzero_interval : ndarray of shape (n_surfaces, 2)
        Margins strictly above the first entry and at most the second certify that this surface
        is nonzero at every optimum; where the first is the larger one nothing is certified. They
        do *not* certify zero slack.
    zero_slack : ndarray of shape (n_surfaces,), bool
        True where some optimum of the margin LP at the classifier's own margin has no slack,
        which needs a margin of at most t*. Other optima of the same value may have some.
    status : Status
    """

    margin: Array
    coef: Array
    nonzero_interval: Array
    zero_slack: NDArray[np.bool_]
    status: Status

    @property
    def separable(self) -> bool:
        """True if every surface separates its classes with a positive margin."""
        return bool((self.margin > 0).all())


def max_margin(
    features: Array,
    signs: Array,
    bound: float,
    solver: str = "auto",
    start: Array | None = None,
    settings: MarginSettings = MARGIN,
) -> tuple[float, Array, Status]:
    r"""Largest margin of a surface inside the box (paper, remark after the margin theorem).

    .. math:: \max_{t, a} \; t \quad \text{s.t.} \quad \sigma_i a^\top \phi_i \ge t, \;
              |a| \le \eta

    Solved on a working set like the margin LP: a restricted value is an upper bound, the
    smallest margin of its solution over all rows a lower one. The margin is attained by the
    coefficients, and 0 where no surface separates the signs.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.array([[-1.0], [1.0], [2.0]])
    >>> margin, coef, _ = max_margin(x, np.array([-1.0, 1.0, 1.0]), bound=10.0)
    >>> margin, coef
    (10.0, array([10.]))
    """
    signed = features * signs[:, None]
    n_samples, n_features = signed.shape
    if start is None:
        start = least_squares(signed, np.ones(n_samples), np.ones(n_samples))[:, 0]
    negligible = 1e-12 * bound * float(np.abs(signed).max(initial=0.0))
    margins, working = signed @ start, np.zeros(n_samples, dtype=bool)
    upper = np.inf
    for _ in range(settings.max_rounds):
        candidates = np.flatnonzero(~working & (margins < upper))
        size = max(6 * n_features + 30, int(working.sum()))
        working[candidates[np.argsort(margins[candidates])[:size]]] = True
        upper, coef = _max_margin_of(signed[working], bound, solver)
        margins = signed @ coef
        gap = upper - margins.min()
        if gap <= settings.tight * upper + negligible or working[margins < upper].all():
            break
    status = Status.OPTIMAL if gap <= settings.accepted * upper + negligible else Status.INACCURATE
    attained = float(margins.min())
    return (attained if attained > negligible else 0.0), coef, status


def _max_margin_of(signed: Array, bound: float, solver: str) -> tuple[float, Array]:
    """The dual of the maximal margin, with one equality for each coefficient b = a / bound.

    min  1'(t+ + t-)
    s.t. G'alpha - t+ + t- = 0                            (multipliers: b)
         1'alpha = 1,  alpha, t+, t- >= 0
    """
    n_rows, n_features = signed.shape
    identity = np.eye(n_features)
    equalities = np.block(
        [[signed.T, -identity, identity], [np.ones(n_rows), np.zeros(2 * n_features)]]
    )
    solution = linear_program(
        np.concatenate([np.zeros(n_rows), np.ones(2 * n_features)]),
        A_eq=equalities,
        b_eq=np.concatenate([np.zeros(n_features), [1.0]]),
        bounds=(0.0, np.inf),
        solver=solver,
    )
    require_solution(solution.status, "LP of the largest margin")
    return bound * solution.objective, bound * np.clip(solution.dual_eq[:-1], -1.0, 1.0)


def certify_margin(
    features: Array,
    signs: Array,
    weight: Array,
    margin: float,
    beta: float,
    bound: float,
    solver: str = "auto",
) -> MarginCertificate:
    r"""What can be promised about the margin LP on some data.

    *Nonzero surface.* Let the surface a^ have all margins at least t. For epsilon in
    (beta |a^|_1 / sum w, t] the point (a^, no slack) is feasible and costs less than a = 0,
    which costs epsilon sum w; so the optimum is not zero. It may have slack.

    *Zero slack.* Let V(c) be the value of the program with all weights times c. If an optimum
    without slack exists, it costs the same under c = 2, and V(2) = V(1). If conversely
    V(2) = V(1), let a be optimal for c = 2, with slack sum S: then
    V(1) <= S + beta |a|_1 <= 2 S + beta |a|_1 = V(2) = V(1), so S = 0 and a is optimal for
    c = 1. Slack zero is optimal exactly if V(2) = V(1).

    `signs`, (n_samples, n_surfaces), are 0 for rows of which a surface says nothing; the rest is
    as in `fit_surface`.
    """
    n_surfaces, n_features = signs.shape[1], features.shape[1]
    margins, coef, interval = np.zeros(n_surfaces), np.zeros((n_surfaces, n_features)), []
    zero_slack, statuses = np.zeros(n_surfaces, dtype=bool), []
    for surface, sign in enumerate(signs.T):
        rows = sign != 0.0
        some = features[rows], sign[rows]
        single, double = (
            fit_surface(*some, factor * weight[rows], margin, beta, bound, solver)
            for factor in (1.0, 2.0)
        )
        margins[surface], coef[surface], status = max_margin(*some, bound, solver, single.coef)
        least = beta * np.abs(coef[surface]).sum() / weight[rows].sum()
        interval.append((least, margins[surface]))
        doubt = single.objective - single.lower_bound + double.objective - double.lower_bound
        zero_slack[surface] = (
            double.objective - single.objective
            <= 1e-9 * single.objective + 2.0 * max(doubt, 0.0) + 1e-12 * margin
        )
        statuses += [status, single.status, double.status]
    return MarginCertificate(
        margin=margins,
        coef=coef,
        nonzero_interval=np.array(interval).reshape(n_surfaces, 2),
        zero_slack=zero_slack,
        status=worst_status(statuses),
    )


def nonzero_margin(
    features: Array,
    signs: Array,
    weight: Array,
    fits: Sequence[SurfaceFit],
    beta: float,
    bound: float,
    solver: str = "auto",
) -> float | None:
    """Middle of the margins that certify all surfaces nonzero, None if there are none."""
    # `fits` are surfaces near those of largest margin; the rest is as in `certify_margin`.
    least, largest = 0.0, np.inf
    for sign, fit in zip(signs.T.astype(float), fits, strict=True):
        rows = sign != 0.0
        margin, coef, _ = max_margin(features[rows], sign[rows], bound, solver, fit.coef)
        least = max(least, beta * np.abs(coef).sum() / weight[rows].sum())
        largest = min(largest, margin)
    return 0.5 * (least + largest) if least < largest < np.inf else None
