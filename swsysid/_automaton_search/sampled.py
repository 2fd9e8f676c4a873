r"""From recordings to an automaton in discrete time: laws and stays by rows, resets, guards.

The mode at row k makes x[k + 1]. A transition that is taken at row k had a guard below zero at row
k - 1 and has one that is not at row k, so that its zero lies anywhere between the two. Where the
state jumps, row k holds what the reset made; what the old law made of row k - 1 is what it, and the
guard, were given.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swsysid._automaton.first_modes import FirstModes
from swsysid._automaton_search.answer import IdentifiedAutomaton
from swsysid._automaton_search.assembly import (
    automaton_of,
    order_of_modes,
    switch_times_of,
    verdicts_of,
)
from swsysid._automaton_search.found import FoundTransition
from swsysid._automaton_search.margins import guard_with_margin
from swsysid._automaton_search.resets import best_reset
from swsysid._automaton_search.settings import SETTINGS
from swsysid._discrete_stays.identify import DiscreteStays, identify_stays
from swsysid._discrete_stays.settings import SETTINGS as DISCRETE
from swsysid._results import Array
from swsysid._stays.given import Given


@dataclass(frozen=True)
class Taken:
    """Transitions that were taken, one row for each."""

    recording: NDArray[np.intp]
    source: NDArray[np.intp]
    target: NDArray[np.intp]
    times: Array
    jumped: NDArray[np.bool_]
    last: Array  # (n_taken, n_columns): columns at the row before
    given: Array  # what guard and reset were given
    after: Array  # (n_taken, n_states)

    def __len__(self) -> int:
        return len(self.times)

    def take(self, rows: NDArray[np.bool_]) -> Taken:
        """Some of them."""
        return Taken(*(part[rows] for part in vars(self).values()))


def identified(
    given: Given,
    *,
    lags: int | str,
    library: object,
    n_modes: int | str,
    max_modes: int,
    degree: int,
) -> IdentifiedAutomaton:
    """The automaton of some recordings; `degree` is that of the guards."""
    stays = _until_they_jump(
        identify_stays(
            given.records,
            lags,
            library=library,
            n_modes=n_modes,
            channels=given.names,
            settings=replace(DISCRETE, most_modes=max_modes),
        )
    )
    columns = _with_clocks(stays)
    taken = _taken(stays, columns, given)
    pairs = np.unique(np.column_stack([taken.source, taken.target]), axis=0)
    found = [
        _transition(stays, columns, taken.take((taken.source == i) & (taken.target == j)), degree)
        for i, j in pairs
    ]
    found = [one for one in found if one.is_one]
    modes = _by_samples(stays, given)
    order = order_of_modes(modes, len(stays.coef))
    first = FirstModes(stays.rows.columns[:, : _n_lagged(stays)], stays.modes)
    automaton = automaton_of(
        stays.coef, stays.feature_map, found, first, order, discrete_time=True, lags=stays.rows.lags
    )
    return IdentifiedAutomaton(
        automaton,
        [np.argsort(order)[own] for own in modes],
        [
            np.where(np.isfinite(x), x, r.filled)
            for x, r in zip(stays.states, given.records, strict=True)
        ],
        switch_times_of(found, len(given.records)),
        stays.noise,
        None,
        verdicts_of(found, order, 1.0),
        stays.candidates,
        (stays.straddling.sum() - sum(len(one) for one in found if one.jumps)) / len(stays.rows),
    )


def _until_they_jump(stays: DiscreteStays) -> DiscreteStays:
    """The same stays; a row that no law explains belongs to the stay before it, which ends so."""
    modes, begins = stays.modes.copy(), stays.rows.begins
    for k in np.flatnonzero(stays.straddling & ~begins):
        modes[k] = modes[k - 1]
    return replace(stays, modes=modes)


def _n_lagged(stays: DiscreteStays) -> int:
    return stays.rows.n_states * (stays.rows.lags + 1)


def _entries(stays: DiscreteStays) -> NDArray[np.bool_]:
    """True at rows whose mode was entered there: another one than before, or after a jump."""
    rows, modes = stays.rows, stays.modes
    entered = np.zeros(len(rows), dtype=bool)
    entered[1:] = (modes[1:] != modes[:-1]) | (stays.straddling[:-1] & ~stays.straddling[1:])
    return entered & ~rows.begins


def _with_clocks(stays: DiscreteStays) -> Array:
    """Columns of the rows, steps since their mode was entered (NaN if unknown), and the step."""
    rows, entered = stays.rows, _entries(stays)
    dwell = np.empty(len(rows))
    since = np.nan
    for k, (begins, enters) in enumerate(zip(rows.begins, entered, strict=True)):
        since = np.nan if begins else 0.0 if enters else since + 1.0
        dwell[k] = since
    return np.column_stack([rows.columns, dwell, rows.sample.astype(float)])


def _taken(stays: DiscreteStays, columns: Array, given: Given) -> Taken:
    rows, n_states = stays.rows, stays.rows.n_states
    at = np.flatnonzero(_entries(stays))
    before = at - 1
    jumped = stays.straddling[before]
    source = stays.modes[before]
    made = np.einsum("kij,kj->ki", stays.coef[source], stays.feature_map(rows.columns[before]))
    reached = columns[at].copy()
    reached[:, -2] = columns[before, -2] + 1.0  # the mode is still the old one
    reached[jumped, :n_states] = made[jumped]
    times = np.array(
        [given.records[r].t[k] for r, k in zip(rows.recording[at], rows.sample[at], strict=True)]
    )
    return Taken(
        rows.recording[at], source, stays.modes[at], times, jumped,
        columns[before], reached, rows.columns[at, :n_states],
    )  # fmt: skip


def _transition(stays: DiscreteStays, columns: Array, taken: Taken, degree: int) -> FoundTransition:
    """Guard and reset of what was taken from one mode to another."""
    n_states, reset = stays.rows.n_states, None
    inside = (stays.modes == taken.source[0]) & ~stays.straddling
    guard = guard_with_margin(columns[inside], taken.last, taken.given, degree)
    if taken.jumped.mean() > 0.5:
        least = SETTINGS.least_noise * np.maximum(taken.after.std(axis=0), np.finfo(float).tiny)
        errors = SETTINGS.end_of_stay * np.maximum(stays.noise, least)
        none = np.zeros(0, dtype=np.intp)
        reset = best_reset(taken.given[:, :n_states], taken.after, errors, none)
    source, target = int(taken.source[0]), int(taken.target[0])
    return FoundTransition(source, target, taken.recording, taken.times, guard, reset)


def _by_samples(stays: DiscreteStays, given: Given) -> list[NDArray[np.intp]]:
    """Mode of every sample: that of its row, of the nearest row before, or of the first one."""
    modes = []
    for k, record in enumerate(given.records):
        own = np.flatnonzero(stays.rows.recording == k)
        samples = stays.rows.sample[own]
        if not len(own):
            modes.append(np.zeros(len(record.t), dtype=np.intp))
            continue
        last = np.searchsorted(samples, np.arange(len(record.t)), side="right") - 1
        modes.append(stays.modes[own][np.maximum(last, 0)])
    return modes
