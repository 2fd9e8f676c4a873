"""Figures of the benchmark of undeclared effects, and their tables in Markdown."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field

import numpy as np

from benchmarks.goals import Goal
from benchmarks.markdown import table
from benchmarks.results import origins

__all__ = ["condensed", "recording_counts", "recording_tables", "tables"]


@dataclass(frozen=True)
class _Figure:
    """One line of the first table: its name, which side is better, and what is asked of it."""

    name: str
    better: str
    goal: Goal = field(default_factory=Goal)
    is_share: bool = True


def _share(at_least: float, at_most: float | None = None) -> Goal:
    return Goal(at_least, at_most, percent=True)


FIGURES = {
    "first": _Figure("first effect right", "larger", _share(0.95)),
    "itself": _Figure("... and named first itself", "larger"),
    "alone": _Figure("nothing found besides", "larger"),
    "both": _Figure("both of two effects", "larger", _share(0.85)),
    "clean": _Figure("clean systems without an effect", "larger", _share(0.98)),
    "near": _Figure("held-out error within 1.15 of the true structure", "larger"),
    "trimmed": _Figure("... without the worst hundredth of the rows", "larger"),
    "covered": _Figure("parameters inside their 95 % interval", "inside", _share(0.9, 0.98)),
    "ratio": _Figure("median of that error ratio", "smaller", Goal(at_most=1.15), is_share=False),
    "search_median": _Figure(
        "CPU time of a search in fits, median", "smaller", Goal(at_most=200), is_share=False
    ),
    "search_largest": _Figure(
        "CPU time of a search in fits, largest", "smaller", Goal(at_most=200), is_share=False
    ),
}


def condensed(records: list[dict]) -> dict:
    """What is kept of the records: figures with their numbers of records, counts, what failed."""
    singles = [one for one in records if len(one["cell"][1]) == 1]
    pairs = [one for one in records if len(one["cell"][1]) == 2]
    clean = [one for one in records if not one["cell"][1]]
    return {
        "figures": _figures(singles, pairs, clean),
        "kinds": _kinds(singles),
        "wrong": _wrong(records),
    }


def tables(parts: dict[str, dict]) -> str:
    """Figures beside their goals, then one table of kinds by systems, then what went wrong."""
    found = parts["searches"]
    lines = [*_figure_table(found["figures"]), "", *_kind_table(found["kinds"]), ""]
    lines += ["What was planted and what was found where they differ:", ""]
    lines += [f"- {line}" for line in found["wrong"]] or ["Nothing."]
    if "states" in parts:
        systems = parts["states"]["largest_difference"]
        lines += ["", "Largest difference of the states between records with noise 0 and 2 %: "]
        lines[-1] += ", ".join(f"{name} {value}" for name, value in systems.items()) + "."
    return "\n".join([*lines, "", origins(parts)]) + "\n"


def recording_counts(records: list[dict]) -> dict:
    """What is kept of searches in recordings: how many of each system, and what went wrong."""
    planted = [one for one in records if len(one["cell"][1]) == 1]
    clean = [one for one in records if not one["cell"][1]]
    counts = {}
    for system in dict.fromkeys(one["cell"][0] for one in records):
        own = [one for one in planted if one["cell"][0] == system]
        found = [one for one in own if one["found"]]
        alarms = [bool(one["found"]) for one in clean if one["cell"][0] == system]
        counts[system] = {
            "right": [sum(map(first_right, found)), len(own)],
            "wrong": [sum(not first_right(one) for one in found), len(own)],
            "missed": [len(own) - len(found), len(own)],
            "false": [sum(alarms), len(alarms)],
        }
    times = {
        "planted": [one["seconds"] for one in planted],
        "clean": [one["seconds"] for one in clean],
    }
    seconds = {name: [float(np.median(own)), max(own)] for name, own in times.items() if own}
    drawn = dict(sorted(Counter(one["cell"][1][0] for one in planted).items()))
    return {"counts": counts, "drawn": drawn, "seconds": seconds, "wrong": _wrong(records)}


def recording_tables(parts: dict[str, dict]) -> str:
    """Shares right, wrong, missed and false alarms of each system, and what went wrong."""
    found = parts["searches"]
    counts = found["counts"]
    every = {
        name: np.sum([own[name] for own in counts.values()], axis=0).tolist()
        for name in ("right", "wrong", "missed", "false")
    }
    rows = [
        [system, *(f"{n / of:.1%} of {of}" if of else "-" for n, of in own.values())]
        for system, own in {**counts, "all": every}.items()
    ]
    head = ["system", "first effect right", "wrong", "missed", "false alarms (clean)"]
    drawn = ", ".join(f"{kind} {count}" for kind, count in found["drawn"].items())
    told = [
        f"{name} {median:.1f} and {largest:.1f}"
        for name, (median, largest) in found["seconds"].items()
    ]
    lines = [*table(head, rows, "lrrrr"), "", f"Planted: {drawn}.", ""]
    lines += [f"CPU seconds of a search, median and largest: {'; '.join(told)}.", ""]
    lines += ["What was planted and what was found where they differ:", ""]
    lines += [f"- {line}" for line in found["wrong"]] or ["Nothing."]
    return "\n".join([*lines, "", origins(parts)]) + "\n"


def first_right(record: dict) -> bool:
    """True if the first effect found is the planted one, or names it as its rival."""
    return bool(record["right"]) and (record["right"][0] or record["among_rivals"][0])


def both_right(record: dict) -> bool:
    """True if every planted effect is found (as an effect or as a rival of one)."""
    told = [a or b for a, b in zip(record["right"], record["among_rivals"], strict=True)]
    return sum(told) >= len(record["cell"][1])


def _figures(singles, pairs, clean) -> dict[str, dict]:
    """Value and number of records of every figure that has any."""
    ratios, trimmed = (
        np.array([one[name] for one in singles]) for name in ("ratio", "trimmed_ratio")
    )
    times = [one["seconds"] / one["fit_seconds"] for one in [*singles, *pairs, *clean]]
    of_records = {
        "first": (np.mean, [first_right(one) for one in singles]),
        "itself": (np.mean, [one["right"][:1] == [True] for one in singles]),
        "alone": (np.mean, [len(one["found"]) == 1 for one in singles]),
        "both": (np.mean, [both_right(one) for one in pairs]),
        "clean": (np.mean, [not one["found"] for one in clean]),
        "near": (np.mean, ratios <= 1.15),
        "trimmed": (np.mean, trimmed <= 1.15),
        "covered": (np.mean, [x for one in singles if first_right(one) for x in one["covered"]]),
        "ratio": (np.median, ratios),
        "search_median": (np.median, times),
        "search_largest": (np.max, times),
    }
    return {
        name: {"value": float(of(values)), "of": len(values)}
        for name, (of, values) in of_records.items()
        if len(values)
    }


def _kinds(singles) -> dict[str, dict[str, list[int]]]:
    """Of each kind and system, how many were right and how many were run."""
    cells: dict = defaultdict(lambda: defaultdict(lambda: [0, 0]))
    for one in singles:
        cell = cells[one["cell"][1][0]][one["cell"][0]]
        cell[0] += int(first_right(one))
        cell[1] += 1
    return {kind: dict(systems) for kind, systems in cells.items()}


def _wrong(records) -> list[str]:
    lines = []
    for one in records:
        planted = one["cell"][1]
        right = both_right(one) if len(planted) == 2 else first_right(one)
        if (planted and not right) or (not planted and one["found"]):
            system, _, noise, seed = one["cell"]
            name = " + ".join(planted) or f"nothing ({noise})"
            found = ", ".join(one["found"]) or "nothing"
            lines.append(f"{system}, seed {seed}: {name}; found {found}")
    return lines


def _figure_table(figures: dict[str, dict]) -> list[str]:
    rows = []
    for name, figure in FIGURES.items():
        if name in figures:
            value = figures[name]["value"]
            told = f"{value:.1%}" if figure.is_share else f"{value:.4g}"
            columns = [figure.name, told, str(figures[name]["of"]), figure.better]
            rows.append([*columns, figure.goal.told, figure.goal.verdict(value)])
    return table(["figure", "value", "records", "better", "goal", "verdict"], rows, "lrrl")


def _kind_table(kinds: dict[str, dict]) -> list[str]:
    systems = list(dict.fromkeys(name for counts in kinds.values() for name in counts))
    rows = [
        [kind, *("/".join(map(str, counts.get(system, []))) for system in systems)]
        for kind, counts in kinds.items()
    ]
    return table(["kind", *systems], rows, "l")
