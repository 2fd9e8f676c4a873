"""The folder of the results: all files of one run and none of another."""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from swsysid._tables.table import TableError

#: What a run writes; the first two say what the folder holds.
MODEL, AUTOMATON, TEXT = "model.json", "automaton.json", "identification.txt"
EFFECTS, PORTRAIT, GRAPH = "model_with_effects.json", "phase_portrait.png", "automaton.png"
REPORT = "report.html"
_NAMES = (MODEL, AUTOMATON, TEXT, EFFECTS, PORTRAIT, GRAPH, REPORT)
_DRAFT = ".swsysid-"
_FORMATS = ("swsysid model", "swsysid automaton")


def prepare(folder: Path, source: str, content: str) -> None:
    """Make the folder before the work is done, and say whose results will be replaced.

    `source` names the recording and `content` is the checksum of its file. Files of these names
    that no run has written are not touched: TableError says so.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=_DRAFT, dir=folder):
            pass  # it can be written to
    except OSError as error:
        raise TableError(f"--output {folder} cannot be written: {error.strerror}.") from error
    there = [name for name in _NAMES if (folder / name).exists()]
    if not there:
        return
    told = [_told(folder / name) for name in (MODEL, AUTOMATON) if name in there]
    if not told or None in told:
        raise TableError(
            f"--output {folder} holds {there[0]} that this command has not written; move it, or "
            "name another folder."
        )
    before = told[0].get("recording", {}) if told[0] else {}
    same = before.get("source") == source and before.get("checksum", content) == content
    if not same:
        whose = before.get("source") or "another run"
        whose = f"another {whose}" if whose == source else whose
        print(
            f"swsysid: the results of {whose} in {folder} will be replaced; --output names another "
            "folder.",
            file=sys.stderr,
        )


@contextmanager
def results(folder: Path, adds: bool = False) -> Iterator[Path]:
    """A folder to write to; its files take the place of all that an earlier run has left.

    With `adds` the files that this run has written before stay, too.

    Nothing is changed unless all of them are written, and two runs do not mix: one moves its files
    after the other.
    """
    draft = Path(tempfile.mkdtemp(prefix=_DRAFT, dir=folder))
    try:
        yield draft
        with _alone_in(folder):
            written = {path.name for path in draft.iterdir()}
            for name in _NAMES:
                if name in written:
                    os.replace(draft / name, folder / name)
                elif not adds:
                    (folder / name).unlink(missing_ok=True)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


@contextmanager
def _alone_in(folder: Path) -> Iterator[None]:
    """Wait for others who move files into the folder, where the system has such locks."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    lock = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # some network drives have no locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
    finally:
        os.close(lock)


def _told(path: Path) -> dict | None:
    """What a model file says of itself; None if it is none of ours."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) and content.get("format") in _FORMATS else None
