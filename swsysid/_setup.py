"""What the regressor's parameters mean: checks, and the problem and search they describe."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import clone
from sklearn.utils.validation import validate_data

from swsysid._blocks.sampling import Sample
from swsysid._blocks.sources import RowBlocks, holds_blocks, row_blocks
from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._features import FeatureMap
from swsysid._identification import Search
from swsysid._losses import get_loss
from swsysid._problem import SwitchingProblem, offers_penalty
from swsysid._rows import CanonicalRows
from swsysid.relaxations import get_relaxation

__all__ = [
    "build_problem",
    "build_search",
    "checked_blocks",
    "check_parameters",
    "input_names",
    "trajectory_codes",
]


# Unit of the coupling where the margin is only known after the fit.
_USUAL_MARGIN = 1e-2


def check_parameters(estimator: Any) -> None:
    """Refuse parameters that make no sense, in one sentence each."""
    _check_count(estimator, "n_modes", allow="auto")
    _check_count(estimator, "n_init", allow="auto")
    _check_count(estimator, "max_modes")
    _check_count(estimator, "max_iter")
    _check_number(estimator, "tol", zero=True)
    _check_number(estimator, "coef_bound", allow=None)
    _check_number(estimator, "sparsity", allow=(None, "auto"), zero=True)
    _check_number(estimator, "coupling", allow="auto", zero=True)
    if not isinstance(estimator.solver, str):
        raise ValueError(
            f"solver={estimator.solver!r} must be 'auto' or the name of a solver, such as "
            "'clarabel'."
        )
    get_loss(estimator.loss)
    get_relaxation(estimator.relaxation)
    if isinstance(estimator.init, str) and estimator.init not in ("auto", "random"):
        raise ValueError(
            f"init={estimator.init!r} is unknown; choose 'auto', 'random', an array of labels "
            "(n_samples,) or of coefficients (n_modes, n_states, n_features_out)."
        )
    surface = estimator.surface
    if surface is not None and not (hasattr(surface, "fit") and hasattr(surface, "predict")):
        raise TypeError(f"surface={surface!r} is not a classifier; it must have fit and predict.")


def build_problem(estimator: Any, rows: CanonicalRows, feature_map: FeatureMap) -> SwitchingProblem:
    """The identification problem on the canonical rows."""
    X, targets, _ = rows.arrays
    surface = PolynomialSurfaceClassifier() if estimator.surface is None else estimator.surface
    if getattr(surface, "random_state", 0) is None:
        # Left to itself the search for mode-books would draw from numpy's global state.
        surface = clone(surface).set_params(random_state=0)
    relaxation = get_relaxation(estimator.relaxation)
    relaxation.loss, relaxation.solver = estimator.loss, estimator.solver
    return SwitchingProblem(
        features=feature_map(X),
        targets=targets,
        coordinates=X,
        weight=rows.weight,
        n_modes=estimator.n_modes,
        loss=get_loss(estimator.loss),
        relaxation=relaxation,
        surface=surface,
        coupling=_resolve_coupling(estimator.coupling, surface),
        scale=np.ones(targets.shape[1]),
        outlying=np.zeros(len(X), dtype=bool),
        coef_bound=estimator.coef_bound,
        solver=estimator.solver,
    )


def build_search(estimator: Any, rows: CanonicalRows, sample: Sample | None = None) -> Search:
    """How to look for the answer on the canonical rows, of all data or of a sample of them."""
    return Search(
        init=_resolve_init(estimator, rows, sample),
        n_init=None if estimator.n_init == "auto" else int(estimator.n_init),
        max_iter=estimator.max_iter,
        tol=estimator.tol,
        sparsity=estimator.sparsity,
        gate_degree=getattr(estimator.surface, "degree", 2),
        max_modes=estimator.max_modes,
        trajectory=rows.arrays[2],
        n_jobs=estimator.n_jobs,
        verbose=estimator.verbose,
    )


def checked_blocks(
    estimator: Any, X: Any, y: Any, sample_weight: Any, groups: Any
) -> tuple[RowBlocks, bool]:
    """The rows of the data, and whether `y` has one velocity without a column of its own.

    Rows in memory are checked at once, blocks when they are read.
    """
    if not holds_blocks(X):
        X, y = validate_data(estimator, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
        trajectory_codes(groups, len(X))
        y = np.asarray(y, dtype=float)
        groups = None if groups is None else np.asarray(groups)
        return row_blocks(X, y, sample_weight, groups), y.ndim == 1
    blocks = row_blocks(X, y, sample_weight, groups)
    first, target = (X, y) if hasattr(X, "shape") else (X[0], y[0])
    names = first[:1] if hasattr(first, "columns") else np.zeros((1, np.shape(first)[1]))
    validate_data(estimator, names)
    return blocks, len(np.shape(target)) == 1


def input_names(estimator: Any) -> list[str]:
    """Names of the columns of X, x0, x1, ... where they have none."""
    default = [f"x{column}" for column in range(estimator.n_features_in_)]
    return list(getattr(estimator, "feature_names_in_", default))


def trajectory_codes(groups: ArrayLike | None, n_samples: int) -> NDArray[np.intp]:
    """Trajectories numbered from 0; one trajectory if there are no groups."""
    if groups is None:
        return np.zeros(n_samples, dtype=np.intp)
    groups = np.asarray(groups)
    if groups.shape != (n_samples,):
        raise ValueError(
            f"groups has shape {groups.shape}; give one trajectory name for each of the "
            f"{n_samples} samples."
        )
    return np.unique(groups, return_inverse=True)[1]


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
    margin = getattr(surface, "margin", "auto")
    return _USUAL_MARGIN if isinstance(margin, str) else margin


def _resolve_init(estimator: Any, rows: CanonicalRows, sample: Sample | None) -> Any:
    """The start as a name, coefficients, or labels of the canonical rows."""
    if isinstance(estimator.init, str):
        return estimator.init
    init = np.asarray(estimator.init)
    if estimator.n_modes == "auto":
        raise ValueError("An array for init fixes the number of modes; give n_modes as a number.")
    if init.ndim == 3:
        return init.astype(float)
    n_samples, n_modes = len(rows.inverse) if sample is None else sample.n_rows, estimator.n_modes
    if init.shape != (n_samples,) or not np.isin(init, np.arange(n_modes)).all():
        raise ValueError(
            f"init has shape {init.shape}; give 'auto', 'random', labels 0..{n_modes - 1} of "
            f"shape ({n_samples},) or coefficients of shape (n_modes, n_states, n_features_out)."
        )
    labels = np.empty(len(rows.weight), dtype=np.intp)
    kept = rows.inverse >= 0
    labels[rows.inverse[kept]] = (init if sample is None else init[sample.place])[kept]
    return labels


def _check_count(estimator: Any, name: str, allow: Any = ()) -> None:
    value = getattr(estimator, name)
    if isinstance(value, str) and value == allow:
        return
    if not isinstance(value, Integral) or isinstance(value, bool) or value < 1:
        also = f" or {allow!r}" if allow else ""
        raise ValueError(f"{name}={value!r} must be a positive integer{also}.")


def _check_number(estimator: Any, name: str, allow: Any = (), zero: bool = False) -> None:
    value = getattr(estimator, name)
    allowed = allow if isinstance(allow, tuple) else (allow,)
    if value is None or isinstance(value, str):
        if value in allowed:
            return
    elif isinstance(value, Real) and not isinstance(value, bool):
        number = float(value)
        if np.isfinite(number) and (number > 0 or (zero and number == 0)):
            return
    also = "".join(f" or {choice!r}" for choice in allowed)
    sign = "non-negative" if zero else "positive"
    raise ValueError(f"{name}={value!r} must be a {sign} number{also}.")
