"""Lagged rows in units of their own: features, targets and states as the searches see them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from swsysid._data.features import FeatureMap
from swsysid._data.trajectories import spread
from swsysid._discrete_stays.lagged import Labels, LaggedRows
from swsysid._discrete_stays.rows import RowProblem
from swsysid._known.known import Known
from swsysid._known.region import Region
from swsysid._results import Array

# Rows in which starts are compared, in pieces of so many in a row.
_MOST_SEARCHED, _PIECE = 4000, 200
FARTHEST = 10.0  # of the largest state: one further off is given up


@dataclass(frozen=True)
class DiscreteData:
    """Rows of recordings and their features, in units in which all are of order one."""

    rows: LaggedRows
    feature_map: FeatureMap
    row_features: Array  # (n_rows, n_features), in the units of the user
    feature_unit: Array  # (n_features,): root mean square, 1 where it is zero
    target_unit: Array  # (n_states,): deviation
    memory: Labels  # (n_features,): the longest lag that each sees
    known: Known | None = None

    @classmethod
    def of(
        cls, rows: LaggedRows, feature_map: FeatureMap, known: Known | None = None
    ) -> DiscreteData:
        """Rows with the units that they ask for."""
        features = feature_map(rows.columns)
        size = np.sqrt(np.square(features).mean(axis=0))
        unit = np.where(size > 0.0, size, 1.0)
        memory = _memory(rows, feature_map)
        return cls(rows, feature_map, features, unit, spread(rows.targets), memory, known)

    @cached_property
    def problem(self) -> RowProblem:
        """Features, targets and stretches of the rows."""
        features = self.row_features / self.feature_unit
        targets = self.rows.targets / self.target_unit
        region = None if self.known is None else self.region
        return RowProblem(features, targets, self.rows.begins, self.memory, region)

    def region(self, n_modes: int) -> Region:
        """What is known of so many laws, in these units."""
        unit = self.target_unit[:, None] / self.feature_unit
        return self.region_of_user(n_modes).in_units(unit)

    def region_of_user(self, n_modes: int) -> Region:
        """The same in the units of the user."""
        assert self.known is not None, "something is known"
        equations = (name.removesuffix("[k]") for name in self.rows.names[: self.rows.n_states])
        terms = tuple(map(str, self.feature_map.names_out))
        return _region(self.known, tuple(equations), terms, n_modes)

    @cached_property
    def column_unit(self) -> Array:
        """Unit of every column: of its state, and 1 of an input."""
        units = np.ones(self.rows.columns.shape[1])
        units[: self.n_lagged] = np.tile(self.target_unit, self.rows.lags + 1)
        return units

    @property
    def sees_inputs(self) -> NDArray[np.bool_]:
        """Features that change with the inputs, (n_features,)."""
        other = np.arange(self.rows.columns.shape[1]) >= self.n_lagged
        return _changes(self.feature_map, self.rows.columns, other)

    @property
    def n_lagged(self) -> int:
        """Number of the columns that are states."""
        return self.rows.n_states * (self.rows.lags + 1)

    @cached_property
    def columns(self) -> Array:
        """Columns of the rows in these units."""
        return self.rows.columns / self.column_unit

    def coef(self, coef: Array) -> Array:
        """Laws in the units of the user."""
        return coef * self.target_unit[:, None] / self.feature_unit

    def features(self, columns: Array) -> Array:
        """Features of columns in these units."""
        return self.feature_map.at_rows(columns * self.column_unit) / self.feature_unit

    def take(self, rows: NDArray) -> DiscreteData:
        """Some of the rows, in the same units."""
        return replace(self, rows=self.rows.take(rows), row_features=self.row_features[rows])

    def rows_of_part(self) -> NDArray[np.intp]:
        """Pieces of the recordings that are enough to compare laws, spread over all of them."""
        n = len(self.rows)
        if n <= _MOST_SEARCHED:
            return np.arange(n)
        place, stretch = self.problem.places
        pieces = np.column_stack([stretch, place // _PIECE])
        piece = np.unique(pieces, axis=0, return_inverse=True)[1].ravel()
        n_pieces = int(piece.max()) + 1
        count = max(1, _MOST_SEARCHED * n_pieces // n)
        kept = np.linspace(0, n_pieces - 1, count).round().astype(int)
        return np.flatnonzero(np.isin(piece, kept))


@lru_cache(maxsize=32)
def _region(
    known: Known, equations: tuple[str, ...], terms: tuple[str, ...], n_modes: int
) -> Region:
    return known.region(equations, terms, n_modes)


def _memory(rows: LaggedRows, feature_map: FeatureMap) -> Labels:
    """The longest lag that each feature sees, by what changes with the columns of every lag."""
    columns, lags, n_states = rows.columns, np.arange(rows.lags + 1), rows.n_states
    n_inputs = columns.shape[1] // len(lags) - n_states
    lag = np.concatenate([np.repeat(lags, n_states), np.repeat(lags, n_inputs)])
    memory = np.zeros(feature_map.at_rows(columns[:1]).shape[1], dtype=np.intp)
    for longest in lags[1:]:
        memory[_changes(feature_map, columns, lag == longest)] = longest
    return memory


def _changes(feature_map: FeatureMap, columns: Array, some: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Features that change with some of the columns."""
    changed = np.where(some, columns[::-1], columns)
    return np.asarray((feature_map.at_rows(changed) != feature_map.at_rows(columns)).any(axis=0))
