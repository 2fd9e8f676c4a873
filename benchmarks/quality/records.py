"""What is kept of the runs of the quality benchmark: figures of every cell over the seeds."""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from benchmarks.quality.cases import MAIN, STRESS

__all__ = ["condensed", "condensed_reliability", "condensed_timing"]

_LIMITS = {scenario.name: scenario.median for scenario in MAIN + STRESS}
# Medians over the seeds, of the records that have them.
_MEDIANS = ("rmse", "rmse_away", "wrong", "seconds", "seconds_all")


def condensed(records: list[dict]) -> dict:
    """Cells of case, corruption and method; and how often the number of modes was right."""
    by_cell: dict[tuple, dict[int, dict]] = defaultdict(dict)
    for record in records:
        cell = record["case"], record["scenario"], record["method"]
        by_cell[cell][record["seed"]] = record
    counted = [record for record in records if record["method"] == "count"]
    cells = [
        _cell(case, scenario, method, runs, by_cell.get((case, scenario, "oracle"), {}))
        for (case, scenario, method), runs in by_cell.items()
        if method != "count"
    ]
    return {"cells": cells, "count": _count(counted)}


def _cell(case: str, scenario: str, method: str, runs: dict, oracle: dict) -> dict:
    """Figures of one method in one case and corruption."""
    rows = [runs[seed] for seed in sorted(runs)]
    balanced = np.array([row["balanced"] for row in rows])
    known = [name for name in _MEDIANS if name in rows[0]]
    cell = {
        "case": case,
        "scenario": scenario,
        "method": method,
        "seeds": len(rows),
        "balanced": [float(np.median(balanced)), float(balanced.min()), float(balanced.max())],
    } | {name: float(np.median([row[name] for row in rows])) for name in known}
    shared = [seed for seed in sorted(runs) if seed in oracle]
    if method == "oracle" or not shared:
        return cell
    losses = np.array([oracle[seed]["balanced"] - runs[seed]["balanced"] for seed in shared])
    more = np.median([runs[seed]["wrong"] - oracle[seed]["wrong"] for seed in shared])
    cell |= {"loss": [float(np.median(losses)), float(losses.max())], "wrong_more": float(more)}
    if "warnings" in rows[0]:
        warned = np.array(["ConvergenceWarning" in runs[seed]["warnings"] for seed in shared])
        far = losses > _LIMITS.get(scenario, _LIMITS["clean"])
        cell["warned"] = bool(far.any() and warned[far].all())
    return cell


def _count(records: list[dict]) -> dict:
    wrong = [
        f"{row['case']} / {row['scenario']} / seed {row['seed']}: {row['n_modes']}"
        for row in records
        if row["n_modes"] != row["n_modes_true"]
    ]
    return {"of": len(records), "wrong": wrong}


def condensed_timing(records: list[dict]) -> list[dict]:
    """Seconds of ours, of PARC's kept fit and of all its fits: medians of each cell."""
    seconds: dict = defaultdict(lambda: defaultdict(list))
    for row in records:
        columns = seconds[row["case"], row["scenario"]]
        columns[row["method"]].append(row["seconds"])
        if "seconds_all" in row:
            columns["every"].append(row["seconds_all"])
    return [
        {
            "case": case,
            "scenario": scenario,
            "seconds": [float(np.median(columns[name])) for name in ("ours", "parc", "every")],
        }
        for (case, scenario), columns in seconds.items()
        if len(columns) == 3
    ]


def condensed_reliability(records: list[dict]) -> dict:
    """Claimed probabilities of modes and how often they are right, of each corruption."""
    runs: dict[str, list[dict]] = defaultdict(list)
    for row in records:
        if row["method"] == "ours" and "reliability" in row:
            runs[row["scenario"]].append(row)
    of_all = [row for rows in runs.values() for row in rows]
    return {
        "cases": list(dict.fromkeys(row["case"] for row in of_all)),
        "seeds": len({row["seed"] for row in of_all}),
        "scenarios": {name: _reliability(rows) for name, rows in runs.items()},
    }


def _reliability(rows: list[dict]) -> dict:
    """Shares of the samples of all runs together."""
    # number of samples, sum of their claims, number right; from the least sure bin on
    bins = np.sum([row["reliability"] for row in rows], axis=0)
    number, claimed, right = bins[:-1].T  # the last bin holds the samples it is sure of
    total = max(number.sum(), 1)
    shares = {
        "least sure 10 %: claimed": np.mean([row["least_claimed"] for row in rows]),
        "least sure 10 %: right": np.mean([row["least_right"] for row in rows]),
        "p < 0.99: share of all": number.sum() / bins[:, 0].sum(),
        "p < 0.99: claimed": claimed.sum() / total,
        "p < 0.99: right": right.sum() / total,
        "p < 0.99: calibration error": np.abs(claimed - right).sum() / total,
        "p >= 0.99: right": bins[-1, 2] / max(bins[-1, 0], 1),
        "all samples: calibration error": np.mean([row["calibration"] for row in rows]),
    }
    return {"shares": {name: float(share) for name, share in shares.items()}}
