"""What the tests of a residual go by, with the reason of each number."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers of the residual report."""

    # -- what can be judged -------------------------------------------------------------------
    fewest_rows: int = 30  # of a report: three bins of ten rows
    fewest_neighbours: int = 10  # pairs or triples of rows behind one number of a trajectory
    exact: float = 1e-9  # of the velocities: below it a residual is rounding
    rounding: float = 1e-12  # of a column: below it its changes are rounding

    # -- rows that a smoother has made --------------------------------------------------------
    degree: int = 4  # of its polynomials, as `differentiate` has them

    # -- how the significance is divided ------------------------------------------------------
    # Rearrangements share one correction (Westfall and Young); the two tests whose distribution
    # is known have Holm's.
    weight_of_rearrangements: float = 0.8
    weight_of_whiteness: float = 0.1
    weight_of_bias: float = 0.1
    most_permutations: int = 100_000  # more take hours and tell nothing further

    # -- bins of a channel --------------------------------------------------------------------
    fewest_bins: int = 4
    most_bins: int = 10  # more are less powerful against smooth dependences
    rows_a_bin: int = 20
    most_sides: int = 5  # a pair of columns is cut into at most so many cells each way
    most_pairs: int = 45  # all pairs of ten columns

    # -- what a found dependence is taken away with -------------------------------------------
    rows_a_line: int = 40  # a line in each finer bin has two coefficients
    most_lines: int = 25
    most_removed: int = 4  # dependences; what is left after them is seldom worth a name
    strong: float = 0.2  # so strong a channel is gone before correlation in time is measured


SETTINGS = Settings()
