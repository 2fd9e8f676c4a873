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
    # a gap that clipped samples leave is bridged up to so many steps
    bridged: float = 4.0
    # polynomials beyond are lost to rounding
    most_degree: int = 20
    most_decimated: int = 1_000_000

    # -- sensors: below this share of the largest value, differences are rounding
    rounding: float = 1e-12
    # fewer distances of neighbouring values are a signal of states, not of an encoder
    fewest_levels: int = 5
    # quanta by which the distances of values on a grid may be off, after single precision
    off_grid: float = 0.05
    # readings that show how long a logger holds them, and the share of them that it need not hold
    fewest_readings: int = 20
    single_readings: float = 0.02
    # samples that a clipped stretch has at least, times those of any stay elsewhere; samples beside
    # it that show how fast the movement to it is: at least so many, and until it has made so many
    # quanta or deviations
    plateau: int = 3
    approach: int = 7
    plain: float = 10.0
    # noise below this share of the range may be what differences leave of a smooth signal
    visible: float = 1e-4
    # quanta of noise above which there is more than that of rounding, 0.29
    beyond_rounding: float = 0.4
    # standard deviations beyond which a speed is not noise; quanta that may hide a smooth turn
    sure: float = 4.0
    hidden_quanta: float = 6.0
    # share of a trajectory that accelerates less than it does where it stops
    hardly: float = 0.95

    # samples that a rest has at least; share of the largest derivative up to which there is none
    shortest_rest: int = 5
    standing: float = 1e-9
    # times the noise that movement has at least where rest can be told from it
    plain_movement: float = 3.0
    # a larger share of rows at rest outvotes those that move, or nearly
    mostly: float = 1 / 3
    # of the rows that move, so many are kept of those at rest
    kept_at_rest: float = 0.1

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
    # Of rounding, which is white noise only nearly: so many times as much, in comparisons with
    # smoothers of up to so many times the variance.
    rounding_margin: float = 1.7
    rounding_reach: float = 30.0

    # -- smoothing: relative deviation of the steps up to which sampling counts as even (and of a
    # line's slope up to which the times are known), and rows smoothed at a time, which bounds the
    # memory
    even: float = 1e-3
    rows_at_a_time: int = 20_000
    # an error that grows by less than a tenth is not worth a warning
    noticed: float = 1.1


SETTINGS = Settings()
