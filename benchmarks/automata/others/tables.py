"""The table of automata that others published."""

from __future__ import annotations

from benchmarks.markdown import percent, share, table
from benchmarks.results import origins

__all__ = ["RIGHT", "tables"]

RIGHT = 1e-3  # mean deviation of unseen rollouts up to which an automaton counts as found
_HEAD = [
    "automaton", "modes too many", "labels right", "rollouts off by, mean (largest)",
    "switches made", "says that guards tell all", "warns", "seconds",
]  # fmt: skip


def tables(parts: dict) -> str:
    """The figures of each automaton, for each noise, and how many are right."""
    text = [origins(parts)]
    for told, part in parts.items():
        cells = part["cells"]
        right = [_is_right(one) for one in cells]
        wrong = [one for one in cells if "refused" not in one and not _is_right(one)]
        silent, named = (sum(bool(one[key]) == says for one in wrong)
                         for key, says in (("doubts", False), ("warns", True)))  # fmt: skip
        text += [
            "",
            f"**{told}**: {sum(right)} of {len(cells)} within {percent(RIGHT)}; "
            f"of {len(wrong)} that are not {named} warn and name a mode or a transition, and "
            f"{silent} say that guards tell all switches.",
            "",
            *table(_HEAD, map(_row, cells)),
        ]
    return "\n".join(text) + "\n"


def _is_right(one: dict) -> bool:
    return one.get("mean") is not None and one["mean"] <= RIGHT


def _row(one: dict) -> list[str]:
    if "refused" in one:
        return [one["name"], one["refused"], *[""] * 5, f"{one['seconds']:.1f}"]
    ended = one["mean"] is None
    return [
        one["name"],
        f"{one['modes']:+.0f}" if one["modes"] else "0",
        share(one["labels"]),
        "ended early" if ended else f"{percent(one['mean'])} ({percent(one['largest'])})",
        share(one["switches"]),
        "no" if one["doubts"] else "yes",
        "yes" if one["warns"] else "no",
        f"{one['seconds']:.1f}",
    ]
