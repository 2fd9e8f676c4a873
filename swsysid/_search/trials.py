"""Candidates: an effect at a place, in a state equation, in all modes or one, and its trial.

A trial fits everything on training folds, nonlinear parameters included, and predicts the rows it
has not seen. What it is worth is measured there only.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swsysid._data.records import Records
from swsysid._noise import STUDENT, exact_below, robust_scale, robust_weights
from swsysid._results import Array
from swsysid._search.regression import COLLINEAR, Background, Regression

__all__ = ["Bench", "PlacedEffect", "Trial"]


@dataclass(frozen=True)
class PlacedEffect:
    """An effect at a place, and where it acts.

    Attributes
    ----------
    effect : Effect
    place : Place
    target : int
        State equation.
    mode : int or None
        None for all modes.
    replaced : int or None
        Feature of the library whose place the columns take, with a coefficient in each mode.
    theta : tuple of float
        Nonlinear parameters.
    """

    effect: Any
    place: Any
    target: int
    mode: int | None = None
    replaced: int | None = None
    theta: tuple[float, ...] = ()

    @property
    def n_parameters(self) -> int:
        """Parameters beyond those of the declared model."""
        own = len(self.effect.terms) - (self.replaced is not None)
        return own + len(self.theta) + self.effect.place_parameters(self.place)

    def physical(
        self, records: Records, coef: Array, theta: Array | None = None
    ) -> dict[str, float]:
        """Parameters by their physical names, for coefficients of the columns."""
        values = self.theta if theta is None else theta
        names = self.effect.theta_names(records, self.place)
        terms = self.effect.terms
        if len(coef) != len(terms):  # in the place of a feature, with coefficients in each mode
            n_modes = len(coef) // len(terms)
            terms = [f"{name}_mode_{mode}" for mode in range(n_modes) for name in terms]
        return self.effect.physical(
            dict(zip(names, map(float, values), strict=True)),
            dict(zip(terms, map(float, coef), strict=True)),
        )

    def design(self, columns: Array, modes: NDArray[np.intp], n_modes: int) -> Array:
        """Columns that multiply the coefficients: all, those of one mode, or those of each."""
        if self.mode is not None:
            return columns * (modes == self.mode)[:, None]
        if self.replaced is None or n_modes == 1:
            return columns
        return np.column_stack([columns * (modes == mode)[:, None] for mode in range(n_modes)])

    def in_mode(self, coef: Array, mode: int, n_modes: int) -> Array:
        """Coefficients of the columns in one mode; none if the effect does not act in it."""
        if self.mode is not None:
            return coef if mode == self.mode else coef[:0]
        if self.replaced is None or n_modes == 1:
            return coef
        return coef.reshape(n_modes, -1)[mode]

    @property
    def signature(self) -> tuple:
        """What tells it from other candidates, nonlinear parameters aside."""
        return (self.effect.kind, self.place, self.target, self.mode, self.replaced)


@dataclass(frozen=True)
class Trial:
    """A candidate and how it predicts rows that it has not seen.

    Attributes
    ----------
    candidate : PlacedEffect
        With the nonlinear parameters that suit all rows of the search.
    change : ndarray of shape (n_samples,)
        What the candidate adds to the prediction of the target on held-out rows.
    grid : tuple of ndarray
        Values that were scanned.
    by_fold : list of int
        Value of the scan that suits each fold, and all rows at the end.
    """

    candidate: PlacedEffect
    change: Array
    grid: Array
    by_fold: tuple[int, ...]


@dataclass(frozen=True)
class Bench:
    """Everything a trial needs: the whole record, the rows of the search and their regression.

    Columns with a memory are computed along whole trajectories and cut to the rows afterwards.
    """

    records: Records
    rows: NDArray[np.intp]
    regression: Regression
    linear: dict[int, int]  # feature that is a channel itself
    fit: Any = None
    kept: dict = field(default_factory=dict, repr=False)
    taken: set = field(default_factory=set)  # (target, feature) whose place another effect has

    @cached_property
    def backgrounds(self) -> list[Background]:
        """One for each fold, and the one of all rows at the end."""
        return self.backgrounds_without(None)

    def backgrounds_without(self, feature: int | None) -> list[Background]:
        """As `backgrounds`, from regressions without one feature."""
        key = ("backgrounds", feature)
        if key not in self._known:
            problem = self.regression if feature is None else self.regression.without(feature)
            folds = [*range(len(problem.folds.parts)), None]
            self._known[key] = [problem.background(fold) for fold in folds]
        return self._known[key]

    @cached_property
    def _known(self) -> dict:
        return {}

    @cached_property
    def held_out(self) -> Array:
        """Residuals of the declared model on rows that it has not seen."""
        return self.regression.held_out_residuals()

    @cached_property
    def loss(self) -> Array:
        """Weighted sum of squares of `held_out` in each block, (n_blocks, n_states)."""
        return self.regression.block_sums(self.held_out**2)

    def columns(self, effect: Any, place: Any, grid: Array) -> Array:
        """Columns for every row of a grid of parameters, (n_samples, n_values, n_terms)."""
        listed = [effect.columns(self.records, place, *theta)[self.rows] for theta in grid]
        return np.stack(listed, axis=1)

    def scanned_columns(self, effect: Any, place: Any, grid: Array) -> Array:
        """As `columns`, and kept: the next scan of the same record asks for them again."""
        key = (id(effect), place)
        if key not in self.kept:
            self.kept[key] = self.columns(effect, place, grid)
        return self.kept[key]

    @cached_property
    def velocities(self) -> Array:
        """Measured velocities on the rows of the search, modelled ones elsewhere."""
        velocities = self.fit.predict(self.records)
        velocities[self.rows] = self.regression.targets
        return velocities

    @cached_property
    def all_modes(self) -> NDArray[np.intp]:
        """Modes of the whole record according to the surface."""
        return self.fit.predict_modes(self.records)

    @property
    def loudest_state(self) -> int:
        """State whose laws differ most between the modes."""
        coef = self.fit.switching.coef_
        sizes = np.abs(self.regression.features[:, : coef.shape[2]]).mean(axis=0)
        apart = (np.ptp(coef, axis=0) * sizes).sum(axis=1)
        return int(np.argmax(apart / self.regression.targets.std(axis=0)))

    def likely_modes(self) -> NDArray[np.intp]:
        """The mode whose law fits best, row by row, whatever the surface says."""
        seen = self.records.take(self.rows)
        fields = self.fit.mode_velocities(seen)
        errors = self.regression.targets - fields
        chosen = np.take_along_axis(errors, self.regression.modes[None, :, None], axis=0)[0]
        scale = robust_scale(chosen) + 1e-300
        return np.argmin(np.sum((errors / scale) ** 2, axis=2), axis=0)

    def misfit(self, records: Records) -> float:
        """Negative log likelihood of what the laws leave over on other records."""
        problem = self.regression
        features = self.fit.features(records)[self.rows]
        n_library = features.shape[1]
        other = replace(
            problem, features=np.column_stack([features, problem.features[:, n_library:]])
        )
        floor = exact_below(problem.targets)
        again = replace(other, weight=robust_weights(other.background(None).left_over, floor))
        left = again.background(None).left_over
        return float(STUDENT.cost(left, STUDENT.scale(left, floor)).sum())

    @property
    def n_targets(self) -> int:
        """Number of state equations."""
        return self.regression.targets.shape[1]

    def mismatch(self, records: Records, state: int) -> float:
        """Median square of what a recorded state moves beyond its own measured velocity."""
        assert records.t is not None
        values, velocity = records.channel(state), self.velocities[:, state]
        missed = []
        for rows in records.trajectories:
            step, rate = np.diff(records.t[rows]), velocity[rows]
            if self.fit.switching.discrete_time:
                missed.append(values[rows][1:] - rate[:-1])
            else:
                missed.append(np.diff(values[rows]) - 0.5 * step * (rate[1:] + rate[:-1]))
        return float(np.median(np.concatenate(missed) ** 2))

    def is_spanned(self, effect: Any, place: Any) -> bool:
        """True if the library leaves nothing of an effect's columns, which have no parameters."""
        if effect.parameters(self.records, place):
            return False
        columns = self.columns(effect, place, np.empty((1, 0)))
        gram, _, size, _ = self.backgrounds[-1].normal_equations(columns)
        left = np.einsum("gqq->gq", gram.sum(axis=0))
        return bool((left <= COLLINEAR * size.sum(axis=0)).all())

    def loss_of(self, trial: Trial) -> Array:
        """Weighted sum of squares in each block with the effect added."""
        error = self.held_out[:, trial.candidate.target] - trial.change
        return self.regression.block_sums(error**2)

    def p_value(self, trial: Trial) -> float:
        """Probability of so good a prediction of the residual if there were no effect.

        A one-sided test of the slope of the held-out residuals on the predicted change, its
        error robust to whatever happens inside a block.
        """
        residual = self.held_out[:, trial.candidate.target]
        moments = self.regression.block_sums(
            np.column_stack([residual * trial.change, trial.change**2])
        )
        size = moments[:, 1].sum()
        if size <= 0.0:
            return 1.0
        slope = moments[:, 0].sum() / size
        scatter = float(np.sum((moments[:, 0] - slope * moments[:, 1]) ** 2))
        n_blocks = len(moments)
        error = np.sqrt(scatter * n_blocks / max(n_blocks - 1, 1)) / size
        if error == 0.0:
            return 0.0 if slope > 0 else 1.0
        return float(stats.t.sf(slope / error, n_blocks - 1))
