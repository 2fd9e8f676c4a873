"""Numbers that several files of a search for effects go by, and the reason behind each.

Those that one file uses stand in it, beside what they decide.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """How effects are looked for, compared and accepted.

    Gains are differences of log likelihoods on held-out rows.
    """

    # -- parts of the record ---------------------------------------------------------------------
    n_folds: int = 5
    memories: float = 4.0  # of a block: its sum has nine tenths of the variance of a long one's
    shown: float = 2.0  # standard errors within which noise hides what is there
    rows_a_column: int = 8  # fewer rows than that, or of a mode, are too few to hold any out

    # -- velocities of recorded states -----------------------------------------------------------
    shortest_window: int = 7  # samples
    rows_a_window: int = 3  # slopes a third of a window apart are uncorrelated

    # -- candidates beside a model ---------------------------------------------------------------
    most_unsure: float = 0.4  # share of the rows; where more are unsure all count

    # -- structures ------------------------------------------------------------------------------
    surprise: float = 0.002  # probability that a surface is wrong where it is sure
    gross: float = 6.0  # robust standard deviations beyond which an error counts no more
    tie: float = 3.0  # gain within which structures are as good as each other
    hopeful: float = 0.5  # p-value up to which a candidate is fitted together with the modes
    n_restarts: int = 10  # kinds with which the modes are sought anew
    n_questions: int = 3  # times that a term is scanned again at the modes found with it

    # -- what may enter --------------------------------------------------------------------------
    # Every record has an endless rest that is significant and small: 0.05 a row is an error
    # smaller by five per cent.
    gain_a_row: float = 0.05
    gap_steps: float = 1.5  # steps of the record: samples farther apart are no neighbours
    mode_gain_a_row: float = 0.25  # by which one more mode must be better than a named effect

    # -- what is said of the result --------------------------------------------------------------
    spanned: float = 1e-6  # of the size of a shape: less of it is left by the library


@dataclass(frozen=True)
class ReportSettings:
    """What several of the text, the page and the pictures go by."""

    worth_telling: float = 0.01  # share by which an error is lowered
    precision: int = 3  # digits of a law in text
    clearly_worse: float = 0.05  # share by which rollouts of recordings rise: beyond their luck
    least_noise: float = 1e-4  # of the spreads of the states: less is rounding beside a rollout's


SETTINGS, REPORT = SearchSettings(), ReportSettings()
