"""What the regressor's parameters mean: checks, and the rows, problem and search they describe.

Descents begin with memberships that are given, random, or of seeds.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from sklearn.base import clone
from sklearn.utils.validation import validate_data

from swsysid._checks.arrays import labels, numbers
from swsysid._checks.estimators import rows_and_velocities
from swsysid._checks.parameters import (
    MOST_MODES,
    MOST_STARTS,
    flag,
    jobs,
    one_of,
    random_numbers,
    real,
    shown,
    solver_name,
    verbosity,
    whole,
)
from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._data.features import FeatureMap
from swsysid._data.rows import CanonicalRows, canonical_rows, common_factor
from swsysid._data.sampling import Sample, draw_sample
from swsysid._data.sources import (
    Reweighted,
    RowBlocks,
    Rows,
    columns_of_blocks,
    holds_blocks,
    row_blocks,
)
from swsysid._data.trajectories import group_labels
from swsysid._identification.problem import Modes, SwitchingProblem
from swsysid._identification.settings import Parameters
from swsysid._identification.within import KnownGuard, KnownLaws
from swsysid._known.known import Known, check_known, refuse_energies
from swsysid._losses import get_loss
from swsysid._results import Array
from swsysid._seeding.search import same_partition
from swsysid._seeding.seeding import Seed, seed_modes
from swsysid._surfaces.surface import Classifier, is_classifier, offers_penalty, option
from swsysid.relaxations import get_relaxation
from swsysid.relaxations._base import one_hot

# Unit of the coupling where the margin is only known after the fit.
_USUAL_MARGIN = 1e-2


@dataclass(frozen=True)
class TrainingRows:
    """All rows of a fit, and those of them that are in memory."""

    blocks: RowBlocks  # all rows, as they were given
    sample: Sample  # all of them if they are not too many, else some

    @property
    def in_memory(self) -> Rows:
        """The rows in memory, in their own order."""
        return self.sample.rows

    @cached_property
    def distinct(self) -> CanonicalRows:
        """X, velocities and trajectory of the rows in memory, sorted, repetitions merged."""
        rows = self.in_memory
        _, codes = np.unique(group_labels(rows.groups, len(rows)), return_inverse=True)
        return canonical_rows(rows.X, rows.targets, codes, sample_weight=rows.weight)

    def without_factor(self) -> TrainingRows:
        """The same rows without a common factor of their weights."""
        factor = common_factor(self.distinct.weight)
        if factor == 1.0:
            return self
        rows = replace(self.in_memory, weight=self.in_memory.weight / factor)
        return TrainingRows(Reweighted(self.blocks, factor), replace(self.sample, rows=rows))


def check_parameters(estimator: Parameters) -> None:
    """Refuse parameters that make no sense, in one sentence each."""
    whole("n_modes", estimator.n_modes, also=("auto",))
    whole("n_init", estimator.n_init, most=MOST_STARTS, also=("auto",))
    whole("max_modes", estimator.max_modes, most=MOST_MODES)
    whole("max_iter", estimator.max_iter)
    real("tol", estimator.tol, least=0)
    real("coef_bound", estimator.coef_bound, above=0, also=(None,))
    real("sparsity", estimator.sparsity, least=0, also=(None, "auto"))
    real("coupling", estimator.coupling, least=0, also=("auto",))
    solver_name(estimator.solver)
    flag("discrete_time", estimator.discrete_time)
    verbosity(estimator.verbose)
    jobs(estimator.n_jobs)
    random_numbers(estimator.random_state)
    get_loss(estimator.loss)
    get_relaxation(estimator.relaxation)
    if isinstance(estimator.init, str):
        one_of("init", estimator.init, ("auto", "random"))
    if estimator.surface is not None and not is_classifier(estimator.surface):
        raise TypeError(
            f"surface={shown(estimator.surface)} is not a classifier; it must have fit and predict."
        )


def checked_rows(
    estimator: Parameters, X: object, y: object, sample_weight: object, groups: object
) -> tuple[TrainingRows, bool]:
    """The rows of a fit, and whether `y` has one velocity without a column of its own."""
    settings = estimator.settings
    # Rows in memory are checked at once, blocks when they are read.
    if not holds_blocks(X):
        X, y = rows_and_velocities(estimator, X, y, reset=True)
        groups = None if groups is None else labels("groups", groups, len(X))
        blocks, one_target = row_blocks(X, y, sample_weight, groups), y.ndim == 1
    else:
        read_at_once = settings.read_at_once
        blocks = row_blocks(X, y, sample_weight, groups, read_at_once=read_at_once)
        names, one_target = columns_of_blocks(X, y)
        validate_data(estimator, names)
    sample = draw_sample(blocks, settings.sampled, settings.whole)
    return TrainingRows(blocks, sample).without_factor(), one_target


def build_problem(
    estimator: Parameters, rows: CanonicalRows, feature_map: FeatureMap
) -> SwitchingProblem:
    """The identification problem on the canonical rows."""
    X, targets, _ = rows.arrays
    n_modes = 1 if estimator.n_modes == "auto" else int(estimator.n_modes)
    whole("n_modes", min(n_modes, len(X)), most=MOST_MODES)  # modes beyond the rows are dropped
    known = check_known(estimator.known)
    surface = PolynomialSurfaceClassifier() if estimator.surface is None else estimator.surface
    if known is not None and (guard := known.of_guard()) is not None:
        names = known.columns or feature_map.names_in
        surface = KnownGuard.of(guard, estimator, names).within
    if option(surface, "random_state", 0) is None:
        # Left to itself the search for mode-books would draw from numpy's global state.
        surface = clone(surface).set_params(random_state=0)
    relaxation = get_relaxation(estimator.relaxation)
    relaxation.loss, relaxation.solver = estimator.loss, estimator.solver
    return SwitchingProblem(
        features=feature_map(X),
        targets=targets,
        coordinates=X,
        weight=rows.weight,
        n_modes=n_modes,
        loss=get_loss(estimator.loss),
        relaxation=relaxation,
        surface=surface,
        coupling=_resolve_coupling(estimator.coupling, surface),
        scale=np.ones(targets.shape[1]),
        outlying=np.zeros(len(X), dtype=bool),
        coef_bound=estimator.coef_bound,
        known=_known_laws(estimator, known, feature_map, targets.shape[1]),
        solver=estimator.solver,
        settings=estimator.settings,
    )


def _known_laws(
    estimator: Parameters, given: Known | None, feature_map: FeatureMap, n_states: int
) -> KnownLaws | None:
    if (laws := KnownLaws.of(given, feature_map, n_states)) is None:
        return None
    if estimator.coef_bound is not None:
        raise ValueError("known and coef_bound exclude each other; bound coefficients in known.")
    if estimator.discrete_time:
        refuse_energies(laws.known)
    region = laws.region(2 if estimator.n_modes == "auto" else int(estimator.n_modes))
    if region.is_of_one_law:
        raise ValueError(
            f"known={shown(str(laws.known))} leaves modes nothing to differ in; ask for n_modes=1, "
            "or leave something free."
        )
    return laws


def build_search(
    estimator: Parameters, rows: CanonicalRows, sample: Sample | None = None
) -> Search:
    """How to look for the answer on the canonical rows, of all data or of a sample of them."""
    return Search(estimator, _resolve_init(estimator, rows, sample), rows.arrays[2])


def _resolve_coupling(coupling: float | str, surface: Classifier) -> float:
    """The coupling as a number; ``"auto"`` is one nat for each margin of violation."""
    if coupling == "auto":
        margin = option(surface, "margin", _USUAL_MARGIN)
        unit = _USUAL_MARGIN if isinstance(margin, str) else margin
        return 1.0 / unit if offers_penalty(surface) else 0.0
    if coupling and not offers_penalty(surface):
        raise ValueError(
            f"coupling={coupling} needs a surface with mode_penalty, which "
            f"{type(surface).__name__} lacks; use coupling=0 or PolynomialSurfaceClassifier."
        )
    return float(coupling)


def _resolve_init(
    estimator: Parameters, rows: CanonicalRows, sample: Sample | None
) -> str | NDArray:
    """The start as a name, coefficients, or labels of the canonical rows."""
    if isinstance(estimator.init, str):
        return estimator.init
    init = numbers("init", estimator.init)
    if estimator.n_modes == "auto":
        raise ValueError("An array for init fixes the number of modes; give n_modes as a number.")
    if init.ndim == 3:
        return init
    n_modes = int(estimator.n_modes)
    n_samples = len(rows.inverse) if sample is None else sample.n_rows
    if init.shape != (n_samples,) or not np.isin(init, np.arange(n_modes)).all():
        raise ValueError(
            f"init has shape {init.shape}; give 'auto', 'random', labels 0..{n_modes - 1} of "
            f"shape ({n_samples},) or coefficients of shape (n_modes, n_states, n_features_out)."
        )
    labels = np.empty(len(rows.weight), dtype=np.intp)
    kept = rows.inverse >= 0
    labels[rows.inverse[kept]] = (init if sample is None else init[sample.place])[kept]
    return labels


@dataclass(frozen=True)
class Search:
    """How to look for the answer on some rows: the regressor's parameters, and what they mean."""

    parameters: Parameters
    init: str | NDArray  # ``"auto"``, ``"random"``, labels of these rows or coefficients
    trajectory: Modes  # of every row, kept whole where rows are held out

    @property
    def gate_degree(self) -> int:
        """Degree of the gate: that of the surface."""
        return whole("degree", option(self.parameters.surface, "degree", 2), least=0)


