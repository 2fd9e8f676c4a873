"""One search beside a declared model, from its folds to what the untouched rows leave of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral

import numpy as np
from sklearn.model_selection import check_cv

from swsysid._data.records import Records
from swsysid._effect_model.declared import Declared
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.acceptance import Finding
from swsysid._effect_search.folds import (
    Folds,
    SearchData,
    Split,
    exact_states,
    exciting_folds,
    memory_of,
)
from swsysid._effect_search.greedy import Round, Search
from swsysid._effect_search.recording import Measured
from swsysid._effect_search.settings import SETTINGS
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._effect_search.untouched import Tried, Untouched
from swsysid._results import Array
from swsysid.effects import Effect, UnmeasuredDisturbance
from swsysid.effects._kinematics import with_kinematics


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
        lost = self.findings[place]
        structure, findings = self.context.without(self.structure, place), list(self.findings)
        del findings[place]
        # What it has explained may be part of a force that nobody knows.
        for number in reversed(range(len(findings))):
            if isinstance(findings[number].candidate.effect, UnmeasuredDisturbance):
                structure = self.context.without(structure, number)
                del findings[number]
        structure, anew = self.search.with_disturbances(structure, tuple(findings), self.rounds)
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
    is_last: bool,
) -> Outcome:
    """So many effects at most beside a declared model, `first` fitted to the searched rows.

    It is not the last search where what it finds only serves to know the record better.
    """
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
            records=known.told_on(parts.search),
            rows=rows,
            targets=targets,
            folds=choices.folds(records.take(rows), targets, left[:, ~exact], rng),
            part=parts.search,
            exact_states=frozenset(np.flatnonzero(exact).tolist()),
            noise=measured.noise,
        ),
        declared=first,
        significance=choices.significance,
    )
    search = Search(context, most, choices.n_jobs, choices.verbose)
    structure, findings, rounds = search.run()
    judge = Untouched(context, records, measured.targets, split.held_out, is_last)
    steps = [one.structure for one in rounds]
    structure, findings, tried = judge.judged(structure, findings, steps)
    structure, findings = search.beside_the_unknown(structure, findings, rounds)
    return Outcome(split, search, structure, findings, rounds, tried)
