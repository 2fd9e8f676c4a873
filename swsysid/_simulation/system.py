"""What a simulation asks of a switching system, and how its failures become an orderly end.

Tolerances, limits and differences follow the scales in which states are counted.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from swsysid._data.coordinates import Extent
from swsysid._results import Array, Status

ATOL = 1e-10  # tolerance of an integration beside the relative one, in sizes of a state

_STATE_BOUND = 1e9  # sizes at which a state has diverged
_LEAST_SIZE = 1e-3  # of the largest state: the size of one that starts at zero

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
    def has_surfaces(self) -> bool:
        """False if state and inputs never change the mode."""
        return True

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
    def has_surfaces(self) -> bool:
        """True if the mode may change along a flow."""
        return self.system.has_surfaces

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


@dataclass(frozen=True)
class Scales:
    """Origin and size of every state, and how far from a middle it may go."""

    origin: Array  # (n_states,): the integrator's states are counted from here
    size: Array  # (n_states,)
    atol: Array  # (n_states,)
    middle: Array  # (n_states,)
    bound: Array  # (n_states,)

    @classmethod
    def of(
        cls, extent: Extent | None, x0: Array, atol: float | None, state_bound: float | None
    ) -> Scales:
        """Sizes are spreads of the data; where nobody knows these, the first state tells.

        A state that starts at zero is then as large as a small part of the largest one.
        """
        origin = np.zeros(len(x0)) if extent is None else extent.centre
        away = np.nan_to_num(np.abs(x0 - origin), posinf=0.0)
        size = np.maximum(away, _LEAST_SIZE * (away.max(initial=0.0) or 1.0))
        if not away.any():
            size = np.ones(len(x0))
        if extent is not None:
            size = np.where(extent.spread > 0.0, extent.spread, size)
        tolerance = ATOL * size if atol is None else np.full(len(x0), atol)
        if state_bound is not None:
            return cls(origin, size, tolerance, 0.0 * origin, np.full(len(x0), state_bound))
        return cls(origin, size, tolerance, origin, _STATE_BOUND * np.maximum(size, away))

    def repeated(self, n_rows: int) -> Scales:
        """Those of so many rows of states in one vector."""
        return Scales(*(np.tile(part, n_rows) for part in vars(self).values()))
