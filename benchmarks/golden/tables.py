"""What is printed of a comparison."""

from __future__ import annotations

import numpy as np

from benchmarks.golden.comparison import Comparison
from benchmarks.markdown import table

__all__ = ["told"]

_HEAD = ["kind", "records", "equal", "moved", "better", "worse", "right", "alarms"]
_HEAD += ["CPU s", "ratio", "median", "verdict"]
_NOTE = "Ratios of CPU times are in units of the yardstick beside each; they decide nothing."


def told(lines: dict[str, Comparison]) -> str:
    """A line a kind, then every record that got worse or better."""
    text = [*table(_HEAD, [_row(*one) for one in lines.items()], "lr"), "", _NOTE]
    for word in ("other data", "worse", "better", "new"):
        text += [
            f"- {word}: {name} {one.cell}: {'; '.join(one.changes)}"
            for name, comparison in lines.items()
            for one in comparison.verdicts
            if one.word == word
        ]
    return "\n".join(text)


def _row(name: str, one: Comparison) -> list[str]:
    ratios = [each.time for each in one.verdicts if np.isfinite(each.time)]
    counts = [one.count("equal"), sum(each.moved for each in one.verdicts)]
    counts += [one.count("better"), one.count("worse")]
    return [
        name,
        *map(str, [len(one.verdicts), *counts]),
        *(f"{before} -> {now}" for before, now in (one.right, one.alarms)),
        f"{one.seconds[0]:.0f} -> {one.seconds[1]:.0f}",
        f"{one.units[1] / one.units[0]:.2f}" if ratios else "-",
        f"{np.median(ratios):.2f}" if ratios else "-",
        "WORSE" if one.is_worse else "holds",
    ]
