"""From the structure that a search ends with to effects with numbers, intervals and rivals."""

from __future__ import annotations

import numpy as np

from swsysid._effect_search.ladder import Ladder
from swsysid._results import Array
from swsysid._search.folds import make_folds
from swsysid._search.greedy import Search
from swsysid._search.intervals import parameter_intervals
from swsysid._search.joint_fit import JointFit
from swsysid._search.trials import PlacedEffect
from swsysid._search.workshop import Structure
from swsysid.effects import FoundEffect, Rival

__all__ = ["describe_findings"]

_TOP = 0.05  # share of the samples on which two rivals differ most


def describe_findings(
    search: Search, structure: Structure, ladder: Ladder, final: JointFit, targets: Array
) -> list[FoundEffect]:
    """Effects in the order of the ladder, with the numbers of the fit to all rows."""
    if not final.terms:
        return []
    records, rows = search.records, np.arange(len(search.records))
    folds = make_folds(records, 5, np.random.RandomState(0))
    intervals = parameter_intervals(final, records, rows, targets, folds)
    found = []
    for place, term in enumerate(final.terms):
        label = _label(term, records.names)
        target = records.names[term.target]
        parameters = term.physical(records, final.coef[place])
        finding = ladder.findings[place]
        gaining = _gaining_state(term, ladder, place)
        found.append(
            FoundEffect(
                kind=term.effect.kind,
                target=gaining if term.effect.n_more_modes else term.target,
                mode=term.mode,
                place=label,
                parameters=parameters,
                intervals=intervals[place],
                p_value=finding.p_value,
                error_before=float(ladder.held_out[place][gaining]),
                error_after=float(ladder.held_out[place + 1][gaining]),
                rivals=tuple(
                    _rival(search, structure, ladder, place, rival) for rival in finding.rivals
                ),
                meaning=term.effect.describe(label, target),
                formula=term.effect.formula(label, parameters),
                placed=term,
            )
        )
    return found


def _gaining_state(term: PlacedEffect, ladder: Ladder, place: int) -> int:
    """The equation an effect acts in; of a sensor, a guard or a mode that which gains most."""
    if term.effect.terms:
        return term.target
    before = np.maximum(ladder.held_out[place], np.finfo(float).tiny)
    return int(np.argmin(ladder.held_out[place + 1] / before))


def _label(term: PlacedEffect, names) -> str:
    return term.effect.label(term.place, names)


def _rival(
    search: Search, structure: Structure, ladder: Ladder, place: int, rival: PlacedEffect
) -> Rival:
    """A rival with its own error on the held-out rows, and how to tell it apart."""
    records = search.records
    terms = (*ladder.terms[:place], rival)
    other = search.structure(terms, structure.fit.modes).fit
    errors = ladder.errors_of(other)
    names = rival.effect.theta_names(records, rival.place)
    return Rival(
        kind=rival.effect.kind,
        target=rival.target,
        mode=rival.mode,
        place=_label(rival, records.names),
        parameters=dict(zip(names, rival.theta, strict=True)),
        error=float(errors[rival.target]),
        advice=_advice(search, ladder, place, other),
    )


def _advice(search: Search, ladder: Ladder, place: int, other: JointFit) -> str:
    """Where in the record the two models differ most: more samples there tell them apart."""
    records, mine = search.records, ladder.fits[place + 1]
    apart = np.abs(mine.predict(records) - other.predict(records)).sum(axis=1)
    if apart.max() <= 1e-9 * np.abs(mine.predict(records)).max():
        return "the two are the same function of these data: samples outside their range"
    most = np.argsort(-apart)[: max(10, int(_TOP * len(apart)))]
    term = ladder.terms[place]
    channel = term.place if isinstance(term.place, int) else 0
    low, high = np.quantile(records.channel(channel)[most], [0.1, 0.9])
    return (
        f"more samples with {records.names[channel]} between {low:.3g} and {high:.3g}, where the "
        "two differ most"
    )
