"""What is known of the laws of recordings: where a descent begins, and what the data say of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from swsysid._known.checks import KnownCheck, Released, checks
from swsysid._known.known import Known
from swsysid._known.region import Region
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import Array
from swsysid._stays.descent import Reached
from swsysid._stays.equations import NodeEquations
from swsysid._stays.identification import StayIdentification, counted_as_one, leaves_noise
from swsysid._stays.laws import Laws
from swsysid._stays.origin import Origin
from swsysid._stays.samples import Samples, misfits
from swsysid._ties import least_of
from swsysid.metrics._modes import best_matching, contingency

_RIDGE = 1e-9  # of the metric of coefficients: what features do not tell moves least


@dataclass(frozen=True)
class Knowledge:
    """What a user knows, and where the columns are counted from while laws are sought."""

    known: Known | None
    origin: Origin
    left_out: frozenset[int] = frozenset()  # numbers of sentences that are not held

    def region(self, model: SwitchingSystemRegressor) -> Region | None:
        """Of the coefficients of a model of columns counted from the origin; None for all."""
        if self.known is None:
            return None
        features, (n_modes, n_states, _) = model.switching_model.feature_map, model.coef_.shape
        equations = features.names_in[:n_states]
        region = self.known.region(equations, list(features.names_out), n_modes, self.left_out)
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


class Again:
    """Identifications with some of the sentences left out, each made once."""

    def __init__(
        self,
        identified: Callable[[frozenset[int]], StayIdentification],
        estimator: SwitchingSystemRegressor,
        noise: Array,  # as neighbouring samples show it
    ):
        self._identified, self.n_modes, self.noise = identified, estimator.n_modes, noise
        self._done: dict[frozenset[int], Reached] = {}

    def __call__(self, left_out: frozenset[int]) -> Reached:
        """What is most likely without some of the sentences."""
        if left_out not in self._done:
            self._done[left_out] = self._identified(left_out).reached
        return self._done[left_out]


def checked(found: StayIdentification, again: Again) -> tuple[KnownCheck, ...]:
    """What the recordings would rather have, for each thing known, and how surely."""
    region = found.estimate.laws.region
    return () if region is None else checks(_StayFit.of(found.reached, again), region)


@dataclass(frozen=True)
class _StayFit:
    """The most likely estimate, all coefficients free of which anything is known."""

    reached: Reached
    again: Again

    @classmethod
    def of(cls, reached: Reached, again: Again) -> _StayFit:
        """That of what an identification has reached."""
        laws = reached.estimate.laws
        assert laws.region is not None
        laws = replace(laws, free=laws.free | laws.region.whole.touched)
        return cls(replace(reached, estimate=replace(reached.estimate, laws=laws)), again)

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
        return float(np.nansum(np.square(left)) / self.freedom), counted_as_one(self.reached)

    @property
    def freedom(self) -> float:
        """Values less unknowns."""
        seen = np.isfinite(self.reached.estimate.nodes.y).sum()
        return max(1.0, float(seen) - self.reached.n_unknowns)

    def released(self, region: Region) -> Released:
        """By the step of Gauss and Newton, with the noise that is left after it."""
        laws = replace(self.reached.estimate.laws, region=region)
        other, equations = replace(self.reached.estimate, laws=laws), copy(self._equations)
        equations.steps = laws.steps
        step, gain = equations.step(0.0)
        moved = replace(self, reached=replace(self.reached, estimate=other.moved(step)))
        change = np.zeros(laws.coef.shape)
        change[laws.places] = step[: len(laws.places[0])]
        unit, as_one = min(self.unit, moved.unit)
        return Released(
            change, gain, unit * as_one, self.freedom / as_one, lambda: _of_laws(equations)
        )

    @property
    def falls_short(self) -> bool:
        asked = self.again.n_modes
        fewer = asked != "auto" and len(self.coef) < int(asked)
        return fewer or not leaves_noise(self.reached, self.again.noise)

    def without(self, left_out: frozenset[int]) -> _StayFit:
        return self._named(self.again(left_out))

    def log_p_beside(self, other: _StayFit) -> float:
        gain = self.reached.with_noise(other.reached.noise).value - other.reached.value
        n_free = max(1.0, other.reached.n_unknowns - self.reached.n_unknowns)
        unit, as_one = other.unit
        statistic = 2.0 * max(0.0, gain) / (n_free * unit * as_one)
        return float(fisher.logsf(statistic, n_free, other.freedom / as_one))

    def likeliest(self, others: Mapping[int, _StayFit]) -> int:
        noise = np.min([one.reached.noise for one in others.values()], axis=0)
        price = 0.5 * np.log(max(2.0, self.freedom))
        return least_of(
            sorted(others),
            lambda k: (
                others[k].reached.with_noise(noise).value + price * others[k].reached.n_unknowns
            ),
        )

    def _named(self, reached: Reached) -> _StayFit:
        """What was reached without a sentence, its modes named as these are."""
        n_modes = len(self.coef)
        if len(reached.estimate.laws.coef) == n_modes:  # integrated in other steps, perhaps
            both = [Samples.of(one.estimate).modes for one in (reached, self.reached)]
            beside = (both[0] < n_modes) & (both[1] < n_modes)  # no slides
            joint = contingency(both[0][beside], both[1][beside], shape=(n_modes, n_modes))
            estimate = reached.estimate.renamed(best_matching(joint)[1])
            reached = replace(reached, estimate=estimate)
        return _StayFit.of(reached, self.again)


def _of_laws(equations: NodeEquations) -> Array:
    """Covariance of the coefficients, infinite where nothing tells."""
    covariance = equations.covariance()
    of_laws = covariance.of_laws
    every = np.arange(len(of_laws))
    of_laws[every, every] = np.where(covariance.untold_laws, np.inf, of_laws[every, every])
    return of_laws
