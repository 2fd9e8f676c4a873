"""What effects ask of a declared model: to be fitted beside them, then its laws and its modes.

A declared model has laws that are linear in a library, one for each mode. Where a switching
regressor is declared, modes and surface are sought with the effects inside; where a hybrid
automaton is, recordings go through its modes, and its laws keep the terms that they have.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.utils import check_random_state

from swsysid._automaton.model import HybridAutomaton
from swsysid._data.features import FeatureMap
from swsysid._data.records import Records
from swsysid._data.rows import CanonicalRows, canonical_rows
from swsysid._identification.identify import identify
from swsysid._identification.setup import build_problem, build_search
from swsysid._identification.within import KnownLaws
from swsysid._known.known import Known, check_known
from swsysid._known.region import Region
from swsysid._pipelines import steps_before, switching_step, with_parameters
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array, IdentificationWarning, MisfitWarning
from swsysid._surfaces.surface import has_monomials
from swsysid.effects import Effect, StructureEffect

Modes = NDArray[np.intp]
Doubts = tuple[Warning, ...]
Added = Callable[[Records], Array]  # what effects add in each mode, (n_modes, n_rows, n_states)
_DOUBTS = (ConvergenceWarning, IdentificationWarning)


class FittedLaws(Protocol):
    """The laws of a fitted declared model, and what tells their modes."""

    # the automaton that the laws belong to; None if a surface tells the modes
    automaton: HybridAutomaton | None = None

    @property
    def coef(self) -> Array:
        """Coefficients of the library, (n_modes, n_states, n_features)."""

    @property
    def support(self) -> NDArray[np.bool_]:
        """Terms that the laws may have, shaped like `coef`."""
        return np.ones(self.coef.shape, dtype=bool)

    @property
    def region(self) -> Region | None:
        """Coefficients that what is known allows; None for all."""
        return None

    @property
    def feature_map(self) -> FeatureMap:
        """The library, of the columns that the laws see."""

    @property
    def discrete_time(self) -> bool:
        """True if the laws give next states."""

    @property
    def seeks_modes(self) -> bool:
        """True if the modes are sought with the effects, False if recordings tell them."""
        return False

    @property
    def resets(self) -> frozenset[tuple[int, int]]:
        """Modes before and after, where states are known to jump."""
        return frozenset()

    @property
    def n_columns(self) -> int:
        """Number of states and inputs."""

    @property
    def n_surface_parameters(self) -> int:
        """What a guard that takes the place of the surface does without, scales not counted."""
        return 0

    def seen(self, X: Array) -> Array:
        """States and inputs as the laws see them."""

    def modes(self, records: Records, added: Added) -> Modes:
        """Modes along the trajectories; `added` is what effects add to the velocities."""

    def probabilities(self, records: Records) -> Array:
        """Probability of every mode before velocities are asked, (n_rows, n_modes)."""
        return self.allowed(records.X)

    def allowed(self, X: Array) -> Array:
        """Probability of every mode at states and inputs alone, (n_rows, n_modes)."""

    def with_surface_between(self, X: Array, modes: Modes) -> object:
        """The estimator with its surface fitted to modes that recordings tell."""

    def column_names(self, names: Sequence[str]) -> list[str] | None:
        """Names of what the laws see for names of states and inputs; None if there are none."""

    def guard_equations(self, names: Sequence[str], precision: int, style: str) -> list[str]:
        """What makes the modes change, as text or LaTeX."""


class Declared(Protocol):
    """A declared model that can be fitted to what effects leave over."""

    @property
    def n_modes(self) -> int | str:
        """Number of modes, or "auto"."""

    @property
    def discrete_time(self) -> bool:
        """True if the targets are next states."""

    @property
    def robust(self) -> bool:
        """False if residuals count by their squares."""
        return True

    @property
    def known(self) -> object | None:
        """The model itself if it has laws before any fit; recordings then tell their modes."""
        return None

    def with_modes(self, n_modes: int) -> Declared:
        """The same with so many modes."""
        return self

    def extended(self, effect: StructureEffect) -> Declared:
        """The same with what an effect adds to its structure."""

    def anew(self, records: Records, added: Array) -> Declared | None:
        """Identified once more beside effects; None if it is fitted with them anyway.

        `added` is what they add to the velocities, (n_modes, n_samples, n_states).
        """
        return None

    def refuses(self, effect: Effect) -> str | None:
        """Why an effect cannot stand beside it; None if it can."""
        return None

    def library(self, X: Array) -> Array:
        """Features of states and inputs, (n_rows, n_features)."""

    def support(self, n_modes: int, n_states: int, n_features: int) -> NDArray[np.bool_]:
        """Terms that the laws may have, (n_modes, n_states, n_features)."""

    def fitted(self, records: Records, targets: Array, modes: Modes | None) -> FittedDeclared:
        """Itself fitted to rows, from modes to start with if there are any."""

    def sought(self, columns: Array, records: Records, targets: Array) -> Modes:
        """Modes of rows whose library has further columns."""


@dataclass(frozen=True)
class FittedDeclared:
    """A declared model after a fit."""

    estimator: object  # as a user has it: a regressor, a pipeline, an automaton
    modes: Modes  # of the rows of the fit
    doubts: Doubts = ()  # what it had to say of its fit


def region_of(
    known: Known | None, feature_map: FeatureMap, shape: tuple[int, ...]
) -> Region | None:
    """Laws of a shape that what is known allows; None for all."""
    laws = KnownLaws.of(known, feature_map, shape[1])
    if laws is None or len(laws.terms) != shape[2]:  # an effect has brought terms of its own
        return None
    return laws.region(shape[0])


def may_have(region: Region | None, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Terms that are not known to be missing, of laws of a shape."""
    if region is None:
        return np.ones(shape, dtype=bool)
    told, values = region.fixed
    return np.asarray(~told | (values != 0.0))


