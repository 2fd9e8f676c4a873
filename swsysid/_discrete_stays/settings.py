"""Numbers of an identification in discrete time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class DiscreteSettings:
    """What an identification in discrete time takes for granted.

    Targets are in units of their deviation and features of their root mean square, so that none of
    these numbers has a unit of the user's.
    """

    # -- Rows. Share of a value that rounding leaves undecided; residuals below `exact` come from
    # arithmetic, and laws of highest likelihood in all states would only add to it.
    rounding: float = 1e-14
    exact: float = 1e-11
    dependent: float = 1e-11  # share of a feature by which it differs from combinations of others
    most_searched: int = 4000  # rows in which starts are compared, in pieces of so many in a row
    piece: int = 200
    # probability beforehand of a row that no law explains, and of a switch
    unexplained: float = 1e-3
    switching: float = 0.02
    # -- Starts: laws of windows of so many rows for each feature and a few to spare, and of the
    # shortest ones in so many parts; so many windows of each length are tried and the best of
    # neighbours kept (in parts a few in a hundred are in one mode); singular values below this
    # share say nothing
    window_factors: tuple[float, ...] = (1.0, 2.0, 4.0, 8.0)
    spare: int = 2
    window_parts: tuple[int, ...] = (2, 3, 4)
    tried: int = 400
    tried_in_parts: int = 2000
    windows: int = 40
    rank: float = 1e-10
    block: int = 3  # rows whose squares are averaged where starts are judged
    share: float = 0.1  # of the rows, which a law should at least explain
    reweightings: int = 6
    # thresholds that are tried in a column, how often finer ones around the best, and the columns
    # that are left then
    levels: int = 9
    closer: int = 5
    thresholds: int = 3
    # -- Alternation: by how much a scale may shrink at once, what it keeps at the end, most rounds
    shrinks: float = 0.1
    settled: float = 0.99
    most_rounds: int = 40
    # share of the stays of a mode that are as short as a jump, and how many times as much as the
    # best law the one of all rows that straddle a jump leaves
    momentary: float = 0.95
    rough: float = 3.0
    # -- States: their disturbance as a share of the noise, smaller and smaller, since wrong modes
    # disturb them too, in two stages; steps of a descent, and nats that count
    stages: tuple[tuple[float, ...], ...] = (
        (1.0, 1.0, 1.0, 0.3, 0.1),
        (0.03, 0.01, 0.01, 0.01, 0.01, 0.01),
    )
    most_steps: int = 10
    converged: float = 0.02
    least_noise: float = 1e-7
    # the disturbance as a share of the noise when they are told apart, from noise of the sensor
    # alone to noise of the equation alone (a ten-thousandth of the variance is the other's), and
    # the steps in which it climbs: likelihoods of 30 to 2000 rows have one summit
    ratios: tuple[float, ...] = (0.01, 0.03, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 100.0)
    ratio_steps: tuple[float, ...] = (10.0**0.5, 10.0**0.125)
    # nats by which one kind of noise may be worse and still be all there is: two deviations
    as_likely: float = 2.0
    # -- Modes by a filter: rows that are decoded side by side, those more to both sides in which a
    # hypothesis settles, and hypotheses of a piece; one whose state is further off is given up
    decoded: int = 60
    overlap: int = 15
    n_kept: int = 4
    farthest: float = 10.0
    # probability that a row does what no guard says
    doubt: float = 0.01
    # -- Numbers of modes that are tried after the best one, and the largest one
    patience: int = 2
    # nats a row by which modes are so much worse than the best ones that those are taken up again
    worse: float = 0.03
    # nats a row by which a number is so much worse than the best one that it is not judged any
    # more, before each stage of the states
    hopeless: tuple[float, ...] = (0.5, 0.1)
    most_modes: int = 6
    # -- Most lags that are tried, the share of a recording that is held out, samples after which a
    # rollout begins anew, standard errors by which a longer memory must be better, and the error
    # of a rollout below which it is rounding
    most_lags: int = 4
    held_out: float = 0.3
    horizon: int = 40
    standard_errors: float = 2.0
    exact_rollout: float = 1e-8

    def price(self, n_modes: int, switching: float) -> float:
        """Nats that a switch takes."""
        return max(0.0, float(np.log((1.0 - switching) / switching * max(1, n_modes - 1))))


SETTINGS = DiscreteSettings()
