"""Velocities that are as late as the states they are made of, brought to the time of the others."""

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
