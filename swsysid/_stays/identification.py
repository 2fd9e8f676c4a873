"""What recordings say of a switching system, and the rounds in which it was found.

With it, the noise of measurements by what rollouts leave of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._free_rollouts.breaks import first_breaks
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.descent import Reached
from swsysid._stays.lifted import Estimate
from swsysid._stays.samples import misfits
from swsysid._stays.settings import LIMITS
from swsysid._stays.width import Width, width

_AS_NEIGHBOURS = 1.15  # what is left counts as noise up to so many times what neighbours show


@dataclass(frozen=True)
class StayRecord:
    """One round of assign, estimate, refit the surface.

    Attributes
    ----------
    round : int
    value : float
        Half the sum of squared misfits, in units of the noise.
    n_switches : int
    changed : int
        Intervals between samples whose mode is another one than in the round before.
    noise : ndarray of shape (n_states,)
        Standard deviations in which misfits were measured.
    """

    round: int
    value: float
    n_switches: int
    changed: int
    noise: Array


@dataclass(frozen=True)
class StayIdentification:
    """What recordings say of a switching system, given the number of its modes."""

    model: SwitchingSystemRegressor
    reached: Reached
    history: tuple[StayRecord, ...]
    criterion: float  # the value at the noise of the first round, and what the surface takes

    @property
    def estimate(self) -> Estimate:
        """Laws, stays and states."""
        return self.reached.estimate

    @cached_property
    def width(self) -> Width:
        """Variances of instants, covariance of laws, guards and resets."""
        return width(self.reached, counted_as_one(self.reached))

    def renamed(self, order: NDArray[np.intp]) -> StayIdentification:
        """The same, mode ``order[k]`` of its estimate called k."""
        reached = replace(self.reached, estimate=self.estimate.renamed(order))
        return replace(self, reached=reached)

    @property
    def left(self) -> Array:
        """What the rollouts leave of the measurements: standard deviations, (n_states,)."""
        return noise_of(self.reached, self.reached.noise)


def noise_of(reached: Reached, sigma: Array) -> Array:
    """Standard deviations of the measurements by what the rollouts leave."""
    left = misfits(reached.estimate)
    count = np.isfinite(left).sum(axis=(0, 1))
    freedom = max(0.1, 1.0 - reached.n_unknowns / max(1, count.sum()))
    found = np.sqrt(np.nansum(np.square(left), axis=(0, 1)) / np.maximum(1, count) / freedom)
    least = LIMITS.exactly * reached.estimate.laws.spread
    return np.where(count > 0, np.maximum(found, least), sigma)


def leaves_noise(reached: Reached, sigma: Array) -> bool:
    """True if what is left is noise of the size that neighbours show, and in every stretch.

    Stays, laws or a surface that are wrong somewhere leave more there (Page's test).
    """
    noise = noise_of(reached, sigma)
    left = misfits(reached.estimate) / noise
    breaks = first_breaks(
        [left[: len(t), k] for k, t in enumerate(reached.estimate.nodes.recordings.times)]
    )
    whole = all((one < 0).all() for one in breaks)
    return whole and bool((noise <= _AS_NEIGHBOURS * sigma).all())


def counted_as_one(reached: Reached) -> float:
    r"""Samples that count as one, :math:`1 + 2 \sum_k \rho_k` up to the first lag of noise.

    Where a law is missing, neighbouring misfits are alike.
    """
    left = misfits(reached.estimate) / reached.noise
    known = np.isfinite(left)
    values = np.where(known, left, 0.0)
    variance, n = np.square(values).sum(), known.sum()
    together = 1.0
    for lag in range(1, min(100, len(values) // 4)):
        pairs = (known[lag:] & known[:-lag]).sum()
        rho = (values[lag:] * values[:-lag]).sum() / max(variance, 1e-300) * n / max(pairs, 1)
        if rho < 2.0 / np.sqrt(max(pairs, 1)):
            break
        together += 2.0 * float(rho)
    return together
