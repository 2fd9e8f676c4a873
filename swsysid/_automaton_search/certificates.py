r"""How far a guard is from the samples on both of its sides, and how far any guard could be.

In its mode a guard is below zero at every sample, :math:`c_i`; where the old law takes the last
sample before a switch, :math:`c_k^-`, within an interval, :math:`c_k^+`, it is not. The margin
program of the paper (section IV) for guards of the same monomials,

.. math::

    \max_{a, m} m \quad \text{with} \quad -a \cdot \phi(c_i) \ge m, \quad a \cdot \phi(c_k^+) \ge m,
    \quad \tfrac1n \sum_k a \cdot \big(\phi(c_k^+) - \phi(c_k^-)\big) = 1 ,

bounds the margin of each: one that lies where the switches say has a smaller one, and nobody a
larger one. Both are negative where no guard has all samples on their sides.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from swsysid._automaton.transitions import Guard, PolynomialGuard
from swsysid._automaton_search.found import FoundTransition, Told
from swsysid._automaton_search.guards import known_rows
from swsysid._results import Array
from swsysid._solvers.conic import linear_program
from swsysid._stays.given import Given
from swsysid._stays.laws import Laws


class Certificate(NamedTuple):
    """Margins in units of the mean rise of a guard across its switches; a half is the most."""

    margin: float
    largest: float


UNKNOWN = Certificate(np.nan, np.nan)


def certificate(guard: Guard, below: Array, last: Array, reached: Array) -> Certificate:
    """That of a guard, with columns inside its mode and on both sides of its switches.

    Of several conditions the least one, each with the rows at which it does not hold.
    """
    if len(guard.conditions) == 1:
        return _of_condition(guard.conditions[0], below, last, reached)
    each = []
    for one in guard.conditions:
        waits = one.values(last) < 0.0
        inside = below[one.values(below) < 0.0]
        each.append(_of_condition(one, inside, last[waits], reached[waits]))
    return min(each, key=lambda one: np.nan_to_num(one.margin, nan=np.inf))


def _of_condition(guard: PolynomialGuard, below: Array, last: Array, reached: Array) -> Certificate:
    below, both = known_rows(guard, below), known_rows(guard, np.hstack([last, reached]))
    last, reached = np.split(both, 2, axis=1)
    if not len(reached):
        return UNKNOWN
    inside, before, after = (_terms(guard, rows) for rows in (below, last, reached))
    rising = (after - before).mean(axis=0)
    scale = float(rising.sum())
    if not scale > 0.0:
        return UNKNOWN
    signed = np.vstack([-inside, -before, after])
    return Certificate(float(signed.sum(axis=1).min()) / scale, _largest(signed, rising))


def certificates(told: Told, given: Given, laws: Laws) -> list[Certificate]:
    """Those of all transitions of an automaton in continuous time."""
    entered = [
        np.sort(np.concatenate([one.times[one.recording == k] for one in told.changes] or [[]]))
        for k in range(len(given.records))
    ]
    inside = [_columns(told, given, entered, k, np.arange(len(own))) for k, own in
              enumerate(told.modes)]  # fmt: skip
    return [
        UNKNOWN if one.guard is None else certificate(
            one.guard.whole,
            np.vstack([rows[own == one.source]
                       for rows, own in zip(inside, told.modes, strict=True)]),
            *_around(one, told, given, laws, entered),
        )
        for one in told.changes
    ]  # fmt: skip


def _around(
    one: FoundTransition, told: Told, given: Given, laws: Laws, entered: Sequence[Array]
) -> tuple[Array, Array]:
    """Columns at the samples before the switches, and where the old law takes them."""
    n_states, mode, rows = len(laws.spread), np.array([one.source]), []
    for k, time in zip(one.recording.tolist(), one.times.tolist(), strict=True):
        record = given.records[k]
        place = int(np.clip(np.searchsorted(record.t, time) - 1, 0, len(record.t) - 2))
        last, ahead = _columns(told, given, entered, k, np.array([place, place + 1]))
        duration = record.t[[place + 1]] - record.t[place]
        u, after = record.u[[place]], record.u[[place + 1]]
        x = laws.step(mode, last[None, :n_states], u, after, duration)[0]
        # the clocks go on as well
        clocks = last[-2:] + duration
        rows.append((last, np.concatenate([x, ahead[n_states:-2], clocks])))
    last, reached = np.array(rows).transpose(1, 0, 2)
    return last, reached


def _columns(told: Told, given: Given, entered: Sequence[Array], k: int, samples) -> Array:
    """States, inputs, dwell and time at samples of a recording; no dwell where it began."""
    record = given.records[k]
    t = record.t[samples]
    begins = np.append(np.nan, entered[k])[np.searchsorted(entered[k], t, side="right")]
    return np.column_stack([told.states[k][samples], record.u[samples], t - begins, t])


def _terms(guard: PolynomialGuard, rows: Array) -> Array:
    """Terms whose sum is the guard, (n_rows, n_terms)."""
    used = guard.powers.any(axis=0)
    kept = guard.coef != 0.0
    columns = rows[:, used]
    monomials = np.prod(columns[:, None, :] ** guard.powers[kept][:, used], axis=2)
    return np.asarray(monomials * guard.coef[kept], dtype=float)


def _largest(signed: Array, rising: Array) -> float:
    """The margin of the best sum of the same terms; NaN where the solver fails."""
    n, n_terms = signed.shape
    unit = np.maximum(np.abs(signed).max(axis=0), np.finfo(float).tiny)
    done = linear_program(
        np.append(np.zeros(n_terms), -1.0),
        A_ub=np.hstack([-signed / unit, np.ones((n, 1))]),
        b_ub=np.zeros(n),
        A_eq=np.append(rising / unit, 0.0)[None, :],
        b_eq=[1.0],
        bounds=[(-np.inf, np.inf)] * n_terms + [(-np.inf, 0.5)],
    )
    return float(done.x[-1])
