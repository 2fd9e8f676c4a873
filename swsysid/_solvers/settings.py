"""How exact regressions are solved: what their time depends on, and their optima do not."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["SETTINGS", "SolverSettings"]


@dataclass(frozen=True)
class SolverSettings:
    """Settings of `least_absolute_deviations`, with the reasons behind them."""

    narrow: int = 8  # columns up to which edge steps beat the interior point, two to four times
    short: int = 20_000  # rows up to which they do without merging
    edge_steps: int = 30  # for each column, after which the interior point takes over
    warm_steps: int = 8  # from coefficients near the optimum; more cost as much as a fresh start
    sampled: float = 0.5  # rows of a first guess, in units of (n p)^(2/3)
    kept: float = 0.8  # rows kept around it, in the same units
    fewest: int = 1000  # rows below which merging does not pay
    fewest_kept: float = 4.0  # nor with fewer than so many times the kept rows
    wrong: float = 0.1  # share of the kept rows that may have been missed before they are doubled
    handover: float = 1e-4  # relative gap at which the interior point hands over to edge steps
    tight: float = 1e-11  # relative gap of a proof; where edges lead nowhere, of the interior point
    proved: float = 1e-9  # relative gap up to which an answer counts as optimal


SETTINGS = SolverSettings()
