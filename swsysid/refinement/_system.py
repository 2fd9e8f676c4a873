"""A model as laws and surfaces with derivatives by what is free of it, and as a map of sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from swsysid._data.recordings import Record
from swsysid._results import Array
from swsysid._simulation.model import SwitchingModel
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Features, Laws, Maps
from swsysid._stays.polynomial_laws import laws_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.rollouts import nowhere
from swsysid._surfaces.surface import LinearForm, Surface, decisions_of, is_linear
from swsysid.refinement._stated import Output, ParametricLibrary

# A step times the fastest rate of the model: the error of a Runge-Kutta step is its fifth power
# over 120, 3e-6.
_STEP_RATE = 0.2
_MOST_SUBSTEPS = 50
_MOST_ROWS = 500  # at which rates and sizes are looked at
_STEP = 1e-6  # of a difference quotient, times the size of a parameter

FAR = 1e100
OfRows = Callable[[Array, Mapping[str, float]], Array]  # of rows and named parameters


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
        inside = tuple(one for _, one in self.varied(self.features, values.named, named))
        if self.model.discrete_time:
            return Maps(coef, features, spread, free, inside=inside)
        if self.libraries:
            return Laws(coef, features, spread, free, inside=inside)
        return laws_of(coef, self.model.feature_map, spread, free)

    def varied(
        self, of_rows: OfRows, named: Mapping[str, float], sizes: Mapping[str, float]
    ) -> list[tuple[str, Features]]:
        """Derivatives of features or of what is read by named parameters of some sizes."""

        def by(name: str, move: float, X: Array) -> Array:
            both = ({**named, name: named[name] + sign * move} for sign in (1.0, -1.0))
            higher, lower = (of_rows(X, one) for one in both)
            return (higher - lower) / (2.0 * move)

        return [(name, partial(by, name, _STEP * size)) for name, size in sizes.items()]

    def guards(self, surface: Array, free: NDArray[np.bool_], spread: Array) -> Guards:
        """The surfaces between `classes`, for sizes of states and inputs."""
        form = self.linear
        if form is None:
            return _decisions_as_guards(self.model.surface, spread)
        if not len(form.coef):
            return nowhere(spread)
        coef = surface / form.scale[:, None]
        return Guards(coef, form.features, spread, form.mode_book, free)

    @property
    def classes(self) -> NDArray[np.intp]:
        """Modes that the surface tells."""
        form = self.linear
        return np.asarray(self.model.surface.classes_ if form is None else form.classes)


def grid_of(
    system: System,
    records: Sequence[Record],
    guess: Sequence[Array],
    *,
    held: bool,
    substeps: int = 1,
) -> Recordings:
    """Records side by side to roll out; in discrete time they count turns."""
    turns = system.model.discrete_time
    parts = [
        Record(np.arange(len(one.t), dtype=float) if turns else one.t, one.y[:, :0], one.u)
        for one in records
    ]
    return Recordings.of(parts, guess, held=held).divided(substeps).with_long_steps()


def substeps_for(laws: Laws, columns: Array, duration: float) -> int:
    """Runge-Kutta steps in a duration that the fastest rate of the laws asks for.

    The rate is the spectral radius of the field's Jacobian that nine of ten points stay below, in
    the fastest mode; a root or a kink may make it infinite at a few.
    """
    if laws.leaps:
        return 1
    rows = np.unique(np.linspace(0, len(columns) - 1, _MOST_ROWS).astype(int))
    rate, columns = 0.0, columns[rows]
    for mode in laws.modes:
        slopes = np.nan_to_num(laws.linear(mode, columns)[1].transpose(2, 1, 0))
        radius = np.abs(np.linalg.eigvals(slopes)).max(axis=1)
        rate = max(rate, float(np.quantile(radius, 0.9)))
    steps = np.ceil(duration * rate / _STEP_RATE)
    return int(np.clip(steps, 1, _MOST_SUBSTEPS))


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
