"""What is known of the laws of recordings: where a descent begins, and what the data say of it."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._known.checks import KnownCheck, Released, checks
from swsysid._known.known import Known
from swsysid._known.region import Region
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.descent import Reached, descended
from swsysid._stays.equations import NodeEquations
from swsysid._stays.identification import StayIdentification, counted_as_one
from swsysid._stays.laws import Laws
from swsysid._stays.origin import Origin
from swsysid._stays.samples import misfits
from swsysid._stays.settings import SETTINGS

_RIDGE = 1e-9  # of the metric of coefficients: what features do not tell moves least


@dataclass(frozen=True)
class Knowledge:
    """What a user knows, and where the columns are counted from while laws are sought."""

    known: Known | None
    origin: Origin

    def region(self, model: SwitchingSystemRegressor) -> Region | None:
        """Of the coefficients of a model of columns counted from the origin; None for all."""
        if self.known is None:
            return None
        features, (n_modes, n_states, _) = model.switching_model.feature_map, model.coef_.shape
        equations = features.names_in[:n_states]
        region = self.known.region(equations, list(features.names_out), n_modes)
        return region.by(self.origin.change(features)) if self.origin.moves else region

    def check(self, model: SwitchingSystemRegressor, possible: NDArray[np.bool_]) -> None:
        """ValueError where it contradicts coefficients of a model that are not `possible` else."""
        if (region := self.region(model)) is not None:
            region.check(model.coef_, possible)

    def sought(
        self, model: SwitchingSystemRegressor, possible: NDArray[np.bool_], free: NDArray[np.bool_]
    ) -> NDArray[np.bool_]:
        """Coefficients that are sought, where without it these are `free`; the model is told."""
        if (region := self.region(model)) is None:
            return free
        fixed, values = region.fixed
        model.coef_ = np.where(fixed, values, model.coef_)
        return region.sought(free, possible)


NOTHING = Knowledge(None, Origin(np.zeros(0)))


def placed(laws: Laws, columns: Array) -> Laws:
    """The laws whose velocities at rows are nearest to given ones, of those that are allowed."""
    if laws.region is None:
        return laws
    features = laws.features(columns)
    mode, state, feature = laws.places
    gram = features.T @ features / len(features)
    gram += _RIDGE * np.diag(np.where(np.diag(gram) > 0.0, np.diag(gram), 1.0))
    alike = (mode[:, None] == mode) & (state[:, None] == state)
    metric = np.where(alike, gram[np.ix_(feature, feature)], 0.0) / np.square(laws.spread[state])
    return replace(laws, coef=laws.region.nearest(laws.coef, laws.free, metric))


def checked(found: StayIdentification) -> tuple[KnownCheck, ...]:
    """What the recordings would rather have, for each thing known, and how surely."""
    laws = found.estimate.laws
    if laws.region is None:
        return ()
    wide = replace(laws, free=laws.free | laws.region.touched)
    estimate = replace(found.estimate, laws=wide)
    return checks(_StayFit(replace(found.reached, estimate=estimate)), laws.region)


@dataclass(frozen=True)
class _StayFit:
    """The most likely estimate, all coefficients free of which anything is known."""

    reached: Reached

    @property
    def coef(self) -> Array:
        return self.reached.estimate.laws.coef

    @property
    def free(self) -> NDArray[np.bool_]:
        return self.reached.estimate.laws.free

    @cached_property
    def _equations(self) -> NodeEquations:
        return self.reached.objective.normal_equations(self.reached.estimate)

    @cached_property
    def unit(self) -> tuple[float, float]:
        """Mean square of what is left, in units of the noise; samples that count as one."""
        left = misfits(self.reached.estimate) / self.reached.noise
        return float(np.nansum(np.square(left)) / self._freedom), counted_as_one(self.reached)

    @property
    def _freedom(self) -> float:
        seen = np.isfinite(self.reached.estimate.nodes.y).sum()
        return max(1.0, float(seen) - self.reached.n_unknowns)

    def released(self, region: Region) -> Released:
        """By the step of Gauss and Newton, with the noise that is left after it."""
        other, equations = self._of(region), copy(self._equations)
        laws = other.reached.estimate.laws
        equations.steps = laws.steps
        step, gain = equations.step(0.0)
        moved = _StayFit(replace(self.reached, estimate=other.reached.estimate.moved(step)))
        change = np.zeros(laws.coef.shape)
        change[laws.places] = step[: len(laws.places[0])]
        unit, as_one = min(self.unit, moved.unit)
        return Released(
            change, gain, unit * as_one, self._freedom / as_one, lambda: _of_laws(equations)
        )

    def refitted(self, region: Region) -> _StayFit:
        """By a descent from here, its stays as they are."""
        estimate, objective = self._of(region).reached.estimate, self.reached.objective
        n_turns = SETTINGS.ties[-1][1]
        estimate, value = descended(estimate, objective, n_turns, SETTINGS)
        return _StayFit(Reached(estimate, objective, value))

    def _of(self, region: Region) -> _StayFit:
        laws = replace(self.reached.estimate.laws, region=region)
        return _StayFit(replace(self.reached, estimate=replace(self.reached.estimate, laws=laws)))


def _of_laws(equations: NodeEquations) -> Array:
    """Covariance of the coefficients, infinite where nothing tells."""
    covariance = equations.covariance()
    of_laws = covariance.of_laws
    every = np.arange(len(of_laws))
    of_laws[every, every] = np.where(covariance.untold_laws, np.inf, of_laws[every, every])
    return of_laws
