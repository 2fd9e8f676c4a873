r"""The score test of effects at every place: what each explains by one step of Gauss and Newton.

Candidates stand in the law with the coefficient zero. With states and starts eliminated, S is the
information on the law's own coefficients (first block) and on those of the candidates (second), g
the negative gradient there. The squares that a candidate explains beside the law are

.. math:: \tilde g^\top \tilde S^{-1} \tilde g, \quad \tilde g = g_2 - S_{21} S_{11}^{-1} g_1, \quad
          \tilde S = S_{22} - S_{21} S_{11}^{-1} S_{12} .
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Protocol, TypeGuard

import numpy as np
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded
from scipy.linalg.lapack import dtbtrs

from swsysid._data.records import Records
from swsysid._journal import step
from swsysid._output_error.estimate import Fitted, of_samples
from swsysid._output_error.law import Law
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid._stays.arrow import Arrow
from swsysid._stays.descent import most_likely
from swsysid._stays.flow import joined_legs, steady_legs
from swsysid._stays.laws import slope_of
from swsysid._stays.lifted import Estimate, Objective
from swsysid._stays.settings import SETTINGS as STAYS
from swsysid._ties import largest_first
from swsysid.effects import (
    Effect,
    MeasurementEffect,
    PlacedEffect,
    Quantisation,
    RateEffect,
    UnknownFunction,
)
from swsysid.effects._shapes import shapes

_TURNS_OF_SCAN = 12
_COLUMNS_AT_ONCE = 256
_N_SHORTLISTED = 6  # of each tie
_PROMISING = 0.01  # share that it would explain by one step, where it is estimated at all


@dataclass(frozen=True)
class Candidate:
    """An effect at a place in an equation, and the values at which it is scanned."""

    placed: PlacedEffect  # without values
    grid: Array  # (n_values, n_theta)

    def trials(self, seen: Records, missed: Array) -> list[PlacedEffect]:
        """The effect at every value that may explain what velocities (n_samples, n_states) miss."""
        effect, own = self.placed.effect, missed[:, [self.placed.target]]
        values = effect.shortlist(seen, self.placed.place, self.grid, own).tolist()
        return [replace(self.placed, theta=tuple(one)) for one in values]


def is_sought(effect: Effect) -> bool:
    """True of what can be told in recordings of one law: what changes it, and what sensors do."""
    # a function without a name has columns once its channel is known
    changes = _changes_the_law(effect) or isinstance(effect, UnknownFunction)
    return changes or is_of_a_sensor(effect)


def _changes_the_law(effect: Effect) -> bool:
    return bool(effect.terms) or isinstance(effect, RateEffect)


def is_of_a_sensor(effect: Effect) -> TypeGuard[MeasurementEffect]:
    """True of what changes the record by a number that a fit can find."""
    return isinstance(effect, MeasurementEffect) and not isinstance(effect, Quantisation)


def skipped(effects: Sequence[Effect], records: Records) -> dict[str, str]:
    """Kinds that are not looked for in recordings of one law, and why."""
    reasons = {}
    for effect in effects:
        missing = effect.missing(records)
        if missing is not None:
            reasons[effect.kind] = missing
        elif not is_sought(effect):
            reasons[effect.kind] = "is not looked for in recordings of one law"
    return reasons


def candidates(
    effects: Sequence[Effect], records: Records, targets: Sequence[int]
) -> Iterator[Candidate]:
    """All of them, the simplest explanation first."""
    for effect in (one for each in effects for one in (each, *each.elsewhere(records))):
        if not _changes_the_law(effect) or effect.missing(records) is not None:
            continue
        for place in effect.places(records):
            grid = effect.grid(records, place)
            if not len(grid):
                continue
            for target in targets:
                if effect.acts_in(records, place, target):
                    yield Candidate(PlacedEffect(effect, place, target), grid)


def all_candidates(
    effects: Sequence[Effect], records: Records, targets: Sequence[int]
) -> list[Candidate]:
    """The same as a list, functions of one channel for those without a name."""
    named = [effect for effect in effects if not isinstance(effect, UnknownFunction)]
    if len(named) < len(effects):
        named += [shape for shape in shapes(records) if len(shape.channels) == 1]
    return list(candidates(named, records, targets))


def special_cases(
    placed: PlacedEffect, effects: Sequence[Effect], records: Records
) -> list[PlacedEffect]:
    """Simpler effects of which one is the general case, with the values that they share."""
    place = placed.place
    theta = dict(zip(placed.effect.theta_names(records, place), placed.theta, strict=True))
    return [
        replace(placed, effect=effect, theta=tuple(theta[name] for name in names))
        for effect in effects
        if effect.kind in placed.effect.special_cases
        and set(names := effect.theta_names(records, place)) <= set(theta)
    ]


def variants(
    placed: PlacedEffect, law: Law, linear: Mapping[int, int], records: Records
) -> list[PlacedEffect]:
    """The effect beside the channel's own term, in its place, or both, as its role says."""
    place = placed.place
    feature = linear.get(int(place)) if isinstance(place, (int, np.integer)) else None
    has = feature is not None and bool(law.declared[placed.target, feature])
    taken = {(term.target, term.replaced) for term in law.terms}
    beside, in_its_place = placed.effect.stands(records, place, has)
    listed = []
    if in_its_place and (placed.target, feature) not in taken:
        listed.append(replace(placed, replaced=feature))
    if beside:
        listed.append(placed)
    return listed


