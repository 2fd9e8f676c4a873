"""What the regressor's parameters mean: checks, and the problem and search they describe."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import clone
from sklearn.utils.validation import validate_data

from swsysid._checks.arrays import labels, numbers
from swsysid._checks.estimators import rows_to_fit
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
from swsysid._data.rows import CanonicalRows
from swsysid._data.sampling import Sample
from swsysid._data.sources import holds_blocks, row_blocks
from swsysid._identification.problem import SwitchingProblem
from swsysid._identification.rows import TrainingRows
from swsysid._identification.settings import IdentificationSettings
from swsysid._identification.starts import Search
from swsysid._losses import get_loss
from swsysid._surfaces.surface import Classifier, is_classifier, offers_penalty, option
from swsysid.relaxations import Relaxation, get_relaxation

__all__ = [
    "build_problem",
    "build_search",
    "check_parameters",
    "checked_rows",
    "Parameters",
]


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


# Unit of the coupling where the margin is only known after the fit.
_USUAL_MARGIN = 1e-2


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


def build_problem(
    estimator: Parameters, rows: CanonicalRows, feature_map: FeatureMap
) -> SwitchingProblem:
    """The identification problem on the canonical rows."""
    X, targets, _ = rows.arrays
    n_modes = 1 if estimator.n_modes == "auto" else int(estimator.n_modes)
    whole("n_modes", min(n_modes, len(X)), most=MOST_MODES)  # modes beyond the rows are dropped
    surface = PolynomialSurfaceClassifier() if estimator.surface is None else estimator.surface
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
        solver=estimator.solver,
        settings=estimator.settings,
    )


def build_search(
    estimator: Parameters, rows: CanonicalRows, sample: Sample | None = None
) -> Search:
    """How to look for the answer on the canonical rows, of all data or of a sample of them."""
    return Search(
        init=_resolve_init(estimator, rows, sample),
        n_init=None if estimator.n_init == "auto" else int(estimator.n_init),
        max_iter=estimator.max_iter,
        tol=estimator.tol,
        sparsity=estimator.sparsity,
        gate_degree=option(estimator.surface, "degree", 2),
        chooses_n_modes=estimator.n_modes == "auto",
        max_modes=estimator.max_modes,
        trajectory=rows.arrays[2],
        n_jobs=estimator.n_jobs,
        verbose=estimator.verbose,
    )


def checked_rows(
    estimator: Parameters,
    X: Any,
    y: Any,
    sample_weight: Any,
    groups: Any,
    settings: IdentificationSettings,
) -> tuple[TrainingRows, bool]:
    """The rows of a fit, and whether `y` has one velocity without a column of its own.

    Rows in memory are checked at once, blocks when they are read.
    """
    if not holds_blocks(X):
        X, y = rows_to_fit(estimator, X, y)
        groups = None if groups is None else labels("groups", groups, len(X))
        blocks = row_blocks(X, y, sample_weight, groups)
        return TrainingRows.of(blocks, settings), y.ndim == 1
    blocks = row_blocks(X, y, sample_weight, groups)
    first, target = (X, y) if hasattr(X, "shape") else (X[0], y[0])
    names = first[:1] if hasattr(first, "columns") else np.zeros((1, np.shape(first)[1]))
    one_target = len(np.shape(target)) == 1
    del first, target  # they may be blocks, of which one at a time is in memory
    validate_data(estimator, names)
    return TrainingRows.of(blocks, settings), one_target


def _resolve_coupling(coupling: float | str, surface: Any) -> float:
    """The coupling as a number; ``"auto"`` is one nat for each margin of violation."""
    if coupling == "auto":
        return 1.0 / _margin(surface) if offers_penalty(surface) else 0.0
    if coupling and not offers_penalty(surface):
        raise ValueError(
            f"coupling={coupling} needs a surface with mode_penalty, which "
            f"{type(surface).__name__} lacks; use coupling=0 or PolynomialSurfaceClassifier."
        )
    return float(coupling)


def _margin(surface: Any) -> float:
    margin = option(surface, "margin", "auto")
    return _USUAL_MARGIN if isinstance(margin, str) else margin


def _resolve_init(estimator: Parameters, rows: CanonicalRows, sample: Sample | None) -> Any:
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
