"""The table of `peers` in Markdown, from the kept results."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchmarks import markdown
from benchmarks.results import origins

__all__ = ["PEERS", "table"]

PEERS = ["CasADi", "dynamax, particles", "dynamax, hidden Markov"]


def table(parts: dict[str, dict]) -> str:
    """Seconds of building and running; those of a peer that takes less than ours are bold."""
    head = ["plant", "ours", *PEERS, "error of laws, ours / CasADi", "right modes, ours / dynamax"]
    lines = markdown.table(head, [_row(name, part["turns"]) for name, part in parts.items()])
    return "\n".join([*lines, "", origins(parts)]) + "\n"


def _row(name: str, turns: dict[str, Sequence[dict[str, float]]]) -> list[str]:
    """Medians of the turns."""
    medians = {
        side: {key: float(np.median([turn[key] for turn in own])) for key in own[0]}
        for side, own in turns.items()
    }
    least = medians["ours"]["running"]
    seconds = [_seconds(medians.get(peer), least) for peer in PEERS]
    laws = [markdown.percent(one["laws"]) for one in medians.values() if "laws" in one]
    modes = [markdown.share(one["modes"]) for one in medians.values() if "modes" in one]
    return [name, f"{least:.2f} s", *seconds, " / ".join(laws), " / ".join(modes)]


def _seconds(one: dict[str, float] | None, least: float) -> str:
    if one is None:
        return "affine laws only"
    told = f"{one['building']:.2f} + {one['running']:.2f} s"
    return told if one["building"] + one["running"] >= least else f"**{told}**"
