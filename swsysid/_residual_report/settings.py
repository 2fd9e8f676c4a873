"""What the tests of a residual go by, with the reason of each number."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers of the residual report."""

    # -- what can be judged -------------------------------------------------------------------
    fewest_rows: int = 30  # of a report: three bins of ten rows
    fewest_rows_of_a_mode: int = 60  # of a mode examined by itself, as its tests share the level
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

    # -- outliers -----------------------------------------------------------------------------
    clip: float = 4.0  # robust deviations: one normal row in 16000 is cut off
    clip_of_size: float = 2.0  # of the size of noise: neighbours across a jump count little

    # -- bins of a channel --------------------------------------------------------------------
    fewest_bins: int = 4
    most_bins: int = 10  # more are less powerful against smooth dependences
    rows_a_bin: int = 20
    most_sides: int = 5  # a pair of columns is cut into at most so many cells each way
    most_pairs: int = 45  # all pairs of ten columns
    # Quantiles of the distance from the surface: bins are narrow where it is small.
    near_surface: tuple[float, ...] = (0.02, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8)

    # -- what a found dependence is taken away with -------------------------------------------
    rows_a_line: int = 40  # a line in each finer bin has two coefficients
    most_lines: int = 25
    most_removed: int = 4  # dependences; what is left after them is seldom worth a name
    strong: float = 0.2  # so strong a channel is gone before correlation in time is measured

    # -- rearrangement in blocks --------------------------------------------------------------
    lengths_a_block: float = 4.0  # correlation lengths: neighbouring blocks are all but independent
    fewest_blocks: int = 5  # 120 orders, as many as the level needs
    longest_lag: int = 400  # of the correlation length, which is summed up to the first noise
    entries_at_once: int = 4_000_000  # of rearranged residuals, 16 MB in single precision

    # -- whiteness of a trajectory by itself --------------------------------------------------
    rows_a_lag: int = 5
    level_of_a_trajectory: float = 0.01

    # -- noise floor --------------------------------------------------------------------------
    n_neighbours: int = 10  # points of the line that meets distance zero at the variance
    most_rows_of_neighbours: int = 5000  # a size from so many rows is known to 1 %

    # -- spectrum -----------------------------------------------------------------------------
    fewest_rows_of_a_piece: int = 16
    longest_piece: int = 1000  # longer trajectories are cut, as Welch did
    oversampling: int = 2  # points of the grid in a resolution: a peak between two loses 10 %
    frequencies_at_once: int = 128

    # -- words --------------------------------------------------------------------------------
    named_shape: float = 0.8  # a shape is named if it holds this share of what the bins hold
    most_digits: int = 6  # numbers with more before or behind the point have an exponent
    most_named: int = 4  # dependences of one equation in its verdict
    much: float = 0.5  # a share that is no noise and is spoken of, whatever the tests say


SETTINGS = Settings()