# -- switching regressors --------------------------------------------------------------------------


@dataclass(frozen=True)
class DeclaredSwitching(Declared):
    """A switching regressor, perhaps at the end of a pipeline."""

    estimator: BaseEstimator

    @property
    def _switching(self) -> SwitchingSystemRegressor:
        regressor: SwitchingSystemRegressor = switching_step(self.estimator)[1]
        return regressor

    @property
    def n_modes(self) -> int | str:
        n_modes: int | str = self._switching.n_modes
        return n_modes

    @property
    def discrete_time(self) -> bool:
        return bool(self._switching.discrete_time)

    @property
    def robust(self) -> bool:
        return bool(self._switching.loss != "squared")

    def with_modes(self, n_modes: int) -> DeclaredSwitching:
        return replace(self, estimator=with_parameters(self.estimator, n_modes=n_modes))

    def extended(self, effect: StructureEffect) -> DeclaredSwitching:
        return replace(self, estimator=effect.extended(self.estimator))

    def library(self, X: Array) -> Array:
        seen, feature_map = self._library(X)
        return np.asarray(feature_map(seen))

    def support(self, n_modes: int, n_states: int, n_features: int) -> NDArray[np.bool_]:
        switching = self._switching
        known = check_known(switching.known)
        shape = n_modes, n_states, n_features
        if known is None or not known.columns:
            return np.ones(shape, dtype=bool)
        row = np.ones((1, len(known.columns)))
        features = FeatureMap(switching.feature_library, row, known.columns)
        return may_have(region_of(known, features, shape), shape)

    def fitted(self, records: Records, targets: Array, modes: Modes | None) -> FittedDeclared:
        # A search fits it often and on data that lack something: only the fit that is handed over
        # may warn the user.
        declared = self._switching.get_params(deep=False)
        copy = clone(self.estimator)
        if modes is not None and declared["init"] == "auto":
            n_modes = int(modes.max()) + 1 if declared["n_modes"] == "auto" else declared["n_modes"]
            copy = with_parameters(self.estimator, init=modes, n_modes=n_modes)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            copy.fit(records.X, targets)
        switching = switching_step(copy)[1]
        switching.set_params(init=declared["init"], n_modes=declared["n_modes"])
        # What the model leaves over is what the search is for, so that is no doubt about its fit.
        doubts = (
            one.message
            for one in caught
            if issubclass(one.category, _DOUBTS) and not issubclass(one.category, MisfitWarning)
        )
        spoken = tuple(one for one in doubts if isinstance(one, Warning))
        return FittedDeclared(copy, switching.modes_, spoken)

    def sought(self, columns: Array, records: Records, targets: Array) -> Modes:
        switching = self._switching
        X, feature_map = self._library(records.X)
        groups = np.zeros(len(X), np.intp) if records.groups is None else records.groups
        rows = canonical_rows(np.column_stack([X, columns]), targets, groups)
        extended, *rest = rows.arrays
        plain = CanonicalRows((extended[:, : X.shape[1]], *rest), rows.weight, rows.inverse)
        problem = build_problem(switching, plain, feature_map)
        known = problem.known and replace(problem.known, n_beside=columns.shape[1])
        features = np.column_stack([problem.features, extended[:, X.shape[1] :]])
        problem = replace(problem, features=features, known=known)
        found = identify(
            problem, build_search(switching, plain), check_random_state(switching.random_state)
        )
        modes: Modes = rows.restore(found.best.modes)
        return modes

    def _library(self, X: Array) -> tuple[Array, FeatureMap]:
        """What the switching regressor would see, not fitted yet, and its library."""
        before = steps_before(self.estimator)
        X = X if before is None else clone(before).fit(X).transform(X)
        names = [f"x{column}" for column in range(X.shape[1])]
        return X, FeatureMap(self._switching.feature_library, X, names)


