"""A switching system as formulas: laws, and the surfaces that tell the modes."""

from __future__ import annotations

import numpy as np

from swsysid._data.features import FeatureMap
from swsysid._results import Array
from swsysid._surfaces.surface import Surface, has_monomials, is_linear, option
from swsysid.exporting import Expression, HybridSystem, NoFormulaError, Surfaces
from swsysid.exporting._features import columns_of, combination, features_of, monomials


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
