"""How exact regressions are solved: what their time depends on, and their optima do not.

Numbers of steps are those of sixty regressions of 50 to 5000 rows on 2 to 20 columns, exact, with
heavy tails, and a tenth of the rows gross errors.
"""

from __future__ import annotations

from dataclasses import dataclass


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


@dataclass(frozen=True)
class InteriorPointSettings:
    """Settings of `interior_point`."""

    step_share: float = 0.9995  # of the way to the boundary
    max_iter: int = 60  # 9 in the median, 14 at most
    rounding: float = 1e-14  # gap, of the sum of the targets, below which there is none


@dataclass(frozen=True)
class EuclideanSettings:
    """Settings of `least_euclidean_norms`."""

    tight: float = 1e-10  # relative duality gap that ends the iterations
    rounding: float = 1e-14  # the same, of the norms of the targets, where all are met
    max_iter: int = 80  # 7 in the median, 35 at most
    max_halvings: int = 30  # of a step: then it is a billionth of itself
    met: float = 1e-6  # residual, of the longest target, that only the smoothing has left


SETTINGS = SolverSettings()
INTERIOR_POINT, EUCLIDEAN = InteriorPointSettings(), EuclideanSettings()
