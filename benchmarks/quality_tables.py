"""Tables, figures to reach, and the picture of the quality benchmark, from its records."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from quality_cases import CASES, MAIN, STRESS

__all__ = ["draw", "report"]

TITLES = {
    "oracle": "oracle",
    "ours": "swsysid",
    "k_plane": "k-plane + logistic",
    "parc": "PARC",
    "single": "single model",
}
# Five nested modes must meet the figure of the hard corruptions whatever spoils them.
HARD_CASES = {"rings5"}
LIMITS = {scenario.name: (scenario.median, scenario.worst) for scenario in MAIN + STRESS}
HARD_LIMITS = (STRESS[0].median, STRESS[0].worst)
LEGEND = (
    "Balanced accuracy of the modes at 2000 noise-free held-out samples: median of the seeds, in "
    "brackets the worst. Gap: oracle minus swsysid, seed by seed. Away: more than 2 % of the "
    "states' spread from the guard."
)


class Records:
    """The cells of one run, looked up by case, corruption and method."""

    def __init__(self, records: list[dict]):
        self._records = records
        self.scenarios = _in_order(records, "scenario", LIMITS)
        self.cases = _in_order(records, "case", CASES)
        self.methods = [name for name in TITLES if any(r["method"] == name for r in records)]
        self.cells = [
            (case, scenario)
            for scenario in self.scenarios
            for case in self.cases
            if len(self.values(case, scenario, "ours", "balanced"))
        ]

    def values(self, case: str, scenario: str, method: str, column: str) -> np.ndarray:
        """One column over the seeds, in their order."""
        chosen = [
            (record["seed"], record[column])
            for record in self._records
            if (record["case"], record["scenario"], record["method"]) == (case, scenario, method)
        ]
        return np.array([value for _, value in sorted(chosen, key=lambda pair: pair[0])])

    def median(self, cell: tuple[str, str], method: str, column: str) -> float:
        """Median over the seeds, nan where the method was not run."""
        values = self.values(*cell, method, column)
        return float(np.median(values)) if len(values) else np.nan

    def gaps(self, cell: tuple[str, str]) -> np.ndarray:
        """What ours loses against the oracle, seed by seed."""
        balanced = [self.values(*cell, method, "balanced") for method in ("oracle", "ours")]
        return balanced[0] - balanced[1]

    def with_method(self, method: str) -> list[dict]:
        """All records of one method."""
        return [record for record in self._records if record["method"] == method]


def report(records: list[dict]) -> str:
    """The tables in Markdown, and each figure with whether it is reached."""
    found = Records(records)
    seeds = len({record["seed"] for record in records})
    parts = [f"# Who finds the right modes\n\n{seeds} seeds. {LEGEND}\n"]
    parts += [_table(found, scenario) for scenario in found.scenarios]
    parts.append("## Figures to reach\n")
    parts += [f"- {line}" for figure in FIGURES for line in figure(found)]
    return "\n".join(parts) + "\n"


# -- tables ----------------------------------------------------------------------------------


def _table(found: Records, scenario: str) -> str:
    head = [
        "case",
        *(TITLES[name] for name in found.methods),
        "gap",
        "RMSE (oracle)",
        "away (oracle)",
        "wrong (oracle)",
        "s",
        "reached",
    ]
    lines = [f"## {scenario}\n", "| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
    for cell in found.cells:
        if cell[1] == scenario:
            lines.append("| " + " | ".join(_row(found, cell)) + " |")
    return "\n".join(lines) + "\n"


def _row(found: Records, cell: tuple[str, str]) -> list[str]:
    gaps = found.gaps(cell)

    def pair(column: str, form: str) -> str:
        ours, oracle = (found.median(cell, method, column) for method in ("ours", "oracle"))
        return f"{ours:{form}} ({oracle:{form}})"

    return [
        cell[0],
        *(_accuracy(found.values(*cell, method, "balanced")) for method in found.methods),
        f"{np.median(gaps):+.4f} ({gaps.max():+.4f})",
        pair("rmse", ".2g"),
        pair("rmse_away", ".2g"),
        pair("wrong", ".0f"),
        f"{found.median(cell, 'ours', 'seconds'):.2f}",
        "yes" if _is_close(found, cell) else "**no**",
    ]


def _accuracy(values: np.ndarray) -> str:
    return f"{np.median(values):.4f} ({values.min():.4f})" if len(values) else "-"


# -- figures to reach ------------------------------------------------------------------------


def _is_hard(cell: tuple[str, str]) -> bool:
    return cell[0] in HARD_CASES or LIMITS.get(cell[1]) == HARD_LIMITS


def _is_close(found: Records, cell: tuple[str, str]) -> bool:
    """Balanced accuracy close enough to the oracle's, or a warning where that may do."""
    gaps = found.gaps(cell)
    median, worst = HARD_LIMITS if _is_hard(cell) else LIMITS.get(cell[1], LIMITS["clean"])
    if np.median(gaps) <= median and gaps.max() <= worst:
        return True
    warned = ["ConvergenceWarning" in names for names in _warnings(found, cell)]
    return _is_hard(cell) and all(np.array(warned)[gaps > median])


def _warnings(found: Records, cell: tuple[str, str]) -> list[list[str]]:
    rows = found.with_method("ours")
    chosen = [row for row in rows if (row["case"], row["scenario"]) == cell]
    return [row["warnings"] for row in sorted(chosen, key=lambda row: row["seed"])]


