"""What the page of the documentation asks for that runs in a browser: two questions, in JSON."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

from swsysid._cli.output import MODEL, REPORT
from swsysid._tables.readers import read_table
from swsysid._tables.several import usual_clock
from swsysid._tables.table import NUMERIC, TableError

_FOLDER = "swsysid_output"
_RUNS = ("run", "trajectory", "group", "recording", "experiment")


def columns_of(path: str) -> str:
    r"""The columns of a file, each with what it probably is: ``time``, ``groups`` or nothing.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     path = Path(folder, "log.csv")
    ...     _ = path.write_text("t [s],T [K]\n0,293.5\n1,294.0\n2,294.5\n")
    ...     found = json.loads(columns_of(str(path)))["columns"]
    >>> [(one["name"], one["unit"], one["role"]) for one in found]
    [('t', 's', 'time'), ('T', 'K', '')]
    """
    try:
        table = read_table(path)
    except (TableError, OSError) as error:
        return json.dumps({"refused": str(error)})
    clock, found = usual_clock(table), []
    for name, values in table.columns.items():
        title = table.title(name)
        role = "time" if clock is not None and name == table.resolve(clock) else ""
        if not role and title.lower().removesuffix("s") in _RUNS:
            role = "groups"
        if role or values.dtype.kind in NUMERIC:
            found.append({"name": title, "unit": table.unit(name), "role": role})
    return json.dumps({"columns": found})


def identified(main: Callable[[list[str]], int], words: Sequence[str]) -> str:
    """Run the command line, its `main`: its page and its model, or why it refuses."""
    said, why = io.StringIO(), io.StringIO()
    with redirect_stdout(said), redirect_stderr(why):
        try:
            code = main([*words, "--output", _FOLDER])
        except SystemExit as refused:  # of the parser
            code = 2 if refused.code else 0
    if code:
        return json.dumps({"refused": why.getvalue().strip().removeprefix("swsysid: ")})
    files = {"text": said.getvalue()}
    for key, name in (("page", REPORT), ("model", MODEL)):
        path = Path(_FOLDER, name)
        files[key] = path.read_text(encoding="utf-8") if path.exists() else ""
    return json.dumps(files)
