"""Records in files, one a kind; a record is a line, so that a difference is one, too."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.results import measured_here

__all__ = ["FROZEN", "load", "save"]

FROZEN = Path(__file__).parent / "frozen"


def load(folder: Path, kind: str) -> dict[str, dict]:
    """The records of a kind by their cells, none if the file is not there."""
    file = Path(folder, f"{kind}.json")
    if not file.exists():
        return {}
    records = json.loads(file.read_text(encoding="utf-8"))["records"]
    return {json.dumps(one["cell"]): one for one in records}


def save(folder: Path, kind: str, records: dict[str, dict]) -> None:
    """Write all records of a kind, in the order in which they come."""
    file = Path(folder, f"{kind}.json")
    file.parent.mkdir(parents=True, exist_ok=True)
    lines = ",\n".join(json.dumps(one, separators=(",", ":")) for one in records.values())
    origin = json.dumps(measured_here())
    file.write_text(f'{{"origin": {origin},\n"records": [\n{lines}\n]}}\n', encoding="utf-8")
