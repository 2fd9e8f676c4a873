"""The tables of measured data in Markdown, from the kept results."""

from __future__ import annotations

from benchmarks.goals import Goal
from benchmarks.markdown import table
from benchmarks.measured.rows import LEFT_OUT
from benchmarks.results import origins

_OF_CALLS = ("effects", "by_default", "by_command")  # and not of free runs

__all__ = ["by_default", "effects", "free_runs"]


def free_runs(parts: dict[str, dict]) -> str:
    """Errors of free runs beside the published ones, marked where the best is not reached.

    Below them what the scores are without the first samples, and what was chosen in training.
    """
    head = ["data set", "change", "before", "after"]
    head += [f"published, {name}" for name in ("linear", "one can read", "best")]
    runs = {name: part for name, part in parts.items() if name not in _OF_CALLS}
    every = [row for part in runs.values() for row in part["rows"]]
    lines = table([*head, "against these two"], [_free_run(row) for row in every], "l")
    scored = [f"without {n}" if n else "all samples" for n in LEFT_OUT]
    left_out = table(["data set", "change", *scored], [_left_out(row) for row in every], "l")
    told = "The same second models, scored without the first samples of each test record:"
    chosen = [f"- {row['data']}, {row['chosen']}." for row in every if row["chosen"]]
    if chosen:
        chosen = ["", "What was chosen, by errors on the training record:", "", *chosen]
    return "\n".join([*lines, "", _cost(runs), "", told, "", *left_out, *chosen]) + "\n"


def effects(parts: dict[str, dict]) -> str:
    """What a search with the whole library found, the error of each rung, and what is left."""
    head = ["data set and target", "found", "error before", "error after", "search, in fits"]
    found = parts["effects"]["rows"]
    rows = [
        [row["data"], row["found"], _errors([row["before"]]), _errors([row["after"]])]
        + [f"{row['fits']:.0f}"]
        for row in found
    ]
    ladder = [
        [row["data"], " → ".join(f"{error:.3g}" for error in row["rungs"]), row["left"]]
        for row in found
    ]
    told = (
        "The ladder: errors of the declared model and after each effect, on the quarter that the "
        "search holds out, and what the report says of the last model's residuals there:"
    )
    lines = [*table(head, rows, "l"), "", _cost({"effects": parts["effects"]}), "", told, ""]
    lines += table(["data set and target", "errors", "what is left over"], ladder, "l")
    return "\n".join(lines) + "\n"


def by_default(parts: dict[str, dict]) -> str:
    """What a search by default settings says of each recording."""
    head = ["recording", "lacks", "asked", "found by default", ""]
    head += ["error before", "after", "by hand", "CPU s"]
    rows = [
        [row["data"], row["lacks"], row["estimator"], row["found"].replace("_", " ")]
        + [row["verdict"], _errors([row["before"]]), _errors([row["after"]])]
        + [row["hand"], f"{row['cpu_seconds']:.0f}"]
        for row in parts["by_default"]["rows"]
    ]
    lines = [*table(head, rows, "l"), "", _cost({"by default": parts["by_default"]})]
    return "\n".join(lines) + "\n"


def _free_run(row: dict) -> list[str]:
    columns = [row["data"], row["change"]]
    columns += [_errors(row[name]) for name in ("before", "after", "linear", "readable", "best")]
    if max(row["after"]) > max(row["before"]):
        columns[3] += ", **worse**"
    columns.append("; ".join(filter(None, [_against(row, "readable"), _against(row, "best")])))
    return columns


def _against(row: dict, published: str) -> str:
    """Whether published errors are reached: one mark where all test records have the same."""
    verdicts = [
        Goal(at_most=goal).verdict(after)
        for after, goal in zip(row["after"], row[published], strict=False)
    ]
    return " / ".join(verdicts if len(set(verdicts)) > 1 else verdicts[:1])


def _left_out(row: dict) -> list[str]:
    return [row["data"], row["change"], *(_errors(errors) for errors in row["after_leaving_out"])]


def _errors(errors: list[float]) -> str:
    return " / ".join(f"{error:.3g}" for error in errors)


def _cost(parts: dict[str, dict]) -> str:
    seconds = ", ".join(f"{name} {part['cpu_seconds']:.0f} s" for name, part in parts.items())
    return f"Errors: smaller is better. CPU time: {seconds}. {origins(parts)}"
