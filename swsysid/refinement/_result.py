"""What a refinement has found, and how certain that is.

Residuals of least squares may be correlated along a trajectory.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._known.checks import KnownCheck, blamed
from swsysid._results import Array, Status
from swsysid._simulation.model import FittedModel
from swsysid._stays.arrow import pseudo_inverse


@dataclass(frozen=True)
class RefinementResult:
    """A refined model, and what the rollouts say about it.

    Attributes
    ----------
    model : like the model given
        A copy with the refined parameters; labels of its training samples are not touched. Its
        ``simulate(..., n_draws=)`` gives bands, unless named parameters are free.
    names : list of str
        Names of the free parameters: coefficients, named parameters, surface coefficients. Those
        that what is known lets follow others are not among them.
    values : ndarray of shape (n_parameters,)
        Their estimates.
    covariance : ndarray of shape (n_parameters, n_parameters)
        Covariance of the estimates, with the initial states eliminated; residuals may be
        correlated over neighbouring samples (Newey and West's estimate).
    coef_standard_errors : ndarray of the shape of the coefficients
        0 where a coefficient is fixed.
    initial_states : ndarray of shape (n_trajectories, n_states)
    cost_before, cost_after : float
        Half the sum of the losses of the whole rollouts on the training data.
    rmse_before, rmse_after : ndarrays of shape (n_trajectories, n_outputs)
        Root mean square errors of the whole rollouts, in the units of the channels; infinite
        where a rollout diverges.
    nfev : int
        Number of batched integrations, without those of the Jacobians.
    segment_length, substeps : int
        Number of samples in a segment, and of integration steps between two samples.
    status : Status
    advice : str
        What to do about it.
    held_out_before, held_out_after : ndarrays of shape (n_held_out, n_outputs) or None
        As `rmse_before` and `rmse_after`, on recordings that took no part.
    known : tuple of KnownCheck
        For each thing known what the trajectories would rather have, with its p-value.
    """

    model: FittedModel
    names: list[str]
    values: Array
    covariance: Array
    coef_standard_errors: Array
    initial_states: Array
    cost_before: float
    cost_after: float
    rmse_before: Array
    rmse_after: Array
    nfev: int
    segment_length: int
    substeps: int
    status: Status
    advice: str
    held_out_before: Array | None = None
    held_out_after: Array | None = None
    known: tuple[KnownCheck, ...] = ()

    @property
    def standard_errors(self) -> Array:
        """Standard errors of `values`."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def improved(self) -> bool:
        """True if the rollouts became better; otherwise `model` is the one that was given."""
        return self.cost_after < self.cost_before

    def judged(
        self, before: RefinementResult, after: RefinementResult, start: FittedModel, values: Array
    ) -> RefinementResult:
        """Itself with what rollouts of held-out recordings say; `start` where they become worse.

        `values` are the parameters of `start`.
        """
        known = replace(self, held_out_before=before.rmse_after, held_out_after=after.rmse_after)
        if after.cost_after <= before.cost_after:
            return known
        return replace(
            known,
            model=start,
            values=values,
            cost_after=self.cost_before,
            rmse_after=self.rmse_before,
            advice="Refused: the rollouts of what was held out become worse, and the start is "
            "returned unchanged; look for what its laws lack, or refine on more recordings.",
        )

    def summary(self) -> str:
        """The parameters with their standard errors, and the errors before and after."""
        width = max(len(name) for name in [*self.names, "parameter"])
        lines = [f"{'parameter':<{width}}  {'value':>12}  {'std. error':>12}"]
        for name, value, error in zip(self.names, self.values, self.standard_errors, strict=True):
            lines.append(f"{name:<{width}}  {value:>12.5g}  {error:>12.2g}")
        told = [("trajectory", self.rmse_before, self.rmse_after)]
        if self.held_out_before is not None and self.held_out_after is not None:
            told.append(("held-out trajectory", self.held_out_before, self.held_out_after))
        for what, *errors in told:
            for k, (before, after) in enumerate(zip(*errors, strict=True)):
                pairs = ", ".join(f"{b:.4g} -> {a:.4g}" for b, a in zip(before, after, strict=True))
                lines.append(f"rollout error of {what} {k}: {pairs}")
        lines += [f"known: {one}" for one in self.known]
        return "\n".join([*lines, blamed(self.known) or self.advice])


def robust_covariance(
    slopes: Array,
    residuals: Array,
    weight: Array,
    piece: NDArray[np.intp],
    n_channels: int,
    n_unknowns: int,
) -> Array:
    r"""Covariance :math:`A^+ B A^+` of the parameters, infinite where the data say nothing.

    A is the information :math:`\sum_i w_i g_i g_i^\top` of the derivatives g, (n_residuals,
    n_parameters), with the initial states eliminated. B is the covariance of the sum of the scores
    :math:`w_i r_i g_i`: A times the noise variance if residuals are white. Residuals of one
    `piece`, a rollout, follow each other in time.
    """
    inverse, told = pseudo_inverse((weight[:, None] * slopes).T @ slopes)
    scores = (weight * residuals)[:, None] * slopes
    freedom = len(residuals) / max(1, len(residuals) - n_unknowns)
    covariance: Array = inverse @ (freedom * _long_run(scores, piece, n_channels)) @ inverse
    covariance[~told] = covariance[:, ~told] = 0.0
    covariance[~told, ~told] = np.inf
    return covariance


def _long_run(scores: Array, piece: NDArray, n_channels: int) -> Array:
    """Covariance of the sum of scores that are correlated along each piece (Newey and West)."""
    total = np.zeros((scores.shape[1], scores.shape[1]))
    for k in np.unique(piece):
        own = scores[piece == k]
        total += own.T @ own
        n_lags = n_channels * int(np.ceil((len(own) / n_channels) ** (1.0 / 3.0)))
        for lag in range(1, min(n_lags, len(own) - 1) + 1):
            product = (1.0 - lag / (n_lags + 1.0)) * own[lag:].T @ own[:-lag]
            total += product + product.T
    return total
