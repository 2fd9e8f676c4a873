"""A disturbance as an answer: what is correlated in time and follows no channel.

A slow force that nobody measured looks like a drift, an offset, a forcing, a lag or a polynomial
of whatever moves as slowly. Each effect found has therefore to show that it predicts stretches that
its regression has not seen better than the past of the residual itself does: likelihoods are
compared with a force that is forgotten slowly beneath the noise, with the effect and without it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swsysid._effect_search.acceptance import Finding, confirmed
from swsysid._effect_search.coloured import (
    Coloured,
    Stretches,
    beneath_a_law,
    coloured,
    in_trajectories,
    rows_in_order,
    white,
)
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._noise import robust_scale
from swsysid._results import Array
from swsysid.effects import (
    GuardEffect,
    MeasurementEffect,
    PlacedEffect,
    ResetEffect,
    UnmeasuredDisturbance,
)

Findings = tuple[Finding, ...]


def with_disturbances(
    context: SearchContext, structure: Structure, findings: Findings, n_candidates: int
) -> tuple[Structure, Findings]:
    """The structure without effects that a disturbance explains as well, and with disturbances."""
    usable = [one for one in context.usable if isinstance(one, UnmeasuredDisturbance)]
    if not usable:
        return structure, findings
    questions = _Questions(context, n_candidates)
    kept = questions.needed(structure)
    if kept is not structure:
        structure, findings = confirmed(context, kept)
    fit, added, records = structure.fit, [], context.data.records
    # a force acts on no position: that q' = v is what velocities are
    forced = [one for one in records.states if one not in records.positions]
    for target in forced:
        found = questions.disturbance(structure, target)
        if found is not None:
            model, p_value = found
            theta = (model.size, model.time_constant)
            term = PlacedEffect(usable[0], "time", target, theta=theta)
            added.append(Finding.of(term, p_value, ()))
    if added:
        terms = tuple(one.candidate for one in added)
        coef = tuple(np.zeros(0) for _ in added)
        more = replace(fit, terms=(*fit.terms, *terms), coef=(*fit.coef, *coef))
        structure = replace(structure, fit=more)
    return structure, (*findings, *added)


@dataclass(frozen=True)
class _Questions:
    """What residuals of held-out rows say of a force that is forgotten slowly."""

    context: SearchContext
    n_candidates: int  # of the search for the effects in question

    @cached_property
    def _ordered(self) -> tuple[NDArray[np.intp], Stretches]:
        return rows_in_order(self.context.data)

    @property
    def where(self) -> Stretches:
        """The rows of the search in order."""
        return self._ordered[1]

    def residuals(self, structure: Structure, target: int) -> Array:
        """What regressions leave over of rows they have not seen; a gross error says nothing."""
        # What is gross for as long as a force is remembered, and often, is the force, far above the
        # noise; where it is rare it may be a place at which the structure is wrong.
        settings = self.context.settings
        left = self.context.candidates(structure.fit).held_out[:, target]
        data = self.context.data
        # what holds a plant that sticks is a reaction, and no force
        left = np.where(data.may_stick(structure.fit.terms, data.records, data.rows), 0.0, left)
        gross = settings.gross * max(
            float(robust_scale(left[:, None])[0]), float(data.exact[target])
        )
        left = left[self._ordered[0]]
        far = np.abs(left) > gross
        lasting = far & (self.where.runs(far) >= settings.slow_steps)
        often = lasting.mean() >= settings.often
        return np.where(far & ~(lasting & often), 0.0, left)

    def needed(self, structure: Structure) -> Structure:
        """The structure without the effects that predict no better than a disturbance would."""
        # Several together may be what an observer makes of a force, from the inputs and states of
        # a while ago: then none of them leaves a force behind that is surely slow, and all do.
        least = np.log(self.n_candidates / self.context.significance)
        while True:
            asked = [(self._gain_of(structure, group), group) for group in _asked(structure)]
            gain, group = min(asked, default=(np.inf, ()))
            if gain > least:
                return structure
            structure = self._without(structure, group)

    def _without(self, structure: Structure, group: tuple[int, ...]) -> Structure:
        for place in sorted(group, reverse=True):
            structure = self.context.without(structure, place)
        return structure

    def _gain_of(self, structure: Structure, group: tuple[int, ...]) -> float:
        """By how much effects raise the likelihood beside a disturbance, less its error.

        Infinite where there would be no disturbance without them.
        """
        target = structure.terms[group[0]].target
        fewer = self._without(structure, group)
        without = self.residuals(fewer, target)
        if self._p_value(coloured(without, self.where), without, target) is None:
            return np.inf
        # A filter that smears what an effect does leaves jumps where the effect has none, and the
        # other way round, which neither has made: rows are compared that share no samples. What is
        # gross without the effects and not with them is what they explain, and no force.
        beside = self.residuals(structure, target)
        every = self._smeared(beside)
        usual = beside != 0.0
        # A force that outlasts a stretch is known in the next one: else a line through all of them
        # would explain at each what the past does.
        order, where = in_trajectories(self.context.data).taken(usual).apart(every)
        rows, stretch = self._ordered[0][usual][order], self.where.stretch[usual][order]
        gains = np.zeros(int(self.where.stretch.max()) + 1)
        for sign, option in ((-1.0, fewer), (1.0, structure)):
            features, y = self._law(option, target)
            model, left = beneath_a_law(features[rows], y[rows], where)
            gain = sign * model.log_likelihood(left, where)
            gains += np.bincount(stretch, gain, len(gains)) / every
        more = structure.n_parameters - fewer.n_parameters  # each explains a nat of noise (Akaike)
        return float(gains.sum() - more - gains.std(ddof=1) * np.sqrt(len(gains)))

    def _law(self, structure: Structure, target: int) -> tuple[Array, Array]:
        """Columns of all that acts on a state, mode by mode, and its velocities."""
        problem = self.context.candidates(structure.fit).regression
        each = [
            problem.features[:, problem.support[mode, target]] * (problem.modes == mode)[:, None]
            for mode in range(problem.n_modes)
        ]
        columns = np.column_stack(each)
        return columns[:, columns.any(axis=0)], problem.targets[:, target]

    def _smeared(self, left: Array) -> int:
        """Over how many steps a filter has smeared residuals, one where none has."""
        # The filter of a recording is known; that of velocities as they are given is not.
        if self.context.data.records.average is not None:
            return self.context.settings.rows_a_window
        return self.where.smeared(left)

    def _steps(self, left: Array) -> int:
        """Steps after which no noise, and no filter of it, is remembered."""
        return max(self.context.settings.slow_steps, self._smeared(left))

    def disturbance(self, structure: Structure, target: int) -> tuple[Coloured, float] | None:
        """The force beneath what a structure leaves over of a state, and its p-value."""
        left = self.residuals(structure, target)
        model = coloured(left, self.where)
        p_value = self._p_value(model, left, target)
        return None if p_value is None else (model, p_value)

    def _p_value(self, model: Coloured, left: Array, target: int) -> float | None:
        """That of a force beneath residuals; None if it is not worth the name."""
        settings, squares = self.context.settings, self.context.declared_squares
        gain = self._lead(model, white(left), left)
        p_value = len(squares) * float(stats.chi2.sf(2.0 * max(gain, 0.0), 2))
        worth = model.size**2 >= settings.share_of_a_disturbance * squares[target]
        enough = gain >= settings.gain_a_row * len(left)
        if not (worth and enough and p_value <= self.context.significance):
            return None
        return p_value if self._is_slow(model, left) else None

    def _is_slow(self, model: Coloured, left: Array) -> bool:
        """Whether a force is surely remembered for longer than noise is."""
        least = self._steps(left) * self.where.step
        if model.time_constant < least:
            return False
        lead = self._lead(model, coloured(left, self.where, least), left)
        # half of the estimates of a force at the limit are slower than it
        return float(stats.chi2.sf(2.0 * max(lead, 0.0), 1)) <= 2.0 * self.context.significance

    def _lead(self, one: Coloured, other: Coloured, left: Array) -> float:
        """Gain in log likelihood of one model of residuals over another."""
        gains = one.log_likelihood(left, self.where) - other.log_likelihood(left, self.where)
        return float(gains.sum())


def _asked(structure: Structure) -> list[tuple[int, ...]]:
    """Effects that a disturbance may explain, one by one and all of an equation."""
    by_target: dict[int, list[int]] = {}
    for place, term in enumerate(structure.terms):
        if not isinstance(term.effect, (GuardEffect, MeasurementEffect, ResetEffect)):
            by_target.setdefault(term.target, []).append(place)
    together = [tuple(places) for places in by_target.values()]
    alone = [(place,) for places in together for place in places]
    return list(dict.fromkeys([*alone, *together]))
