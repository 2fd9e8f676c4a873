r"""Whether one structure predicts better than another one by chance.

Two tests, each valid if the simpler structure is true, and the clearer of them counts, corrected
for both. With likelihoods p of a row before and q after, :math:`z = (q - p) / (q + p)` has no
positive mean where p is true, whatever q is, for it is concave in q / p; unlike the logarithm, of
which a few rows hold most, it is bounded. So (i) the sums of z in independent blocks, and (ii) bets
on it, are tested.

Where residuals remember each other for long a regression is hardly sure of anything, although the
sample before says most of what they are. Likelihoods are compared with a force that is forgotten
slowly beneath the noise, with an effect and without it (`SlowForces`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from swsysid._effect_search.chance import BlockSum, chance_of_bets
from swsysid._effect_search.coloured_noise import (
    Coloured,
    Stretches,
    beneath_a_law,
    coloured,
    in_trajectories,
    rows_in_order,
    white,
)
from swsysid._effect_search.folds import memory_of
from swsysid._effect_search.held_out import held_out_errors
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._noise import robust_scale
from swsysid._results import Array

_SHARE_OF_A_DISTURBANCE = 0.05  # what effects leave over a little is no force
_SLOW_STEPS = 4  # steps of the record that a force is remembered for, unlike noise
_OFTEN = 0.1  # share of the rows with gross errors that last: then they are a force


def chance_of_gains(context: SearchContext, before: Structure, after: Structure) -> float:
    """Of predictions that are so much better: of sums of gains in blocks, and of bets on them."""
    gains = before.rows - after.rows
    # Modes, a surface and weights that were fitted to all rows bend to those that are to be
    # predicted; where there are several modes fits that have not seen the rows are judge.
    if after.fit.n_modes > 1 and after.fit.guard is None:
        gains = context.unseen_cost(before) - context.unseen_cost(after)
    values, data = np.tanh(0.5 * gains), context.data
    # What it remembers by chance is what the residuals do.
    left = after.fit.residuals(data.records, data.rows, data.targets)
    remembered = memory_of(data.records.take(data.rows), left[:, data.counted_states])
    blocks = data.folds.blocks_beyond(remembered)
    sums = BlockSum.of(np.bincount(blocks, values).astype(float))
    bets = chance_of_bets(values, blocks, remembered)
    chance = min(1.0, 2.0 * min(sums.chance, bets))  # the clearer of two tests
    if not after.fit.remembers or before.fit.remembers:
        return chance
    # A guard that remembers concerns few rows in few blocks. None of them decides, for a sure
    # surface is wrong now and then; and chance makes a likelihood ratio r with 1 / r at most.
    ratio = float(np.exp(min(0.0, (after.price - before.price) / remembered)))
    return min(1.0, 2.0 * min(chance, ratio))


@dataclass(frozen=True)
class SlowForces:
    """What residuals of held-out rows say of a force that is forgotten slowly."""

    context: SearchContext

    @cached_property
    def _ordered(self) -> tuple[NDArray[np.intp], Stretches]:
        return rows_in_order(self.context.data)

    @property
    def where(self) -> Stretches:
        """The rows of the search in order."""
        return self._ordered[1]

    @cached_property
    def _declared(self) -> Structure:
        return self.context.priced(self.context.declared)

    def residuals(self, structure: Structure, target: int) -> Array:
        """What regressions leave over of rows they have not seen; a gross error says nothing."""
        # What is gross for as long as a force is remembered, and often, is the force, far above the
        # noise; where it is rare it may be a place at which the structure is wrong.
        data = self.context.data
        if _may_run_away(structure):
            left = held_out_errors(structure.fit, data)[:, target]
        else:
            left = self.context.candidates(structure.fit).held_out[:, target]
        # what holds a plant that sticks is a reaction, and no force
        left = np.where(data.may_stick(structure.fit.terms, data.records, data.rows), 0.0, left)
        gross = SETTINGS.gross * max(
            float(robust_scale(left[:, None])[0]), float(data.exact[target])
        )
        left = left[self._ordered[0]]
        far = np.abs(left) > gross
        lasting = far & (self.where.runs(far) >= _SLOW_STEPS)
        often = lasting.mean() >= _OFTEN
        return np.where(far & ~(lasting & often), 0.0, left)

    def gain(self, fewer: Structure, structure: Structure, target: int) -> tuple[BlockSum, int]:
        """By how much effects raise the likelihood beside a force, as the stretches tell it.

        And the number of parameters that they have more.
        """
        # A filter that smears what an effect does leaves jumps where the effect has none, and the
        # other way round, which neither has made: rows are compared that share no samples. What is
        # gross without the effects and not with them is what they explain, and no force.
        residuals = self.residuals(structure, target)
        every = self._smeared(residuals)
        usual = residuals != 0.0
        # A force that outlasts a stretch is known in the next one: else a line through all of them
        # would explain at each what the past does.
        order, where = in_trajectories(self.context.data).taken(usual).decimated(every)
        rows, stretch = self._ordered[0][usual][order], self.where.stretch[usual][order]
        gains = np.zeros(int(self.where.stretch.max()) + 1)
        for sign, option in ((-1.0, fewer), (1.0, structure)):
            features, y = self._law(option, target)
            model, left = beneath_a_law(features[rows], y[rows], where)
            gain = sign * model.log_likelihood(left, where)
            gains += np.bincount(stretch, gain, len(gains)) / every
        return BlockSum.of(gains), structure.n_parameters - fewer.n_parameters

    def disturbance(self, structure: Structure, target: int) -> tuple[Coloured, float] | None:
        """The force beneath what a structure leaves over of a state, and its p-value."""
        left = self.residuals(structure, target)
        model = coloured(left, self.where)
        p_value = self._p_value(model, left, target)
        surely = p_value <= self.context.significance and self._is_slow(model, left)
        return (model, p_value) if surely else None

    def remembers(self, structure: Structure, target: int) -> bool:
        """Whether it leaves something behind that is remembered, and that no filter has made.

        What is forgotten in a sample or two may be noise, and is no force; but the states remember
        it all the same.
        """
        left = self.residuals(structure, target)
        model = coloured(left, self.where)
        if self._p_value(model, left, target) > self.context.significance:
            return False
        # A filter has smeared the velocities, and so what any of the laws leave of them.
        declared = self.residuals(self._declared, target)
        is_filtered = max(self._smeared(left), self._smeared(declared)) > 1
        return not is_filtered or self._is_slow(model, left)

    def chance(self, fewer: Structure, structure: Structure, target: int) -> tuple[float, float]:
        """Of what effects gain beside a force that they leave behind, and that by its blocks.

        Both are one where there is none.
        """
        if not self.context.data.records.timed or self.disturbance(structure, target) is None:
            return 1.0, 1.0
        gain, more = self.gain(fewer, structure, target)
        by_chance = stats.chi2.sf(2.0 * max(gain.value - gain.error, 0.0), max(more, 1))
        return float(by_chance), replace(gain, value=gain.value - more).chance

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
            return SETTINGS.rows_a_window
        return self.where.smeared(left)

    def _steps(self, left: Array) -> int:
        """Steps after which no noise, and no filter of it, is remembered."""
        return max(_SLOW_STEPS, self._smeared(left))

    def _p_value(self, model: Coloured, left: Array, target: int) -> float:
        """That of a memory of residuals; one if it explains too little to be worth a name."""
        squares = self.context.declared_squares
        gain = _lead(model, white(left), left, self.where)
        p_value = len(squares) * float(stats.chi2.sf(2.0 * max(gain, 0.0), 2))
        worth = model.size**2 >= _SHARE_OF_A_DISTURBANCE * squares[target]
        enough = gain >= SETTINGS.gain_a_row * len(left)
        return p_value if worth and enough else 1.0

    def _is_slow(self, model: Coloured, left: Array) -> bool:
        """Whether a force is surely remembered for longer than noise is."""
        least = self._steps(left) * self.where.step
        if model.time_constant < least:
            return False
        lead = _lead(model, coloured(left, self.where, least), left, self.where)
        # half of the estimates of a force at the limit are slower than it
        return float(stats.chi2.sf(2.0 * max(lead, 0.0), 1)) <= 2.0 * self.context.significance


def _may_run_away(structure: Structure) -> bool:
    """Whether a part of the rows may say nothing of what acts on the others."""
    return any(len(term.effect.prior) for term in structure.terms)


def _lead(one: Coloured, other: Coloured, left: Array, where: Stretches) -> float:
    """Gain in log likelihood of one model of residuals over another."""
    gains = one.log_likelihood(left, where) - other.log_likelihood(left, where)
    return float(gains.sum())