@dataclass(frozen=True)
class Starts:
    """Memberships to start from, the most promising first, and what is known of them."""

    memberships: list[Array]  # each (n_samples, n_modes)
    # How often each was found; most starts of the seeding are thrown out early and count for none.
    hits: list[int]
    n_drawn: int
    suspected: NDArray[np.bool_]  # (n_samples,): samples that the best start takes for outliers
    log_likelihood_gap: float = np.inf  # as in `Identification`


def draw_starts(problem: SwitchingProblem, search: Search, random_state) -> Starts:
    """The starts that `search.init` asks for."""
    no_outliers = np.zeros(len(problem.targets), dtype=bool)
    if isinstance(search.init, np.ndarray):
        return Starts([_given_start(problem, search.init)], [1], 1, no_outliers)
    if problem.n_modes == 1:
        return Starts([np.ones((len(problem.targets), 1))], [1], 1, no_outliers)
    n_init = search.parameters.n_init
    if search.init == "random":
        n_starts = problem.settings.random_starts if n_init == "auto" else int(n_init)
        starts = [
            one_hot(_random_cells(problem, random_state), problem.n_modes) for _ in range(n_starts)
        ]
        return Starts(starts, [1] * len(starts), len(starts), no_outliers)
    seeds = seed_modes(
        problem.features,
        problem.targets,
        problem.coordinates,
        n_modes=problem.n_modes,
        gate_degree=search.gate_degree,
        sample_weight=problem.weight,
        n_starts=n_init,
        random_state=random_state,
        settings=problem.settings.seeding,
    )
    return Starts(
        [one_hot(seed.labels, problem.n_modes) for seed in seeds],
        [max(seed.hits, 1) for seed in seeds],
        seeds[0].n_starts,
        seeds[0].inlier < 0.5,
        _log_likelihood_gap(seeds, problem.weight, problem.settings.different),
    )


