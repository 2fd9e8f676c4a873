"""Effects at every place and in every equation where they can act, and their scanned values."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from swsysid._data.records import Records
from swsysid._output_error.law import Law
from swsysid._results import Array
from swsysid.effects import (
    Effect,
    MeasurementEffect,
    PlacedEffect,
    Quantisation,
    RateEffect,
    UnknownFunction,
)


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


def is_of_a_sensor(effect: Effect) -> bool:
    """True of what changes the record by a number that a fit can find."""
    return isinstance(effect, MeasurementEffect) and not isinstance(effect, Quantisation)


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


def variants(
    placed: PlacedEffect, law: Law, linear: dict[int, int], records: Records
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
