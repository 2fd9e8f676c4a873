"""A fitted switching system: its laws as text and formulas, and what else one may ask of it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.parameters import shown
from swsysid._data.coordinates import Extent
from swsysid._data.features import FeatureMap
from swsysid._data.sources import pieces
from swsysid._rendering.printing import check_format, linear_combination, merged, rate, symbol
from swsysid._results import Array, Trajectory
from swsysid._simulation.bands import with_band
from swsysid._simulation.inputs import checked_options
from swsysid._simulation.simulate import simulate
from swsysid._simulation.system import SwitchingSystem
from swsysid._surfaces.surface import (
    Surface,
    WithEquations,
    has_equations,
    has_monomials,
    is_linear,
    locates_events,
    option,
    probabilities_of,
)
from swsysid.exporting import Expression, HybridSystem, NoFormulaError, Surfaces, ToOtherTools
from swsysid.exporting._features import columns_of, combination, features_of, monomials

AddedTerms = Callable[[int, int], Iterable[tuple[float, str, float]]]


@dataclass(frozen=True)
class SwitchingModel(SwitchingSystem):
    """Vector fields C_j Phi(x) and the surface that says which of them is active."""

    coef: Array  # (n_modes, n_states, n_features_out)
    feature_map: FeatureMap
    surface: Surface  # classifier of the states and inputs
    discrete_time: bool  # the targets are next states instead of velocities

    @property
    def parameters(self) -> Array:
        """Coefficients of the laws, then those of the surfaces, in the coordinates of their fit."""
        return np.concatenate([self.coef.ravel(), self._of_surfaces.ravel()])

    def with_parameters(self, parameters: Array) -> SwitchingModel:
        """The same with other coefficients."""
        coef, of_surfaces = np.split(parameters, [self.coef.size])
        surface = self.surface
        if is_linear(surface):
            surface = copy(surface)
            surface.use_coef(of_surfaces.reshape(self._of_surfaces.shape))
        return replace(self, coef=coef.reshape(self.coef.shape), surface=surface)

    @property
    def _of_surfaces(self) -> Array:
        surface, n_columns = self.surface, len(self.feature_map.names_in)
        return surface.linear_form(n_columns).coef if is_linear(surface) else np.empty((0, 0))

    def velocities(self, X: Array) -> Array:
        """Velocity of every mode at every sample, shape (n_modes, n_samples, n_states)."""
        return np.matmul(self.feature_map(X), self.coef.transpose(0, 2, 1))

    def modes(self, X: Array) -> NDArray[np.intp]:
        """The mode that the surface assigns to every sample."""
        return np.concatenate([self.surface.predict(X[rows]) for rows in pieces(len(X))])

    def mode_probabilities(self, X: Array) -> Array:
        """Probability of every mode at every sample, 0 or 1 if the surface gives none."""
        return probabilities_of(self.surface, X, len(self.coef))

    def predict(self, X: Array) -> Array:
        """Velocity of the active mode at every sample, shape (n_samples, n_states)."""
        active = np.empty((len(X), self.n_states))
        for rows in pieces(len(X)):
            some = X[rows]
            active[rows] = self.velocities(some)[self.surface.predict(some), np.arange(len(some))]
        return active

    def equations(
        self,
        precision: int,
        style: str,
        *,
        states: Sequence[str] | None = None,
        columns: Sequence[str] | None = None,
        added: AddedTerms | None = None,
        quantities: Sequence[str] | None = None,
    ) -> list[str]:
        """One equation for every mode and state.

        `states` and `columns` name the states and the columns of X, if not as in the fit, and
        `quantities` what the laws give, if that is no rate; ``added(mode, state)`` lists further
        terms: coefficient, name, size on the data.
        """
        return law_equations(
            self.coef,
            self.feature_map,
            precision,
            style,
            discrete_time=self.discrete_time,
            states=quantities or states or self.feature_map.names_in,
            columns=columns,
            added=added,
            static=quantities is not None,
        )

    def surface_equations(
        self, precision: int, style: str, columns: Sequence[str] | None = None
    ) -> list[str]:
        """One equation for every surface, and the modes on its two sides."""
        if not has_equations(self.surface):
            raise TypeError(
                f"{type(self.surface).__name__} is a surface without equations; use "
                "PolynomialSurfaceClassifier as surface to have them."
            )
        names = self.feature_map.names_in if columns is None else columns
        equations = self.surface.equations(precision, style, names)
        return [
            equation + _sides(number, self.surface, style)
            for number, equation in enumerate(equations)
        ]

    # -- what a simulation asks --------------------------------------------------------------

    @property
    def extent(self) -> Extent | None:
        """Where the states were in the data of the fit, None for a stated model."""
        known = self.feature_map.extent
        return None if known is None else known.first(self.n_states)

    @property
    def n_states(self) -> int:
        """Number of velocities, which is that of the states."""
        return self.coef.shape[1]

    @property
    def n_inputs(self) -> int:
        """Number of columns of X after the states."""
        return len(self.feature_map.names_in) - self.n_states

    def simulate(
        self, x0, t, inputs=None, *, input_hold="zero", covariance=None, **options
    ) -> Trajectory:
        """A rollout with named states; arguments as `simulate` takes them.

        With a band if options ask for one and the covariance of `parameters` is given.
        """
        names = tuple(self.feature_map.names_in[: self.n_states])

        def rolled(model: SwitchingModel, asked: dict[str, object]) -> Trajectory:
            checked_options(asked)
            is_map = self.discrete_time
            done = simulate(
                model, x0, t, inputs, input_hold=input_hold, discrete_time=is_map, **asked
            )
            return replace(done, names=names)

        return with_band(self, covariance, options, rolled)

    def to_hybrid_system(self) -> HybridSystem:
        """Laws and surfaces as formulas."""
        system = system_of(self.coef, self.feature_map, self.surface, self.discrete_time)
        return system.checked(self.velocity, self.mode)

    def velocity(self, x: Array, u: Array, mode: int) -> Array:
        """Velocity (or next state) at one point in one mode."""
        return self.coef[mode] @ self.feature_map.at(np.concatenate([x, u]))

    def mode(self, x: Array, u: Array) -> int:
        """Active mode at one point."""
        if self.has_surface_values:
            return self.decode(self.surface_values(x, u))
        return int(self.surface.predict(np.concatenate([x, u])[None, :])[0])

    def surface_values(self, x: Array, u: Array) -> Array:
        """Values of the surfaces at one point, shape (n_surfaces,)."""
        assert locates_events(self.surface), "asked for only where it has values"
        return self.surface.surface_values_at(np.concatenate([x, u]))

    def decode(self, values: Array) -> int:
        """Active mode for given values of the surfaces."""
        assert locates_events(self.surface), "asked for only where it has values"
        return int(self.surface.decode(values[None, :])[0])

    @property
    def has_surface_values(self) -> bool:
        """True if the surface is known as a function, not only as a classifier."""
        return locates_events(self.surface)


@runtime_checkable
class FittedModel(Protocol):
    """A model whose laws are known: fitted by `SwitchingSystemRegressor`, or stated."""

    coef_: Array

    @property
    def switching_model(self) -> SwitchingModel:
        """Vector fields, feature map and surface as one system."""


class WithSwitchingModel(ToOtherTools):
    """A model that other tools can be told, by its switching system."""

    def to_hybrid_system(self) -> HybridSystem:
        return fitted_system(self).to_hybrid_system()


def _sides(number: int, surface: WithEquations, style: str) -> str:
    """The modes on the two sides of a surface, in brackets."""
    listed = [
        [str(mode) for mode, signs in zip(surface.classes_, surface.mode_book_, strict=True)
         if signs[number] == sign]
        for sign in (-1, 1)
    ]  # fmt: skip
    name = f"f_{{{number}}}" if style == "latex" else f"f{number}"
    parts = [
        f"mode{'s' if len(modes) > 1 else ''} {', '.join(modes)} where "
        + (f"${name} {relation} 0$" if style == "latex" else f"{name} {relation} 0")
        for modes, relation in zip(listed, "<>", strict=True)
    ]
    conditions = f"({'; '.join(parts)})"
    return rf" \quad \text{{{conditions}}}" if style == "latex" else f"   {conditions}"


def fitted_system(model: object) -> SwitchingModel:
    """The switching system of a fitted or a stated model; anything else is refused."""
    if isinstance(model, type) or not hasattr(model, "coef_"):
        raise TypeError(
            f"model={shown(model)} has no coefficients yet; fit it first, or state one with "
            "StatedModel."
        )
    if not isinstance(model, FittedModel):
        raise TypeError(
            f"model={shown(model)} is no switching system; give a fitted SwitchingSystemRegressor "
            "or a StatedModel."
        )
    return model.switching_model


def law_equations(
    coef: Array,
    feature_map: FeatureMap,
    precision: int,
    style: str,
    *,
    discrete_time: bool,
    states: Sequence[str],
    static: bool = False,
    columns: Sequence[str] | None = None,
    added: AddedTerms | None = None,
) -> list[str]:
    """One equation for every mode and state.

    `states` and `columns` name the states (if `static`, what the laws give, which is no rate) and
    what the features are made of, the latter by default as in the fit; ``added(mode, state)`` lists
    further terms: coefficient, name, size on the data.
    """
    check_format(style, precision)
    lines = []
    for mode in range(len(coef)):
        where = rf"\text{{mode }} {mode}: \; " if style == "latex" else f"mode {mode}: "
        laws = laws_of_mode(
            coef, mode, feature_map, precision, style,
            discrete_time=discrete_time, states=states, static=static, columns=columns,
            added=added,
        )  # fmt: skip
        lines += [where + law for law in laws]
    return lines


def laws_of_mode(
    coef: Array,
    mode: int,
    feature_map: FeatureMap,
    precision: int,
    style: str,
    *,
    discrete_time: bool,
    states: Sequence[str],
    static: bool = False,
    columns: Sequence[str] | None = None,
    added: AddedTerms | None = None,
    brief: bool = False,
) -> list[str]:
    """One equation for every state in a mode; arguments as `law_equations` takes them."""
    columns = feature_map.names_in if columns is None else columns
    rows, features, feature_sizes = feature_map.printed(coef[mode], columns)
    lines = []
    for state, row in enumerate(rows.tolist()):
        own = zip(row, features, feature_sizes, strict=True)
        values, names, sizes = merged([*own, *(added(mode, state) if added else ())])
        law = linear_combination(
            values, names, precision=precision, style=style, sizes=sizes, brief=brief
        )
        name = states[state] if state < len(states) else f"y{state}"
        left = symbol(name, style) if static or discrete_time else rate(name, style)
        lines.append(f"{left}{'[k+1]' if discrete_time else ''} = {law}")
    return lines


def system_of(
    coef: Array, feature_map: FeatureMap, surface: Surface, discrete_time: bool
) -> HybridSystem:
    """Laws and surfaces of a switching system; what is no formula is refused in a sentence."""
    n_states, names = coef.shape[1], feature_map.names_in
    if n_states > len(names):
        raise NoFormulaError(
            f"the model has {n_states} velocities and {len(names)} columns of X, so that it is no "
            "system of states; fit it with the states themselves as the first columns of X."
        )
    columns = columns_of(n_states, len(names) - n_states)
    system = HybridSystem(
        tuple(names[:n_states]),
        tuple(names[n_states:]),
        laws_of(coef, feature_map, columns),
        None if len(coef) == 1 else _surfaces(surface, len(coef), columns),
        discrete_time=discrete_time,
    )
    return system.known_by(feature_map.extent)


def laws_of(
    coef: Array, feature_map: FeatureMap, columns: list[Expression]
) -> tuple[tuple[Expression, ...], ...]:
    """For each mode the formula of each state."""
    features = features_of(feature_map.library, columns)
    return tuple(tuple(combination(row, features) for row in law) for law in coef)


def _surfaces(surface: Surface, n_modes: int, columns: list[Expression]) -> Surfaces:
    form = surface.linear_form(len(columns)) if is_linear(surface) else None
    if form is None or not has_monomials(surface):
        raise NoFormulaError(
            f"the surface of {type(surface).__name__} is no formula; use "
            "PolynomialSurfaceClassifier as surface."
        )
    if surface.powers is not None:
        features = monomials(surface.powers, columns)
    else:
        library, row = option(surface, "feature_library", None), np.ones((1, len(columns)))
        known = FeatureMap(library, row, [f"x{place}" for place in range(len(columns))])
        features = features_of(known.library, columns)
    sizes = np.broadcast_to(form.scale, len(surface.coef_))
    functions = tuple(
        combination(row / size, features) for row, size in zip(surface.coef_, sizes, strict=True)
    )
    signs = {int(mode): row for mode, row in zip(form.classes, form.mode_book, strict=True)}
    if sorted(signs) != list(range(n_modes)):
        raise NoFormulaError(
            f"the surface knows the modes {sorted(signs)} of {n_modes}; a mode that no state has "
            "cannot be written: fit with fewer modes."
        )
    return Surfaces(functions, tuple(tuple(map(int, signs[mode])) for mode in range(n_modes)))
