r"""A declared model beside effects that act on rates as a whole.

Velocities then are :math:`r(f)`, where the laws say f. The fit starts with rows whose velocity
tells f. Where r is flat a velocity says no more of f than that it is so small, or so large: there
the laws are fitted to what they say themselves, until they agree with that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._effect_model.declared import Declared, Modes
from swsysid._effect_model.joint_fit import JointFit, fit_jointly
from swsysid._results import Array
from swsysid.effects import PlacedEffect, RateEffect
from swsysid.effects._placed import shaped

_TURNS_OF_SHAPES = 200  # of a law whose rates an effect acts on, until they are the same
_SAME_RATES = 1e-6  # relative to the largest


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
    if not shapes:
        return fit_jointly(declared, plain, records, rows, targets, modes)
    wanted, X = targets.astype(float), records.X[rows]
    for term in reversed(shapes):
        wanted[:, term.target] = term.said(wanted, X)
    told = np.isfinite(wanted).all(axis=1)
    start = None if modes is None else modes[told]
    fit = fit_jointly(declared, plain, records, rows[told], wanted[told], start)
    modes = fit.predict_modes(records)[rows]
    said = _said(fit, records, rows, modes)
    for _ in range(_TURNS_OF_SHAPES):
        wanted = targets + said - shaped(shapes, said, X)
        fit = fit_jointly(declared, plain, records, rows, wanted, modes)
        before, modes, said = said, fit.modes, _said(fit, records, rows, fit.modes)
        if np.abs(said - before).max() <= _SAME_RATES * np.abs(said).max():
            break
    coef = iter(fit.coef)
    own = tuple(np.zeros(0) if term in shapes else next(coef) for term in terms)
    return replace(fit, terms=tuple(terms), coef=own)


def _said(fit: JointFit, records: Records, rows: NDArray[np.intp], modes: Modes) -> Array:
    """What the laws say of some rows, in these modes."""
    return np.asarray(fit.mode_velocities(records, rows)[modes, np.arange(len(rows))])
