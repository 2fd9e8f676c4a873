"""False alarms where nothing is missing, and quantiles of the p-values, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks.goals import Goal
from benchmarks.markdown import table
from benchmarks.results import origins

__all__ = ["RARE", "condensed", "tables"]

RARE = "rare"  # name of the cells in which a law acts rarely
ALARMS = Goal(at_most=0.02, percent=True)
STOPS = Goal(at_least=0.8, percent=True)


def condensed(records: Sequence[dict], levels: Sequence[float]) -> dict:
    """What is kept of the records: counts for each kind of residuals, and what was found."""
    stops = [one["right"] for one in records if one["cell"][0] == RARE]
    records = [one for one in records if one["cell"][0] != RARE]
    nulls = {}
    for null in dict.fromkeys(one["cell"][0] for one in records):
        own = [one for one in records if one["cell"][0] == null]
        nulls[null] = {
            "records": len(own),
            "alarms": sum(bool(one["found"]) for one in own),
            "disturbances": sum(one["disturbances"] > 0 for one in own),
            "rare": sum(one["acts_rarely"] for one in own),
            "candidates": sum(one["candidates"] for one in own),
            "below": np.sum([one["below"] for one in own], axis=0).tolist(),
            "seconds": float(np.median([one["seconds"] for one in own])),
        }
    found = [
        f"{null}, seed {seed}, {one['rows']} rows: {', '.join(one['found'])}"
        for one in records
        if one["found"]
        for null, seed in [one["cell"]]
    ]
    counted = {"right": sum(stops), "records": len(stops)}
    return {"levels": list(levels), "nulls": nulls, "found": found, "stops": counted}


def tables(parts: dict[str, dict]) -> str:
    """False alarms and shares of the p-values of each kind of residuals, and what was found."""
    told = parts["searches"]
    nulls = told["nulls"]
    rows = []
    for name, one in [*nulls.items(), ("all", _all(nulls))]:
        shares = [f"{below / max(one['candidates'], 1):.2g}" for below in one["below"]]
        counts = [f"{one[count]}/{one['records']}" for count in ("alarms", "disturbances", "rare")]
        rows.append([name, *counts, *shares])
    head = [
        "residuals",
        "false alarms",
        "disturbances",
        "rare laws",
        *(f"p <= {level:g}" for level in told["levels"]),
    ]
    share = sum(one["alarms"] for one in nulls.values()) / max(_all(nulls)["records"], 1)
    lines = table(head, rows, "lr")
    lines += ["", f"False alarms in all: {share:.1%}, {ALARMS.told}, {ALARMS.verdict(share)}.", ""]
    stops = told["stops"]
    if stops["records"]:
        found = stops["right"] / stops["records"]
        lines += [f"Stops that act rarely found: {stops['right']} of {stops['records']}, "]
        lines[-1] += f"{STOPS.told}, {STOPS.verdict(found)}."
        lines += [""]
    lines += ["What was found where nothing is missing:", ""]
    lines += [f"- {line}" for line in told["found"]] or ["Nothing."]
    return "\n".join([*lines, "", origins(parts)]) + "\n"


def _all(nulls: dict[str, dict]) -> dict:
    counted = {
        name: sum(one[name] for one in nulls.values())
        for name in ("records", "alarms", "disturbances", "rare", "candidates")
    }
    return counted | {"below": np.sum([one["below"] for one in nulls.values()], axis=0).tolist()}
