r"""A declared model beside effects that act on rates as a whole.

Velocities then are :math:`r(f)`, where the laws say f. At rows where r is flat they tell no more of
f than that it is so small, or so large. As many laws explain velocities as say f there themselves;
the alternation takes what the last laws say, fits the others as if r were not there, and goes on
until the laws agree with themselves. At each fit the squares of what is left do not rise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.declared import SETTINGS, Declared, Modes
from swsysid._effect_model.joint_fit import JointFit, fit_jointly
from swsysid._results import Array
from swsysid.effects import PlacedEffect, RateEffect
from swsysid.effects._placed import shaped


def fit_with_shapes(
    declared: Declared,
    terms: Sequence[PlacedEffect],
    records: Records,
    rows: NDArray[np.intp],
    targets: Array,
    modes: Modes | None = None,
) -> JointFit:
    """`fit_jointly`, with effects of rates as a whole among the terms."""
    plain = tuple(term for term in terms if not isinstance(term.effect, RateEffect))
    shapes = tuple(term for term in terms if isinstance(term.effect, RateEffect))
    fit = fit_jointly(declared, plain, records, rows, targets, modes)
    if not shapes:
        return fit
    every = np.arange(len(rows))
    said = fit.mode_velocities(records, rows)[fit.modes, every]
    for _ in range(SETTINGS.turns_of_shapes):
        wanted = targets + said - shaped(shapes, said, records.X[rows])
        fit = fit_jointly(declared, plain, records, rows, wanted, fit.modes)
        before, said = said, fit.mode_velocities(records, rows)[fit.modes, every]
        if np.abs(said - before).max() <= SETTINGS.same_rates * np.abs(said).max():
            break
    coef = iter(fit.coef)
    own = tuple(np.zeros(0) if term in shapes else next(coef) for term in terms)
    return replace(fit, terms=tuple(terms), coef=own)