def _verdict(text: str, failed: list, total: int) -> list[str]:
    """One line, with the cells that fail."""
    if not total:
        return [f"{text}: not run"]
    missed = ", ".join(" / ".join(cell) for cell in failed)
    verdict = f"not reached in {len(failed)} of {total} cells: {missed}" if failed else "reached"
    return [f"{text}: {verdict}" + ("" if failed else f" in all {total} cells")]


def _accuracy_figure(found: Records) -> list[str]:
    lines = []
    for hard, text in (
        (False, "Balanced accuracy within 0.005 of the oracle (median), 0.015 (worst seed)"),
        (True, "Hard corruptions and five nested modes: within 0.02 (median), or a warning"),
    ):
        cells = [cell for cell in found.cells if _is_hard(cell) == hard]
        lines += _verdict(text, [cell for cell in cells if not _is_close(found, cell)], len(cells))
    return lines


def _velocity_figure(found: Records) -> list[str]:
    cells = [cell for cell in found.cells if not _is_hard(cell)]

    def exceeds(cell) -> bool:
        ours, oracle = (found.median(cell, name, "rmse_away") for name in ("ours", "oracle"))
        return ours > 1.2 * oracle + 1e-6

    text = "Velocity RMSE away from the guard at most 1.2 times the oracle's plus 1e-6"
    return _verdict(text, [cell for cell in cells if exceeds(cell)], len(cells))


def _wrong_figure(found: Records) -> list[str]:
    cells = [cell for cell in found.cells if not _is_hard(cell)]

    def exceeds(cell) -> bool:
        ours, oracle = (found.values(*cell, name, "wrong") for name in ("ours", "oracle"))
        return np.median(ours - oracle) > 2

    text = "At most two more misclassified test samples than the oracle"
    return _verdict(text, [cell for cell in cells if exceeds(cell)], len(cells))


def _time_figure(found: Records) -> list[str]:
    text = "At most a third of PARC's time (median of the cells)"
    ratios = [
        found.median(cell, "ours", "seconds") / found.median(cell, "parc", "seconds")
        for cell in found.cells
        if not _is_hard(cell)
    ]
    ratios = [ratio for ratio in ratios if np.isfinite(ratio)]
    if not ratios:
        return [f"{text}: not run"]
    return [f"{text}: {np.median(ratios):.2f}, {_reached(np.median(ratios) <= 1 / 3)}"]


def _scaling_figure(found: Records) -> list[str]:
    """Cells named after a corruption and a number of samples, against those of 2000."""
    text = "Time at N = 100,000 at most 8 times that at N = 2000"
    lines = []
    for case, scenario in found.cells:
        if ", " in scenario:
            usual = case, scenario.split(", ")[1]
            ratio = found.median((case, scenario), "ours", "seconds")
            ratio /= found.median(usual, "ours", "seconds")
            gap = np.median(found.gaps((case, scenario)))
            lines.append(
                f"{text}: {case} / {usual[1]}: {ratio:.1f} times (gap {gap:+.4f}), "
                + _reached(ratio <= 8 and gap <= LIMITS[usual[1]][0])
            )
    return lines or [f"{text}: not run"]


def _count_figure(found: Records) -> list[str]:
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


def _reached(is_reached: bool) -> str:
    return "reached" if is_reached else "not reached"


FIGURES: tuple[Callable[[Records], list[str]], ...] = (
    _accuracy_figure,
    _velocity_figure,
    _wrong_figure,
    _time_figure,
    _scaling_figure,
    _count_figure,
)


# -- picture ---------------------------------------------------------------------------------


def draw(records: list[dict], file: Path) -> None:
    """Error of the modes of every method, a panel for each corruption, a row for each case."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    found = Records(records)
    size = (2.6 * len(found.scenarios) + 1.5, 0.32 * len(found.cases) + 1.6)
    figure, axes = plt.subplots(
        1, len(found.scenarios), figsize=size, sharey=True, squeeze=False, layout="constrained"
    )
    methods = [name for name in found.methods if name != "single"]
    for panel, scenario in zip(axes[0], found.scenarios, strict=True):
        for marker, method in zip("|osD", methods, strict=False):
            _strip(panel, found, scenario, method, marker)
        panel.set(xscale="log", title=scenario, xlabel="1 - balanced accuracy", xlim=(3e-5, 1))
        panel.grid(axis="x", alpha=0.3)
    axes[0, 0].set_yticks(range(len(found.cases)), found.cases)
    axes[0, 0].invert_yaxis()
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.savefig(file, dpi=150)
    plt.close(figure)


def _strip(panel, found: Records, scenario: str, method: str, marker: str) -> None:
    """Median of every case as a marker, from the best to the worst seed as a line."""
    rows, low, middle, high = [], [], [], []
    for row, case in enumerate(found.cases):
        errors = 1 - found.values(case, scenario, method, "balanced")
        if len(errors):
            shown = np.maximum(errors, 5e-5)  # no error at all has no place on a log axis
            rows.append(row)
            low.append(shown.min())
            middle.append(np.median(shown))
            high.append(shown.max())
    colour = {"oracle": "black", "ours": "C0", "k_plane": "C1", "parc": "C2"}[method]
    panel.hlines(rows, low, high, color=colour, alpha=0.4)
    panel.plot(middle, rows, marker, color=colour, label=TITLES[method], markersize=7, alpha=0.8)


def _in_order(records: list[dict], column: str, known) -> list[str]:
    """Names in the order of the benchmark, others after them."""
    names = dict.fromkeys(record[column] for record in records)
    return [name for name in known if name in names] + [n for n in names if n not in known]
