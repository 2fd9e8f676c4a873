"""Which columns of a table are what: said by the user, checked against the table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from swsysid._tables.table import TableError

if TYPE_CHECKING:
    from swsysid._tables.table import Table


@dataclass(frozen=True)
class Measurement:
    """Which columns of a table are what, and how to differentiate them (`differentiate`)."""

    states: tuple[str, ...]  # with order 2 positions
    inputs: tuple[str, ...] = ()
    signals: tuple[str, ...] = ()  # logged, but not used by the model
    time: str | None = None
    # One for each state; with order 2 the velocities, then the accelerations; empty: not measured.
    derivatives: tuple[str, ...] = ()
    quantity: str | None = None  # that the law gives where it is no rate; the one of `derivatives`
    groups: str | None = None  # the trajectory of each row
    order: int = 1  # 2: the second derivatives of the states obey the law
    method: str = "savitzky_golay"
    window: int | None = None
    cutoff: float | None = None
    decimate: int = 1
    time_step: float | None = None  # seconds between two rows, where no column holds the times
    time_unit: str | None = None  # of the column of the times; None: by its name or its steps
    # Inputs that keep their value between their rows; None: as they say themselves.
    hold: tuple[str, ...] | None = None
    restarts: bool = False  # a new run begins wherever all states jump at once
    fmu_input: str | None = None  # file of the inputs by which a functional mock-up unit is driven
    keep_spikes: bool = False  # use cells that look like no measurement all the same

    @property
    def timed(self) -> bool:
        """Whether the times of the rows are known."""
        return self.time is not None or self.time_step is not None

    @property
    def input_hold(self) -> str | tuple[str, ...]:
        """What the inputs do between two rows, as an identifier takes it."""
        if self.hold is None:
            return "auto"
        return tuple("zero" if name in self.hold else "linear" for name in self.inputs)

    @property
    def channels(self) -> list[str]:
        """The columns of numbers other than the times."""
        return [*self.states, *self.inputs, *self.signals, *self.derivatives]


def read_measured(
    paths: Sequence[str], what: Measurement, units: Mapping[str, str], missing: Sequence[str]
) -> tuple[Table, Measurement]:
    """The table of one file or of several, and which of its columns are what.

    States are those that the file itself names, and times those of a column of a usual name, where
    nobody names any.
    """
    from swsysid._tables.formats import own_format
    from swsysid._tables.several import read_files, recording_files, usual_clock
    from swsysid._tables.together import together

    files = read_files(paths, units, missing, what.fmu_input, what.inputs)
    tables = [table for each in files for table in each]
    if not what.states and not what.quantity:
        listed = dict.fromkeys(column for table in tables for column in table.columns)
        if not tables[0].states:
            raise TableError(
                f"Name the states with --states; the columns are: {', '.join(listed)}."
            )
        what = replace(what, states=tables[0].states)
    [first, *more] = recording_files(paths)
    if len(tables) == 1 and not more and own_format(first, ()) is None:
        [table] = tables
        if not what.timed and not what.derivatives:
            what = replace(what, time=usual_clock(table))
        check_roles(table, what)
        return table, what
    is_clocked = what.time_step is None and (what.time is not None or not what.derivatives)
    _check_once(what.channels)  # runs are joined by these names
    table, time, groups = together(files, what.channels, what.time, what.groups, is_clocked)
    what = replace(what, time=time, groups=groups)
    check_roles(table, what)
    return table, what


def check_roles(table: Table, what: Measurement) -> None:
    """Refuse roles that are missing, doubled, or played by a column that does not exist."""
    if not what.states and not (what.quantity and what.inputs):
        raise TableError(f"Name the states with --states; the columns are: {table.listing()}.")
    times = [what.time] if what.time else []
    for name in [*what.channels, *times, *([what.groups] if what.groups else [])]:
        table.resolve(name)
    expected = 1 if what.quantity else len(what.states) * what.order
    if what.derivatives and len(what.derivatives) != expected:
        kind = "velocities, then accelerations" if what.order == 2 else "one for each state"
        raise TableError(
            f"{len(what.derivatives)} derivatives are named; name {expected} columns, {kind}."
        )
    if not what.derivatives and not what.timed:
        raise TableError(
            "Neither times nor derivatives are named; name the column of the times (--time t) or "
            "those of measured derivatives (--derivatives), or give the seconds between two rows "
            "(--time-step 0.01)."
        )
    if what.time is not None and what.time_step is not None:
        raise TableError("Both --time and --time-step are given; one of them says it all.")
    if what.time_step is not None and not 0 < what.time_step < float("inf"):
        raise TableError(f"--time-step {what.time_step:g} is not a positive number of seconds.")
    for name in what.hold or ():
        if name not in what.inputs:
            raise TableError(f"--hold {name} is no input; name it with --inputs too.")
    _check_once([table.resolve(name) for name in [*what.channels, *times]])


def _check_once(columns: Sequence[str]) -> None:
    twice = [column for column in columns if columns.count(column) > 1]
    if twice:
        raise TableError(
            f"Column {twice[0]!r} is named twice; give each column one role: state, input, "
            "derivative or time."
        )
