"""Many parameter sets of one switching system, evaluated on rows at once.

A row is a point (states, inputs) together with the number of its *owner*, the parameter set that
it is to be evaluated with. All segments of all trajectories under all perturbations of the
parameters are rows of the same batch: numpy sees a few thousand of them at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array
from swsysid._surfaces.mode_books import decisions
from swsysid._surfaces.surface import decisions_of

__all__ = ["Maps", "ParameterSets", "RowSystem", "has_linear_surface", "named_parameters"]

Rows = NDArray[np.intp]
RowMap = Callable[[Array, Mapping[str, Array]], Array]


@dataclass(frozen=True)
class ParameterSets:
    """Values of all parameters, one set for each owner.

    Attributes
    ----------
    coef : ndarray of shape (n_owners, n_modes, n_states, n_features)
    named : dict of str to ndarray of shape (n_owners,)
        Parameters inside features and outputs.
    surface : ndarray of shape (n_owners, n_surfaces, n_surface_features) or None
        Coefficients in the coordinates in which the surface was fitted; None where it is known
        only as a classifier.
    """

    coef: Array
    named: dict[str, Array]
    surface: Array | None

    def __len__(self) -> int:
        return len(self.coef)


class Maps:
    """Feature map, surface and output of a model as functions of rows.

    Parameters
    ----------
    system : SwitchingModel or alike
        Has ``feature_map``, ``surface``, ``coef`` and ``discrete_time``.
    output : callable or ParametricLibrary, default=None
        From rows (states, inputs) to the measured channels; None where states are measured.
    """

    def __init__(self, system: Any, output: Any = None):
        self.n_modes, self.n_states, _ = system.coef.shape
        self.discrete_time = bool(system.discrete_time)
        self.features = _row_map(system.feature_map)
        self.output = None if output is None else _row_map(output)
        self.surface = system.surface
        if has_linear_surface(self.surface):
            self.surface.surface_values(np.ones((1, len(system.feature_map.names_in))))
            self.surface_features = _basis_map(self.surface._basis)

    def decisions(self, X: Array, coef: Array | None) -> Array:
        """Decision of every mode, (n_rows, n_modes); the active mode has the largest."""
        surface, n_rows = self.surface, len(X)
        decided = np.full((n_rows, self.n_modes), -np.inf)
        if coef is not None:
            values = np.einsum("rlf,rf->rl", coef, self.surface_features(X))
            scaled = values / surface._surface_scale
            decided[:, surface.classes_] = decisions(scaled, surface.mode_book_)
        elif (given := decisions_of(surface, X)) is not None:
            decided[:, surface.classes_] = given
        else:
            decided[:] = 0.0
            decided[np.arange(n_rows), surface.predict(X)] = 1.0
        return decided


def has_linear_surface(surface: Any) -> bool:
    """True if the surface is linear in coefficients that can be varied."""
    return all(hasattr(surface, name) for name in ("_basis", "_fitted_coef", "_surface_scale"))


def named_parameters(*maps: Any) -> dict[str, float]:
    """Named parameters of feature map and output; equal names are one parameter."""
    named: dict[str, float] = {}
    for part in maps:
        library = getattr(part, "library", part)
        parameters = library.parameters if hasattr(library, "evaluate") else None
        named.update(parameters or {})
    return named


def _row_map(part: Any) -> RowMap:
    """A feature map or an output as a function of rows and of the parameters of each row."""
    library = getattr(part, "library", part)
    powers = getattr(library, "powers_", None)
    if powers is not None:
        return _Monomials(powers)
    if hasattr(library, "evaluate"):
        return library.evaluate
    return lambda X, named: _matrix(part(X), len(X))


def _basis_map(basis: Any) -> Callable[[Array], Array]:
    """The features of a surface, without the checks that scikit-learn makes at every call."""
    if hasattr(basis, "kept"):
        inner = _basis_map(basis.basis)
        return lambda X: inner(X)[:, basis.kept] * basis.scale
    features = _Monomials(basis.powers) if hasattr(basis, "powers") else _row_map(basis.map)
    if hasattr(basis, "powers"):
        return lambda X: features((X - basis.centre) / basis.scale, {})
    return lambda X: (features(X, {}) - basis.centre) / basis.scale


def _matrix(values: Any, n_rows: int) -> Array:
    return np.asarray(values, dtype=float).reshape(n_rows, -1)


class _Monomials:
    """Monomials, each a product of an earlier one and a column: no powers are computed."""

    def __init__(self, powers: Array):
        known = {tuple(np.zeros(powers.shape[1], dtype=int)): -1}
        self.plan = []
        order = np.argsort(powers.sum(axis=1), kind="stable")
        for place in order:
            power = tuple(int(k) for k in powers[place])
            self.plan.append((place, *self._origin(power, known)))
            known[power] = place
        self.n_features, self.powers = len(powers), powers

    @staticmethod
    def _origin(power, known):
        """An earlier monomial and the column by which it has to be multiplied."""
        for column, exponent in enumerate(power):
            lower = (*power[:column], exponent - 1, *power[column + 1 :])
            if exponent and lower in known:
                return known[lower], column
        return None, None

    def __call__(self, X: Array, named: Mapping[str, Array]) -> Array:
        features = np.empty((len(X), self.n_features))
        for place, origin, column in self.plan:
            if column is not None:
                last = X[:, column]
                features[:, place] = last if origin < 0 else features[:, origin] * last
            else:
                features[:, place] = np.prod(X ** self.powers[place], axis=1)
        return features


class RowSystem:
    """Fields, modes and outputs of rows, each under the parameters of its owner."""

    def __init__(self, maps: Maps, sets: ParameterSets, owners: Rows):
        self.maps, self.sets, self.owners = maps, sets, owners
        self.named = {name: values[owners] for name, values in sets.named.items()}
        self._surface = None if sets.surface is None else sets.surface[owners]
        self._fields = sets.coef.reshape(-1, *sets.coef.shape[2:])

    def part(self, rows: Rows) -> RowSystem:
        """The system of some of the rows."""
        return RowSystem(self.maps, self.sets, self.owners[rows])

    def field(self, modes: Rows) -> Callable[[Array, Array], Array]:
        """Velocity (next state in discrete time) of every row, each in a given mode."""
        coef = self._fields[self.owners * self.maps.n_modes + modes]

        def velocity(x: Array, u: Array) -> Array:
            features = self.maps.features(np.concatenate([x, u], axis=1), self.named)
            return np.matmul(coef, features[:, :, None])[:, :, 0]

        return velocity

    def decisions(self, x: Array, u: Array) -> Array:
        """Decision of every mode at every row."""
        return self.maps.decisions(np.concatenate([x, u], axis=1), self._surface)

    def modes(self, x: Array, u: Array) -> Rows:
        """Active mode of every row."""
        if self.maps.n_modes == 1:
            return np.zeros(len(x), dtype=np.intp)
        return self.decisions(x, u).argmax(axis=1)

    def output(self, x: Array, u: Array) -> Array:
        """What a sensor reads at every row."""
        if self.maps.output is None:
            return x
        return self.maps.output(np.concatenate([x, u], axis=1), self.named)
