"""The kept figures of the quality benchmark, looked up by case, corruption and method."""

from __future__ import annotations

import numpy as np

from benchmarks.quality.cases import CASES, MAIN, STRESS

__all__ = ["SCENARIOS", "TITLES", "Cell", "Cells", "scenario_title"]

TITLES = {
    "oracle": "oracle",
    "ours": "swsysid",
    "k_plane": "k-plane + logistic",
    "parc": "PARC",
    "single": "single model",
}
SCENARIOS = {scenario.name: scenario for scenario in MAIN + STRESS}
_HARD_SCENARIOS = {scenario.name for scenario in STRESS}
# Five nested modes must meet the figure of the hard corruptions whatever spoils them.
_HARD_CASES = {"rings5"}

Cell = tuple[str, str]  # case, scenario


def scenario_title(scenario: str) -> str:
    """What is done to the data, in a few words."""
    return SCENARIOS[scenario].told if scenario in SCENARIOS else scenario


class Cells:
    """Figures of cells; see `benchmarks.quality.records.condensed` for what each has."""

    def __init__(self, cells: list[dict]):
        self._figures = {(one["case"], one["scenario"], one["method"]): one for one in cells}
        self.scenarios = _in_order([one["scenario"] for one in cells], SCENARIOS)
        self.cases = _in_order([one["case"] for one in cells], CASES)

    def methods(self, scenario: str | None = None) -> list[str]:
        """Methods that were run in a corruption, or in any."""
        run = {key[2] for key in self._figures if scenario in (None, key[1])}
        return [name for name in TITLES if name in run]

    def title(self, method: str, scenario: str | None = None) -> str:
        """Name of a method; with its number of seeds where others have more."""
        seeds = self.seeds(method, scenario)
        most = max(self.seeds(name, scenario)[-1] for name in self.methods(scenario))
        if seeds == [most]:
            return TITLES[method]
        return f"{TITLES[method]} ({' to '.join(map(str, seeds))} seed{'s' * (seeds[-1] > 1)})"

    def seeds(self, method: str, scenario: str | None = None) -> list[int]:
        """Smallest and largest number of seeds of a method, one number where they are equal."""
        counts = {
            one["seeds"]
            for (_, name, by), one in self._figures.items()
            if by == method and name in SCENARIOS and scenario in (None, name)
        } or {one["seeds"] for (_, _, by), one in self._figures.items() if by == method}
        return sorted({min(counts), max(counts)})

    def with_methods(self, *methods: str) -> list[Cell]:
        """The cells in which all these methods were run, corruption by corruption."""
        return [
            (case, scenario)
            for scenario in self.scenarios
            for case in self.cases
            if all((case, scenario, method) in self._figures for method in methods)
        ]

    def of(self, cell: Cell, method: str) -> dict:
        """All figures of a cell, none where the method was not run."""
        return self._figures.get((*cell, method), {})

    def value(self, cell: Cell, method: str, column: str) -> float:
        """One figure, nan where there is none."""
        return self.of(cell, method).get(column, np.nan)

    def balanced(self, cell: Cell, method: str) -> float:
        """Median over the seeds of the balanced accuracy."""
        return self.of(cell, method)["balanced"][0]

    def is_hard(self, cell: Cell) -> bool:
        """Whether the milder figure of the hard corruptions holds for the cell."""
        return cell[0] in _HARD_CASES or cell[1] in _HARD_SCENARIOS


def _in_order(names: list[str], known) -> list[str]:
    """Names in the order of the benchmark, others after them."""
    present = dict.fromkeys(names)
    return [name for name in known if name in present] + [n for n in present if n not in known]
