"""Where states and inputs are counted from while recordings are identified.

A tank in kelvin lies a thousand standard deviations from zero. There a constant and the state are
nearly the same feature, and numerical limits that count in spreads hold a state that has not moved.
A law of polynomials is one law wherever columns are counted from, so that columns far from zero are
counted from their mean, and laws, surfaces and errors are told in the user's own columns at last.
"""

from __future__ import annotations

import warnings
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from swsysid._data.coordinates import Extent, shifted_monomials
from swsysid._data.features import FeatureMap
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array, IdentificationWarning
from swsysid._stays.given import Given, check_channels
from swsysid._stays.identification import StayIdentification
from swsysid._stays.samples import Samples
from swsysid._surfaces.surface import Classifier, MovableClassifier, is_movable

# Of the spread of velocities, what coefficients that are told elsewhere may lose; spreads from zero
# up to which laws that cannot be are found all the same.
_LOST, _TOO_FAR = 1e-3, 3e3


@dataclass(frozen=True)
class Origin:
    """What is subtracted from the columns; states that are not measured are counted from zero."""

    offset: Array  # (n_states + n_inputs,)

    @classmethod
    def of(cls, given: Given, estimator: SwitchingSystemRegressor, order: int = 1) -> Origin:
        """Means of the columns that lie far from zero, if the laws can tell them by a constant."""
        check_channels(given)
        n_channels, n_states = given.n_channels, given.n_channels * order
        columns = np.hstack([np.vstack([one.y for one in given.records]),
                             np.vstack([one.u for one in given.records])])  # fmt: skip
        centre, spread = Extent.of(columns)
        offset = np.insert(centre, n_channels, np.zeros(n_states - n_channels))
        if not offset.any() or _may_move(estimator, offset):
            return cls(offset)
        if (np.abs(centre) > _TOO_FAR * spread).any():
            warnings.warn(
                "columns lie so far from zero that double precision leaves few digits of their "
                "laws; subtract a constant from these columns.",
                IdentificationWarning,
                stacklevel=3,
            )
        return cls(np.zeros(len(offset)))

    @property
    def moves(self) -> bool:
        """True if it is another one than zero."""
        return bool(self.offset.any())

    def counted(self, given: Given) -> Given:
        """Recordings with columns counted from here."""
        n_states = len(self.offset) - given.n_inputs
        of_y, of_u = self.offset[: given.n_channels], self.offset[n_states:]
        records = [replace(one, y=one.y - of_y, u=one.u - of_u) for one in given.records]
        return replace(given, records=records)

    def change(self, features: FeatureMap) -> Array:
        """What coefficients (..., n_features) of columns counted from here are multiplied by."""
        if features.powers is None or not self.moves:
            return np.eye(features.n_features_out)
        return shifted_monomials(features.powers, self.offset, np.ones(len(self.offset))).T

    def told(self, found: StayIdentification) -> StayIdentification:
        """The same, its model in the user's own columns; the estimate stays as it is."""
        if not self.moves:
            return found
        other, features = copy(found.model), found.model.switching_model.feature_map
        other.coef_ = found.model.coef_ @ self.change(features)
        counted = Samples.of(found.estimate).columns
        columns = counted + self.offset
        other.use_features(FeatureMap(other.feature_library, columns, features.names_in))
        here = found.model.switching_model.velocities(counted)
        there = other.switching_model.velocities(columns)
        if (np.abs(there - here).max(axis=(0, 1)) > _LOST * here.std(axis=(0, 1))).any():
            warnings.warn(
                "columns lie so far from zero that double precision does not hold the coefficients "
                "of their powers; subtract a constant from these columns, or lower the degree.",
                IdentificationWarning,
                stacklevel=3,
            )
        other.surface_ = self._surface(found.model.surface_)
        other.surface_candidates_ = [
            replace(one, surface=self._surface(one.surface))
            for one in found.model.surface_candidates_
        ]
        return replace(found, model=other)

    def _surface(self, surface: Classifier) -> MovableClassifier:
        assert isinstance(surface, MovableClassifier), "asked of every estimator"
        return surface.moved(self.offset)

    def states(self, states: Array) -> Array:
        """States in the user's own columns."""
        return states + self.offset[: states.shape[-1]]


def _may_move(estimator: SwitchingSystemRegressor, offset: Array) -> bool:
    """True if settings mean the same wherever columns are counted from, and laws can tell where.

    With every monomial there is then each one that has a column with an offset less often.
    """
    if not (estimator.surface is None or is_movable(estimator.surface)):
        return False
    if estimator.coef_bound is not None or estimator.sparsity not in (None, "auto"):
        return False
    names = [f"x{k}" for k in range(len(offset))]
    powers = FeatureMap(estimator.feature_library, np.ones((1, len(offset))), names).powers
    if powers is None:
        return False
    lower = powers[:, None, :] - np.eye(len(offset), dtype=powers.dtype)[np.flatnonzero(offset)]
    wanted = lower[(lower >= 0).all(axis=2)]
    return {tuple(one) for one in wanted.tolist()} <= {tuple(one) for one in powers.tolist()}
