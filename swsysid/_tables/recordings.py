"""Several files as recordings: each a run, or channels of one run beside each other."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import numpy as np
from numpy.typing import NDArray

from swsysid._tables.several import (
    Joined,
    ReadColumn,
    columns_read,
    joined,
    read_files,
    runs_among,
)
from swsysid._tables.table import TableError

if TYPE_CHECKING:
    from pandas import DataFrame

Array = NDArray[np.float64]


class ReadRecording(TypedDict, total=False):
    """One run as `fit` takes it; inputs only where there are any."""

    t: Array
    x: DataFrame
    inputs: DataFrame


class ReadRecordings(list[ReadRecording]):
    """Recordings, a list as `fit` takes it; as text what was read, from where, and what was not.

    Attributes
    ----------
    columns : list of ReadColumn
    remarks : list of str
        What reading had to do or to leave out.
    """

    def __init__(
        self,
        runs: Sequence[ReadRecording],
        columns: Sequence[ReadColumn],
        remarks: Iterable[str] = (),
    ):
        super().__init__(runs)
        self.columns = list(columns)
        self.remarks = list(remarks)

    def __str__(self) -> str:
        return "\n".join([columns_read(self.columns), *self.remarks])


def read_recordings(
    paths: str | Path | Sequence[str | Path],
    *,
    states: Sequence[str],
    inputs: Sequence[str] = (),
    time: str | None = None,
    units: Mapping[str, str] | None = None,
    missing: Sequence[str] = (),
    fmu_input: str | Path | None = None,
) -> ReadRecordings:
    r"""Read files as the recordings that `fit` takes.

    Where every file has all the columns, each is a run, and so is each group of a file that has
    them all under the same names. Where the columns are spread over the files, these are channels
    of one run: on one clock, or each on its own; a state then has no value (NaN) at the times of
    the others, and nothing is interpolated. Inputs are needed at every time. Of the files of
    loggers (MDF, TDMS, HDF5, MATLAB 7.3, ULog, ROS bags, MCAP, COMTRADE, CAN) each group of
    channels keeps its own instants in the same way; results of Modelica tools are read by their
    names, and an FMU is run by FMPy. Dates in several files of one run are one clock; clocks that
    have nothing in common are refused.

    Parameters
    ----------
    paths : str, path or sequence of them
        Files, folders, or patterns such as ``"runs/*.csv"``, whose files are taken in the order of
        the numbers in their names. The database of a CAN bus (.dbc) is named with its logs.
    states, inputs : sequence of str
        Columns.
    time : str, default=None
        The column of the times; None is one called t or time.
    units : dict of str, default=None
        Units by columns, stronger than those in the files.
    missing : sequence of str, default=()
        Words for a missing value, beside the usual ones.
    fmu_input : str or path, default=None
        File of any format with the `inputs` by which an FMU is driven, on one clock and for as
        long as they last; between its rows they lie on lines, and step where a time stands twice.

    Returns
    -------
    ReadRecordings
        A list of dicts with ``t`` and, as data frames, ``x`` and, where there are any, ``inputs``;
        as text a table of what was read.

    Raises
    ------
    ValueError
        If a file cannot be read, or columns are missing; the sentence says which there are.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from swsysid import read_recordings
    >>> folder = Path(tempfile.mkdtemp())
    >>> for run in (2, 10):
    ...     _ = (folder / f"run{run}.csv").write_text("t,x,u\n0,1,0\n0.5,2,1\n")
    >>> runs = read_recordings(folder / "run*.csv", states=["x"], inputs=["u"])
    >>> len(runs), runs[0]["x"]["x"].tolist()
    (2, [1.0, 2.0])
    >>> print(str(runs).splitlines()[1])
    0-1 x                    2        2 run2.csv to run10.csv: x
    """
    if not states:
        raise TableError("states names no column; name those of the states.")
    wanted = [*states, *inputs]
    found = runs_among(read_files(paths, units, missing, fmu_input, inputs), wanted)
    runs = [joined(number, tables, wanted, time) for number, tables in enumerate(found)]
    return ReadRecordings(
        [_recording(run, states, inputs) for run in runs],
        [one for run in runs for one in run.told],
        dict.fromkeys(remark for tables in found for table in tables for remark in table.remarks),
    )


def _recording(run: Joined, states: Sequence[str], inputs: Sequence[str]) -> ReadRecording:
    """The frames of states and inputs; an input that lacks a value is refused."""
    from pandas import DataFrame

    x, u = (
        DataFrame({name: run.columns[name] for name in names}, dtype=float)
        for names in (states, inputs)
    )
    if not inputs:
        return ReadRecording(t=run.t, x=x)
    missing = u.isna().to_numpy()
    if missing.any() and not run.one_clock:
        name = inputs[int(missing.any(axis=0).argmax())]
        raise TableError(
            f"the input {name!r} has no value at {int(missing.any(axis=1).sum())} "
            "of the times of other channels, and inputs are needed at every time; resample it "
            "to all of them, as it is held."
        )
    return ReadRecording(t=run.t, x=x, inputs=u)
