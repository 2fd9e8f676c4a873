"""The cells of a run of the quality benchmark, looked up by case, corruption and method."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from quality_cases import CASES, MAIN, STRESS

__all__ = ["HARD_CASES", "SCENARIOS", "TITLES", "Records"]

TITLES = {
    "oracle": "oracle",
    "ours": "swsysid",
    "k_plane": "k-plane + logistic",
    "parc": "PARC",
    "single": "single model",
}
SCENARIOS = {scenario.name: scenario for scenario in MAIN + STRESS}
# Five nested modes must meet the figure of the hard corruptions whatever spoils them.
HARD_CASES = {"rings5"}

Cell = tuple[str, str]  # case, scenario


class Records:
    """Columns of the records over the seeds."""

    def __init__(self, records: list[dict]):
        self._by_cell: dict[tuple, list[dict]] = defaultdict(list)
        for record in sorted(records, key=lambda record: record["seed"]):
            cell = record["case"], record["scenario"], record["method"]
            self._by_cell[cell].append(record)
        self.scenarios = _in_order(records, "scenario", SCENARIOS)
        self.cases = _in_order(records, "case", CASES)
        present = {record["method"] for record in records}
        self.methods = [name for name in TITLES if name in present]

    def cells_of(self, scenario: str) -> list[Cell]:
        """The cells of a corruption in which any method was run."""
        cells = [(case, scenario) for case in self.cases]
        return [cell for cell in cells if any(self.rows(cell, name) for name in self.methods)]

    def cells_with(self, *methods: str) -> list[Cell]:
        """The cells in which all these methods were run, corruption by corruption."""
        return [
            (case, scenario)
            for scenario in self.scenarios
            for case in self.cases
            if all(self.rows((case, scenario), method) for method in methods)
        ]

    def rows(self, cell: Cell, method: str) -> list[dict]:
        """Records of one cell and method, seed by seed."""
        return self._by_cell.get((*cell, method), [])

    def values(self, cell: Cell, method: str, column: str) -> np.ndarray:
        """One column over the seeds, in their order; of the records that have it."""
        return np.array([row[column] for row in self.rows(cell, method) if column in row])

    def median(self, cell: Cell, method: str, column: str) -> float:
        """Median over the seeds, nan where the method was not run."""
        values = self.values(cell, method, column)
        return float(np.median(values)) if len(values) else np.nan

    def differences(self, cell: Cell, method: str, column: str = "balanced") -> np.ndarray:
        """The oracle's values minus the method's, for the seeds that both have."""
        theirs = {row["seed"]: row[column] for row in self.rows(cell, method)}
        return np.array(
            [
                row[column] - theirs[row["seed"]]
                for row in self.rows(cell, "oracle")
                if row["seed"] in theirs
            ]
        )

    def with_method(self, method: str) -> list[dict]:
        """All records of one method."""
        return [row for cell, rows in self._by_cell.items() if cell[2] == method for row in rows]

    def is_hard(self, cell: Cell) -> bool:
        """Whether the milder figure of the hard corruptions holds for the cell."""
        return cell[0] in HARD_CASES or cell[1] in {scenario.name for scenario in STRESS}


def _in_order(records: list[dict], column: str, known) -> list[str]:
    """Names in the order of the benchmark, others after them."""
    names = dict.fromkeys(record[column] for record in records)
    return [name for name in known if name in names] + [n for n in names if n not in known]
