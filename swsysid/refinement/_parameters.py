"""A model as a plant: its laws, surfaces and sensors as functions of one vector of parameters.

With derivatives by those that are free, and how far these reach.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import numbers
from swsysid._checks.parameters import shown
from swsysid._data.recordings import Record
from swsysid._results import Array
from swsysid._simulation.model import FittedModel, SwitchingModel
from swsysid._stays.guards import Guards
from swsysid._stays.laws import Features, Laws, Maps
from swsysid._stays.output_error import Parts, Sensor
from swsysid._stays.polynomial_laws import laws_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.rollouts import nowhere
from swsysid._surfaces.surface import LinearForm, Surface, decisions_of, is_linear
from swsysid.refinement._known import Followers
from swsysid.refinement._stated import Output, ParametricLibrary, StatedModel

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
        laws: Followers,
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
        coef, self.followers = np.ravel(laws.coef), laws
        self.values = np.concatenate([coef, list(named.values()), surface.ravel()]).astype(float)
        every = [laws.free.ravel(), np.ones(len(named), dtype=bool), free_surface.ravel()]
        self.free = np.concatenate(every) & (not frozen)
        self.following = np.zeros(len(self.values), dtype=bool)
        self.following[: coef.size] = laws.following.ravel() & (not frozen)
        self.low, self.high = np.full((2, len(self.values)), np.array([[-np.inf], [np.inf]]))
        self.low[: coef.size][laws.free.ravel()], self.high[: coef.size][laws.free.ravel()] = (
            laws.bounds
        )

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

    def filled(self, vector: Array) -> Array:
        """All values for those that are free."""
        every = self.values.copy()
        every[self.free] = vector
        if self.following.any():
            moved = (every - self.values)[: self.followers.free.size]
            every[self.following] += self.followers.by @ moved[self.followers.free.ravel()]
        return every

    @property
    def by_vector(self) -> Array:
        """Derivatives of all values by those that are free, (n_values, n_free)."""
        by = np.zeros((len(self.values), len(self)))
        by[self.free, np.arange(len(self))] = 1.0
        if self.following.any():
            by[self.following, : self.followers.by.shape[1]] = self.followers.by
        return by

    def at(self, vector: Array) -> Values:
        """All parameters for those that are free, (n_parameters,)."""
        coef, named, surface = self.split(self.filled(vector))
        return Values(coef, dict(zip(self.named, named.tolist(), strict=True)), surface)

    def pivoted(self, vector: Array) -> Array:
        """The same parameters, with the scale of a surface fixed by its now largest coefficient.

        A coefficient that the data want to be zero must not be the one that fixes the scale: the
        others would have to grow without end. The largest gets the value that it had at the start.
        """
        every = self.filled(vector)
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
        laws = Followers.of(None, model.coef, nothing)
        parameters = Parametrization(system, laws, False, frozen=True)
        return cls(system, parameters, spread, np.arange(n_outputs))

    @property
    def limits(self) -> tuple[Array, Array]:
        """Bounds of the parameters."""
        free = self.parameters.free
        return self.parameters.low[free], self.parameters.high[free]

    @property
    def by_parameters(self) -> Array:
        """Unknowns of laws and surfaces by the parameters."""
        given, every = self.parameters, np.arange(len(self.parameters.values))
        varied, _, surface = given.split(given.free | given.following)
        coef, *others = given.split(every)
        own, form = self.system.classes, self.system.linear
        beside = np.concatenate([one.ravel() for one in others]).astype(np.intp)
        places = np.append(coef[own][varied[own]], beside[given.free[beside]])
        by_parameters = given.by_vector[places]
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
        varied = free[0] | self.parameters.split(self.parameters.following)[0]
        n_states, n_coef = self.system.n_states, int(free[0].sum())
        number = {name: n_coef + k for k, name in enumerate(sizes)}
        inside = [
            (number[name], lambda X, by=by: by(X)[:, self.observed])
            for name, by in self.system.varied(self.system.read, values.named, sizes)
            if self.system.output is not None
        ]
        return Parts(
            self.system.laws(values, varied, sizes, self.spread[:n_states]),
            self.system.guards(values.surface, free[2], self.spread),
            Sensor(lambda X: self.system.read(X, values.named)[:, self.observed], inside),
        )
