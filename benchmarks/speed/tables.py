"""The table of ratios in Markdown, from the kept results."""

from __future__ import annotations

from collections.abc import Iterator
from math import floor, log10

from benchmarks import markdown
from benchmarks.goals import Goal
from benchmarks.results import origins

__all__ = ["table"]

_PREFIXES = {-9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}


def table(parts: dict[str, dict]) -> str:
    """A line for each ratio, in the order of the parts; direct equals beside what they equal."""
    head = ["figure", "ratio (smallest to largest)", "swsysid / other side", "goal", "note"]
    rows = [_row(name, figure) for name, figure in _in_order(parts)]
    lines = markdown.table(head, rows, "lrrl")
    return "\n".join([*lines, "", origins(parts)]) + "\n"


def _in_order(parts: dict[str, dict]) -> Iterator[tuple[str, dict]]:
    """Figures and their names; that of a direct equal is short after the program's first line."""
    direct = parts.get("direct", {"figures": []})["figures"]
    programs: set[str] = set()
    for name, part in parts.items():
        if name != "direct":
            for figure in part["figures"]:
                yield figure["name"], figure
                program = figure["name"].partition(": ")[0]
                programs.add(program)
                for equal in direct:
                    if equal["name"].startswith(f"{program}: "):
                        yield "... " + equal["name"].partition(": ")[2], equal
    for equal in direct:
        if equal["name"].partition(": ")[0] not in programs:
            yield equal["name"], equal


def _row(name: str, figure: dict) -> list[str]:
    ratio, low, high = (_ratio(value) for value in (figure["ratio"], *figure["spread"]))
    sides = " / ".join(_quantity(side, figure["unit"]) for side in figure["sides"])
    goal = Goal.of(figure["goal"])
    told = f"{goal.told}, {goal.verdict(figure['ratio'])}" if goal.told else ""
    asked = told or f"{figure['better']} is better"
    return [name, f"{ratio} ({low} to {high})", sides, asked, figure["note"]]


def _ratio(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def _quantity(value: float, unit: str) -> str:
    """Three digits with a prefix of the unit, such as 57.3 µs; "CPU s" is told as seconds."""
    power = 3 * floor(log10(value) / 3) if value else 0
    unit = unit.removeprefix("CPU ")
    return f"{value / 10.0**power:.3g} {_PREFIXES[power]}{unit}"
