"""What was found on each rig, and what it does to rollouts, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.goals import Goal
from benchmarks.markdown import table
from benchmarks.results import origins

__all__ = ["condensed", "tables"]

RIGHT = ("right", "unknown")
ALL = Goal(at_least=1.0, percent=True)


def condensed(records: Sequence[dict]) -> dict:
    """Verdicts and rollouts of each rig, and what was found where it is not right."""
    rigs = {}
    for name in dict.fromkeys(one["cell"][0] for one in records):
        own = [one for one in records if one["cell"][0] == name]
        rigs[name] = {
            "lacks": own[0]["lacks"],
            "verdicts": [one["verdict"] for one in own],
            "rollouts": [one["rollouts"] for one in own],
            "seconds": float(np.median([one["seconds"] for one in own])),
        }
    wrong = [
        f"{name}, seed {seed}: {', '.join(one['found']) or 'nothing'}"
        for one in records
        if one["verdict"] not in RIGHT
        for name, seed in [one["cell"]]
    ]
    return {"rigs": rigs, "wrong": wrong}


def tables(parts: dict[str, dict]) -> str:
    """How often the answer is right, and the errors of rollouts before and after."""
    found = parts["searches"]
    rows = []
    for name, one in found["rigs"].items():
        right, of = sum(each in RIGHT for each in one["verdicts"]), len(one["verdicts"])
        before, after = np.median(one["rollouts"], axis=0)
        never = sum(after <= before for before, after in one["rollouts"])
        rows.append(
            [
                f"{name}: {one['lacks']}",
                f"{right}/{of}",
                f"{before:.3g}",
                f"{after:.3g}",
                f"{never}/{of}",
                f"{one['seconds']:.1f}",
            ]
        )
    head = ["rig and what it lacks", "right", "rollouts declared", "with what was found"]
    head += ["not worse", "CPU seconds"]
    every = list(found["rigs"].values())
    verdicts = [each for one in every for each in one["verdicts"]]
    rollouts = [each for one in every for each in one["rollouts"]]
    right = sum(each in RIGHT for each in verdicts)
    never = sum(after <= before for before, after in rollouts)
    lines = [*table(head, rows, "lr"), ""]
    lines += [f"Right, or unknown in the right place: {right} of {len(verdicts)}, "]
    lines[-1] += f"{ALL.verdict(right / max(len(verdicts), 1))}."
    lines += [f"Rollouts not worse than declared: {never} of {len(rollouts)}, "]
    lines[-1] += f"{ALL.verdict(never / max(len(rollouts), 1))}."
    lines += ["", "What was found where it is not right:", ""]
    lines += [f"- {line}" for line in found["wrong"]] or ["Nothing."]
    return "\n".join([*lines, "", origins(parts)]) + "\n"
