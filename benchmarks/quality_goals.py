"""The figures that the quality benchmark holds the package to, and whether they are reached."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from quality_cases import STRESS
from quality_records import SCENARIOS, Cell, Records

__all__ = ["goals", "is_close"]


def goals(found: Records, timed: Records) -> list[str]:
    """One line for each figure; `timed` are the records whose seconds are compared."""
    lines = [line for goal in GOALS for line in goal(found)]
    return [*lines, *_time_goal(timed)]


def is_close(found: Records, cell: Cell) -> bool:
    """Balanced accuracy close enough to the oracle's, or a warning where that may do."""
    gaps, hard = found.differences(cell, "ours"), found.is_hard(cell)
    limits = STRESS[0] if hard else SCENARIOS.get(cell[1], SCENARIOS["clean"])
    if np.median(gaps) <= limits.median and gaps.max() <= limits.worst:
        return True
    oracles = {row["seed"] for row in found.rows(cell, "oracle")}
    rows = [row for row in found.rows(cell, "ours") if row["seed"] in oracles]
    warned = ["ConvergenceWarning" in row["warnings"] for row in rows]
    return hard and all(np.array(warned)[gaps > limits.median])


def _time_ratios(timed: Records, column: str) -> list[float]:
    """Our seconds over PARC's, a median of each cell that is not hard."""
    return [
        timed.median(cell, "ours", "seconds") / timed.median(cell, "parc", column)
        for cell in timed.cells_with("ours", "parc")
        if not timed.is_hard(cell)
    ]


def _usual(found: Records) -> list[Cell]:
    return [cell for cell in found.cells_with("oracle", "ours") if not found.is_hard(cell)]


def _verdict(text: str, failed: list, total: int) -> list[str]:
    """One line, with the cells that fail."""
    if not total:
        return [f"{text}: not run"]
    missed = ", ".join(" / ".join(cell) for cell in failed)
    verdict = f"not reached in {len(failed)} of {total} cells: {missed}" if failed else "reached"
    return [f"{text}: {verdict}" + ("" if failed else f" in all {total} cells")]


def _reached(is_reached: bool) -> str:
    return "reached" if is_reached else "not reached"


def _accuracy_goal(found: Records) -> list[str]:
    lines = []
    for hard, text in (
        (False, "Balanced accuracy within 0.005 of the oracle (median), 0.015 (worst seed)"),
        (True, "Hard corruptions and five nested modes: within 0.02 (median), or a warning"),
    ):
        cells = [c for c in found.cells_with("oracle", "ours") if found.is_hard(c) == hard]
        lines += _verdict(text, [cell for cell in cells if not is_close(found, cell)], len(cells))
    return lines


def _velocity_goal(found: Records) -> list[str]:
    def exceeds(cell) -> bool:
        ours, oracle = (found.median(cell, name, "rmse_away") for name in ("ours", "oracle"))
        return ours > 1.2 * oracle + 1e-6

    text = "Velocity RMSE away from the guard at most 1.2 times the oracle's plus 1e-6"
    cells = _usual(found)
    return _verdict(text, [cell for cell in cells if exceeds(cell)], len(cells))


def _wrong_goal(found: Records) -> list[str]:
    text = "At most two more misclassified test samples than the oracle (median)"
    cells = _usual(found)
    failed = [cell for cell in cells if np.median(found.differences(cell, "ours", "wrong")) < -2]
    return _verdict(text, failed, len(cells))


def _scaling_goal(found: Records) -> list[str]:
    """Cells named after a corruption and a number of samples, against those of 2000."""
    text = "Time at N = 100,000 at most 8 times that at N = 2000"
    lines = []
    for case, scenario in found.cells_with("oracle", "ours"):
        if ", " in scenario:
            usual = case, scenario.split(", ")[1]
            ratio = found.median((case, scenario), "ours", "seconds")
            ratio /= found.median(usual, "ours", "seconds")
            gap = np.median(found.differences((case, scenario), "ours"))
            lines.append(
                f"{text}: {case} / {usual[1]}: {ratio:.1f} times (loss {gap:+.4f}), "
                + _reached(ratio <= 8 and gap <= SCENARIOS[usual[1]].median)
            )
    return lines or [f"{text}: not run"]


def _count_goal(found: Records) -> list[str]:
    text = "n_modes='auto' right in at least 95 % of the cells"
    rows = found.with_method("count")
    if not rows:
        return [f"{text}: not run"]
    wrong = [row for row in rows if row["n_modes"] != row["n_modes_true"]]
    missed = ", ".join(
        f"{row['case']} / {row['scenario']} / seed {row['seed']}: {row['n_modes']}" for row in wrong
    )
    share = 1 - len(wrong) / len(rows)
    return [f"{text}: {share:.1%} of {len(rows)}, {_reached(share >= 0.95)}. {missed}".strip()]


def _time_goal(timed: Records) -> list[str]:
    """Against the fit that PARC keeps, and against all the fits it is chosen from."""
    lines = []
    for column, whole in (("seconds", "its kept fit alone"), ("seconds_all", "all its fits")):
        text = f"At most a third of PARC's time, median of the cells, {whole}"
        ratios = _time_ratios(timed, column)
        verdict = (
            f"{np.median(ratios):.2f}, {_reached(np.median(ratios) <= 1 / 3)}"
            if ratios
            else "not run"
        )
        lines.append(f"{text}: {verdict}")
    return lines


GOALS: tuple[Callable[[Records], list[str]], ...] = (
    _accuracy_goal,
    _velocity_goal,
    _wrong_goal,
    _scaling_goal,
    _count_goal,
)
