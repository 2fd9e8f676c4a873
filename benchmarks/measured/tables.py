"""The tables of measured data in Markdown, from the kept results."""

from __future__ import annotations

from benchmarks.goals import Goal
from benchmarks.markdown import table
from benchmarks.results import origins

__all__ = ["effects", "free_runs"]


def free_runs(parts: dict[str, dict]) -> str:
    """Errors of free runs beside the published ones, marked where the best is not reached."""
    head = ["data set", "change", "before", "after", "published, linear", "published, best"]
    runs = {name: part for name, part in parts.items() if name != "effects"}
    rows = [_free_run(row) for part in runs.values() for row in part["rows"]]
    return "\n".join([*table([*head, "against it"], rows, "l"), "", _cost(runs)]) + "\n"


def effects(parts: dict[str, dict]) -> str:
    """What a search with the whole library found."""
    head = ["data set and target", "found", "error before", "error after", "search, in fits"]
    rows = [
        [row["data"], row["found"], _errors([row["before"]]), _errors([row["after"]])]
        + [f"{row['fits']:.0f}"]
        for row in parts["effects"]["rows"]
    ]
    return "\n".join([*table(head, rows, "l"), "", _cost({"effects": parts["effects"]})]) + "\n"


def _free_run(row: dict) -> list[str]:
    columns = [row["data"], row["change"]]
    columns += [_errors(row[name]) for name in ("before", "after", "linear", "best")]
    if max(row["after"]) > max(row["before"]):
        columns[3] += ", **worse**"
    verdicts = [
        Goal(at_most=best).verdict(after)
        for after, best in zip(row["after"], row["best"], strict=False)
    ]
    # one mark where all test records have the same
    columns.append(" / ".join(verdicts if len(set(verdicts)) > 1 else verdicts[:1]))
    return columns


def _errors(errors: list[float]) -> str:
    return " / ".join(f"{error:.3g}" for error in errors)


def _cost(parts: dict[str, dict]) -> str:
    seconds = ", ".join(f"{name} {part['cpu_seconds']:.0f} s" for name, part in parts.items())
    return f"Errors: smaller is better. CPU time: {seconds}. {origins(parts)}"
