"""From a table of measured trajectories to rows (X, Xdot) with names and units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._command.tables import Table, TableError, rate_unit
from swsysid._results import Array
from swsysid.differentiation import differentiate

__all__ = ["Measurement", "Samples", "measure"]

MAX_ROWS = 5000  # decimation keeps about so many where the user does not choose


@dataclass(frozen=True)
class Measurement:
    """Which columns of a table are what, and how to differentiate them.

    Attributes
    ----------
    states, inputs, signals : tuple of str
        Columns of the states (positions with ``order=2``), of the inputs, and of logged signals
        that the model does not use.
    time : str or None
    derivatives : tuple of str
        Columns of measured derivatives, one for each state; with ``order=2`` the velocities,
        then the accelerations. Empty to differentiate the states.
    groups : str or None
        Column that names the trajectory of each row.
    order : {1, 2}
        2 means that the states are positions whose second derivative obeys the law.
    method, window, cutoff
        Of `differentiate`.
    decimate : int or None
        None keeps about five thousand rows.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()
    time: str | None = None
    derivatives: tuple[str, ...] = ()
    groups: str | None = None
    order: int = 1
    method: str = "savitzky_golay"
    window: int | None = None
    cutoff: float | None = None
    decimate: int | None = None


@dataclass(frozen=True)
class Samples:
    """Rows (X, Xdot) of trajectories.

    Attributes
    ----------
    X : ndarray of shape (n_samples, n_states + n_inputs)
    Xdot : ndarray of shape (n_samples, n_states)
    signals : ndarray of shape (n_samples, n_signals)
    t : ndarray of shape (n_samples,) or None
    groups : ndarray of shape (n_samples,)
    names, units : tuple of str
        Of the columns of `X`; a unit is "" where unknown.
    rate_names, rate_units : tuple of str
        Of the columns of `Xdot`.
    n_known : int
        The first `n_known` columns of `Xdot` follow a law that is known: they are velocities,
        which are columns of `X` too.
    signal_names, signal_units : tuple of str
    time_unit : str
    source : str
        What the samples were read from.
    decimate : int
    """

    X: Array
    Xdot: Array
    signals: Array
    t: Array | None
    groups: NDArray
    names: tuple[str, ...]
    units: tuple[str, ...]
    rate_names: tuple[str, ...]
    rate_units: tuple[str, ...]
    n_known: int
    signal_names: tuple[str, ...]
    signal_units: tuple[str, ...]
    time_unit: str
    source: str
    decimate: int


def measure(table: Table, what: Measurement) -> Samples:
    """The rows that `what` describes.

    Raises
    ------
    TableError, ValueError
        If a column is missing or not numeric, or the trajectories cannot be differentiated.
    """
    _check(what)
    names = [*what.states, *what.inputs, *what.signals]
    times = [what.time] if what.time else []
    chosen = [*names, *what.derivatives, *times]
    _check_distinct(table, chosen)
    numbers = table.numbers(chosen)
    _check_complete(table, numbers, chosen)
    groups = np.zeros(len(numbers)) if what.groups is None else table.labels(what.groups)
    if len(groups) != len(numbers):
        raise TableError(
            f"Column {what.groups!r} of {table.source} has {len(groups)} rows, the states have "
            f"{len(numbers)}."
        )
    decimate = what.decimate or max(1, round(len(numbers) / MAX_ROWS))
    if what.derivatives:
        X, Xdot, t, kept = _with_derivatives(numbers, what, groups, decimate)
    else:
        X, Xdot, t, kept, _ = differentiate(
            numbers[:, : len(what.states)],
            numbers[:, -1],
            groups,
            method=what.method,
            inputs=numbers[:, len(what.states) : len(names)] if names[len(what.states) :] else None,
            order=what.order,
            window=what.window,
            cutoff=what.cutoff,
            decimate=decimate,
        )
    X, signals = np.split(X, [X.shape[1] - len(what.signals)], axis=1)
    described = _described(table, what)
    return Samples(X, Xdot, signals, t, kept, **described, decimate=decimate)


def _check(what: Measurement) -> None:
    if not what.states:
        raise TableError("No states are named; name their columns: --states position speed.")
    expected = len(what.states) * what.order
    if what.derivatives and len(what.derivatives) != expected:
        kind = "velocities, then accelerations" if what.order == 2 else "one for each state"
        raise TableError(
            f"{len(what.derivatives)} derivatives are named; name {expected} columns, {kind}."
        )
    if not what.derivatives and what.time is None:
        raise TableError(
            "Neither times nor derivatives are named; name the column of the times (--time t) or "
            "those of measured derivatives (--derivatives)."
        )


def _check_distinct(table: Table, names) -> None:
    """Refuse a column with two roles, by either of its names."""
    columns = [table.resolve(name) for name in names]
    twice = [column for column in columns if columns.count(column) > 1]
    if twice:
        raise TableError(
            f"Column {twice[0]!r} is named twice; give each column one role: state, input, "
            "derivative or time."
        )


def _check_complete(table: Table, numbers, names) -> None:
    """Refuse empty cells, naming the first."""
    for name, column in zip(names, numbers.T, strict=True):
        bad = ~np.isfinite(column)
        if bad.any():
            raise TableError(
                f"Column {name!r} of {table.source} has {bad.sum()} missing or infinite values, "
                f"the first in row {bad.argmax() + 1}; remove these rows or fill them."
            )


def _with_derivatives(numbers, what: Measurement, groups, decimate):
    n_states, n_channels = len(what.states), len(what.inputs) + len(what.signals)
    states, channels, rates, times = np.split(
        numbers, np.cumsum([n_states, n_channels, len(what.derivatives)]), axis=1
    )
    # With order 2 the measured velocities are states as well.
    X = np.hstack([states, rates[:, : n_states * (what.order - 1)], channels])
    t = times[::decimate, 0] if what.time else None
    return X[::decimate], rates[::decimate], t, groups[::decimate]


def _described(table: Table, what: Measurement) -> dict:
    """Names and units; x' is the first and x'' the second derivative of x."""
    ladder = [[table.title(name) for name in what.states]]
    steps = [[table.unit(table.resolve(name)) for name in what.states]]
    time_unit = table.unit(table.resolve(what.time)) if what.time else ""
    for level in range(1, what.order + 1):
        ladder.append([name + "'" * level for name in ladder[0]])
        steps.append([rate_unit(unit, time_unit) for unit in steps[-1]])
    rate_units = _flat(steps[1:])
    if what.derivatives:
        measured = [table.unit(table.resolve(name)) for name in what.derivatives]
        rate_units = [own or derived for own, derived in zip(measured, rate_units, strict=True)]
    inputs = [table.title(name) for name in what.inputs]
    input_units = [table.unit(table.resolve(name)) for name in what.inputs]
    return {
        "names": tuple(_flat(ladder[:-1]) + inputs),
        "units": tuple(_flat(steps[:-1]) + input_units),
        "rate_names": tuple(_flat(ladder[1:])),
        "rate_units": tuple(rate_units),
        "n_known": len(what.states) * (what.order - 1),
        "signal_names": tuple(table.title(name) for name in what.signals),
        "signal_units": tuple(table.unit(table.resolve(name)) for name in what.signals),
        "time_unit": time_unit,
        "source": table.source,
    }


def _flat(lists) -> list:
    return [item for inner in lists for item in inner]
