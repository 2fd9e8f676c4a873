"""Velocities as late as the states they are made of, and modes that they tell, brought to time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.declared import Declared, Modes
from swsysid._effect_model.sharpening import libraries, sharpened_velocities
from swsysid._results import Array
from swsysid.effects import PlacedEffect
from swsysid.effects._placed import late_records


def on_time(
    declared: Declared,
    terms: Sequence[PlacedEffect],
    whole: Records,
    rows: NDArray[np.intp],
    targets: Array,
    modes: Modes | None,
) -> Array:
    """Targets of some rows as they would be if no velocity were late with its state.

    The law that a late velocity obeys at earlier instants says by how much it has changed since.
    """
    late = list(late_records(terms, whole))
    if not late:
        return targets
    if modes is None:
        modes = declared.fitted(whole.take(rows), targets, None).modes
    now, answer = libraries(declared, whole, rows)[0], targets.copy()
    for term, earlier in late:
        then = libraries(declared, earlier, rows)[0]
        changed = sharpened_velocities(declared, targets, then, now, modes)
        answer[:, term.place] = changed[:, term.place]
    return answer


def as_shown(term: PlacedEffect, records: Records, modes: Modes) -> Modes:
    """Modes that a late velocity shows at every sample, for those that there are."""

    def read(t: Array, values: Array) -> Array:
        return _nearest(term.effect.instants(t, *term.theta), t, values)

    return records.along(read, modes.astype(float)).astype(np.intp)


def as_they_were(term: PlacedEffect, records: Records, shown: Modes) -> Modes:
    """Modes at every sample, for those that a late velocity shows; -1 where it shows no more."""

    def read(t: Array, values: Array) -> Array:
        instants = term.effect.instants(t, *term.theta)
        return np.where(t > instants[-1], -1, _nearest(t, instants, values))

    return records.along(read, shown.astype(float)).astype(np.intp)


def _nearest(asked: Array, t: Array, values: Array) -> Array:
    """Of values at increasing times those nearest to some times."""
    return values[np.rint(np.interp(asked, t, np.arange(len(t)))).astype(np.intp)]
