"""From a table of measured trajectories to rows (X, Xdot) with names and units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.measurement import Measurement, check_roles
from swsysid._cli.missing import complete_cells
from swsysid._cli.runs import Runs, runs_of
from swsysid._results import Array
from swsysid._tables.tables import Table
from swsysid._tables.units import rate_unit
from swsysid._tables.wording import counted
from swsysid.differentiation import Smoothing, choose_smoothing, differentiate
from swsysid.differentiation._differentiate import LARGEST_GAP

__all__ = ["Samples", "measure"]

EVEN_GAP = 1.5  # steps; a filter that needs even times starts again after a missing row


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
    smoothing : Smoothing or None
        How the states were smoothed, with the noise found in them; None where derivatives were
        measured.
    remarks : tuple of str
        What reading had to mend, to mask and to leave out, in sentences.
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
    smoothing: Smoothing | None
    remarks: tuple[str, ...]


def measure(table: Table, what: Measurement) -> Samples:
    """The rows that `what` describes.

    Raises
    ------
    TableError, ValueError
        If a column is missing or not numeric, or the trajectories cannot be differentiated.
    """
    check_roles(table, what)
    numbers, labels, remarks = complete_cells(table, what)
    rows = np.flatnonzero(np.isfinite(numbers).all(axis=1))
    if what.timed:
        gap = EVEN_GAP if what.method == "butterworth" else LARGEST_GAP
        runs = runs_of(numbers[:, -1], labels, rows, table.row, what.time or "time", gap)
    else:
        runs = Runs(rows, np.zeros(len(rows), dtype=int) if labels is None else labels[rows], [])
    remarks += runs.remarks
    make = _with_derivatives if what.derivatives else _differentiated
    X, Xdot, t, kept, smoothing = make(numbers[runs.rows], runs.labels, what)
    remarks += _shortened(runs, kept, smoothing, what)
    X, signals = np.split(X, [X.shape[1] - len(what.signals)], axis=1)
    return Samples(
        X,
        Xdot,
        signals,
        t,
        kept,
        **_described(table, what),
        decimate=what.decimate,
        smoothing=smoothing,
        remarks=(*table.remarks, *remarks),
    )


def _differentiated(numbers, labels, what: Measurement):
    n_states = len(what.states)
    states, inputs, times = np.split(numbers, [n_states, numbers.shape[1] - 1], axis=1)
    options: dict = {"order": what.order, "decimate": what.decimate, "too_short": "drop"}
    smoothing = choose_smoothing(
        states,
        times[:, 0],
        labels,
        method=what.method,
        window=what.window,
        cutoff=what.cutoff,
        **options,
    )
    X, Xdot, t, kept, _ = differentiate(
        states,
        times[:, 0],
        labels,
        method=what.method,
        window=smoothing.window,
        cutoff=smoothing.cutoff,
        inputs=inputs if inputs.shape[1] else None,
        **options,
    )
    return X, Xdot, t, kept, smoothing


def _shortened(runs: Runs, kept, smoothing: Smoothing | None, what: Measurement) -> list[str]:
    """What the ends of the smoothing window cost."""
    names, counts = np.unique(runs.labels.astype(str), return_counts=True)
    short = ~np.isin(names, np.unique(kept.astype(str)))
    if not short.any():
        return []
    needed = (
        f"the {smoothing.window} samples of the window"
        if smoothing and smoothing.window
        else "the filter"
    )
    return [
        f"Left out: {counted(int(short.sum()), 'run')} shorter than {needed} "
        f"({counted(int(counts[short].sum()), 'row')})."
    ]


def _with_derivatives(numbers, labels, what: Measurement):
    n_states, n_channels = len(what.states), len(what.inputs) + len(what.signals)
    states, channels, rates, times = np.split(
        numbers, np.cumsum([n_states, n_channels, len(what.derivatives)]), axis=1
    )
    # With order 2 the measured velocities are states as well.
    X = np.hstack([states, rates[:, : n_states * (what.order - 1)], channels])
    t = times[:: what.decimate, 0] if what.timed else None
    return X[:: what.decimate], rates[:: what.decimate], t, labels[:: what.decimate], None


def _described(table: Table, what: Measurement) -> dict:
    """Names and units; x' is the first and x'' the second derivative of x."""
    ladder = [[table.title(name) for name in what.states]]
    steps = [[table.unit(table.resolve(name)) for name in what.states]]
    time_unit = table.unit(table.resolve(what.time)) if what.time else "s" * what.timed
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
