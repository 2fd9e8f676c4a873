"""One search beside a declared model, from its folds to what the untouched rows leave of it.

The held-out part of a record is the judge: what does not lower the error there is not added.
Neither significance nor a gain in the folds is proof that a model with the effect predicts what no
choice has seen. An effect stays if its error there falls by more than the standard error of that
fall, from block to block; otherwise it is listed as tried. Where the part is too short to show the
fall that the searched rows promise, a smaller one is no proof against the effect: it stays, and the
doubt is told with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Integral

import numpy as np
from numpy.typing import NDArray
from sklearn.model_selection import check_cv

from swsysid._data.records import Records
from swsysid._effect_model.declared import Declared
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.acceptance import Finding, confirmed, without_refused
from swsysid._effect_search.chance import BlockSum
from swsysid._effect_search.folds import (
    Folds,
    SearchData,
    Split,
    exact_states,
    exciting_folds,
    make_folds,
    memory_of,
)
from swsysid._effect_search.greedy import Round, Search
from swsysid._effect_search.recording import Measured
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._noise import robust_scale, root_mean_square
from swsysid._results import Array
from swsysid._ties import first_least
from swsysid.effects import Effect, GuardEffect, PlacedEffect, ResetEffect, UnmeasuredDisturbance
from swsysid.effects._kinematics import with_kinematics

_NOT_SHOWN = "the held-out error falls by less than its standard error"


@dataclass(frozen=True)
class Choices:
    """What a user asks of a search."""

    effects: Sequence[Effect]
    cv: object
    significance: float
    n_jobs: int | None
    verbose: int

    def folds(
        self, records: Records, targets: Array, left: Array, rng: np.random.RandomState
    ) -> Folds:
        """Folds of the rows of a search, of which the declared model leaves residuals."""
        n_folds = self.cv if isinstance(self.cv, Integral) else SETTINGS.n_folds
        folds = exciting_folds(records, int(n_folds), rng, memory_of(records, left))
        if self.cv is None or isinstance(self.cv, Integral):
            return folds
        parts = list(check_cv(self.cv).split(records.X, targets, records.groups))
        return replace(folds, parts=parts)


@dataclass(frozen=True)
class Outcome:
    """What a search has found, and of what it was a search."""

    split: Split
    search: Search
    structure: Structure
    findings: tuple[Finding, ...]
    rounds: list[Round]
    tried: tuple[Tried, ...]

    @property
    def context(self) -> SearchContext:
        """What it has been a search of."""
        return self.search.context

    def without(
        self,
        place: int,
        before: Array,
        after: Array,
        rollouts: tuple[float, float] | None = None,
    ) -> Outcome:
        """The same without one of the effects, with which rollouts become worse if these are given.

        `before` and `after` are errors on the untouched rows, (n_states,), without it and with it.
        """
        lost, rest = self.findings[place], (*self.findings[:place], *self.findings[place + 1 :])
        # What it has explained may be part of a force that nobody knows.
        forces = [
            number
            for number, one in enumerate(rest)
            if isinstance(one.candidate.effect, UnmeasuredDisturbance)
        ]
        structure = self.context.without(self.context.without(self.structure, place), *forces)
        known = tuple(one for number, one in enumerate(rest) if number not in forces)
        structure, anew = self.search.with_disturbances(structure, known, self.rounds)
        return replace(
            self,
            structure=structure,
            findings=anew,
            tried=(*self.tried, Tried(lost.candidate, lost.p_value, before, after, rollouts)),
        )


def search_beside(
    declared: Declared,
    first: JointFit,
    measured: Measured,
    parts: Split,
    rng: np.random.RandomState,
    choices: Choices,
    most: int,
) -> Outcome:
    """So many effects at most beside a declared model, `first` fitted to the searched rows."""
    split = parts.of(measured.rows)
    records, rows = measured.records, split.search
    targets = measured.targets[rows]
    left = first.residuals(records, rows, targets)
    exact = exact_states(left, targets)
    known = with_kinematics(records, rows, targets, declared.discrete_time)
    context = SearchContext(
        model=declared.with_modes(first.n_modes),
        effects=choices.effects,
        data=SearchData(
            records=known.decoded_on(parts.search),
            rows=rows,
            targets=targets,
            folds=choices.folds(records.take(rows), targets, left[:, ~exact], rng),
            part=parts.search,
            exact_states=frozenset(np.flatnonzero(exact).tolist()),
            noise=measured.noise,
        ),
        declared=first,
        significance=choices.significance,
        n_jobs=choices.n_jobs,
        verbose=choices.verbose,
    )
    search = Search(context, most)
    structure, findings, rounds = search.run()
    judge = HeldOutJudge(context, records, measured.targets, split.held_out)
    steps = [one.structure for one in rounds]
    structure, findings, tried = judge.judged(structure, findings, steps)
    structure, findings = search.beside_the_unknown(structure, findings, rounds)
    return Outcome(split, search, structure, findings, rounds, tried)


@dataclass(frozen=True)
class Tried:
    """An effect that chance does not explain and that does not help."""

    candidate: PlacedEffect
    p_value: float
    before: Array  # root mean square errors on the untouched rows without it, (n_states,)
    after: Array
    rollouts: tuple[float, float] | None = None  # their errors, where these are why it is not kept


@dataclass(frozen=True)
class Fall:
    """By how much the error of the untouched rows falls, and by how much it was to fall."""

    fall: BlockSum
    promised: float  # by the searched rows
    error: float  # standard error of what is promised for so few rows

    @property
    def is_refuted(self) -> bool:
        """True if it does not fall, or not clearly where so many rows were to show it."""
        if self.fall.is_clear or self.promised <= 0.0:
            return False
        return self.fall.value <= 0.0 or self.promised > SETTINGS.shown * self.error

    @property
    def is_rise(self) -> bool:
        """True if the error clearly rises."""
        return replace(self.fall, value=-self.fall.value).is_clear


@dataclass(frozen=True)
class HeldOutJudge:
    """Rows that have taken part in no choice."""

    context: SearchContext
    records: Records
    targets: Array  # of the whole record
    rows: NDArray[np.intp]

    @cached_property
    def _folds(self) -> Folds:
        rng = np.random.RandomState(0)
        return make_folds(self.records.take(self.rows), SETTINGS.n_folds, rng)

    @cached_property
    def _scale(self) -> Array:
        """Usual errors of the declared model; a few that are gross decide nothing."""
        data = self.context.data
        errors = self.context.declared.residuals(data.records, data.rows, data.targets)
        return np.maximum(robust_scale(errors), data.exact)

    @cached_property
    def _every(self) -> NDArray[np.intp]:
        """The untouched rows, and then those of the search."""
        return np.concatenate([self.rows, self.context.data.rows])

    def _errors(self, fit: JointFit, rows: NDArray[np.intp]) -> Array:
        return self.targets[rows] - fit.predict(self.records, rows=rows)

    def _falls(self, before: JointFit, after: JointFit) -> Array:
        """By how much the squares of the errors of `_every` row fall from one fit to another."""
        gross, rows = SETTINGS.gross, self._every
        sizes = [np.abs(self._errors(fit, rows)) / self._scale for fit in (before, after)]
        losses = [np.sum(np.minimum(size, gross) ** 2, axis=1) for size in sizes]
        # what is gross with the effect and without it says nothing of the effect
        judging = np.minimum(*(size.max(axis=1) for size in sizes)) < gross
        judging &= ~(self._may_stick(before, rows) | self._may_stick(after, rows))
        return np.where(judging, losses[0] - losses[1], 0.0)

    def _may_stick(self, fit: JointFit, rows: NDArray[np.intp]) -> NDArray[np.bool_]:
        """Rows at which a plant may stick, as far as the noise of its states tells."""
        return self.context.data.may_stick(fit.terms, self.records, rows)

    def gain(self, before: JointFit, after: JointFit) -> Fall:
        """By how much they fall in all, and by how much they were to fall."""
        before, after = map(self.context.with_decoded_surface, (before, after))
        data = self.context.data
        falls, searched = np.split(self._falls(before, after), [len(self.rows)])
        in_search = BlockSum.of(data.folds.independent_sums(searched))
        share = np.count_nonzero(falls) / len(data.rows)
        return Fall(
            BlockSum.of(self._folds.independent_sums(falls)),
            share * in_search.value,
            float(np.sqrt(share)) * in_search.error,
        )

    def judged(
        self, structure: Structure, findings: tuple[Finding, ...], earlier: Sequence[Structure]
    ) -> tuple[Structure, tuple[Finding, ...], tuple[Tried, ...]]:
        """Without the effects that do not help, the least helpful first; and these.

        What such an effect has driven out comes back: `earlier` are structures on the way.
        """
        tried: list[Tried] = []
        refused: set[tuple] = set()
        while structure.terms:
            fewer = [self._without(structure, place) for place in range(len(structure.terms))]
            gains = [self.gain(fit, structure.fit) for fit in fewer]
            shown = [self._shows(term) for term in structure.terms]
            useless = [
                place
                for place, one in enumerate(gains)
                if (one.is_refuted if shown[place] else one.is_rise)
            ]
            if not useless:
                findings = tuple(
                    replace(finding, doubts=(*finding.doubts, _NOT_SHOWN))
                    if shown[place] and not gains[place].fall.is_clear
                    else finding
                    for place, finding in enumerate(findings)
                )
                break
            worst = useless[int(first_least([gains[place].fall.value for place in useless]))]
            before, after = (
                root_mean_square(self._errors(fit, self.rows))
                for fit in (fewer[worst], structure.fit)
            )
            lost = findings[worst]
            tried.append(Tried(lost.candidate, lost.p_value, before, after))
            structure = without_refused(self.context, structure, worst, earlier, refused)
            structure, findings = confirmed(self.context, structure)
        return structure, findings, tuple(tried)

    def _without(self, structure: Structure, place: int) -> JointFit:
        if len(structure.terms) == 1:
            return self.context.declared
        return self.context.without(structure, place).fit

    def _shows(self, term: PlacedEffect) -> bool:
        """Whether velocities show an effect: no jump, and no guard where they end at switches."""
        if isinstance(term.effect, ResetEffect):
            return False
        return self.records.decoded_modes is None or not isinstance(term.effect, GuardEffect)
