"""The table of automata that others published."""

from __future__ import annotations

from benchmarks.markdown import percent, share, table
from benchmarks.results import origins

__all__ = ["RIGHT", "tables"]

RIGHT = 1e-3  # mean deviation of unseen rollouts up to which an automaton counts as found
KNOWN = 0.99  # of the labels and of the switches at guards, where there is noise
_HEAD = [
    "automaton", "modes too many", "labels right", "at guards within 1 %",
    "rollouts off by, mean (largest)", "switches made", "says that guards tell all", "seconds",
]  # fmt: skip


def tables(parts: dict) -> str:
    """The figures of each automaton, for each noise, and how many are right."""
    text = [origins(parts)]
    for told, part in parts.items():
        cells = part["cells"]
        right = [_is_right(one) for one in cells]
        silent = sum(_is_silent(one) for one in cells)
        scored = [one for one in cells if "guards" in one]
        text += [
            "",
            f"**{told}**: {sum(right)} of {len(cells)} within {percent(RIGHT)}; "
            f"{silent} of the others say that guards tell all switches; "
            f"{sum(map(_is_known, scored))} of {len(scored)} whose guards were scored have "
            f"{percent(KNOWN)} of the labels and as many switches at guards.",
            "",
            *table(_HEAD, map(_row, cells)),
        ]
    return "\n".join(text) + "\n"


def _is_right(one: dict) -> bool:
    return one.get("mean") is not None and one["mean"] <= RIGHT


def _is_known(one: dict) -> bool:
    return min(one["labels"], one["guards"]) >= KNOWN


def _is_silent(one: dict) -> bool:
    return "refused" not in one and not one["doubts"] and not _is_right(one)


def _row(one: dict) -> list[str]:
    if "refused" in one:
        return [one["name"], one["refused"], *[""] * 5, f"{one['seconds']:.1f}"]
    ended = one["mean"] is None
    return [
        one["name"],
        f"{one['modes']:+.0f}" if one["modes"] else "0",
        share(one["labels"]),
        share(one["guards"]) if "guards" in one else "",
        "ended early" if ended else f"{percent(one['mean'])} ({percent(one['largest'])})",
        share(one["switches"]),
        "no" if one["doubts"] else "yes",
        f"{one['seconds']:.1f}",
    ]
