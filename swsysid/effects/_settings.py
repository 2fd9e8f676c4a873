"""Where the effects of the library are looked for."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class EffectSettings:
    """Ranges and resolutions of scans; the best value is refined between its neighbours."""

    # -- static characteristics ------------------------------------------------------------------
    n_levels: int = 24  # of a threshold
    narrow: float = 0.03  # of a channel's range: narrower than that, a dead zone is friction
    rare_sign: float = 0.03  # share of the samples: a velocity with fewer of one sign has one sign
    most_monomials: int = 60  # in several channels
    sharpest: float = 0.02  # scale of a soft saturation, of the range of the channel
    softest: float = 2.0
    kinematic: float = 0.05  # of the squares of a rate, left by what it is: x' = v, or a difference

    # -- periods of a position in the range of the record -----------------------------------------
    fewest_ripples: float = 6.0  # where the search for slow ones ends
    most_periods: float = 100.0
    ripples_a_period: float = 5.0  # numbers of periods scanned in one: a peak is two wide

    # -- shapes without a name -------------------------------------------------------------------
    knots: tuple[int, ...] = (6, 12, 24)  # of a function of one channel
    more_knots: tuple[int, ...] = (48,)  # tried after the last of them, one after another
    knots_of_two: tuple[int, ...] = (20, 50)  # of a function of two
    more_knots_of_two: tuple[int, ...] = (100, 200, 300)
    prior_rows: float = 0.1  # one row near a knot is worth ten of these
    prior_rows_of_zero: float = 1e-3  # which leave a straight line to the library
    outer: float = 0.01  # share of the samples beyond each outermost knot
    samples_a_knot: int = 4
    digits: int = 9  # of a channel's range: values closer than that are one

    # -- time and memory -------------------------------------------------------------------------
    most_frequencies: int = 200_000
    frequencies_at_once: int = 4000  # in one scan, at most
    n_peaks: int = 6  # of the spectrum of the trajectories whose frequencies are scanned
    frequencies_a_peak: float = 2.5  # scanned in the width of a peak, one over the duration
    fastest: float = 0.25  # of the sampling rate
    fewest_periods: float = 5.0  # in all trajectories: fewer are a drift or a slow feedback
    longest_delay: int = 40  # steps of the record

    forgotten: float = 40.0  # presliding distances after which a contact has forgotten its past
    end: float = 9.0  # of atanh(w): there a contact slides, but for the eighth digit of w
    n_places: int = 1801  # of a table up to there

    # -- sensors ---------------------------------------------------------------------------------
    smallest_offset: float = 0.005  # of the range of the state
    largest_offset: float = 0.5
    n_offsets: int = 8  # of each sign
    latest: int = 16  # steps of the record, for a late sensor
    different: float = 0.5  # values, as a share of the samples: more are no steps of a sensor
    uneven: float = 1e-4  # of a step, by which multiples of it may differ
    mismatch: float = 0.6  # of the squares of state and velocity that a late sensor leaves

    # -- resets ----------------------------------------------------------------------------------
    fewest_jumps: int = 5
    sure_jump: float = 3.0  # errors of a single jump between two stays, where states were measured
    same_crossing: float = 0.7  # share of the jumps; the others are gaps of the record

    # -- guards with memory, agreements as shares of the rows ------------------------------------
    n_thresholds: int = 32  # scanned as ends of a band
    n_halvings: int = 5  # of the distance between two of them, to refine the band
    # Modes are wrong on a few rows in thousands next to a guard.
    worth_a_term: float = 0.0005
    worth_a_band: float = 0.002
    most_guards: int = 3
    slight: float = 0.1  # of the largest term: less is the classifier's margin, not the plant's


SETTINGS = EffectSettings()
