"""Velocities that a filter has smeared or that are late, as the laws of a model are fitted to them.

Of velocities of which a filter shows means the declared model is fitted to the means of its terms.
Velocities as late as the states they are made of are brought to time, with the modes they show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swsysid._checks.arrays import names_of
from swsysid._data.records import Records
from swsysid._effect_model.declared import Declared, FittedDeclared, Modes
from swsysid._effect_model.models import laws_of
from swsysid._noise import robust_regression
from swsysid._results import Array
from swsysid.effects import PlacedEffect
from swsysid.effects._kinematics import is_static
from swsysid.effects._placed import late_records

# Sharpenings of velocities that a filter has made, each from better modes.
_SHARPENINGS = 2


def fitted_alone(
    declared: Declared,
    whole: Records,
    rows: NDArray[np.intp],
    targets: Array,
    modes: Modes | None,
) -> FittedDeclared:
    """The declared model fitted to some rows of a record, of which a filter may show means."""
    seen = whole.take(rows)
    if whole.average is None:
        return declared.fitted(seen, targets, modes)
    blurred, sharp = libraries(declared, whole, rows)

    def sharpened(modes: Modes) -> FittedDeclared:
        for _ in range(_SHARPENINGS):
            at_instants = sharpened_velocities(declared, targets, blurred, sharp, modes)
            fitted = declared.fitted(seen, at_instants, modes)
            if np.array_equal(fitted.modes, modes):
                break  # the same modes make the same velocities
            modes = fitted.modes
        return fitted

    def lost(fitted: FittedDeclared) -> float:
        laws = laws_of(fitted.estimator).coef[fitted.modes]
        errors = np.abs(targets - np.einsum("nkf,nf->nk", laws, blurred)).mean(axis=0)
        return float(np.log(np.maximum(errors, np.finfo(float).tiny)).sum())  # of Laplace's law

    # Modes that are known may be wrong where an effect is missing, and a fit to smeared velocities
    # finds others; but these obey no law of the library at the instants, and it may go astray.
    starts = [declared.fitted(seen, targets, modes).modes]
    if modes is not None and not np.array_equal(starts[0], modes):
        starts.append(modes)
    return min(map(sharpened, starts), key=lost)


def libraries(declared: Declared, whole: Records, rows: NDArray[np.intp]) -> tuple[Array, Array]:
    """The library on some rows as the velocities show it, and as it is at their instants."""
    if whole.average is None:
        features = declared.library(whole.X[rows])
        return features, features
    features = declared.library(whole.X)
    return whole.averaged(features, rows), features[rows]


def sharpened_velocities(
    declared: Declared, targets: Array, blurred: Array, sharp: Array, modes: Modes
) -> Array:
    """Velocities as a filter shows them with the laws at the instants of the rows instead.

    The declared model knows its library at the instants only.
    """
    answer = targets.copy()
    support = declared.support(int(modes.max()) + 1, targets.shape[1], sharp.shape[1])
    for mode in np.unique(modes):
        rows = modes == mode
        for target in range(targets.shape[1]):
            terms = support[mode, target]
            law = robust_regression(blurred[np.ix_(rows, terms)], targets[rows, target])
            answer[rows, target] += (sharp - blurred)[np.ix_(rows, terms)] @ law
    return answer


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


def with_quantity(declared: Declared, records: Records, targets: Array, given: object) -> Records:
    """The record, of which no column is a state if the law gives a quantity that is no rate.

    The `targets` are what a user has `given`, by whose name the quantity is called.
    """
    if declared.discrete_time or declared.known is not None or not is_static(records, targets):
        return records
    return replace(records, quantity=names_of(given, 1, "y")[0])
