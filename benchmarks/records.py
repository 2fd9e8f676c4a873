"""Cells of a long run, one line each in a file, so that an interrupted run resumes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path

from joblib import Parallel

__all__ = ["read", "run_and_append", "write"]


def read(file: Path) -> list[dict]:
    """The records of a file, none if it is not there."""
    if not file.exists():
        return []
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines() if line]


def write(file: Path, records: Iterable[dict], mode: str = "w") -> None:
    """Write records, in the place of the others or (mode ``"a"``) after them."""
    file.parent.mkdir(parents=True, exist_ok=True)
    with file.open(mode, encoding="utf-8") as stream:
        stream.writelines(json.dumps(record) + "\n" for record in records)


def run_and_append(file: Path, calls: Iterable, n_jobs: int) -> Iterator[list[dict]]:
    """Make joblib's delayed calls; the records that each returns are kept as soon as it ends."""
    for records in Parallel(n_jobs=n_jobs, return_as="generator_unordered")(calls):
        write(file, records, "a")
        yield records
