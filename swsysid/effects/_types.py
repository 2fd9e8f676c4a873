"""Four types of effects that are more than columns, by what they change.

In the words of hybrid systems a plain `Effect` changes the flow; these change what was measured,
the guard, the reset map, and the set of modes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator

from swsysid._data.records import Records
from swsysid._results import Array
from swsysid.effects._base import Effect, Place

Modes = NDArray[np.intp]


class Crossing(NamedTuple):
    """Where a mode is left: a sum of monomials of the columns of X that rises to zero there."""

    source: int
    target: int
    coef: Array  # (n_monomials,)
    powers: NDArray[np.intp]  # (n_monomials, n_columns)


class WithoutColumns(Effect):
    """An effect that adds nothing to an equation."""

    terms = ()

    def statement(self, place: Place, names: Sequence[str], target: int, *theta: float) -> str:
        """What it does, in one clause; "" if the equations show it.

        `names` are those of the channels, `target` is the state it acts on.
        """
        return ""


class MeasurementEffect(WithoutColumns):
    """A sensor or a clock that changes the record; its one parameter is 0 where it does not.

    Attributes
    ----------
    beside_others : bool
        Whether only other states tell that a sensor of one is wrong.
    """

    beside_others: ClassVar[bool] = True

    def state_of(self, place: Place) -> int:
        """The state whose record it changes."""
        return int(place)

    def places(self, records: Records) -> Sequence[Place]:
        """The states."""
        return records.states

    def corrected(self, records: Records, place: Place, *theta: float) -> Records:
        """The records as they would be without the effect."""
        raise NotImplementedError

    def recorded(self, records: Records, place: Place, *theta: float) -> Records:
        """What the sensor makes of the true states, the inverse of `corrected`."""
        raise NotImplementedError

    def of_its_velocity(self, records: Records, place: Place, *theta: float) -> Records:
        """Corrected records at the instants of which the recorded velocity of the state tells.

        Others than their own where that velocity is as late as the state.
        """
        return records

    def of_a_recording(self) -> MeasurementEffect:
        """The same of a sensor whose samples are all that is known of the state's velocity."""
        return self

    def is_possible(
        self, records: Records, place: Place, velocities: Array, discrete: bool
    ) -> bool:
        """False if the record itself contradicts the effect.

        `velocities` (n_samples, n_states) are those of the whole record, next states if
        `discrete`.
        """
        return True


class GuardEffect(WithoutColumns):
    """A guard with a memory: which of two modes is active depends on the modes of before."""

    def candidates(
        self, records: Records, modes: Modes
    ) -> Iterator[tuple[Place, tuple[float, ...]]]:
        """Guards and their parameters that could have some modes, -1 where they are not known."""
        raise NotImplementedError

    def refitted(
        self, place: Place, records: Records, modes: Modes
    ) -> tuple[Place, tuple[float, ...]]:
        """The guard and its parameters for other modes, -1 where they are not known."""
        raise NotImplementedError

    def switched(self, records: Records, place: Place, *theta: float) -> Modes:
        """Modes along the trajectories."""
        raise NotImplementedError

    def remembers(self, *theta: float) -> bool:
        """False for parameters with which the modes are a function of the present state."""
        return True

    def without_memory(
        self, place: Place, records: Records, modes: Modes, *theta: float
    ) -> Iterator[tuple[Place, tuple[float, ...]]]:
        """Guards that remember nothing and suit some modes, that with the same place first."""
        raise NotImplementedError

    def crossings(self, place: Place, n_columns: int, *theta: float) -> Sequence[Crossing]:
        """Where each mode is left, for columns of X; none if these are no polynomials."""
        return ()


class ResetEffect(WithoutColumns):
    """A jump of the state where one mode turns into another; no velocity shows it."""

    lowers_nothing = "a jump lies between two samples"

    def candidate(
        self, records: Records, velocities: Array, modes: Modes, target: int
    ) -> tuple[tuple[int, int], tuple[float, ...]] | None:
        """The modes (before, after) and the parameters that suit the jumps of a state, if any."""
        raise NotImplementedError

    def gain(
        self, records: Records, velocities: Array, modes: Modes, target: int
    ) -> tuple[float, float]:
        """By how much the log likelihood of the jumps rises, and the p-value of that."""
        raise NotImplementedError

    def factor(self, *theta: float) -> float:
        """What the state is multiplied by."""
        raise NotImplementedError


class StructureEffect(WithoutColumns):
    """Another declared model, fitted in its place."""

    n_more_modes: ClassVar[int] = 0

    def places(self, records: Records) -> Sequence[Place]:
        """The one place there is."""
        return ["modes"]

    def extended(self, estimator: BaseEstimator) -> BaseEstimator:
        """The declared estimator with what the effect adds to its structure."""
        raise NotImplementedError
