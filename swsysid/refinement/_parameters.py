"""The parameters of a model as one vector: which of them are free, and how far they reach."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import numbers
from swsysid._checks.parameters import shown
from swsysid._results import Array
from swsysid._simulation.model import FittedModel
from swsysid._surfaces.surface import is_linear
from swsysid.refinement._settings import SETTINGS
from swsysid.refinement._stated import Output, StatedModel
from swsysid.refinement._system import System, Values


class Parametrization:
    """Coefficients, named parameters and surface coefficients of a model, and which are free.

    `values` are all of them, in this order, and `free` says which of them a vector of parameters
    holds: coefficients as in `free_coef`, named parameters, and with `fit_surface` the nonzero
    coefficients of each surface but the largest, which fixes its scale. `frozen` leaves nothing
    free: what is asked for is the initial states.
    """

    def __init__(
        self,
        system: System,
        free_coef: NDArray[np.bool_],
        fit_surface: bool,
        frozen: bool = False,
    ):
        self.system, linear = system.model, system.linear
        named = {n: v for each in system.libraries for n, v in (each.parameters or {}).items()}
        surface = np.empty((0, 0)) if linear is None else linear.coef
        if linear is None and fit_surface:
            raise ValueError(
                "fit_surface=True needs a surface that is linear in its coefficients; use "
                "PolynomialSurfaceClassifier or StatedSurface, or fit_surface=False."
            )
        free_surface = (surface != 0.0) & fit_surface
        if surface.size:
            free_surface[np.arange(len(surface)), np.abs(surface).argmax(axis=1)] = False
        self.named, self.surface_shape = list(named), surface.shape
        coef = np.ravel(self.system.coef)
        self.values = np.concatenate([coef, list(named.values()), surface.ravel()]).astype(float)
        every = [free_coef.ravel(), np.ones(len(named), dtype=bool), free_surface.ravel()]
        self.free = np.concatenate(every) & (not frozen)

    def split(self, values: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Coefficients, named parameters and surfaces of values (..., n_values), as views."""
        n_coef = self.system.coef.size
        coef, named, surface = np.split(values, [n_coef, n_coef + len(self.named)], axis=-1)
        shape = values.shape[:-1]
        coef = coef.reshape(*shape, *self.system.coef.shape)
        return coef, named, surface.reshape(*shape, *self.surface_shape)

    def __len__(self) -> int:
        return int(self.free.sum())

    @property
    def start(self) -> Array:
        """The vector of the given model."""
        return self.values[self.free]

    def _filled(self, vector: Array) -> Array:
        """All values for those that are free."""
        every = self.values.copy()
        every[self.free] = vector
        return every

    def at(self, vector: Array) -> Values:
        """All parameters for those that are free, (n_parameters,)."""
        coef, named, surface = self.split(self._filled(vector))
        return Values(coef, dict(zip(self.named, named.tolist(), strict=True)), surface)

    def sizes(self, features: Array, velocities: Array) -> Array:
        """What a change of each parameter has to be for the model to notice.

        A coefficient: the size of the velocity over that of its feature. The rest: themselves.
        """
        start = np.abs(self.values)
        sizes = np.where(start > 0.0, start, 1.0)
        typical = _size(velocities)[:, None] / np.maximum(_size(features), 1e-300)
        coef, own = self.split(sizes)[0], self.split(start)[0]
        coef[:] = np.maximum(own, 1e-2 * typical)
        return np.where(sizes > 0.0, sizes, 1.0)[self.free]

    def pivoted(self, vector: Array) -> Array:
        """The same parameters, with the scale of a surface fixed by its now largest coefficient.

        A coefficient that the data want to be zero must not be the one that fixes the scale: the
        others would have to grow without end. The largest gets the value that it had at the start.
        """
        every = self._filled(vector)
        parts = (self.split(values)[2] for values in (every, self.values, self.free))
        for row, given, free in zip(*parts, strict=True):
            pivot = int(np.abs(row).argmax())
            if free[pivot] and row[pivot] * given[pivot] > 0.0:
                row *= given[pivot] / row[pivot]
                free[:] = given != 0.0
                free[pivot] = False
        return every[self.free]

    @property
    def names(self) -> list[str]:
        """A name for each entry of the vector."""
        states, features = self.system.feature_map.names_in, self.system.feature_map.names_out
        mark, shape = "[k+1]" if self.system.discrete_time else "'", self.system.coef.shape
        every = [
            *(f"mode {m}: {states[k]}{mark}, {features[f]}" for m, k, f in np.ndindex(shape)),
            *self.named,
            *(f"surface {k}, {c}" for k, c in np.ndindex(self.surface_shape)),
        ]
        return list(compress(every, self.free))

    def bounds(self, limits: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
        """Lower and upper bounds of the vector from those of some named parameters."""
        low, high = np.full(len(self.values), -np.inf), np.full(len(self.values), np.inf)
        if not isinstance(limits, Mapping):
            raise TypeError(f"bounds={shown(limits)} must be a dict of names to pairs (low, high).")
        for name, given in limits.items():
            two = np.atleast_1d(numbers(f"bounds of {name}", given))
            if two.shape != (2,):
                raise ValueError(
                    f"bounds of {name} have shape {two.shape}; give a pair (low, high)."
                )
            if name not in self.named:
                known = ", ".join(self.named) or "none"
                raise ValueError(
                    f"bounds names {name!r}, which is no named parameter; choose among: {known}."
                )
            place, (least, most) = self.system.coef.size + self.named.index(name), two.tolist()
            if not least <= self.values[place] <= most:
                raise ValueError(
                    f"{name} starts at {self.values[place]:g}, outside its bounds {least:g} to "
                    f"{most:g}; state a start within them."
                )
            low[place], high[place] = least, most
        return low[self.free], high[self.free]

    def apply(self, model: FittedModel, vector: Array) -> FittedModel:
        """A copy of the model with the parameters of a vector."""
        values, refined = self.at(vector), copy.deepcopy(model)
        refined.coef_ = values.coef.copy()
        system = refined.switching_model
        for library in System(system, output_of(refined)).libraries:
            own = {name: values.named[name] for name in library.parameters or {}}
            library.set_params(parameters=own)
        if self.split(self.free)[2].any() and is_linear(system.surface):
            system.surface.use_coef(values.surface.copy())
        return refined


def fitted_and_free(coef: Array) -> NDArray[np.bool_]:
    """Coefficients of fitted laws that are not zero, (n_modes, n_states, n_features).

    A law that is one feature in every mode, such as q' = v, was exact in the data: it has none.
    """
    size, largest = np.abs(coef), coef.max(axis=2)
    sums_up = np.abs(size.sum(axis=2) - 1.0) <= SETTINGS.rounding
    exact = (sums_up & (np.abs(largest - 1.0) <= SETTINGS.rounding)).all(axis=0)
    return np.asarray((coef != 0.0) & ~exact[:, None])


def output_of(model: FittedModel) -> Output | None:
    """What the sensors of a stated model read."""
    return model.output if isinstance(model, StatedModel) else None


def _size(columns: Array) -> Array:
    return np.sqrt(np.mean(np.square(columns), axis=0))
