"""What a simulation asks of a switching system, and how its failures become an orderly end."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from swsysid._data.extent import Extent
from swsysid._results import Array, Status
from swsysid._simulation.scales import Scales

# what a vector field or a surface may raise far away from its data
FAILURES = (ValueError, ArithmeticError, np.linalg.LinAlgError)

Answer = TypeVar("Answer")


class SimulationEnded(Exception):
    """Leaves the integration loops; never leaves the simulation."""

    def __init__(self, status: Status):
        super().__init__(status.advice)
        self.status = status


class Laws(Protocol):
    """The law of every mode at one point; u has shape (n_inputs,), (0,) without inputs."""

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """Velocity in a mode (the next state in discrete time), shape (n_states,)."""

    @property
    def extent(self) -> Extent | None:
        """Where the states were in the data of the fit, None if nobody knows."""
        return None


class SwitchingSystem(Laws, Protocol):
    """A switching system at one point, whose state and inputs tell the mode.

    Only `velocity` and `mode` have to be written; a class that inherits has the rest.
    """

    def mode(self, x: Array, u: Array) -> int:
        """Active mode."""

    @property
    def n_states(self) -> int | None:
        """Number of states to which `x0` is held, None for any."""
        return None

    @property
    def n_inputs(self) -> int | None:
        """Number of inputs to which `inputs` are held, None for any."""
        return None

    @property
    def has_surface_values(self) -> bool:
        """True if events are located on `surface_values` and not on the mode alone."""
        return False

    def surface_values(self, x: Array, u: Array) -> Array:
        """Values of the surfaces, shape (n_surfaces,)."""
        raise NotImplementedError

    def decode(self, values: Array) -> int:
        """Active mode for given values of the surfaces."""
        raise NotImplementedError

    def jumped(self, x: Array, before: int, after: int) -> Array:
        """The state of a map after a change of modes."""
        return x

    def keep(self, x: Array, u: Array) -> None:
        """Take note of a row of a map that is past."""
        return None


@dataclass(frozen=True)
class GuardedLaws:
    """Laws whose failures are non-finite velocities."""

    system: Laws
    scales: Scales  # the system is not asked about states far beyond their bounds

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """Velocity in a mode; NaN, which makes the integrator shorten its step, on failure."""
        if self._within(x, 1e3).all():
            with suppress(*FAILURES):
                return np.asarray(self.system.velocity(x, u, mode), dtype=float)
        return np.full(len(x), np.nan)

    def within(self, states: Array) -> NDArray[np.bool_]:
        """True for each of the states (..., n_states) that is finite and inside the bound."""
        return np.asarray(self._within(states, 1.0).all(axis=-1))

    def _within(self, states: Array, times: float) -> NDArray[np.bool_]:
        scales = self.scales
        return np.asarray(np.abs(states - scales.middle) <= times * scales.bound)


@dataclass(frozen=True)
class GuardedSystem(GuardedLaws):
    """A switching system whose failures are non-finite velocities or an orderly end."""

    system: SwitchingSystem

    @property
    def has_values(self) -> bool:
        """True if `values` and `decode` can be asked."""
        return self.system.has_surface_values

    def mode(self, x: Array, u: Array) -> int:
        """Active mode."""
        return int(_asked(self.system.mode, x, u))

    def values(self, x: Array, u: Array) -> Array:
        """Values of the surfaces, shape (n_surfaces,)."""
        return np.ravel(_asked(self.system.surface_values, x, u))

    def decode(self, values: Array) -> int:
        """Active mode for given values of the surfaces."""
        return int(_asked(self.system.decode, values))


def _asked(question: Callable[..., Answer], *point: Array) -> Answer:
    try:
        return question(*point)
    except FAILURES as error:
        raise SimulationEnded(Status.STEP_FAILURE) from error
