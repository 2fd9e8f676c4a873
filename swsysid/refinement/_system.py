"""A model as laws and surfaces with derivatives by what is free of it, and as a map of sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._simulation.model import SwitchingModel
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Laws, Maps
from swsysid._stays.polynomial_laws import laws_of
from swsysid._stays.rollouts import nowhere
from swsysid._surfaces.surface import LinearForm, Surface, decisions_of, is_linear
from swsysid.refinement._settings import SETTINGS
from swsysid.refinement._stated import Output, ParametricLibrary

FAR = 1e100


@dataclass(frozen=True)
class Values:
    """Values of all parameters of a model, or for each of them whether it is free."""

    coef: NDArray  # (n_modes, n_states, n_features)
    named: dict[str, float]  # parameters inside features and outputs
    # (n_surfaces, n_surface_features) in the coordinates in which the surface was fitted; empty
    # where it is known only as a classifier
    surface: NDArray


@dataclass(frozen=True)
class System:
    """Feature map, surface and output of a model as functions of rows and parameters.

    `output` is what is measured of rows (states, inputs); None where states are measured.
    """

    model: SwitchingModel
    output: Output | None = None

    @property
    def n_states(self) -> int:
        """Number of states."""
        return int(self.model.coef.shape[1])

    @property
    def libraries(self) -> list[ParametricLibrary]:
        """Feature map and output, where they have named parameters; equal names are one."""
        given = (self.model.feature_map.library, self.output)
        return [library for library in given if isinstance(library, ParametricLibrary)]

    @cached_property
    def linear(self) -> LinearForm | None:
        """The surface as a function of its coefficients; None where it is only a classifier."""
        surface = self.model.surface
        n_columns = len(self.model.feature_map.names_in)
        return surface.linear_form(n_columns) if is_linear(surface) else None

    def read(self, X: Array, named: Mapping[str, float]) -> Array:
        """What the sensors read at rows (states, inputs)."""
        if self.output is None:
            return X[:, : self.n_states]
        if isinstance(self.output, ParametricLibrary):
            return self.output.evaluate(X, named)
        return np.asarray(self.output(X), dtype=float).reshape(len(X), -1)

    def features(self, X: Array, named: Mapping[str, float]) -> Array:
        """Features of rows (states, inputs)."""
        library = self.model.feature_map.library
        if isinstance(library, ParametricLibrary):
            return library.evaluate(X, named)
        return self.model.feature_map.at_rows(X)

    def laws(
        self, values: Values, free: NDArray[np.bool_], named: Mapping[str, float], spread: Array
    ) -> Laws:
        """The laws of `classes`, of which coefficients are free and named parameters.

        `named` has names and sizes of the latter, `spread` the sizes of the states.
        """
        coef, free = values.coef[self.classes], free[self.classes]
        features = partial(self.features, named=values.named)
        inside = tuple(
            partial(self._slope, values.named, name, SETTINGS.step * size)
            for name, size in named.items()
        )
        if self.model.discrete_time:
            return Maps(coef, features, spread, free, inside=inside)
        if self.libraries:
            return Laws(coef, features, spread, free, inside=inside)
        return laws_of(coef, self.model.feature_map, spread, free)

    def _slope(self, named: Mapping[str, float], name: str, move: float, X: Array) -> Array:
        """Derivatives of the features by a named parameter."""
        higher, lower = ({**named, name: named[name] + sign * move} for sign in (1.0, -1.0))
        return (self.features(X, higher) - self.features(X, lower)) / (2.0 * move)

    def guards(self, surface: Array, free: NDArray[np.bool_], spread: Array) -> Guards:
        """The surfaces between `classes`, for sizes of states and inputs."""
        form = self.linear
        if form is None:
            return _decisions_as_guards(self.model.surface, spread)
        if not len(form.coef):
            return nowhere(spread)
        coef = surface / form.scale[:, None]
        return Guards(coef, form.features, spread, form.mode_book, free)

    def known(self, spread: Array, values: Values | None = None) -> tuple[Laws, Guards]:
        """Laws and surfaces as they are, or of some values, for sizes of states and inputs."""
        if values is None:
            form = self.linear
            surface = np.empty((0, 0)) if form is None else form.coef
            values = Values(self.model.coef, {}, surface)
        none = [np.zeros(one.shape, dtype=bool) for one in (values.coef, values.surface)]
        laws = self.laws(values, none[0], {}, spread[: self.n_states])
        return laws, self.guards(values.surface, none[1], spread)

    @property
    def classes(self) -> NDArray[np.intp]:
        """Modes that the surface tells."""
        form = self.linear
        return np.asarray(self.model.surface.classes_ if form is None else form.classes)


def substeps_for(laws: Laws, columns: Array, duration: float) -> int:
    """Runge-Kutta steps in a duration that the fastest rate of the laws asks for.

    The rate is the spectral radius of the field's Jacobian that nine of ten points stay below, in
    the fastest mode; a root or a kink may make it infinite at a few.
    """
    if laws.leaps:
        return 1
    rows = np.unique(np.linspace(0, len(columns) - 1, SETTINGS.most_rows).astype(int))
    rate, columns = 0.0, columns[rows]
    for mode in laws.modes:
        slopes = np.nan_to_num(laws.linear(mode, columns)[1].transpose(2, 1, 0))
        radius = np.abs(np.linalg.eigvals(slopes)).max(axis=1)
        rate = max(rate, float(np.quantile(radius, 0.9)))
    steps = np.ceil(duration * rate / SETTINGS.step_rate)
    return int(np.clip(steps, 1, SETTINGS.most_substeps))


def _decisions_as_guards(surface: Surface, spread: Array) -> Guards:
    """Between every two classes a surface where their decisions are equal."""
    n = len(surface.classes_)
    if n == 1:
        return nowhere(spread)
    first, second = np.triu_indices(n, 1)
    book = np.zeros((n, len(first)), dtype=np.int64)
    book[first, np.arange(len(first))], book[second, np.arange(len(first))] = 1, -1
    place = np.argsort(surface.classes_)

    def leads(X: Array) -> Array:
        X = np.nan_to_num(X, posinf=FAR, neginf=-FAR)  # classifiers refuse what has diverged
        decided = decisions_of(surface, X)
        if decided is None:
            given = np.searchsorted(surface.classes_, surface.predict(X), sorter=place)
            decided = np.eye(n)[place[given]]
        return decided[:, first] - decided[:, second]

    every = np.eye(len(first))
    return Guards(every, leads, spread, book, np.zeros(every.shape, dtype=bool))
