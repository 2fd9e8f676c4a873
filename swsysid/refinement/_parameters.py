"""The parameters of a model as one vector: which of them are free, and how far they reach."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import numbers
from swsysid._checks.parameters import shown
from swsysid._results import Array
from swsysid._simulation.model import FittedModel, SwitchingModel
from swsysid._surfaces.surface import is_linear
from swsysid.refinement._stated import Output, ParametricLibrary, StatedModel
from swsysid.refinement._system import Maps, ParameterSets

__all__ = ["Parametrization", "output_of"]


class Parametrization:
    """Free coefficients, named parameters and surface coefficients of a model, in this order.

    Parameters
    ----------
    model : SwitchingSystemRegressor or StatedModel
    maps : Maps
        Those of its system.
    free : ndarray of shape (n_modes, n_states, n_features), bool
        Coefficients that may change.
    fit_surface : bool
        Whether the coefficients of the surface may change.
    """

    def __init__(self, model: FittedModel, maps: Maps, free: NDArray[np.bool_], fit_surface: bool):
        self.model, self.system = model, model.switching_model
        self.coef, self.free = np.array(self.system.coef, dtype=float), free
        self.named = {
            name: value
            for library in _libraries(model, self.system)
            for name, value in (library.parameters or {}).items()
        }
        self.surface = np.empty((0, 0)) if maps.linear is None else maps.linear.coef.copy()
        if maps.linear is None and fit_surface:
            raise ValueError(
                "fit_surface=True needs a surface that is linear in its coefficients; use "
                "PolynomialSurfaceClassifier or StatedSurface, or fit_surface=False."
            )
        self.surface_free = _surface_free(self.surface, fit_surface)
        self.named_free = True

    def freeze(self) -> None:
        """Leave nothing free: what is asked for is the initial states."""
        self.free = np.zeros_like(self.free)
        self.surface_free = np.zeros_like(self.surface_free)
        self.named_free = False

    @property
    def start(self) -> Array:
        """The vector of the given model."""
        named = np.array(list(self.named.values()) * self.named_free, dtype=float)
        return np.concatenate([self.coef[self.free], named, self.surface[self.surface_free]])

    def __len__(self) -> int:
        return len(self.start)

    def sets(self, vectors: Array) -> ParameterSets:
        """Parameter sets for the rows of `vectors`, (n_owners, n_parameters)."""
        n_owners, n_coef = len(vectors), int(self.free.sum())
        coef = np.broadcast_to(self.coef, (n_owners, *self.coef.shape)).copy()
        coef[:, self.free] = vectors[:, :n_coef]
        named = {name: np.full(n_owners, value) for name, value in self.named.items()}
        if self.named_free:
            named = {name: vectors[:, n_coef + k] for k, name in enumerate(self.named)}
        surface = np.broadcast_to(self.surface, (n_owners, *self.surface.shape)).copy()
        surface[:, self.surface_free] = vectors[:, vectors.shape[1] - self.surface_free.sum() :]
        return ParameterSets(coef, named, surface)

    def sizes(self, features: Array, velocities: Array) -> Array:
        """What a change of each parameter has to be for the model to notice.

        A coefficient: the size of the velocity over that of its feature. The rest: themselves.
        """
        typical = _size(velocities)[:, None] / np.maximum(_size(features), 1e-300)
        typical = np.broadcast_to(typical, self.coef.shape)[self.free]
        start = np.abs(self.start)
        other = np.where(start > 0.0, start, 1.0)
        other[: len(typical)] = np.maximum(start[: len(typical)], 1e-2 * typical)
        return other

    def pivoted(self, vector: Array) -> Array:
        """The same parameters, with the scale of a surface fixed by its now largest coefficient.

        A coefficient that the data want to be zero must not be the one that fixes the scale: the
        others would have to grow without end. The largest gets the value that it had at the start.
        """
        if not self.surface_free.any():
            return vector
        surface = self.sets(vector[None]).surface[0]
        for k, row in enumerate(surface):
            pivot = int(np.abs(row).argmax())
            if self.surface_free[k, pivot] and row[pivot] * self.surface[k, pivot] > 0.0:
                row *= self.surface[k, pivot] / row[pivot]
                self.surface_free[k] = self.surface[k] != 0.0
                self.surface_free[k, pivot] = False
        n_others = len(vector) - int(self.surface_free.sum())
        return np.concatenate([vector[:n_others], surface[self.surface_free]])

    @property
    def names(self) -> list[str]:
        """A name for each entry of the vector."""
        system = self.system
        states, features = system.feature_map.names_in, system.feature_map.names_out
        mark = "[k+1]" if system.discrete_time else "'"
        names = [
            f"mode {mode}: {states[state]}{mark}, {features[feature]}"
            for mode, state, feature in np.argwhere(self.free)
        ]
        names += list(self.named)
        return names + [f"surface {k}, {c}" for k, c in np.argwhere(self.surface_free)]

    def bounds(self, limits: Mapping[str, tuple[float, float]]) -> tuple[Array, Array]:
        """Lower and upper bounds of the vector from those of some named parameters."""
        low, high = np.full(len(self), -np.inf), np.full(len(self), np.inf)
        for name, (least, most) in _pairs(limits):
            if name not in self.named:
                known = ", ".join(self.named) or "none"
                raise ValueError(
                    f"bounds names {name!r}, which is no named parameter; choose among: {known}."
                )
            place = int(self.free.sum()) + list(self.named).index(name)
            if not least <= self.named[name] <= most:
                raise ValueError(
                    f"{name} starts at {self.named[name]:g}, outside its bounds {least:g} to "
                    f"{most:g}; state a start within them."
                )
            low[place], high[place] = least, most
        return low, high

    def spread(self, values: Array) -> Array:
        """Values of the free coefficients in the shape of `coef`, zero where a term is fixed."""
        spread = np.zeros(self.coef.shape)
        spread[self.free] = values[: int(self.free.sum())]
        return spread

    def apply(self, vector: Array) -> FittedModel:
        """A copy of the model with the parameters of a vector."""
        sets = self.sets(vector[None])
        refined = copy.deepcopy(self.model)
        refined.coef_ = sets.coef[0]
        system = refined.switching_model
        for library in _libraries(refined, system):
            own = {name: float(sets.named[name][0]) for name in library.parameters or {}}
            library.set_params(parameters=own)
        if self.surface_free.any() and is_linear(system.surface):
            system.surface.use_coef(sets.surface[0])
        return refined


def output_of(model: FittedModel) -> Output | None:
    """What the sensors of a stated model read."""
    return model.output if isinstance(model, StatedModel) else None


def _libraries(model: FittedModel, system: SwitchingModel) -> list[ParametricLibrary]:
    """Feature map and output, where they have named parameters; equal names are one parameter."""
    given = (system.feature_map.library, output_of(model))
    return [library for library in given if isinstance(library, ParametricLibrary)]


def _pairs(limits: Any) -> list[tuple[str, tuple[float, float]]]:
    """Names and bounds, checked."""
    if not isinstance(limits, Mapping):
        raise TypeError(f"bounds={shown(limits)} must be a dict of names to pairs (low, high).")
    pairs = {name: np.atleast_1d(numbers(f"bounds of {name}", two)) for name, two in limits.items()}
    for name, two in pairs.items():
        if two.shape != (2,):
            raise ValueError(f"bounds of {name} have shape {two.shape}; give a pair (low, high).")
    return [(name, (float(two[0]), float(two[1]))) for name, two in pairs.items()]


def _surface_free(surface: Array, fit_surface: bool) -> NDArray[np.bool_]:
    """Nonzero coefficients of each surface but the largest, which fixes its scale."""
    free = (surface != 0.0) & fit_surface
    if surface.size:
        free[np.arange(len(surface)), np.abs(surface).argmax(axis=1)] = False
    return free


def _size(columns: Array) -> Array:
    return np.sqrt(np.mean(np.square(columns), axis=0))
