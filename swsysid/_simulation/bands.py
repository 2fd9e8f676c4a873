r"""Bands of rollouts: where models lead that are as likely as the one that was found.

With the coefficients :math:`\theta` of laws, surfaces, guards and resets and their covariance
:math:`\Sigma`, draws :math:`\theta_k \sim N(\theta, \Sigma)` are rolled out each from the same
start, and the band is between two quantiles of their states at each time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Protocol, Self, TypeVar
from warnings import warn

import numpy as np

from swsysid._checks.parameters import MOST_RESAMPLES, random_numbers, real, whole
from swsysid._rendering.printing import counted
from swsysid._results import Array, IdentificationWarning, Trajectory

_FEWEST = 20  # below this many draws a quantile of the tails is no more than an extreme
_OPTIONS = ("n_draws", "confidence", "random_state")


class Parametric(Protocol):
    """A system as a function of the vector of its coefficients."""

    @property
    def parameters(self) -> Array: ...

    def with_parameters(self, parameters: Array) -> Self: ...


System = TypeVar("System", bound=Parametric)


def with_band(
    system: System,
    covariance: Array | None,
    options: Mapping[str, object],
    rolled: Callable[[System, dict[str, object]], Trajectory],
) -> Trajectory:
    """The rollout of a system with options, and its band if they ask for one by ``n_draws``.

    A system of which no covariance is known is rolled out with all options, and so refuses these.
    """
    if covariance is None or "n_draws" not in options:
        return rolled(system, dict(options))
    asked = {"confidence": 0.95, "random_state": None, **options}
    n_draws = whole("n_draws", asked.pop("n_draws"), least=_FEWEST, most=MOST_RESAMPLES)
    share = real("confidence", asked.pop("confidence"), above=0, below=1)
    numbers = random_numbers(asked.pop("random_state"))
    done = rolled(system, dict(asked))
    low = np.full((n_draws, *done.x.shape), -np.inf)
    high = np.full(low.shape, np.inf)
    for k, moved in enumerate(drawn(system.parameters, covariance, n_draws, numbers)):
        x = rolled(system.with_parameters(moved), dict(asked)).x[: len(done.t)]
        low[k, : len(x)] = high[k, : len(x)] = x  # beyond its end it may be anywhere
    tail = 0.5 * (1.0 - share)
    return replace(
        done,
        lower=np.quantile(low, tail, axis=0, method="lower"),
        upper=np.quantile(high, 1.0 - tail, axis=0, method="higher"),
    )


def drawn(mean: Array, covariance: Array, n_draws: int, numbers: np.random.RandomState) -> Array:
    """Draws from a normal distribution, (n_draws, n); what nothing tells stays, with a warning.

    Entries of the mean beyond those of the covariance stay, too.

    Examples
    --------
    >>> numbers = np.random.RandomState(0)
    >>> both = drawn(np.array([5.0, 1.0, 7.0]), np.array([[4.0, 2.0], [2.0, 1.0]]), 1000, numbers)
    >>> bool(np.allclose(both[:, 0] - 5.0, 2.0 * (both[:, 1] - 1.0))), float(both[:, 2].std())
    (True, 0.0)
    """
    variances = np.diag(covariance)
    if untold := int(np.isinf(variances).sum()):
        warn(
            f"the recordings do not tell {counted(untold, 'coefficient')}; draws leave "
            f"{'it as it is' if untold == 1 else 'them as they are'}, and the band is too narrow "
            "where they act.",
            IdentificationWarning,
            stacklevel=4,
        )
    free = np.flatnonzero(np.isfinite(variances) & (variances > 0.0))
    unit = np.sqrt(variances[free])
    # in units of the standard errors, where rounding is that of correlations
    sizes, directions = np.linalg.eigh(covariance[np.ix_(free, free)] / unit / unit[:, None])
    root = directions * np.sqrt(np.clip(sizes, 0.0, None)) * unit[:, None]
    draws = np.tile(mean, (n_draws, 1))
    draws[:, free] += numbers.standard_normal((n_draws, len(free))) @ root.T
    return draws


def check_no_band(options: Mapping[str, object]) -> None:
    """Refuse to draw where no covariance is known."""
    if asked := [name for name in _OPTIONS if name in options]:
        raise ValueError(
            f"{asked[0]} is given, and how certain the coefficients of this model are together is "
            "not known: identify it by TrajectoryIdentifier or HybridAutomatonRegressor (with "
            "noise and refine=True, where its report does not say that rollouts became worse), "
            "refine it, or give it covariance_ of a bootstrap."
        )