class Score(Protocol):
    """What candidates would explain beside a fitted law."""

    @property
    def squares(self) -> float:
        """That are left, in units of the noise."""

    def missed(self, stretches: Stretches) -> Array:
        """What the law lacks at every sample, zero at others than those of the stretches."""

    def response(self, columns: Array) -> Array:
        """What columns (n_samples, n_terms) of unit coefficient add."""

    def gains(self, trials: Sequence[PlacedEffect], responses: Sequence[Array]) -> Array:
        """Squares that each trial explains, in units of the noise, by the response to each."""


@step
def shortlist(
    law: Law, scores: Sequence[Score], stretches: Stretches, listed: Sequence[Candidate]
) -> list[PlacedEffect]:
    """The candidates that explain most by any of some scores, each at its best values."""
    missed = scores[0].missed(stretches)
    parts = [candidate.trials(stretches.seen, missed) for candidate in listed]
    trials = [trial for part in parts for trial in part]
    owner = np.repeat(np.arange(len(listed)), [len(part) for part in parts])
    said = np.nan_to_num(law.rates(stretches.seen))
    columns = (_columns(trial, stretches.seen, said)[stretches.rows] for trial in trials)
    responses = [scores[0].response(one) for one in columns]
    chosen: dict[int, None] = {}
    # what has one coefficient and nothing else explains less, and may be all there is
    plain = [k for k, one in enumerate(trials) if len(one.effect.terms) == 1 and not one.theta]
    for score in scores:
        gains = score.gains(trials, responses)
        best = [
            int(np.flatnonzero(owner == k)[gains[owner == k].argmax()]) for k in np.unique(owner)
        ]
        ranked = [plain[k] for k in largest_first(gains[plain])]
        # a step shows little of what bends much, and ten monomials that bend alike hide the rest
        first_of_kind = {trials[k].effect.kind: k for k in reversed(ranked)}
        listed_first = (
            *(best[k] for k in largest_first(gains[best])[:_N_SHORTLISTED]),
            *ranked[:_N_SHORTLISTED],
            *first_of_kind.values(),
        )
        promising = _PROMISING * score.squares
        chosen |= dict.fromkeys(k for k in listed_first if gains[k] > promising)
    return [trials[k] for k in chosen]


def of_sensors(
    law: Law, rolled_out: Array, stretches: Stretches, effects: Sequence[MeasurementEffect]
) -> Iterator[PlacedEffect]:
    """Corrections of states that explain a share worth it of what rollouts leave of these.

    They are free: a disturbance would let the states follow a sensor that is wrong. A sensor may be
    right or wrong beside others alone: with one state it says no more than a delay does.
    """
    seen = stretches.corrected(law.terms).seen
    missed = np.nan_to_num(rolled_out, posinf=0.0)  # of what diverges nothing is told
    for effect, place in ((one, place) for one in effects for place in one.places(seen)):
        n_measured, state = missed.shape[1], effect.state_of(place)
        is_told = n_measured > 1 or not effect.beside_others
        if not is_told or state >= n_measured or effect.missing(seen) is not None:
            continue
        (parameter,) = effect.parameters(seen, place)
        slope = slope_of_sensor(PlacedEffect(effect, place, state, theta=(0.0,)), stretches)
        left = missed[:, state]
        size = -(left @ slope) / (slope @ slope)
        if size * (left @ slope) < -SETTINGS.worthwhile * (left @ left):
            nearest = parameter.values[np.abs(parameter.values - size).argmin()]
            if nearest != 0.0:
                yield PlacedEffect(effect, place, state, theta=(float(nearest),))


