"""The numbers of the differentiation, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers that hold for every record; users have the options of `differentiate`."""

    # differences of this order leave noise and hardly any of a smooth signal
    noise_order: int = 6
    # a longer gap, in median steps, is not one trajectory any more
    largest_gap: float = 20.0
    # polynomials beyond are lost to rounding
    most_degree: int = 20
    most_decimated: int = 1_000_000

    # -- strengths to choose from, each about 1.4 times the one before it
    windows: tuple[int, ...] = (
        *(7, 9, 11, 15, 21, 29, 41, 57, 81, 115, 163, 231, 327, 463, 655, 927, 1311, 1855, 2623),
        *(3711, 5247, 7419, 10493),
    )
    # of the sampling rate
    cutoffs: tuple[float, ...] = (
        *(0.4, 0.28, 0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025, 0.0175, 0.0125),
    )
    # share of the rows that the ends of a window may cost
    lost: float = 0.25
    # rows that decide, and rows of one trajectory that decide side by side; more say the same
    rows: int = 50_000
    stretch: int = 1_000
    # Noise explains a departure up to this over the root of the number of rows, relative to it: the
    # estimated variance of the noise and the departure itself are uncertain by about five.
    doubt: float = 10.0

    # -- smoothing: relative deviation of the steps up to which sampling counts as even, and rows
    # smoothed at a time, which bounds the memory
    even: float = 1e-3
    rows_at_a_time: int = 20_000


SETTINGS = Settings()