@dataclass(frozen=True)
class SwitchingLaws(FittedLaws):
    """Those of a fitted switching regressor, whose surface tells the mode."""

    estimator: BaseEstimator

    @property
    def switching(self) -> SwitchingSystemRegressor:
        """The switching regressor, the last step if the estimator is a pipeline."""
        regressor: SwitchingSystemRegressor = switching_step(self.estimator)[1]
        return regressor

    @property
    def coef(self) -> Array:
        coef: Array = self.switching.coef_
        return coef

    @property
    def region(self) -> Region | None:
        return region_of(check_known(self.switching.known), self.feature_map, self.coef.shape)

    @property
    def support(self) -> NDArray[np.bool_]:
        return may_have(self.region, self.coef.shape)

    @property
    def feature_map(self) -> FeatureMap:
        return self.switching.switching_model.feature_map

    @property
    def discrete_time(self) -> bool:
        return bool(self.switching.discrete_time)

    @property
    def seeks_modes(self) -> bool:
        return True

    @property
    def n_columns(self) -> int:
        n_columns: int = self.estimator.n_features_in_
        return n_columns

    @property
    def n_surface_parameters(self) -> int:
        surface = self.switching.switching_model.surface
        if not has_monomials(surface):
            return 0
        return int(np.count_nonzero(surface.coef_)) - len(surface.coef_)

    def seen(self, X: Array) -> Array:
        transform, _ = switching_step(self.estimator)
        return np.asarray(transform(X))

    def modes(self, records: Records, added: Added) -> Modes:
        modes: Modes = self.switching.predict_modes(self.seen(records.X))
        return modes

    def allowed(self, X: Array) -> Array:
        return np.asarray(self.switching.predict_mode_proba(self.seen(X)))

    def with_surface_between(self, X: Array, modes: Modes) -> object:
        """The estimator with its surface fitted to these modes instead."""
        estimator = deepcopy(self.estimator)
        switching = switching_step(estimator)[1]
        switching.surface_ = clone(switching.surface_).fit(self.seen(X), modes)
        return estimator

    def column_names(self, names: Sequence[str]) -> list[str] | None:
        before = steps_before(self.estimator)
        if before is None:
            return list(names[: self.switching.n_features_in_])
        try:
            return list(before.get_feature_names_out(list(names[: before.n_features_in_])))
        except (AttributeError, ValueError):
            return None

    def guard_equations(self, names: Sequence[str], precision: int, style: str) -> list[str]:
        model = self.switching.switching_model
        return model.surface_equations(precision, style, self.column_names(names))
