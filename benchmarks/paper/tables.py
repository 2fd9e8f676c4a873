"""The tables of the page "The paper reproduced"."""

from __future__ import annotations

import numpy as np

from benchmarks import markdown
from benchmarks.goals import MISSED
from benchmarks.results import origins

__all__ = ["tables"]

TITLES = {
    "SLS": "The switching damped oscillator (SLS)",
    "SPS": "The switching quartic oscillator (SPS)",
}
# Cases of the package's defaults, by the systems of the paper's algorithm.
CASES = {"SLS": "SLS", "SPS": "SPS, fields of the text"}
PAPER = {  # seconds an iteration, in the order simplex, moment
    "SLS": (5.88, 70.95),
    "SPS": (16.995, 76.313),
}
NAMES = {"simplex": "LP", "moment": "SDP"}
LARGER = ("mode accuracy", "mode IoU")
RIGHT = 0.99


def tables(parts: dict[str, dict]) -> str:
    """The page's part, as Markdown: for each system its starts and its figures, and the times."""
    defaults = parts["defaults"]
    systems = {name: parts[name] for name in TITLES}
    sections = [
        section(name, system, defaults["tables"][CASES[name]], defaults["seeds"])
        for name, system in systems.items()
    ]
    times = ["## Seconds an iteration", "", seconds(systems), origins(parts)]
    return "\n".join([*sections, *times]) + "\n"


def section(name: str, system: dict, table: dict, seeds: int) -> str:
    """One system: its pictures, what its starts come to, and its table."""
    return "\n".join(
        [
            f"## {TITLES[name]}",
            "",
            *figure(
                f"paper_{name}_iterations.png",
                "Cost, wrong modes and tightness by iteration, and the surface.",
                "What the paper shows of its iterations, from ten starts near equal identity laws; "
                "strong, the start of least final cost. Top left the relaxed cost, top right the "
                "share of samples in a wrong mode, bottom left the share of one-hot samples "
                "(tightness), bottom right the samples in the modes found, with the surface found "
                "and the true one.",
            ),
            starts(name, system),
            *figure(
                f"paper_{name}_rollouts.png",
                "Rollouts of the identified systems and their errors.",
                "Three of twelve rollouts of the system identified from that start (solid) over "
                "the truth (dashed), and the root mean square error of all twelve over time. "
                "Left the SDP, right the LP.",
            ),
            metrics(system, table, seeds),
        ]
    )


def figure(file: str, alt: str, caption: str) -> list[str]:
    """A picture with its caption."""
    return [f"```{{figure}} _static/{file}", f":alt: {alt}", "", caption, "```", ""]


def starts(name: str, system: dict) -> str:
    """What each relaxation comes to from all starts, as a table and a sentence each."""
    head = ["relaxation", "start", "right modes", "cost, first to last", "tightness, first to last"]
    rows, sentences = [], []
    for relaxation, runs in system["runs"].items():
        equal, drawn = runs[0], runs[1:]
        rows.append(_row(NAMES[relaxation], "equal identity laws", [equal]))
        rows.append(_row(NAMES[relaxation], f"median of {len(drawn)} near them", drawn))
        change = np.array([run["tightness"][-1] - run["tightness"][0] for run in drawn])
        sentences.append(
            f"With the {NAMES[relaxation]} tightness falls from {np.sum(change < -1e-3)} of the "
            f"{len(drawn)} starts, rises from {np.sum(change > 1e-3)} and stays from "
            f"{np.sum(np.abs(change) <= 1e-3)}; from equal identity laws, the paper's start, it "
            f"goes from {equal['tightness'][0]:.3f} to {equal['tightness'][-1]:.3f}."
        )
    return "\n".join([*markdown.table(head, rows, "llr"), "", *sentences, ""])


def _row(relaxation: str, start: str, runs: list[dict]) -> list[str]:
    right = sum(run["accuracy"] >= RIGHT for run in runs)
    cost, tight = (
        [np.median([run[key][at] for run in runs]) for at in (0, -1)]
        for key in ("relaxed", "tightness")
    )
    changes = [f"{cost[0]:.3g} to {cost[1]:.3g}", f"{tight[0]:.3f} to {tight[1]:.3f}"]
    return [relaxation, start, f"{right} of {len(runs)}", *changes]


def metrics(system: dict, table: dict, seeds: int) -> str:
    """The paper's table beside the algorithm's here, the package's defaults and the oracle."""
    head = ["metric", "better", "paper, LP and SDP", "paper's algorithm here, LP", "the same, SDP"]
    head += [f"default, median of {seeds}", "worst", "oracle, median"]
    rows = []
    for metric, row in table.items():
        larger = metric in LARGER
        best = [_best(system, relaxation)["figures"][metric] for relaxation in NAMES]
        shown = [row["paper"], *best, row["median"], row["worst"], row["oracle"]]
        cells = [number(value, larger) for value in shown]
        if missed(larger, row["median"], row["oracle"], row["paper"]):
            cells[3] += f" {MISSED}"
        rows.append([metric, "larger" if larger else "smaller", *cells])
    return "\n".join([*markdown.table(head, rows, "llr"), ""])


def _best(system: dict, relaxation: str) -> dict:
    """The run that the algorithm would keep."""
    return min(system["runs"][relaxation], key=lambda run: run["objective"])


def missed(larger: bool, ours: float, oracle: float, paper: float) -> bool:
    """True if a figure reaches neither the paper's nor the oracle's."""
    sign = 1.0 if larger else -1.0
    bars = [sign * bar for bar in (oracle, paper) if np.isfinite(bar)]
    return sign * ours < min(bars) - 1e-12


def number(value: float, larger: bool) -> str:
    """A figure; what is rounding error is zero."""
    if not np.isfinite(value):
        return "–"
    return f"{value:.4f}" if larger else "0" if abs(value) < 1e-9 else f"{value:.2g}"


def seconds(algorithm: dict) -> str:
    """Seconds an iteration, the paper's and ours, and how many times as fast."""
    rows = []
    for name, system in algorithm.items():
        for (relaxation, runs), theirs in zip(system["runs"].items(), PAPER[name], strict=True):
            ours = float(np.median([run["seconds_an_iteration"] for run in runs]))
            numbers = [f"{theirs:.4g}", f"{ours:.2g}", f"{theirs / ours:.0f}"]
            rows.append([name, NAMES[relaxation], *numbers])
    head = ["system", "relaxation", "paper, s", "here, s", "ratio"]
    return "\n".join([*markdown.table(head, rows, "llr"), ""])
