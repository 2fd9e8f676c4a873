"""The bench on which candidates are tried: rows, modes and weights of the current model."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from swsysid._data.records import Records
from swsysid._noise import exact_below, robust_weights
from swsysid._results import Array
from swsysid._search.folds import Folds
from swsysid._search.joint_fit import JointFit, corrected
from swsysid._search.regression import Regression
from swsysid._search.trials import Bench

__all__ = ["bench_of"]

_SURE = 0.95  # a row whose mode is less sure than this says nothing about the laws
_MOST_UNSURE = 0.4


def bench_of(
    fit: JointFit,
    records: Records,
    rows: NDArray[np.intp],
    targets: Array,
    folds: Folds,
    without: int | None = None,
    kept: dict | None = None,
) -> Bench:
    """Candidates are tried beside the library and the columns of the effects found so far.

    The columns of the term `without` are left out, as if it had not been found. `kept` holds
    columns that were computed before.
    """
    others = [term for place, term in enumerate(fit.terms) if place != without]
    whole, records = records, corrected(others, records)
    searched = records.take(rows)
    features = fit.features(searched)
    linear = _linear_features(features, searched)
    known = [
        term.design(
            term.effect.columns(records, term.place, *term.theta)[rows], fit.modes, fit.n_modes
        )
        for term in others
    ]
    regression = Regression(
        features=np.column_stack([features, *known]),
        targets=targets,
        modes=fit.modes,
        n_modes=int(fit.modes.max()) + 1,
        weight=_weight(fit, whole, rows, targets),
        folds=folds,
    )
    # a corrected record is gone after the bench, and so are its columns
    kept = kept if kept is not None and records is whole else {}
    taken = {(term.target, term.replaced) for term in others if term.replaced is not None}
    return Bench(records, rows, regression, linear, fit, kept, taken)


def _weight(fit: JointFit, records: Records, rows: NDArray[np.intp], targets: Array) -> Array:
    """Small for outliers, none where the mode is uncertain or the surface and the data differ."""
    modes = fit.predict_modes(records)
    modes[rows] = fit.modes
    weight = robust_weights(targets - fit.predict(records, modes)[rows], exact_below(targets))
    searched = records.take(rows)
    sure = fit.mode_proba(searched).max(axis=1) >= _SURE
    sure &= fit.estimator_modes(searched) == fit.modes
    return np.where(sure, weight, 0.0) if np.mean(~sure) <= _MOST_UNSURE else weight


def _linear_features(features: Array, records: Records) -> dict[int, int]:
    """Which feature is a multiple of which channel."""
    found: dict[int, int] = {}
    size = np.linalg.norm(features, axis=0)
    for channel in range(records.X.shape[1]):
        values = records.X[:, channel]
        norm = np.linalg.norm(values)
        cosine = np.abs(values @ features) / np.where(size * norm > 0, size * norm, np.inf)
        best = int(cosine.argmax())
        if cosine[best] > 1.0 - 1e-10:
            found[channel] = best
    return found
