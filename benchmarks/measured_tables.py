"""The tables of `measured.py` in Markdown, from its results."""

from __future__ import annotations

from goals import Goal
from results import origins

__all__ = ["effects", "free_runs"]


def free_runs(parts: dict[str, dict]) -> str:
    """Errors of free runs beside the published ones, marked where the best is not reached."""
    head = "| data set | change | before | after | published, linear | published, best |"
    lines = [f"{head} against it |", "|---|---|---|---|---|---|---|"]
    rows = [row for name, part in parts.items() if name != "effects" for row in part["rows"]]
    lines += [_free_run(row) for row in rows]
    runs = {name: part for name, part in parts.items() if name != "effects"}
    return "\n".join([*lines, "", _cost(runs)]) + "\n"


def effects(parts: dict[str, dict]) -> str:
    """What a search with the whole library found."""
    lines = [
        "| data set and target | found | error before | error after | search, in fits |",
        "|---|---|---|---|---|",
    ]
    for row in parts["effects"]["rows"]:
        before, after = (f"{row[name]:.3g}" for name in ("before", "after"))
        lines.append(f"| {row['data']} | {row['found']} | {before} | {after} | {row['fits']:.0f} |")
    return "\n".join([*lines, "", _cost({"effects": parts["effects"]})]) + "\n"


def _free_run(row: dict) -> str:
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
    return "| " + " | ".join(columns) + " |"


def _errors(errors: list[float]) -> str:
    return " / ".join(f"{error:.3g}" for error in errors)


def _cost(parts: dict[str, dict]) -> str:
    seconds = ", ".join(f"{name} {part['cpu_seconds']:.0f} s" for name, part in parts.items())
    return f"Errors: smaller is better. CPU time: {seconds}. {origins(parts)}"
