"""What an identification is asked for, and sizes and limits that no user should have to choose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from swsysid._data.sources import READ_AT_ONCE
from swsysid._seeding.misfit import MisfitSettings
from swsysid._seeding.settings import SeedingSettings
from swsysid._surfaces.surface import Classifier
from swsysid.relaxations._base import Relaxation


@dataclass(frozen=True)
class CalibrationSettings:
    """When a row belongs to no mode, and what noise is assumed of the others."""

    outlying: float = 10.0  # residuals beyond this many scales belong to no mode ...
    # ... unless that would discard more than this share of a mode: then it is the mode that fits
    # badly, not the rows.
    most_outlying: float = 0.5
    # In a pass rows are suspected from this share of the first limit on: the vector fields have
    # moved since those that say which rows are outliers.
    suspected: float = 0.5
    # Smallest scale of a residual, relative to the spread of the velocity: below it the data are
    # clean, and differences are roundoff.
    least_scale: float = 1e-9
    # Expected share of outliers; it bounds what a single row can say about its mode.
    outlier_share: float = 0.02
    # Their deviation over the median distance of a velocity from its median.
    outlier_breadth: float = 7.4


@dataclass(frozen=True)
class ModeCountSettings:
    """How numbers of modes are compared."""

    held_out: float = 0.25  # share of the samples held out ...
    trajectories: int = 4  # ... as whole trajectories where there are so many
    most_rows: int = 3000  # of either part; more rows say no more
    # Differences of fewer standard errors than this, and this many nats, are noise.
    standard_errors: float = 2.0
    free_nats: float = 2.0
    patience: int = 2  # counts tried beyond the best one before the search gives up
    # Two batches of random starts suffice beside the cuts of every smaller mode.
    seeding: SeedingSettings = SeedingSettings(most_starts=32)
    n_splits: int = 2  # so many cuts
    # Residuals below this share of an output's typical deviation are none: on exact data the
    # comparison must not be about rounding errors.
    least_scale: float = 1e-4
    # A sample costs about this much at most, or a nat for every output if these are more.
    most_nats: float = 3.0
    # One law with all monomials up to these degrees is compared with several modes ...
    smooth_degrees: tuple[int, ...] = (2, 3, 5, 7)
    most_monomials: int = 60  # ... as long as there are not too many monomials for the rows
    rows_a_monomial: int = 10


@dataclass(frozen=True)
class TrustRegionSettings:
    """How far from a sample's answer that of all rows is looked for."""

    # Chance that vector fields of a sample are farther from those of all rows than expected.
    chance: float = 0.01
    fewest: int = 10  # rows kept at least for each column
    # Rows kept next to a margin, in units of p / m for p features known from m rows; and never
    # fewer than so many for each feature.
    near_margin: float = 10.0
    fewest_near_margin: int = 20
    # No row of all is expected to have more than so many times the leverage of those sampled.
    leverage: float = 3.0
    # Residuals and margins may move this share of what they moved in the step before.
    following: float = 0.3
    exact: float = 1e-9  # residuals below this share of the spread of the targets count as zero
    # Share of the smallest residuals that tell their density at zero; number of the smallest
    # distances that tell how many are smaller still.
    resolved: float = 0.1
    counted: int = 20


@dataclass(frozen=True)
class GuardSettings:
    """Which samples judge a guard, and what they must show."""

    # The residuals of a sample decide its mode if the odds against it are below this.
    doubt: float = float(np.exp(-4.0))
    # The neighbours predict the mode of a sample if so many of so many share it.
    n_neighbours: int = 10
    n_agreeing: int = 3
    # Fewer decided samples of the smallest mode, or contradictions, allow no judgement.
    fewest: int = 5
    # Of a flexible classifier, which has learned the modes of its own samples by heart.
    n_folds: int = 3
    most_rows: int = 3000  # more decided samples say no more
    n_iterations: int = 10  # for the shares of the modes
    # Samples that contradict the state, as a share of the decided ones: a fitted surface that is a
    # little off leaves about a thousandth.
    tolerated: float = 0.0075


@dataclass(frozen=True)
class IdentificationSettings:
    """Sizes and limits of a fit."""

    # Data of at most `whole` rows are identified as a whole, of more a sample of `sampled` rows.
    whole: int = 40_000
    sampled: int = 10_000
    read_at_once: int = READ_AT_ONCE  # rows of a file
    # Starts are compared on so many rows, which decide between them as well as all rows do.
    deciding: int = 20_000
    random_starts: int = 10  # number of starts with ``init="random"``
    # Partitions that differ on more than this share of the samples are different answers, and a gap
    # of log likelihoods within so many nats leaves the choice between them open: dense gates on
    # thousands of samples differ by hundreds where the samples decide.
    different: float = 0.02
    open: float = 20.0
    same: float = 0.995  # two runs found the same answer if they agree on this share of the samples
    # An answer that at most one start in so many finds is no more than the best so far.
    seldom: int = 32
    # The mode-book is chosen anew when more than this share of the weight has changed its mode.
    another_book: float = 0.02
    # Each surface is a search for monomials of its own: that of a surface for each pair of twenty
    # modes would take longer than the fit.
    most_surfaces: int = 15
    no_advantage: float = 1e-6  # log evidences that differ by less differ by rounding errors
    nearly_tied: float = 5.0  # log evidences this close leave both surfaces in the race
    # Terms are chosen anew for the modes that the last choice led to, at most so often.
    most_choices: int = 5
    # Before all rows a larger sample is passed over: so many times the rows to the power 2/3.
    larger: float = 4.0
    # Rows that a pass keeps at most, over all outputs: they must fit into memory.
    most_kept: int = 5_000_000
    # If a pass over all rows would keep more, passes over at least so many times fewer rows come
    # before.
    fewer: int = 4
    # Where a pass kept too few rows, residuals and margins reach so many times as far. Few rows are
    # next to a margin, and what a surface does far from them is hard to foresee.
    wider: float = 2.0
    wider_margins: float = 8.0
    most_tries: int = 3  # how often a pass keeps more rows before it is given up
    no_gain: float = 1e-9  # gains of an objective below so many nats a row count as zero
    # Passes for the surfaces alone, which follow where they are not coupled.
    most_surface_passes: int = 10
    calibration: CalibrationSettings = CalibrationSettings()
    mode_count: ModeCountSettings = ModeCountSettings()
    trust_region: TrustRegionSettings = TrustRegionSettings()
    guard: GuardSettings = GuardSettings()
    misfit: MisfitSettings = MisfitSettings()
    seeding: SeedingSettings = SeedingSettings()


class Parameters(Protocol):
    """The parameters of a `SwitchingSystemRegressor`, which says what they mean."""

    n_modes: int | str
    relaxation: str | Relaxation
    loss: str
    coef_bound: float | None
    sparsity: float | str | None
    surface: Classifier | None
    coupling: float | str
    init: str | ArrayLike
    known: object
    n_init: int | str
    max_modes: int
    max_iter: int
    tol: float
    solver: str
    discrete_time: bool
    n_jobs: int | None
    random_state: int | np.random.RandomState | None
    verbose: int
    settings: IdentificationSettings
