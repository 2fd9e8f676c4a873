"""Numbers of the seeding, and why they are what they are."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SeedingSettings:
    """How seeds are sought.

    Targets are in units of their deviation, coordinates standardised, features whitened, so that
    none of these numbers has a unit of the user's.
    """

    # -- Units. A typical deviation is at least this share of the mean one.
    least_of_mean: float = 0.25
    # -- Rows. More of them move a partition no more: the search needs fewer than the final fit.
    most_rows: int = 20_000
    most_searched: int = 3000
    # -- Starts. They are drawn in batches until the best partition was found so many times in the
    # first batch, or in all; small problems are searched with fewer batches.
    batch: int = 16
    most_starts: int = 96
    samples_a_batch: int = 100
    hits_at_once: int = 4
    hits: int = 3
    # Starts from laws of neighbourhoods that go with every batch, the best of so many draws; and
    # how often more of them are drawn where the answer leaves over more than noise.
    n_laws: int = 3
    law_draws: int = 12
    more_laws: int = 4
    # The next law is one of rows that the laws so far explain badly: with the first power of the
    # residual a rare mode of clean data is found, with small powers outliers are passed over.
    law_powers: tuple[float, float] = (0.2, 1.0)
    # Rows are neighbours in the state and in residuals up to a few typical sizes.
    law_reach: float = 3.0
    # Probability of the drawn mode at the start: the others must be able to win a row back.
    first_probability: float = 0.98
    # -- Iterations, and how many starts of a batch are kept after them.
    halving: tuple[tuple[int, int], ...] = ((10, 10), (20, 6))
    law_iterations: int = 10
    last_iterations: int = 40
    final_iterations: int = 25
    # Iterations end where none gains so many nats, or so many a sample.
    tolerance: float = 5e-3
    tolerance_a_sample: float = 1e-6
    n_kept: int = 3
    # -- The gate. At most so many features, and at least so many samples for each coefficient;
    # its first stages know polynomials up to `coarse_degree` only.
    most_gate_features: int = 50
    samples_a_coefficient: int = 5
    coarse_degree: int = 2
    # Prices of its mean squared score: while searching, and then in the final fits one by one.
    # What the coarse polynomials cannot say has a larger one: noisy labels do not determine it,
    # and a gate that is free to is fitted to them.
    ridge: float = 1e-2
    final_ridges: tuple[float, ...] = (1e-2, 1e-3, 1e-4)
    fine_ridge: float = 0.1
    # A Newton step changes no score by more.
    most_score_change: float = 5.0
    # -- Noise. The search assumes Student's law with so many degrees of freedom: with four, 20 % of
    # gross one-sided outliers led one search of four astray (the band of the quality benchmark).
    dof: float = 3.0
    # Outliers of the final fit are so many typical deviations broad.
    outlier_breadth: float = 5.0
    # The first stages assume at least this share of the single model's residual: with
    # less, a start on exact data freezes with a few per cent of the samples taken for outliers.
    coarse_noise: float = 0.1
    # Share of outliers at the start of the final fit, and its limits.
    outlier_share: float = 0.02
    outlier_limits: tuple[float, float] = (1e-4, 0.3)
    # One iteration leaves at least this share of a variance: no start can collapse onto a handful
    # of samples at once.
    least_shrinkage: float = 0.25
    # Residuals below this are rounding errors; reweighting by 1 / |residual| ends at `small`.
    exact: float = 1e-7
    small: float = 1e-3
    # Price of moving a coefficient, for modes without samples.
    proximal: float = 1e-10
    # -- Partitions. Two are the same if they differ on at most this share of the weight; or, where
    # noise makes labels fuzzy, on the larger share if their likelihoods are so many nats apart.
    same: float = 0.005
    same_if_tied: float = 0.03
    tied: float = 2.0


DEFAULTS = SeedingSettings()
