"""What a candidate is tried beside: a fit, its rows and modes, and regressions on its library.

A trial fits everything on training folds, nonlinear parameters included, and predicts the rows it
has not seen. What it is worth is measured there only.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.features import linear_features
from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit, known_modes
from swsysid._effect_search.chance import Slope
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.regression import Background, Regression, SharedSums
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.switches import at_smeared_switches
from swsysid._noise import STUDENT, robust_weights
from swsysid._results import Array
from swsysid._ties import ROUNDING
from swsysid.effects import Effect, PlacedEffect
from swsysid.effects._base import Place
from swsysid.effects._placed import corrected

_SURE = 0.95  # a row whose mode is less sure than this says nothing about the laws


# Values that were scanned and theirs, with the effect, whose identity is the key while it is kept.
Columns = dict[tuple[int, Place], tuple[Effect, Array, Array]]


@dataclass(frozen=True)
class Trial:
    """A candidate and how it predicts rows that it has not seen."""

    candidate: PlacedEffect  # with the nonlinear parameters that suit all rows of the search
    change: Array  # what it adds to the prediction of its target on held-out rows
    grid: Array  # values that were scanned, (n_values, n_theta)
    by_fold: tuple[int, ...]  # that which suits each fold, and all rows at the end


@dataclass
class Scan:
    """Trials of some effects beside a fit, the best first, and those refined by their rank."""

    effects: tuple[Effect, ...]
    trials: list[Trial]
    gains: Array  # of each, (n_trials,)
    refined: dict[int, Trial] = field(default_factory=dict)


@dataclass(frozen=True)
class CandidateContext:
    """A fit beside which candidates are tried."""

    fit: JointFit
    data: SearchData  # with the record as the sensors of the fit would have it
    regression: Regression  # of the library and the columns of the effects found so far
    linear: dict[int, int]  # which channel (key) is which feature
    other_terms: tuple[tuple[PlacedEffect, slice], ...]  # effects found so far, and their features
    replaced: set[tuple[int, int]]  # (target, feature) whose place another effect has
    kept: Columns = field(repr=False)  # that were computed before
    scans: dict[tuple[int, ...], Scan] = field(default_factory=dict, repr=False)
    _backgrounds: dict[int | None, list[Background]] = field(default_factory=dict, repr=False)
    _sums: dict[int | None, SharedSums] = field(default_factory=dict, repr=False)
    _lost: dict[int | None, Array] = field(default_factory=dict, repr=False)

    @property
    def records(self) -> Records:
        """The record."""
        return self.data.records

    # -- regressions -----------------------------------------------------------------------------

    def problem(self, without: int | None = None) -> Regression:
        """The regression, perhaps without one feature."""
        return self.backgrounds(without)[-1].problem

    def backgrounds(self, without: int | None = None) -> list[Background]:
        """Regressions of each fold, and of all rows at the end; perhaps without one feature."""
        if without not in self._backgrounds:
            problem = self.regression if without is None else self.regression.without(without)
            folds = [*range(len(problem.folds.parts)), None]
            self._backgrounds[without] = [problem.background(fold) for fold in folds]
        return self._backgrounds[without]

    def sums(self, without: int | None = None) -> SharedSums:
        """What the same regressions share."""
        if without not in self._sums:
            self._sums[without] = SharedSums(self.backgrounds(without))
        return self._sums[without]

    def lost(self, without: int | None = None) -> Array:
        """What a missing feature changes in the predictions of held-out rows."""
        if without not in self._lost:
            self._lost[without] = self.held_out - self._held_out(without)
        return self._lost[without]

    @property
    def tests(self) -> list[NDArray[np.intp] | None]:
        """Rows on which the background of each fold is tested; None for that of all rows."""
        return [*(test for _, test in self.regression.folds.parts), None]

    @cached_property
    def held_out(self) -> Array:
        """Residuals of the fit on rows that its regressions have not seen."""
        return self._held_out(None)

    def _held_out(self, without: int | None) -> Array:
        residuals = np.empty_like(self.regression.targets)
        for background, (_, test) in zip(
            self.backgrounds(without), self.regression.folds.parts, strict=False
        ):
            residuals[test] = background.errors(test)
        return residuals

    @cached_property
    def left_over(self) -> Array:
        """What each regression leaves of the targets in question on its training rows.

        Of every sample that a search may look at, nothing where it is no such row.
        """
        # A scan picks the best value of each fold: what suits it must be among those it looks at.
        samples, targets = self.data.searched_rows, self.targets
        left = np.zeros((len(self.searched), len(self.backgrounds()), len(targets)))
        for number, one in enumerate(self.backgrounds()):
            weight = self.regression.weight[one.train, None]
            left[samples[one.train], number] = weight * one.left_over[:, targets]
        return left.reshape(len(left), -1)

    # -- columns ---------------------------------------------------------------------------------

    def columns(self, effect: Effect, place: Place, grid: Array) -> Array:
        """Columns for every row of a grid of parameters, (n_samples, n_values, n_terms)."""
        # Those with a memory are computed along whole trajectories and cut to the rows afterwards.
        listed = [effect.columns(self.records, place, *theta) for theta in grid]
        stacked = np.stack(listed, axis=1)
        flat = self.records.averaged(stacked.reshape(len(stacked), -1), self.data.rows)
        return flat.reshape(-1, *stacked.shape[1:])

    def scanned_columns(self, effect: Effect, place: Place, grid: Array) -> Array:
        """As `columns`, and kept: the next scan of the same record asks for them again."""
        key = (id(effect), place)
        if key not in self.kept or not np.array_equal(self.kept[key][1], grid):
            self.kept[key] = effect, grid, self.columns(effect, place, grid)
        return self.kept[key][2]

    # -- what the data say beside the laws -------------------------------------------------------

    @cached_property
    def velocities(self) -> Array:
        """Measured velocities on the rows of the search, modelled ones elsewhere."""
        velocities = self.fit.predict(self.records, self._most_likely_modes)
        velocities[self.data.rows] = self.regression.targets
        return velocities

    @cached_property
    def surface_modes(self) -> NDArray[np.intp]:
        """Modes of the whole record according to the surface or guard."""
        return self.fit.predict_modes(self.records)

    @property
    def _most_likely_modes(self) -> NDArray[np.intp]:
        """Those that the states show, and where they do not those of the surface."""
        if self.records.decoded_modes is None:
            return self.fit.predict_modes(self.records)
        known = self.known_modes
        return np.where(known >= 0, known, self.surface_modes)

    @cached_property
    def known_modes(self) -> NDArray[np.intp]:
        """Modes of the whole record from the data, -1 where there are none."""
        return known_modes(self.fit, self.records, self.data.rows)

    @cached_property
    def switched_modes(self) -> NDArray[np.intp]:
        """Modes between which the whole record switches: as it tells them, or as the surface."""
        known = self.known_modes
        return self.surface_modes if self.records.decoded_modes is None else known

    @cached_property
    def jumping(self) -> tuple[Records, Array, NDArray[np.intp]]:
        """What jumps are looked for in: samples of the search, their velocities and modes."""
        records = self.data.without_gaps(self.records)
        part = slice(None) if self.data.part is None else self.data.part
        return records, self.velocities[part], self.switched_modes[part]

    @cached_property
    def searched(self) -> Records:
        """The samples that a search may look at."""
        return self.data.searched(self.records)

    @property
    def targets(self) -> list[int]:
        """States whose equations may lack something."""
        return self.data.counted_states

    @property
    def most_switched_state(self) -> int:
        """State whose laws differ most between the modes."""
        library = self.regression.features[:, : self.fit.laws.coef.shape[2]]
        return self.fit.most_switched_state(library, self.regression.targets.std(axis=0))

    def of_channel(self, channel: Place, target: int) -> list[int]:
        """Features that say what a channel does at present to the velocity of a state."""
        own = [self.linear[channel]] if channel in self.linear else []
        for term, columns in self.other_terms:
            if (term.place, term.target) == (channel, target) and not term.effect.needs:
                own += range(columns.start, columns.stop)
        return own

    def misfit(self, records: Records, own: Records, state: int) -> float:
        """Negative log likelihood of what the laws leave over on other records.

        The equation of a state may have records of its `own`.
        """
        left = self._left_over(records)
        if own is not records:
            left[:, state] = self._left_over(own)[:, state]
        return float(STUDENT.cost(left, STUDENT.scale(left, self.data.exact)).sum())

    def _left_over(self, records: Records) -> Array:
        """What the laws leave over of the rows on other records."""
        problem, floor = self.regression, self.data.exact
        features = self.fit.features(records, self.data.rows)
        known = problem.features[:, features.shape[1] :]
        other = replace(problem, features=np.column_stack([features, known]))
        again = replace(other, weight=robust_weights(other.background(None).left_over, floor))
        return again.background(None).left_over

    # -- what a trial is worth -------------------------------------------------------------------

    def gains(self, trials: list[Trial]) -> Array:
        """Gain in log likelihood of each trial in each block, (n_trials, n_blocks)."""
        # The unit of the squares in each state is what the best of the trials leaves over there.
        before = self.regression.block_sums(self.held_out**2)
        targets = np.array([trial.candidate.target for trial in trials])
        losses = np.array(
            [
                self.regression.block_sums((self.held_out[:, target] - trial.change) ** 2)
                for target, trial in zip(targets, trials, strict=True)
            ]
        )
        least = before.sum(axis=0)
        np.minimum.at(least, targets, losses.sum(axis=1))
        per_row = least / max(self.regression.weight.sum(), 1.0)
        variance = np.maximum(per_row, self.data.exact**2)
        return (before[:, targets].T - losses) / (2.0 * variance[targets])[:, None]

    def level_with(self, best: Trial, trials: list[Trial]) -> dict[int, float]:
        """Places of the trials within one standard error of one of them, and how far behind."""
        gains = self.gains([best, *trials])
        behind = gains[0] - gains[1:]
        error = behind.std(axis=1) * np.sqrt(behind.shape[1])
        lost = behind.sum(axis=1)
        # What explains less than half of it is not as good, however much its gain scatters. What
        # is the same function of these rows lags behind by rounding, and so does the scatter.
        gained = max(float(gains[0].sum()), 0.0)
        most = np.maximum(np.minimum(error, 0.5 * gained), ROUNDING * gained)
        return {place: float(lost[place]) for place in np.flatnonzero(lost <= most).tolist()}

    def evidence(self, trial: Trial) -> Slope:
        """What speaks for a trial: the slope of held-out residuals on the change it predicts."""
        # At a switch that a filter has smeared any effect that changes there explains a part.
        folds, target = self.regression.folds, trial.candidate.target
        left = self.held_out.copy()
        left[:, target] -= trial.change
        smeared = at_smeared_switches(self.data, self.regression.modes, left)
        weight = np.where(smeared, 0.0, self.regression.weight)
        return Slope(trial.change, self.held_out[:, target], weight, folds.series, folds.blocks)

    def p_value(self, trial: Trial) -> float:
        """Probability of so good a prediction of the residual if there were no effect."""
        return self.evidence(trial).chance


def candidate_context(
    fit: JointFit, data: SearchData, without: tuple[int, ...] = (), kept: Columns | None = None
) -> CandidateContext:
    """Candidates are tried beside the library and the columns of the effects found so far."""
    # The columns of the terms `without` are left out, as if these had not been found.
    left = [place for place in range(len(fit.terms)) if place not in without]
    others = [fit.terms[place] for place in left]
    rest = replace(fit, terms=tuple(others), coef=tuple(fit.coef[place] for place in left))
    records = corrected(others, data.records)
    features = fit.features(records, data.rows)
    known = [
        term.design(term.columns(records, data.rows), fit.modes, fit.n_modes) for term in others
    ]
    ends = features.shape[1] + np.cumsum([0, *(part.shape[1] for part in known)])
    regression = Regression(
        features=np.column_stack([features, *known]),
        targets=rest.on_time(data.records, data.rows, data.targets),
        modes=fit.modes,
        n_modes=int(fit.modes.max()) + 1,
        weight=row_weights(fit, data),
        folds=data.folds,
        support=_support(fit, sum(part.shape[1] for part in known)),
    )
    return CandidateContext(
        fit=fit,
        data=replace(data, records=records),
        regression=regression,
        linear=linear_features(fit.library(records)[data.rows], records.X[data.rows]),
        other_terms=tuple(
            (term, slice(*ends[place : place + 2])) for place, term in enumerate(others)
        ),
        replaced={(term.target, term.replaced) for term in others if term.replaced is not None},
        # a corrected record is gone after the context, and so are its columns
        kept=kept if kept is not None and records is data.records else {},
    )


def _support(fit: JointFit, n_known: int) -> NDArray[np.bool_]:
    """Terms that the laws may have in the modes of some rows; columns that are known all may."""
    own = fit.laws.support[: int(fit.modes.max()) + 1]
    return np.concatenate([own, np.ones((*own.shape[:2], n_known), dtype=bool)], axis=2)


def row_weights(fit: JointFit, data: SearchData) -> Array:
    """Small for outliers, none where the mode is in doubt or the plant may stick."""
    residuals = fit.residuals(data.records, data.rows, data.targets)
    weight = robust_weights(residuals, data.exact)
    searched = data.records.take(data.rows)
    sure = fit.mode_proba(searched).max(axis=1) >= _SURE
    sure &= fit.surface_modes(searched) == fit.modes
    if np.mean(~sure) <= SETTINGS.most_unsure:
        weight = np.where(sure, weight, 0.0)
    return np.where(data.may_stick(fit.terms, data.records, data.rows), 0.0, weight)
