"""From a table of measured trajectories to rows (X, Xdot) with names and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from swsysid._cli.angles import is_angle, is_in_degrees, unwrapped
from swsysid._cli.clocks import fill_states, with_own_clocks
from swsysid._cli.masking import complete_cells
from swsysid._cli.measurement import Measurement, check_roles
from swsysid._cli.recorded import Recorded, Steps
from swsysid._cli.restarts import with_restarts
from swsysid._cli.runs import Runs, runs_of
from swsysid._cli.settings import PREPARING
from swsysid._cli.times import in_seconds
from swsysid._rendering.printing import counted
from swsysid._results import Array
from swsysid._stays.given import FEWEST_SAMPLES, read_given
from swsysid._stays.start import measured_noise
from swsysid._tables.table import Table, TableError
from swsysid._tables.units import rate_unit
from swsysid.differentiation import Smoothing, choose_smoothing, differentiate
from swsysid.differentiation._smoothing import LARGEST_GAP

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Samples:
    """Rows of trajectories, with the names and units of their columns."""

    X: Array  # states, then inputs
    Xdot: Array
    signals: Array
    t: Array | None
    groups: NDArray
    names: tuple[str, ...]  # of the columns of X
    rate_names: tuple[str, ...]
    signal_names: tuple[str, ...]
    units: Mapping[str, str]  # by these names, where they are known
    time_unit: str
    # So many columns of Xdot, the first, follow a law that is known: they are velocities, which
    # are columns of X too.
    n_known: int
    source: str
    decimate: int
    smoothing: Smoothing | None  # with the noise found in the states; None for measured rates
    remarks: tuple[str, ...]  # what reading had to mend, to mask and to leave out
    recorded: Recorded | None = None  # before smoothing; None for measured rates

    @property
    def frame(self) -> pd.DataFrame:
        """`X` with the names of its columns."""
        import pandas as pd

        return pd.DataFrame(self.X, columns=list(self.names))

    @property
    def with_recorded_inputs(self) -> Array:
        """`X` with the recorded values that are nearest to filtered inputs.

        A filter makes of a switch values that it never has; none is drawn at, or told of.
        """
        X = self.X.copy()
        if self.recorded is not None:
            inputs = self.recorded.inputs.T
            for place, column in enumerate(inputs, start=X.shape[1] - len(inputs)):
                values = np.unique(column[np.isfinite(column)])
                X[:, place] = values[np.searchsorted((values[1:] + values[:-1]) / 2, X[:, place])]
        return X

    def unit(self, name: str) -> str:
        """The unit of a column, "" where unknown."""
        return self.units.get(name, "")

    @property
    def angles(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """The columns of `X` that are angles; those of an angle in degrees or of its rate."""
        units = list(enumerate(map(self.unit, self.names)))
        return (
            tuple(k for k, unit in units if is_angle(unit)),
            tuple(k for k, unit in units if is_in_degrees(unit)),
        )

    def with_unit(self, name: str) -> str:
        """A name with its unit in brackets."""
        return f"{name} [{self.unit(name)}]" if self.unit(name) else name


def measure(table: Table, what: Measurement, rest: str = "thin") -> Samples:
    """The rows that `what` describes; TableError or ValueError say what is in the way.

    What becomes of a long `rest` is said as `differentiate` takes it.
    """
    check_roles(table, what)
    table = with_own_clocks(in_seconds(table.spelled(what.channels), what), what)
    numbers, labels, steps, remarks = complete_cells(table, what)
    runs = _runs(table, what, numbers, labels)
    table = unwrapped(table, what, numbers, runs)
    runs = with_restarts(runs, numbers, what, table.row)
    remarks += _still(table, what, numbers[runs.rows])
    recorded = None
    if not what.derivatives:
        recorded = Recorded.of(numbers[runs.rows], runs.labels, what)
        recorded = recorded.with_steps(steps, _runs_of(steps, numbers, labels, runs))
    put_between = np.zeros(len(what.states), dtype=bool)
    if what.timed and not what.derivatives:
        put_between = fill_states(what, numbers, labels)
    whole = _complete(table, what, numbers, runs)
    make = _with_derivatives if what.derivatives else partial(_differentiated, rest=rest)
    X, Xdot, t, kept, smoothing = make(numbers[whole.rows], whole.labels, what)
    remarks += [*runs.remarks, *_shortened(whole, kept, smoothing)]
    if smoothing is not None:
        if recorded is not None and put_between.any():
            smoothing = _of_samples(smoothing, recorded, put_between)
        remarks += _unlike(what, numbers[whole.rows], smoothing)
        _refuse_rates(what, X)
    X, signals = np.split(X, [X.shape[1] - len(what.signals)], axis=1)
    return Samples(
        X,
        Xdot,
        signals,
        t,
        kept,
        **_described(table, what),
        n_known=len(what.states) * (what.order - 1),
        source=table.source,
        decimate=what.decimate,
        smoothing=smoothing,
        remarks=(*table.remarks, *remarks),
        recorded=recorded,
    )


def _runs(table: Table, what: Measurement, numbers: Array, labels: NDArray | None) -> Runs:
    """The rows in order, those with a missing state among them."""
    rows = np.flatnonzero(np.isfinite(numbers).any(axis=1))
    if not what.timed:
        return Runs(rows, np.zeros(len(rows), dtype=int) if labels is None else labels[rows], [])
    gap = PREPARING.even_gap if what.method == "butterworth" else LARGEST_GAP
    times, cells = numbers[:, -1], numbers[:, :-1]
    return runs_of(times, cells, labels, rows, table.row, what.time or "time", gap)


def _complete(table: Table, what: Measurement, numbers: Array, runs: Runs) -> Runs:
    """The rows with all states; a run ends where too many in a row lack one."""
    holds_all = np.isfinite(numbers[runs.rows]).all(axis=1)
    if holds_all.all():
        return runs
    rows = runs.rows[holds_all]
    labels = np.zeros(len(numbers), dtype=runs.labels.dtype)
    labels[runs.rows] = runs.labels
    alone = np.full_like(numbers, np.nan)
    alone[rows] = numbers[rows]
    return _runs(table, what, alone, labels)


def _runs_of(steps: Steps, numbers: Array, labels: NDArray | None, runs: Runs) -> NDArray:
    """The run in which each step of an input lies, None if in none.

    Where the clock starts again, several runs have its time: it is the one that stands nearest.
    """
    found = np.full(len(steps.t), None, dtype=object)
    nearest = np.full(len(steps.t), np.inf)
    for label in set(runs.labels.tolist()):
        rows = runs.rows[runs.labels == label]
        t = numbers[rows, -1]
        inside = (steps.t > t[0]) & (steps.t <= t[-1])
        if labels is not None:
            inside &= labels[steps.rows] == labels[rows[0]]
        away = np.abs(rows[np.searchsorted(t, steps.t).clip(max=len(t) - 1)] - steps.rows)
        better = inside & (away < nearest)
        found[better], nearest[better] = label, away[better]
    return found


def _still(table: Table, what: Measurement, numbers: Array) -> list[str]:
    """What columns that never change cannot tell; a state among them is refused."""
    remarks = []
    for name, values in zip(what.channels, numbers.T, strict=False):
        known = values[np.isfinite(values)]
        if not len(known) or name in what.derivatives or np.ptp(known) > 0.0:
            continue
        if len(known) == 1:
            raise TableError(
                f"Column {name!r} of {table.source} holds one number; no law can be told from it."
            )
        told = f"Column {name!r} of {table.source} is {known[0]:g} in all {len(known):,} rows"
        if name in what.states:
            raise TableError(
                f"{told}; no law can be told from a state that never moves, leave it out."
            )
        if name in what.inputs:
            remarks.append(f"{told}: what it does cannot be told from a constant, leave it out.")
    return remarks


def _unlike(what: Measurement, numbers: Array, smoothing: Smoothing) -> list[str]:
    """Columns whose neighbouring samples have little in common."""
    spread = numbers[:, : len(what.states)].std(axis=0)
    names = [
        name
        for name, noise, size in zip(what.states, smoothing.noise, spread, strict=False)
        if noise > PREPARING.unlike * size
    ]
    if not names:
        return []
    return [
        f"Neighbouring samples of {', '.join(names)} have little in common: that is noise, or a "
        "motion faster than its sampling; record at least ten samples between two switches."
    ]


def _of_samples(smoothing: Smoothing, recorded: Recorded, put_between) -> Smoothing:
    """The noise of states by their samples alone: values put between these are smoother."""
    given = read_given(recorded.states, recorded.t, recorded.groups, None)
    measured = measured_noise(given, smoothing.noise)
    noise = np.where(put_between, measured, smoothing.noise)
    return Smoothing(smoothing.method, smoothing.window, smoothing.cutoff, noise)


def _refuse_rates(what: Measurement, X: Array) -> None:
    """With order 2 the rate of a position is no position of its own."""
    n = len(what.states) * (what.order - 1)
    if n < 2:
        return
    alike = np.asarray(np.corrcoef(X[:, : 2 * n].T))[n : 2 * n, :n]
    rate_of, column = np.unravel_index(np.argmax(alike - np.eye(n)), alike.shape)
    if rate_of != column and alike[rate_of, column] > PREPARING.rate:
        raise TableError(
            f"Column {what.states[column]!r} is the rate of {what.states[rate_of]!r}; with "
            "--order 2 name the positions alone, or leave --order out."
        )


def _differentiated(numbers, labels, what: Measurement, rest: str):
    import pandas as pd

    states, inputs, times = np.split(numbers, [len(what.states), numbers.shape[1] - 1], axis=1)
    longest = int(np.unique(labels.astype(str), return_counts=True)[1].max(initial=0))
    if longest < FEWEST_SAMPLES:
        raise TableError(
            f"No trajectory is long enough to be differentiated: the longest of "
            f"{len(set(labels.tolist()))} has {longest} samples, and {FEWEST_SAMPLES} are the "
            "least; record longer ones, or check what --groups and --time name."
        )
    rows = pd.DataFrame(states, columns=list(what.states)), times[:, 0], labels
    options: dict = {"method": what.method, "order": what.order, "decimate": what.decimate}
    options["too_short"] = "drop"
    smoothing = choose_smoothing(*rows, window=what.window, cutoff=what.cutoff, **options)
    options |= {"window": smoothing.window, "cutoff": smoothing.cutoff}
    driven = inputs if inputs.shape[1] else None
    return (*differentiate(*rows, inputs=driven, rest=rest, **options)[:4], smoothing)


def _with_derivatives(numbers, labels, what: Measurement):
    n_states, n_channels = len(what.states), len(what.inputs) + len(what.signals)
    states, channels, rates, times = np.split(
        numbers, np.cumsum([n_states, n_channels, len(what.derivatives)]), axis=1
    )
    # With order 2 the measured velocities are states as well.
    X = np.hstack([states, rates[:, : n_states * (what.order - 1)], channels])
    t = times[:: what.decimate, 0] if what.timed else None
    return X[:: what.decimate], rates[:: what.decimate], t, labels[:: what.decimate], None


def _shortened(runs: Runs, kept, smoothing: Smoothing | None) -> list[str]:
    """What the ends of the smoothing window cost."""
    names, counts = np.unique(runs.labels.astype(str), return_counts=True)
    short = ~np.isin(names, np.unique(kept.astype(str)))
    if not short.any():
        return []
    window = smoothing.window if smoothing else None
    needed = f"the {window} samples of the window" if window else "the filter"
    return [
        f"Left out: {counted(int(short.sum()), 'run')} shorter than {needed} "
        f"({counted(int(counts[short].sum()), 'row')})."
    ]


def _described(table: Table, what: Measurement) -> dict:
    """Names and units; x' is the first and x'' the second derivative of x."""
    time_unit = table.unit(table.resolve(what.time)) if what.time else "s" * what.timed
    units = {
        table.title(name): table.unit(table.resolve(name))
        for name in (*what.states, *what.inputs, *what.signals)
    }
    levels = [tuple(table.title(name) for name in what.states)]
    for _ in range(0 if what.quantity else what.order):
        units |= {f"{name}'": rate_unit(units[name], time_unit) for name in levels[-1]}
        levels.append(tuple(f"{name}'" for name in levels[-1]))
    rate_names = sum(levels[1:], start=())
    if what.quantity:
        rate_names = (table.title(what.quantity),)
    for rate, name in zip(rate_names, what.derivatives, strict=bool(what.derivatives)):
        units[rate] = table.unit(table.resolve(name)) or units.get(rate, "")
    return {
        "names": (*sum(levels[: what.order], start=()), *map(table.title, what.inputs)),
        "rate_names": rate_names,
        "signal_names": tuple(map(table.title, what.signals)),
        "units": {name: unit for name, unit in units.items() if unit},
        "time_unit": time_unit,
    }
