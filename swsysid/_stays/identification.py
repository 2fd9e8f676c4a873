"""What recordings say of a switching system, and the rounds in which it was found."""

from __future__ import annotations

from dataclasses import dataclass

from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.descent import Reached
from swsysid._stays.lifted import Estimate
from swsysid._stays.noise import noise_of


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

    @property
    def left(self) -> Array:
        """What the rollouts leave of the measurements: standard deviations, (n_states,)."""
        return noise_of(self.reached, self.reached.noise)
