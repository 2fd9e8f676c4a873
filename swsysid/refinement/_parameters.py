"""The parameters of a model as one vector: which of them are free, and how far they reach."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import numbers
from swsysid._checks.parameters import shown
from swsysid._results import Array
from swsysid._simulation.model import FittedModel, SwitchingModel
from swsysid._stays.output_error import Parts, Sensor
from swsysid._surfaces.surface import is_linear
from swsysid.refinement._stated import Output, StatedModel
from swsysid.refinement._system import System, Values

_ROUNDING = 1e-9  # by which a fitted law that another column is exactly may differ from it


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
        self.low, self.high = np.full((2, len(self.values)), np.array([[-np.inf], [np.inf]]))

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

    def bound(self, limits: Mapping[str, tuple[float, float]]) -> None:
        """Keep some named parameters between two values."""
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
            self.low[place], self.high[place] = least, most

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
    sums_up = np.abs(size.sum(axis=2) - 1.0) <= _ROUNDING
    exact = (sums_up & (np.abs(largest - 1.0) <= _ROUNDING)).all(axis=0)
    return np.asarray((coef != 0.0) & ~exact[:, None])


def output_of(model: FittedModel) -> Output | None:
    """What the sensors of a stated model read."""
    return model.output if isinstance(model, StatedModel) else None


@dataclass(frozen=True)
class ParametrizedPlant:
    """A model with its parameters, for sizes of states and inputs and the outputs that are read."""

    system: System
    parameters: Parametrization
    spread: Array
    observed: NDArray[np.intp]

    @classmethod
    def known(cls, model: SwitchingModel, spread: Array, n_outputs: int = 0) -> ParametrizedPlant:
        """A model of which nothing is free; of its first states so many are read."""
        system, nothing = System(model), np.zeros(model.coef.shape, dtype=bool)
        parameters = Parametrization(system, nothing, False, frozen=True)
        return cls(system, parameters, spread, np.arange(n_outputs))

    @property
    def limits(self) -> tuple[Array, Array]:
        """Bounds of the parameters."""
        free = self.parameters.free
        return self.parameters.low[free], self.parameters.high[free]

    @property
    def by_parameters(self) -> Array:
        """Unknowns of laws and surfaces by the parameters."""
        coef, _, surface = self.parameters.split(self.parameters.free)
        own, n_coef, form = self.system.classes, int(coef.sum()), self.system.linear
        number = (np.cumsum(coef.ravel()) - 1).reshape(coef.shape)[own]
        places = np.append(number[coef[own]], np.arange(n_coef, len(self.parameters)))
        by_parameters = np.zeros((len(places), len(self.parameters)))
        by_parameters[np.arange(len(places)), places] = 1.0
        if surface.any() and form is not None:
            by_parameters[-surface.sum() :] /= form.scale[np.nonzero(surface)[0], None]
        return by_parameters

    def parts(self, vector: Array) -> Parts:
        """The model of some parameters."""
        values, free = self.parameters.at(vector), self.parameters.split(self.parameters.free)
        start = self.parameters.split(self.parameters.values)[1]
        sizes = {
            name: abs(size) or 1.0
            for name, size, own in zip(self.parameters.named, start.tolist(), free[1], strict=True)
            if own
        }
        n_states, n_coef = self.system.n_states, int(free[0].sum())
        number = {name: n_coef + k for k, name in enumerate(sizes)}
        inside = [
            (number[name], lambda X, by=by: by(X)[:, self.observed])
            for name, by in self.system.varied(self.system.read, values.named, sizes)
            if self.system.output is not None
        ]
        return Parts(
            self.system.laws(values, free[0], sizes, self.spread[:n_states]),
            self.system.guards(values.surface, free[2], self.spread),
            Sensor(lambda X: self.system.read(X, values.named)[:, self.observed], inside),
        )
