"""The numbers of a search for effects and of its report, and the reason behind each."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchSettings:
    """How effects are looked for, compared and accepted.

    Gains are differences of log likelihoods on held-out rows.
    """

    # -- parts of the record ---------------------------------------------------------------------
    held_out: float = 0.25  # share that takes part in no choice
    n_folds: int = 5
    n_blocks: int = 32  # of a t-test: its quantiles are those of the normal law to a few per cent
    fewest_trajectories: int = 6  # with fewer, stretches are held out instead of whole ones
    n_stretches: int = 16
    memories: float = 4.0  # of a block: its sum has nine tenths of the variance of a long one's
    forgotten: float = 2.0  # rows: what remembers no more than the next one leaves no gap
    excited: float = 0.2  # of a channel's spread: where it moves less nothing of it is learned
    stakes: tuple[float, ...] = (0.1, 0.3, 0.5, 0.7, 0.9)  # of a wealth: one of them is near best
    gap: float = 0.01  # of a trajectory, between a held-out stretch and its neighbours
    possible: float = 0.05  # probability of a mode that a row next to a surface may be in
    shown: float = 2.0  # standard errors within which noise hides what is there
    rows_a_column: int = 8  # fewer rows than that, or of a mode, are too few to hold any out
    fewest_rows: int = 40

    # -- velocities of recorded states -----------------------------------------------------------
    n_filterings: int = 3  # the later ones with a better model of what need not be filtered
    degree: int = 2  # of local polynomials: a slope in the middle is a mean of what it shows
    shortest_window: int = 7  # samples
    deciding_rows: int = 600  # of the longest stays, which say how straight a rest is
    enough_rows: int = 200  # a longer window is not worth fewer
    enough_rows_of_a_mode: int = 40  # nor these, of which three folds must tell its law
    rows_a_window: int = 3  # slopes a third of a window apart are uncorrelated

    # -- candidates beside a model ---------------------------------------------------------------
    sure: float = 0.95  # a row whose mode is less sure than this says nothing about the laws
    most_unsure: float = 0.4  # share of the rows; where more are unsure all count
    beside_a_switch: int = 2  # rows on each side whose velocities the shortest filter has smeared
    most_smeared: float = 0.75  # share of the rows of one more mode that may be such rows
    n_refined: int = 16  # trials whose parameters are refined, besides the best of every kind
    between_values: float = 0.25  # share of a gain that the nearest value of a scan shows at least
    fine: float = 1e-3  # of the distance between two values of a scan: below every interval
    n_sweeps: int = 5  # over parameters of one effect that trade off
    sure_smear: float = 3.0  # standard errors of the correlation by which a filter is told
    held_late: float = 0.6  # steps: a held input is late by half of one, as far as it is known
    correction: float = 5.0  # gain for which the correction of a sensor is worth a fit

    # -- structures ------------------------------------------------------------------------------
    surprise: float = 0.002  # probability that a surface is wrong where it is sure
    gross: float = 6.0  # robust standard deviations beyond which an error counts no more
    tie: float = 3.0  # gain within which structures are as good as each other
    hopeful: float = 0.5  # p-value up to which a candidate is fitted together with the modes
    same_modes: float = 0.995  # share of the rows: then an effect has left the modes as they were
    n_lately: int = 4  # fits whose candidates are remembered
    n_answers: int = 48  # to questions about structures that are remembered
    n_restarts: int = 10  # kinds with which the modes are sought anew
    n_splits: int = 17  # thresholds of a channel: about every twentieth row of a mode
    n_questions: int = 3  # times that a term is scanned again at the modes found with it

    # -- before a search -------------------------------------------------------------------------
    explains_nothing: float = 0.1  # of a velocity's variance: a declared model with less is none
    differentiated_rows: int = 500  # of one trajectory: a difference is one in all of its rows
    fewest_differentiated: int = 100  # rows: of fewer nobody says that they are differences
    longest_differentiator: int = 51  # samples of a moving polynomial
    adding_up: int = 30  # steps over which the noise of measured velocities leads away from states
    too_close: float = 0.5  # share of that: velocities nearer to the states were made of them

    # -- rows set aside --------------------------------------------------------------------------
    fewest_in_interval: int = 5  # rows of an event in time: fewer are an accident
    in_intervals: float = 0.9  # share of the rows that follow each other: then they are an event
    same_event: float = 0.01  # probability below which errors elsewhere do not explain a stretch
    nowhere: float = 0.5  # share of the others where all are: with more it is no place of its own

    # -- what may enter --------------------------------------------------------------------------
    # Every record has an endless rest that is significant and small: 0.05 a row is an error
    # smaller by five per cent.
    gain_a_row: float = 0.05
    share: float = 0.01  # of the squares that the declared model leaves over
    # One more mode bends to anything and explains whatever the first named effect leaves over.
    share_of_a_mode: float = 0.1
    share_of_a_disturbance: float = 0.05  # what effects leave over a little is no force
    # of what an effect that remembers inputs explains: beside what the states show of a force
    observed: float = 0.5
    slow_steps: int = 4  # steps of the record that a force is remembered for, unlike noise
    n_generalised: int = 12  # times at most that a law and the noise beneath it are fitted in turn
    fine_scale: float = 0.01  # of sizes and times of a force, and nats: below every standard error
    same_likelihood: float = 0.5  # nats: a gain by which neither of them changes
    often: float = 0.1  # share of the rows with gross errors that last: then they are a force
    gap_steps: float = 1.5  # steps of the record: samples farther apart are no neighbours
    mode_gain_a_row: float = 0.25  # by which one more mode must be better than a named effect

    # A filter and a law that is not known yet leave a gain of a few per cent where there is none.
    trifle: float = 0.005  # share of what an effect explains that its special case may lack
    plain: float = 0.9  # share of a held-out error: velocities that leave less need no rollout
    n_nearest: int = 3  # effects with a name that are told beside a function without one

    # -- what is said of the result --------------------------------------------------------------
    level: float = 0.95  # of confidence intervals and bands
    spanned: float = 1e-6  # of the size of a shape: less of it is left by the library
    step: float = 0.05  # of a derivative, as a share of the distance between values of the scan
    differing: float = 0.05  # share of the samples on which two rivals differ most
    as_good: float = 1.5  # ratio of held-out errors beyond which no one calls an effect as good


@dataclass(frozen=True)
class ReportSettings:
    """What several of the text, the page and the pictures go by."""

    worth_telling: float = 0.01  # share by which an error is lowered
    precision: int = 3  # digits of a law in text
    clearly_worse: float = 0.05  # share by which rollouts of recordings rise: beyond their luck
    least_noise: float = 1e-4  # of the spreads of the states: less is rounding beside a rollout's


SETTINGS, REPORT = SearchSettings(), ReportSettings()
