"""Tables of the benchmark of undeclared effects."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

__all__ = ["tables"]


def tables(records: list[dict]) -> str:
    """Goals, then one table of kinds by systems, then what went wrong."""
    singles = [one for one in records if len(one["cell"][1]) == 1]
    pairs = [one for one in records if len(one["cell"][1]) == 2]
    clean = [one for one in records if not one["cell"][1]]
    lines = [*_goals(singles, pairs, clean), "", *_kinds(singles), "", *_wrong(records)]
    return "\n".join(lines) + "\n"


def first_right(record: dict) -> bool:
    """True if the first effect found is the planted one, or names it as its rival."""
    return bool(record["right"]) and (record["right"][0] or record["among_rivals"][0])


def both_right(record: dict) -> bool:
    """True if every planted effect is found (as an effect or as a rival of one)."""
    told = [a or b for a, b in zip(record["right"], record["among_rivals"], strict=True)]
    return sum(told) >= len(record["cell"][1])


def _goals(singles, pairs, clean) -> list[str]:
    lines = ["| figure | reached | goal |", "|---|---|---|"]

    def row(name, values, goal):
        if len(values):
            lines.append(f"| {name} | {np.mean(values):.1%} of {len(values)} | {goal} |")

    row("first effect right", [first_right(one) for one in singles], "95 %")
    row("... and named first itself", [one["right"][:1] == [True] for one in singles], "")
    row("nothing found besides", [len(one["found"]) == 1 for one in singles], "")
    row("both of two effects", [both_right(one) for one in pairs], "85 %")
    row("clean systems without an effect", [not one["found"] for one in clean], "98 %")
    pairs_of_ratios = [[one["ratio"], one["trimmed_ratio"]] for one in singles]
    ratios, trimmed = np.reshape(pairs_of_ratios, (-1, 2)).T
    row("held-out error within 1.15 of the true structure", ratios <= 1.15, "")
    row("... without the worst hundredth of the rows", trimmed <= 1.15, "")
    covered = [inside for one in singles if first_right(one) for inside in one["covered"]]
    row("parameters inside their 95 % interval", covered, "90 to 98 %")
    times = [one["seconds"] / one["fit_seconds"] for one in [*singles, *pairs, *clean]]
    if times:
        lines.append(
            f"| search over one fit, CPU time | median {np.median(times):.0f}, largest "
            f"{np.max(times):.0f} | 200 |"
        )
    if len(ratios):
        lines.append(f"| median of that error ratio | {np.median(ratios):.3f} | 1.15 |")
    return lines


def _kinds(singles) -> list[str]:
    systems = list(dict.fromkeys(one["cell"][0] for one in singles))
    cells = defaultdict(list)
    for one in singles:
        cells[one["cell"][1][0], one["cell"][0]].append(first_right(one))
    kinds = list(dict.fromkeys(one["cell"][1][0] for one in singles))
    lines = ["| kind | " + " | ".join(systems) + " |", "|---" * (len(systems) + 1) + "|"]
    for kind in kinds:
        told = [
            f"{sum(cells[kind, system])}/{len(cells[kind, system])}" if cells[kind, system] else ""
            for system in systems
        ]
        lines.append(f"| {kind} | " + " | ".join(told) + " |")
    return lines


def _wrong(records) -> list[str]:
    lines = ["What was planted and what was found where they differ:", ""]
    for one in records:
        planted = one["cell"][1]
        right = both_right(one) if len(planted) == 2 else first_right(one)
        if (planted and not right) or (not planted and one["found"]):
            system, _, noise, seed = one["cell"]
            name = " + ".join(planted) or f"nothing ({noise})"
            found = ", ".join(one["found"]) or "nothing"
            lines.append(f"- {system}, seed {seed}: {name}; found {found}")
    return lines
