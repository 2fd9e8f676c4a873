"""The numbers of the differentiation, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers that hold for every record; users have the options of `differentiate`."""

    # a longer gap, in median steps, is not one trajectory any more
    largest_gap: float = 20.0
    # -- sensors: below this share of the largest value, differences are rounding
    rounding: float = 1e-12
    # quanta of noise above which there is more than that of rounding, 0.29
    beyond_rounding: float = 0.4
    # standard deviations beyond which a speed is not noise; quanta that may hide a smooth turn
    sure: float = 4.0
    hidden_quanta: float = 6.0

    # -- strengths to choose from, each about 1.4 times the one before it
    windows: tuple[int, ...] = (
        *(7, 9, 11, 15, 21, 29, 41, 57, 81, 115, 163, 231, 327, 463, 655, 927, 1311, 1855, 2623),
        *(3711, 5247, 7419, 10493),
    )
    # share of the rows that the ends of a window may cost
    lost: float = 0.25

    # -- smoothing: relative deviation of the steps up to which sampling counts as even (and of a
    # line's slope up to which the times are known), and rows smoothed at a time, which bounds the
    # memory
    even: float = 1e-3
    rows_at_a_time: int = 20_000


SETTINGS = Settings()
