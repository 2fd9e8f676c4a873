"""How many answers change with each constant, in Markdown."""

from __future__ import annotations

from benchmarks.markdown import table
from benchmarks.results import origins

__all__ = ["BASE", "condensed", "tables"]

# The line without a change.
BASE = "as it is"


def condensed(records: list[dict]) -> dict:
    """Of each constant and factor, how many answers are right and how many are others."""
    [base] = [one for one in records if one["constant"] == BASE]
    changes = [
        {
            "constant": one["constant"],
            "factor": one["factor"],
            "value": one["value"],
            "right": one["verdict"].count("right"),
            "others": sum(a != b for a, b in zip(one["found"], base["found"], strict=True)),
            "alarms": one["verdict"].count("false alarm"),
            "seconds": sum(one["seconds"]) / sum(base["seconds"]),
        }
        for one in records
        if one["constant"] != BASE
    ]
    kept = {"of": len(base["records"]), "right": base["verdict"].count("right")}
    return kept | {"alarms": base["verdict"].count("false alarm"), "changes": changes}


def tables(parts: dict[str, dict]) -> str:
    """Constants that change an answer, those that change most first; the others are named."""
    found = parts["changes"]
    by_name: dict[str, dict[float, dict]] = {}
    for one in found["changes"]:
        by_name.setdefault(one["constant"], {})[one["factor"]] = one
    matter = {name: own for name, own in by_name.items() if _others(own)}
    rows = [
        [f"`{name}`", *(column for factor in (0.5, 2.0) for column in _columns(own.get(factor)))]
        for name, own in sorted(matter.items(), key=lambda each: -_others(each[1]))
    ]
    head = ["constant", "halved", "right", "other answers", "doubled", "right", "other answers"]
    silent = ", ".join(f"`{name}`" for name in by_name if name not in matter)
    first = f"As they are {found['right']} of {found['of']} answers are right"
    lines = [f"{first}, with {found['alarms']} false alarms.", ""]
    lines += [*table(head, rows, "lrrrrrr"), ""] if rows else []
    lines += [f"No answer changes with {silent or 'the others'}."]
    return "\n".join([*lines, "", origins(parts)]) + "\n"


def _others(own: dict[float, dict]) -> int:
    return max(one["others"] for one in own.values())


def _columns(one: dict | None) -> list[str]:
    if one is None:
        return ["", "", ""]
    return [f"{one['value']:.3g}", str(one["right"]), str(one["others"])]
