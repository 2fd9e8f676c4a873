"""From the structure that a search ends with to effects with numbers, intervals and rivals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.acceptance import Finding
from swsysid._effect_search.contributions import parameter_intervals
from swsysid._effect_search.folds import Rows, Split
from swsysid._effect_search.formulas import formulas, table_of
from swsysid._effect_search.reading import follow_the_states
from swsysid._effect_search.rollouts import Rollout, are_worse
from swsysid._effect_search.settings import REPORT, SETTINGS
from swsysid._effect_search.structures import SearchContext, Structure
from swsysid._effect_search.switches import FurtherMode
from swsysid._noise import robust_scale, root_mean_square
from swsysid._results import Array
from swsysid.effects import (
    Formula,
    FoundEffect,
    PlacedEffect,
    Rival,
    StructureEffect,
    UnknownFunction,
    UnmeasuredDisturbance,
)

_PLAIN = 0.9  # share of a held-out error: velocities that leave less need no rollout
_DIFFERING = 0.05  # share of the samples on which two rivals differ most
_AS_GOOD = 1.5  # ratio of held-out errors beyond which no one calls an effect as good


@dataclass(frozen=True)
class Ladder:
    """The declared model, then one effect after the other, and the error of each.

    The effects of the structure that a search has ended with come in the order of what is lost
    without them, the most important first; forces that nobody knows, of which no model can be
    simulated, are last.
    """

    context: SearchContext
    structure: Structure
    found: tuple[Finding, ...]  # one for each term of the structure
    records: Records  # the whole record
    targets: Array  # of all of it
    split: Split

    @cached_property
    def _order(self) -> list[int]:
        places = list(range(len(self.structure.terms)))
        if len(places) < 2:
            return places
        prices = [self.context.without(self.structure, place).price for place in places]
        return sorted(places, key=lambda place: (self._is_unknown(place), -prices[place]))

    def _is_unknown(self, place: int) -> bool:
        return isinstance(self.structure.terms[place].effect, UnmeasuredDisturbance)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """p-value in the light of all others and rivals of each effect."""
        return tuple(self.found[place] for place in self._order)

    @property
    def terms(self) -> tuple[PlacedEffect, ...]:
        """The effects."""
        return tuple(self.structure.terms[place] for place in self._order)

    @property
    def n_simulated(self) -> int:
        """Number of effects that change a simulation."""
        return sum(not self._is_unknown(place) for place in self._order)

    @property
    def least(self) -> int:
        """The place in the structure of that of them without which least is lost."""
        return self._order[self.n_simulated - 1]

    def added(self, rank: int) -> tuple[int, Array, Array]:
        """Place of an effect in the structure, and errors on the untouched rows, (n_states,).

        Before it is added and after it.
        """
        (_, before), (_, after) = self.errors[rank : rank + 2]
        return self._order[rank], before, after

    @property
    def is_in_doubt(self) -> bool:
        """True if there are doubts about the effect without which least is lost."""
        return bool(self.found[self.least].doubts)

    @property
    def gained(self) -> float:
        """The factor by which that effect lowers an error on the untouched rows.

        What is gross with the effect and without it says nothing of the effect.
        """
        rows = self.split.held_out[~self.may_stick(self.split.held_out)]
        fits = self.fits[self.n_simulated - 1 : self.n_simulated + 1]
        judged, data = self.context.data.counted_states, self.context.data
        left = [self._left_over(fit, rows)[:, judged] for fit in fits]
        scales = [np.maximum(robust_scale(errors), data.exact[judged]) for errors in left]
        sizes = [
            np.max(np.abs(one) / scale, axis=1) for one, scale in zip(left, scales, strict=True)
        ]
        usual = np.minimum(*sizes) < SETTINGS.gross
        before, after = (root_mean_square(errors[usual]) for errors in left)
        return float(np.max(before / np.maximum(after, np.finfo(float).tiny)))

    def _left_over(self, fit: JointFit, rows: Rows) -> Array:
        return self.targets[rows] - fit.predict(self.records, rows=rows)

    def gaining(self, before: Array, after: Array) -> int:
        """The state whose error falls by the largest factor, from two errors (n_states,)."""
        exact = self.context.data.exact
        return int(np.argmin(np.maximum(after, exact) / np.maximum(before, exact)))

    @property
    def is_plain(self) -> bool:
        """True if there are no doubts, and the error clearly falls."""
        return not self.is_in_doubt and self.gained * _PLAIN > 1.0

    def is_refused(self, rollouts: Sequence[Rollout], measured: bool) -> bool:
        """True if rollouts speak against the effect without which least is lost.

        Velocities that were measured are the better witness of what is plain in them, and of
        nothing else; those that were made of the states say nothing that rollouts do not.
        """
        if measured and self.is_plain and not self._velocities_follow:
            return False
        strict = measured and self._velocities_follow and not self.is_plain
        luck = 0.0 if strict else REPORT.clearly_worse
        in_doubt = measured or self.is_in_doubt
        return are_worse(rollouts, gained=self.gained, in_doubt=in_doubt, luck=luck)

    @cached_property
    def _velocities_follow(self) -> bool:
        """Whether velocities are so near to their states that they must have been made of them."""
        left = self.targets - self.structure.fit.predict(self.records)
        return not self.context.model.discrete_time and follow_the_states(
            self.records, self.targets, left
        )

    @cached_property
    def fits(self) -> tuple[JointFit, ...]:
        """The declared model, then one effect more each; fitted to the rows of the search."""
        fit, terms = self.structure.fit, self.terms
        between = [self.context.structure(terms[:n], fit.modes).fit for n in range(1, len(terms))]
        coef = tuple(fit.coef[place] for place in self._order)
        last = [replace(fit, terms=terms, coef=coef)] if terms else []
        return tuple(
            map(self.context.with_decoded_surface, (self.context.declared, *between, *last))
        )

    @cached_property
    def errors(self) -> list[tuple[Array, Array]]:
        """Root mean square errors of each of `fits` on the searched and on the held-out rows."""
        return [self.errors_of(fit) for fit in self.fits]

    def formulas(self, place: int) -> tuple[Formula, ...]:
        """Expressions in the place of an effect that has none."""
        if not isinstance(self.terms[place].effect, UnknownFunction):
            return ()
        number = self._order[place]
        base = self.context.candidates(self.structure.fit, without=(number,))
        return formulas(base, self.structure.terms[number])

    def errors_of(self, fit: JointFit) -> tuple[Array, Array]:
        """Those of a fit, (n_states,) each, on the rows at which the plant surely moves."""
        squares = (self.targets - fit.predict(self.records)) ** 2
        searched, held_out = (
            np.sqrt(np.mean(squares[rows[~self.may_stick(rows)]], axis=0))
            for rows in (self.split.search, self.split.held_out)
        )
        return searched, held_out

    def may_stick(self, rows: Rows) -> NDArray[np.bool_]:
        """Rows at which an effect found may hold the plant, with a force that no law tells."""
        held = self.context.data.may_stick(self.structure.terms, self.records, rows)
        return held & ~held.all()


def describe_findings(
    ladder: Ladder, final: JointFit, covariances: list[Array]
) -> list[FoundEffect]:
    """Effects in the order of the ladder, with the numbers of the fit to all rows."""
    records = ladder.records
    intervals = parameter_intervals(final, covariances, records)
    found = []
    for place, (term, finding) in enumerate(zip(final.terms, ladder.findings, strict=True)):
        label, parameters = term.label(records.names), term.physical(records, final.coef[place])
        equations: tuple[str, ...] = ()
        if isinstance(term.effect, StructureEffect):
            mode = FurtherMode(ladder.fits[0], final, records, ladder.split.search)
            parameters, equations = parameters | {"share_of_rows": mode.share}, mode.equations
        (_, before), (_, after) = ladder.errors[place : place + 2]
        # the equation an effect acts in; of a sensor, a guard or a mode that which gains most
        own = term.effect.terms or isinstance(term.effect, UnmeasuredDisturbance)
        gaining = term.target if own else ladder.gaining(before, after)
        found.append(
            FoundEffect(
                kind=term.effect.kind,
                target=gaining if isinstance(term.effect, StructureEffect) else term.target,
                mode=term.mode,
                place=label,
                parameters=parameters,
                intervals=intervals[place],
                p_value=finding.p_value,
                error_before=float(before[gaining]),
                error_after=float(after[gaining]),
                rivals=_rivals(ladder, place, gaining),
                meaning=term.effect.describe(label, records.equations[term.target]),
                formula=term.effect.formula(label, parameters),
                placed=term,
                table=table_of(final, place, covariances[place], records, ladder.targets),
                formulas=ladder.formulas(place),
                doubts=finding.doubts,
                equations=equations,
            )
        )
    return found


def _rivals(ladder: Ladder, place: int, gaining: int) -> tuple[Rival, ...]:
    """Rivals that lower the held-out error by half as much, and leave none that is much larger.

    Where rows are few the scatter of their gains tells effects hardly apart. The effects that are
    near a shape are there to say by how much they miss it, and all of them are told.
    """
    (_, before), (_, after) = ladder.errors[place : place + 2]
    falls = after[gaining] < before[gaining]
    middle = 0.5 * (before[gaining] + after[gaining])
    most = min(middle, _AS_GOOD * after[gaining]) if falls else np.inf
    if isinstance(ladder.terms[place].effect, UnknownFunction):
        most = np.inf
    # in the place of one more mode there are those of the model before it
    is_mode = isinstance(ladder.terms[place].effect, StructureEffect)
    modes = ladder.fits[place].modes if is_mode else ladder.structure.fit.modes
    kept = []
    for rival in ladder.findings[place].rivals:
        terms = (*ladder.terms[:place], rival)
        other = ladder.context.with_decoded_surface(ladder.context.structure(terms, modes).fit)
        errors = ladder.errors_of(other)[1]
        if errors[gaining] <= most:
            kept.append(_rival(ladder, place, rival, other, float(errors[rival.target])))
    return tuple(kept)


def _rival(ladder: Ladder, place: int, rival: PlacedEffect, other: JointFit, error: float) -> Rival:
    """A rival with its own error on the held-out rows, and how to tell it apart."""
    names = rival.effect.theta_names(ladder.records, rival.place)
    return Rival(
        kind=rival.effect.kind,
        target=rival.target,
        mode=rival.mode,
        place=rival.label(ladder.records.names),
        parameters=dict(zip(names, rival.theta, strict=True)),
        error=error,
        advice=_advice(ladder, place, other),
    )


def _advice(ladder: Ladder, place: int, other: JointFit) -> str:
    """Where in the record the two models differ most: more samples there tell them apart."""
    records = ladder.records
    predicted = ladder.fits[place + 1].predict(records)
    difference = np.abs(predicted - other.predict(records)).sum(axis=1)
    if difference.max() <= 1e-9 * np.abs(predicted).max():
        return "the two are the same function of these data: samples outside their range"
    most = np.argsort(-difference)[: max(10, int(_DIFFERING * len(difference)))]
    acting = ladder.terms[place].place
    channel = acting if isinstance(acting, int) else 0
    low, high = np.quantile(records.channel(channel)[most], [0.1, 0.9])
    return (
        f"more samples with {records.names[channel]} between {low:.3g} and {high:.3g}, where the "
        "two differ most"
    )
