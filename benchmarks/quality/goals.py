"""The figures that the quality benchmark holds the package to, and whether they are reached."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.goals import Goal
from benchmarks.quality.cases import STRESS
from benchmarks.quality.cells import SCENARIOS, Cell, Cells

__all__ = ["Line", "goals", "is_close"]

_THIRD = Goal(at_most=round(1 / 3, 3))


@dataclass(frozen=True)
class Line:
    """A figure beside its goal; `missed` says where it is missed."""

    figure: str
    value: str
    goal: str
    verdict: str
    missed: str = ""


def goals(found: Cells, count: dict, timing: list[dict]) -> list[Line]:
    """Every figure that was measured."""
    return [
        *_accuracy(found),
        *_velocity(found),
        *_wrong(found),
        *_scaling(found),
        *_count(count),
        *_time(found, timing),
    ]


def is_close(found: Cells, cell: Cell) -> bool:
    """Whether the balanced accuracy is as close to the oracle's as is asked of the cell."""
    median, worst = found.of(cell, "ours")["loss"]
    limits = STRESS[0] if found.is_hard(cell) else SCENARIOS.get(cell[1], SCENARIOS["clean"])
    return median <= limits.median and worst <= limits.worst


def _compared(found: Cells, is_hard: bool) -> list[Cell]:
    return [c for c in found.with_methods("oracle", "ours") if found.is_hard(c) == is_hard]


def _in_all(text: str, failed: list[str], total: int) -> Iterator[Line]:
    """A figure that is asked of every cell."""
    if total:
        reached = total - len(failed)
        verdict = Goal(at_least=total).verdict(reached)
        yield Line(text, f"{reached} of {total} cells", "all", verdict, "; ".join(failed))


def _accuracy(found: Cells) -> Iterator[Line]:
    """A warning beside a wrong answer is told, but it reaches no figure."""

    def told(cell: Cell) -> str:
        ours = found.of(cell, "ours")
        warned = ", with a warning" if ours.get("warned") else ", without a warning"
        return f"{' / '.join(cell)} (loss {ours['loss'][0]:.3f}{warned})"

    for is_hard, text in (
        (False, "Balanced accuracy at most 0.005 below the oracle's (median), 0.015 (worst seed)"),
        (True, "Hard corruptions and five nested modes: at most 0.02 below it (median)"),
    ):
        cells = _compared(found, is_hard)
        far = [told(cell) for cell in cells if not is_close(found, cell)]
        yield from _in_all(text, far, len(cells))


def _velocity(found: Cells) -> Iterator[Line]:
    def exceeds(cell) -> bool:
        ours, oracle = (found.value(cell, name, "rmse_away") for name in ("ours", "oracle"))
        return ours > 1.2 * oracle + 1e-6

    text = "Velocity RMSE away from the guard at most 1.2 times the oracle's plus 1e-6"
    cells = _compared(found, is_hard=False)
    yield from _in_all(text, [" / ".join(c) for c in cells if exceeds(c)], len(cells))


def _wrong(found: Cells) -> Iterator[Line]:
    text = "At most two more misclassified test samples than the oracle (median)"
    cells = _compared(found, is_hard=False)
    more = {cell: found.value(cell, "ours", "wrong_more") for cell in cells}
    failed = [f"{' / '.join(cell)} ({n:.0f} more)" for cell, n in more.items() if n > 2]
    yield from _in_all(text, failed, len(cells))


def _scaling(found: Cells) -> Iterator[Line]:
    """Cells named after a corruption and a number of samples, against those of 2000."""
    for case, scenario in found.with_methods("oracle", "ours"):
        if ", " not in scenario:
            continue
        usual, goal = scenario.split(", ")[1], Goal(at_most=8)
        ratio = found.value((case, scenario), "ours", "seconds")
        ratio /= found.value((case, usual), "ours", "seconds")
        loss = found.of((case, scenario), "ours")["loss"][0]
        verdict = goal.verdict(ratio if loss <= SCENARIOS[usual].median else np.inf)
        text = f"Time at N = 100,000 in times of that at N = 2000, {case} / {usual}"
        yield Line(text, f"{ratio:.1f} (loss {loss:+.4f})", goal.told, verdict)


def _count(count: dict) -> Iterator[Line]:
    if count["of"]:
        goal = Goal(at_least=0.95, percent=True)
        share = 1 - len(count["wrong"]) / count["of"]
        told = f"{share:.1%} of {count['of']}"
        missed = "; ".join(count["wrong"])
        yield Line("n_modes='auto' right", told, goal.told, goal.verdict(share), missed)


def _time(found: Cells, timing: list[dict]) -> Iterator[Line]:
    """Against the fit that PARC keeps, and against all the fits it is chosen from."""
    usual = [one for one in timing if not found.is_hard((one["case"], one["scenario"]))]
    for column, whole in ((1, "its kept fit alone"), (2, "all its fits")):
        ratios = [one["seconds"][0] / one["seconds"][column] for one in usual]
        if ratios:
            ratio = float(np.median(ratios))
            text = f"Time as a share of PARC's, median of the cells, {whole}"
            yield Line(text, f"{ratio:.2f}", _THIRD.told, _THIRD.verdict(ratio))
