"""What becomes of states where recordings switch: affine maps, the identity where there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.transitions import AffineReset
from swsysid._results import Array
from swsysid._stays.nodes import Rows


@dataclass(frozen=True)
class Resets:
    """The resets of some transitions, offset and matrix."""

    maps: Array  # (n_transitions, n_states, 1 + n_states)
    free: NDArray[np.bool_]  # of the same shape

    @classmethod
    def of(cls, given: Sequence[AffineReset | None], n_states: int) -> Resets:
        """Those of some transitions: what is said of a state that does not go on is free."""
        goes_on = np.eye(n_states, n_states + 1, 1)
        maps = np.array([
            goes_on if one is None else np.column_stack([one.offset, one.matrix]) for one in given
        ]).reshape(-1, n_states, n_states + 1)  # fmt: skip
        return cls(maps, maps != goes_on)

    @cached_property
    def places(self) -> tuple[Rows, ...]:
        """Transition, state and column of each unknown."""
        return np.nonzero(self.free)

    @property
    def n_free(self) -> int:
        """Number of unknowns."""
        return int(self.free.sum())

    def reset(self, transition: int) -> AffineReset | None:
        """That of a transition."""
        own = self.maps[transition]
        if not self.free[transition].any():
            return None
        return AffineReset(own[:, 1:].copy(), own[:, 0].copy())

    def known(self) -> Resets:
        """The same with nothing free."""
        return replace(self, free=np.zeros_like(self.free))

    def moved(self, step: Array) -> Resets:
        """Other resets."""
        maps = self.maps.copy()
        maps[self.places] += step
        return replace(self, maps=maps)

    def landed(self, transitions: Rows, x: Array) -> Array:
        """States after."""
        maps = self._taken(transitions)
        return np.asarray(maps[:, :, 0] + np.einsum("ksc,kc->ks", maps[:, :, 1:], x))

    def varied(self, transitions: Rows, x: Array, Z: Array) -> Array:
        """Derivatives of the states after, from those before: by the same unknowns and by its own.

        Those by its own come last.
        """
        transition, state, column = self.places
        own = np.zeros((len(x), x.shape[1], self.n_free))
        with_one = np.hstack([np.ones((len(x), 1)), x])
        taken = transitions[:, None] == transition
        own[:, state, np.arange(self.n_free)] = taken * with_one[:, column]
        return np.concatenate([self._taken(transitions)[:, :, 1:] @ Z, own], axis=2)

    def _taken(self, transitions: Rows) -> Array:
        """The map at each switch; of transition -1, the identity."""
        goes_on = np.eye(self.maps.shape[1], self.maps.shape[2], 1)
        return np.concatenate([self.maps, goes_on[None]])[transitions]
