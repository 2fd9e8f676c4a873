"""From a table of measured trajectories to rows (X, Xdot) with names and units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._command.measurement import Measurement, check_roles
from swsysid._command.refusal import TableError
from swsysid._command.tables import Table
from swsysid._command.units import rate_unit
from swsysid._results import Array
from swsysid.differentiation import differentiate

__all__ = ["Samples", "measure"]


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
    check_roles(table, what)
    names = [*what.states, *what.inputs, *what.signals]
    times = [what.time] if what.time else []
    chosen = [*names, *what.derivatives, *times]
    numbers = table.numbers(chosen)
    _check_complete(table, numbers, chosen)
    groups = np.zeros(len(numbers)) if what.groups is None else table.labels(what.groups)
    if len(groups) != len(numbers):
        raise TableError(
            f"Column {what.groups!r} of {table.source} has {len(groups)} rows, the states have "
            f"{len(numbers)}."
        )
    if what.derivatives:
        X, Xdot, t, kept = _with_derivatives(numbers, what, groups, what.decimate)
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
            decimate=what.decimate,
        )
    X, signals = np.split(X, [X.shape[1] - len(what.signals)], axis=1)
    described = _described(table, what)
    return Samples(X, Xdot, signals, t, kept, **described, decimate=what.decimate)


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