def _log_likelihood_gap(seeds: list[Seed], weight: Array, different: float) -> float:
    """How far the likelihood of the next really different partition is behind, in nats."""
    first = seeds[0]
    return min(
        (
            first.log_likelihood - seed.log_likelihood
            for seed in seeds[1:]
            if not same_partition(first.labels, seed.labels, weight, different)
        ),
        default=np.inf,
    )


def _given_start(problem: SwitchingProblem, init: Array) -> Array:
    if init.ndim == 1:
        return one_hot(init, problem.n_modes)
    expected = (problem.n_modes, problem.targets.shape[1], problem.features.shape[1])
    if init.shape != expected:
        raise ValueError(
            f"init has shape {init.shape}; coefficients to start from must have the shape "
            f"(n_modes, n_states, n_features_out) = {expected}."
        )
    return replace(problem, coupling=0.0).assign(init).membership


def _random_cells(problem: SwitchingProblem, random_state) -> Modes:
    """Cells of the samples nearest to random ones, in standardised coordinates."""
    probability = problem.weight / problem.weight.sum()
    spread = problem.coordinates.std(axis=0)
    points = problem.coordinates / np.where(spread > 0, spread, 1.0)
    centres = points[random_state.choice(len(points), problem.n_modes, p=probability)]
    return np.square(points[:, None, :] - centres).sum(axis=2).argmin(axis=1)
