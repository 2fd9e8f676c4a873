"""Many parameter sets of one switching system, evaluated on rows at once.

A row is a point (states, inputs) together with the number of its *owner*, the parameter set that
it is to be evaluated with. All segments of all trajectories under all perturbations of the
parameters are rows of the same batch: numpy sees a few thousand of them at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._simulation.model import SwitchingModel
from swsysid._surfaces.surface import decisions_of, is_linear
from swsysid.refinement._stated import Output, ParametricLibrary

Rows = NDArray[np.intp]
RowMap = Callable[[Array, Mapping[str, Array]], Array]


@dataclass(frozen=True)
class ParameterSets:
    """Values of all parameters, one set for each owner."""

    coef: Array  # (n_owners, n_modes, n_states, n_features)
    named: dict[str, Array]  # parameters inside features and outputs, (n_owners,)
    # (n_owners, n_surfaces, n_surface_features) in the coordinates in which the surface was
    # fitted; not used where it is known only as a classifier
    surface: Array


class Maps:
    """Feature map, surface and output of a system as functions of rows.

    `output` maps rows (states, inputs) to the measured channels; None where states are measured.
    """

    def __init__(self, system: SwitchingModel, output: Output | None = None):
        self.n_modes, self.n_states, _ = system.coef.shape
        self.discrete_time = bool(system.discrete_time)
        library = system.feature_map.library
        self.features: RowMap = lambda X, named: system.feature_map.at_rows(X)
        if isinstance(library, ParametricLibrary):
            self.features = library.evaluate
        self.output: RowMap | None = None
        if isinstance(output, ParametricLibrary):
            self.output = output.evaluate
        elif output is not None:
            self.output = lambda X, named: np.asarray(output(X), dtype=float).reshape(len(X), -1)
        self.surface = surface = system.surface
        n_columns = len(system.feature_map.names_in)
        self.linear = surface.linear_form(n_columns) if is_linear(surface) else None

    def decisions(self, X: Array, coef: Array) -> Array:
        """Decision of every mode, (n_rows, n_modes); the active mode has the largest."""
        decided = np.full((len(X), self.n_modes), -np.inf)
        if self.linear is not None:
            decided[:, self.linear.classes] = self.linear.decisions(X, coef)
        elif (given := decisions_of(self.surface, X)) is not None:
            decided[:, self.surface.classes_] = given
        else:
            decided = np.eye(self.n_modes)[self.surface.predict(X)]
        return decided


@dataclass(frozen=True)
class RowSystem:
    """Fields, modes and outputs of rows, each under the parameters of its owner."""

    maps: Maps
    sets: ParameterSets
    owners: Rows

    def part(self, rows: Rows) -> RowSystem:
        """The system of some of the rows."""
        return RowSystem(self.maps, self.sets, self.owners[rows])

    def features(self, x: Array, u: Array) -> Array:
        """Features of every row."""
        return self.maps.features(np.concatenate([x, u], axis=1), self._named)

    def field(self, modes: Rows) -> Callable[[Array, Array], Array]:
        """Velocity (next state in discrete time) of every row, each in a given mode."""
        coef = self.sets.coef[self.owners, modes]
        return lambda x, u: np.matmul(coef, self.features(x, u)[:, :, None])[:, :, 0]

    def modes(self, x: Array, u: Array) -> Rows:
        """Active mode of every row."""
        if self.maps.n_modes == 1:
            return np.zeros(len(x), dtype=np.intp)
        return self._decisions(x, u).argmax(axis=1)

    def lead(self, old: Rows, new: Rows, x: Array, u: Array) -> Array:
        """By how much the decision for the old mode exceeds that for the new one, (n_rows, 1)."""
        decided, rows = self._decisions(x, u), np.arange(len(x))
        return (decided[rows, old] - decided[rows, new])[:, None]

    def output(self, x: Array, u: Array) -> Array:
        """What a sensor reads at every row."""
        if self.maps.output is None:
            return x
        return self.maps.output(np.concatenate([x, u], axis=1), self._named)

    def _decisions(self, x: Array, u: Array) -> Array:
        return self.maps.decisions(np.concatenate([x, u], axis=1), self._surface)

    @cached_property
    def _surface(self) -> Array:
        return self.sets.surface[self.owners]

    @cached_property
    def _named(self) -> dict[str, Array]:
        return {name: values[self.owners] for name, values in self.sets.named.items()}