def slope_of_sensor(term: PlacedEffect, stretches: Stretches) -> Array:
    """By how much a corrected state moves with the one number of its sensor, (n_samples,)."""
    effect, seen, (value,) = term.effect, stretches.seen, term.theta
    assert isinstance(effect, MeasurementEffect)
    (parameter,) = effect.parameters(seen, term.place)
    step = np.abs(parameter.values[parameter.values != 0.0]).min()
    there, back = (effect.corrected(seen, term.place, value + one) for one in (step, -step))
    moved = there.channel(term.target) - back.channel(term.target)
    return np.asarray(moved[stretches.rows] / (2.0 * step))


def _columns(trial: PlacedEffect, seen: Records, said: Array) -> Array:
    """What a candidate changes along whole recordings, (n_samples, n_terms), by rates of a law."""
    if isinstance(trial.effect, RateEffect):
        return (trial.shaped(said, seen.X) - said)[:, [trial.target]]
    return np.nan_to_num(trial.effect.columns(seen, trial.place, *trial.theta))


@dataclass(frozen=True)
class RolloutScore:
    """Equations of a law at states that follow the recordings over about 1 / tie samples."""

    followed: Estimate
    arrow: Arrow
    band: Array  # lower factor of its band
    right: Array  # of the nodes, and of the coefficients of the law
    by_law: Array  # (n_states, n_own, n_intervals): of the ends of intervals, in units of the noise
    by_state: Array  # (n_states, n_states, n_intervals), likewise
    gaps: Array  # (n_intervals, n_states)
    square: Array  # (n_intervals,): squared weights of the ties
    noise: Array
    squares: float  # that are left

    @classmethod
    def of(cls, fit: Fitted, tie: float) -> RolloutScore:
        """Of a fitted law, its states let go as the tie allows."""
        settings = replace(STAYS.roughly(), ties=((tie, _TURNS_OF_SCAN),))
        with np.errstate(all="ignore"):
            followed = most_likely(fit.reached.estimate, fit.noise, settings).estimate
            followed = replace(followed, nodes=followed.nodes.joined(as_usual=False))
            equations = Objective(fit.noise, tie).normal_equations(followed)
            arrow, right = equations.reduced()
            legs = joined_legs(steady_legs(followed.laws, followed.nodes, followed.states))
        unit = fit.noise[:, None, None]
        nodes = followed.nodes
        return cls(
            followed,
            arrow,
            cholesky_banded(arrow.band, lower=True, check_finite=False),
            right,
            legs.by_law.swapaxes(0, 1) / unit,
            legs.by_state.swapaxes(0, 1) * fit.noise[None, :, None] / unit,
            (followed.states[nodes.begins + 1] - legs.ends) / fit.noise,
            1.0 / (np.square(tie) * nodes.parts),
            fit.noise,
            2.0 * equations.value,
        )

    def missed(self, stretches: Stretches) -> Array:
        """What the law lacks of the velocities of its states, zero at other samples."""
        nodes, rates = self.followed.nodes, np.zeros(self.followed.states.shape)
        gaps = self.gaps * self.noise
        rates[nodes.begins] = slope_of(np.zeros_like(gaps), gaps, nodes.steps)  # none of an event
        missed = np.zeros((len(stretches.seen), len(self.noise)))
        missed[stretches.rows] = of_samples(nodes, rates)
        return missed

    def response(self, columns: Array) -> Array:
        """What columns (n_samples, n_terms) of unit coefficient add to the end of each interval."""
        nodes = self.followed.nodes
        recordings, at_nodes = nodes.recordings, columns
        if len(columns) < len(nodes):  # times at which nothing was measured stand between samples
            at_nodes = np.empty((len(nodes), columns.shape[1]))
            done, first = 0, 0
            for t, places in zip(recordings.times, recordings.sampled, strict=True):
                own = columns[done : done + len(places)]
                for column, values in zip(at_nodes[first : first + len(t)].T, own.T, strict=True):
                    column[:] = np.interp(np.arange(len(t)), places, values)
                done, first = done + len(places), first + len(t)
        begins = nodes.begins
        return np.asarray(0.5 * nodes.steps[:, None] * (at_nodes[begins] + at_nodes[begins + 1]))

    def gains(self, trials: Sequence[PlacedEffect], responses: Sequence[Array]) -> Array:
        """Squares that each trial explains, in units of the noise."""
        n_band = len(self.arrow.border)
        b, d = np.split(self.right, [n_band])
        own = cho_solve_banded(
            (self.band, True), np.column_stack([self.arrow.border, b]), check_finite=False
        )
        seen = self.arrow.border.T @ own
        information, gradient = self.arrow.corner - seen[:, :-1], d - seen[:, -1]
        unit = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
        inverse = np.linalg.pinv(information / unit / unit[:, None], rcond=1e-12, hermitian=True)
        inverse = inverse / unit / unit[:, None]
        gains = np.zeros(len(trials))
        targets = np.array([trial.target for trial in trials])
        for target in np.unique(targets):
            listed = np.flatnonzero(targets == target).tolist()
            for some in _at_once([responses[k] for k in listed]):
                chosen = [listed[k] for k in some]
                moves = [responses[k] for k in chosen]
                gains[chosen] = self._gains_in(target, moves, own, inverse, gradient)
        return gains

    @step
    def _gains_in(
        self, target: int, moves: Sequence[Array], own: Array, inverse: Array, gradient: Array
    ) -> Array:
        """Of some trials in one equation, from what nodes and the law would do alone.

        What nodes take away are squares of what the factor of their band makes of a column, solved
        forward; nothing is solved backward.
        """
        begins, unit = self.followed.nodes.begins, self.noise[target]
        columns = np.hstack(moves).T / unit  # (n_columns, n_intervals)
        weighted = self.square * columns
        border = np.zeros((len(columns), *self.followed.states.shape))
        border[:, begins] = weighted[:, :, None] * self.by_state[target].T
        border[:, begins + 1, target] -= weighted
        border = border.reshape(len(columns), -1)
        of_nodes = border @ own
        across = weighted @ self.by_law[target].T - of_nodes[:, :-1]
        left = weighted @ self.gaps[:, target] - of_nodes[:, -1] - across @ (inverse @ gradient)
        half, _ = dtbtrs(self.band, border.T, uplo="L", overwrite_b=True)
        gains, start = np.zeros(len(moves)), 0
        for k, move in enumerate(moves):
            theirs = slice(start, start + move.shape[1])
            start = theirs.stop
            alone = weighted[theirs] @ columns[theirs].T
            block = alone - half[:, theirs].T @ half[:, theirs]
            block = block - across[theirs] @ inverse @ across[theirs].T
            gains[k] = explained(block, left[theirs], np.diag(alone))
        return gains


