"""From the structure that a search ends with to effects with numbers, intervals and rivals."""

from __future__ import annotations

import numpy as np

from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_search.folds import SearchData
from swsysid._effect_search.intervals import parameter_intervals
from swsysid._effect_search.ladder import Ladder
from swsysid.effects import FoundEffect, PlacedEffect, Rival, StructureEffect

__all__ = ["describe_findings"]


def describe_findings(ladder: Ladder, final: JointFit) -> list[FoundEffect]:
    """Effects in the order of the ladder, with the numbers of the fit to all rows."""
    if not final.terms:
        return []
    records = ladder.records
    intervals = parameter_intervals(final, SearchData.whole(records, ladder.targets))
    found = []
    for place, term in enumerate(final.terms):
        label, parameters = term.label(records.names), term.physical(records, final.coef[place])
        finding, gaining = ladder.findings[place], _gaining_state(term, ladder, place)
        found.append(
            FoundEffect(
                kind=term.effect.kind,
                target=gaining if isinstance(term.effect, StructureEffect) else term.target,
                mode=term.mode,
                place=label,
                parameters=parameters,
                intervals=intervals[place],
                p_value=finding.p_value,
                error_before=float(ladder.held_out[place][gaining]),
                error_after=float(ladder.held_out[place + 1][gaining]),
                rivals=tuple(_rival(ladder, place, rival) for rival in finding.rivals),
                meaning=term.effect.describe(label, records.names[term.target]),
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


def _rival(ladder: Ladder, place: int, rival: PlacedEffect) -> Rival:
    """A rival with its own error on the held-out rows, and how to tell it apart."""
    terms, modes = (*ladder.terms[:place], rival), ladder.structure.fit.modes
    other = ladder.context.structure(terms, modes).fit
    names = rival.effect.theta_names(ladder.records, rival.place)
    return Rival(
        kind=rival.effect.kind,
        target=rival.target,
        mode=rival.mode,
        place=rival.label(ladder.records.names),
        parameters=dict(zip(names, rival.theta, strict=True)),
        error=float(ladder.errors_of(other)[rival.target]),
        advice=_advice(ladder, place, other),
    )


def _advice(ladder: Ladder, place: int, other: JointFit) -> str:
    """Where in the record the two models differ most: more samples there tell them apart."""
    records, settings = ladder.records, ladder.context.settings
    predicted = ladder.fits[place + 1].predict(records)
    apart = np.abs(predicted - other.predict(records)).sum(axis=1)
    if apart.max() <= 1e-9 * np.abs(predicted).max():
        return "the two are the same function of these data: samples outside their range"
    most = np.argsort(-apart)[: max(10, int(settings.apart * len(apart)))]
    term = ladder.terms[place]
    channel = term.place if isinstance(term.place, int) else 0
    low, high = np.quantile(records.channel(channel)[most], [0.1, 0.9])
    return (
        f"more samples with {records.names[channel]} between {low:.3g} and {high:.3g}, where the "
        "two differ most"
    )
