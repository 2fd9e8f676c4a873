"""What no library has a name for: whether it is called unknown, in the right place.

An answer is right if the first effect found is `unknown_function` of the planted channels, or
`unmeasured_disturbance` for a disturbance, in the planted equation. A wrong name counts as such
where the unknown is not among its rivals.
"""

from __future__ import annotations

import time
import warnings
from collections import defaultdict
from typing import NamedTuple

import numpy as np

from benchmarks.markdown import table
from benchmarks.results import origins
from benchmarks.undeclared.cells import effects_found
from swsysid import EffectSearchCV
from swsysid.datasets import make_undeclared
from swsysid.effects import UnknownFunction, UnmeasuredDisturbance

__all__ = ["UnlistedCell", "run_unlisted", "unlisted_counts", "unlisted_tables"]

VERDICTS = ("right", "unknown of another channel", "wrong name", "its rival", "missed")


class UnlistedCell(NamedTuple):
    """What is planted where."""

    system: str
    kind: str
    seed: int

    @classmethod
    def of(cls, record: dict) -> UnlistedCell:
        """The cell of a record."""
        return cls(*record["cell"])


def run_unlisted(cell: UnlistedCell) -> list[dict]:
    """The record of one search for what was planted."""
    data = make_undeclared(unlisted=cell.kind, system=cell.system, random_state=cell.seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        start = time.process_time()
        search = EffectSearchCV(data.estimator).fit(data.X, data.Xdot, t=data.t, groups=data.groups)
        seconds = time.process_time() - start
        ratio, inside = error_ratios(search, data)
    return [
        {
            "cell": list(cell),
            "found": [f"{one.kind} of {one.place}" for one in search.effects_],
            "verdict": verdict(search.effects_, data.unlisted),
            "ratio": ratio,
            "inside_ratio": inside,
            "effects": effects_found(search),
            "seconds": seconds,
        }
    ]


def verdict(effects, planted) -> str:
    """One of `VERDICTS`."""
    if not effects:
        return "missed"
    first = effects[0]
    if _is_planted(first, planted):
        return "right"
    if first.kind in (UnknownFunction.kind, UnmeasuredDisturbance.kind):
        return "unknown of another channel"
    rivals = any(one.kind == UnknownFunction.kind for one in first.rivals)
    return "its rival" if rivals else "wrong name"


def _is_planted(effect, planted) -> bool:
    if effect.target != planted.target:
        return False
    if planted.is_disturbance:
        return effect.kind == UnmeasuredDisturbance.kind
    shape = effect.placed.effect
    return isinstance(shape, UnknownFunction) and set(shape.channels) == set(planted.channels)


def error_ratios(search, data) -> list[float]:
    """Error on fresh records over the truth's, which is the noise: of all rows, and inside.

    Inside are rows whose states and input lie in the middle 98 % of those that were fitted, for
    what a shape is beyond them no record has shown; and of these all but the hundredth with the
    largest errors, as in the table of listed kinds: next to the guard a row may be in either mode.
    """
    test, target = data.test, data.unlisted.target
    wrong = search.predict(test.X, t=test.t, groups=test.groups)[:, target]
    wrong -= test.Xdot_clean[:, target]
    noise = float(np.std((data.Xdot - data.Xdot_clean)[:, target]))
    low, high = np.quantile(data.X, [0.01, 0.99], axis=0)
    inside = np.sort(np.abs(wrong[((test.X >= low) & (test.X <= high)).all(axis=1)]))
    kept = inside[: len(inside) - len(inside) // 100]
    return [float(np.sqrt(1.0 + np.mean(one**2) / noise**2)) for one in (wrong, kept)]


def unlisted_counts(records: list[dict]) -> dict:
    """How many of each kind got each verdict, and the error ratios of shapes that are right."""
    counts: dict[str, dict[str, int]] = defaultdict(lambda: dict.fromkeys(VERDICTS, 0))
    ratios = defaultdict(list)
    for one in records:
        kind = one["cell"][1]
        counts[kind][one["verdict"]] += 1
        if one["verdict"] == "right" and "disturbance" not in kind:
            ratios[kind].append([one["ratio"], one["inside_ratio"]])
    wrong = [
        f"{system}, seed {seed}: {kind}; found {', '.join(one['found']) or 'nothing'}"
        for one in records
        for system, kind, seed in [one["cell"]]
        if one["verdict"] != "right"
    ]
    seconds = [one["seconds"] for one in records]
    return {
        "counts": dict(counts),
        "ratios": dict(ratios),
        "wrong": wrong,
        "seconds": [float(np.median(seconds)), max(seconds)] if seconds else [],
    }


def unlisted_tables(parts: dict[str, dict]) -> str:
    """Verdicts of each kind, and how the error of its shape compares with the truth's."""
    found = parts["searches"]
    rows = [
        [kind, *(str(own[name]) for name in VERDICTS), *_medians(found["ratios"].get(kind))]
        for kind, own in found["counts"].items()
    ]
    total = [sum(own[name] for own in found["counts"].values()) for name in VERDICTS]
    every = [pair for own in found["ratios"].values() for pair in own]
    rows.append(["all", *map(str, total), *_medians(every)])
    head = ["planted", *VERDICTS, "error ratio", "inside the range"]
    lines = [*table(head, rows, "l" + "r" * (len(head) - 1)), ""]
    share = [total[VERDICTS.index(name)] / max(sum(total), 1) for name in ("right", "wrong name")]
    lines += [f"Right {share[0]:.1%}, wrong name without the unknown as its rival {share[1]:.1%}."]
    near = [pair[1] <= 1.15 for pair in every]
    if near:
        lines += [f"Error inside the range within 1.15 of the truth's: {np.mean(near):.1%}."]
    if found["seconds"]:
        median, largest = found["seconds"]
        lines += [f"CPU seconds of a search, median and largest: {median:.1f} and {largest:.1f}."]
    lines += ["", "What was planted and what was found where they differ:", ""]
    lines += [f"- {line}" for line in found["wrong"]] or ["Nothing."]
    return "\n".join([*lines, "", origins(parts)]) + "\n"


def _medians(ratios) -> list[str]:
    """Medians of all rows and inside, as text."""
    if not ratios:
        return ["-", "-"]
    return [f"{value:.3g}" for value in np.median(np.array(ratios), axis=0)]