def explained(block: Array, left: Array, alone: Array) -> float:
    """Squares by information and gradient of columns, of which `alone` are the squares.

    What the law can say itself explains nothing more.
    """
    unit = np.sqrt(np.maximum(alone, np.finfo(float).tiny))
    block, left = block / unit / unit[:, None], left / unit
    if not np.isfinite(block).all() or (np.diag(block) <= SETTINGS.spanned).any():
        return 0.0
    return max(0.0, float(left @ np.linalg.pinv(block, rcond=1e-8, hermitian=True) @ left))


@step
def scores(fit: Fitted, ties: Sequence[float] = SETTINGS.ties) -> list[RolloutScore]:
    """Over some numbers of samples; LinAlgError where no step from the fit says anything."""
    found = []
    for tie in ties:
        with suppress(LinAlgError):  # where states are let go too far nothing holds them
            found.append(RolloutScore.of(fit, tie))
    if not found:
        raise LinAlgError("no tie holds the states")
    return found


def _at_once(moves: Sequence[Array]) -> list[list[int]]:
    """Numbers of as many trials as are worked together."""
    ends = np.cumsum([move.shape[1] for move in moves])
    group = ends // _COLUMNS_AT_ONCE
    return [np.flatnonzero(group == one).tolist() for one in np.unique(group)]
