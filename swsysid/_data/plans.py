"""What the steps of a feature library do to rows, as plain functions of arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np
from sklearn import config_context
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import FeatureUnion, Pipeline
from sklearn.preprocessing import PolynomialFeatures

from swsysid._data.coordinates import Monomials
from swsysid._data.function_library import FunctionLibrary

Features = Callable[[np.ndarray], np.ndarray]


def arrays():
    """Steps of a library hand arrays on, also where scikit-learn is set to make data frames.

    Those name their columns x0, x1, ..., and a later step then refuses the names of the user.
    """
    return config_context(transform_output="default")


def powers_of(library, n_columns: int) -> np.ndarray | None:
    """Exponents of the columns, if monomials of them, or of some, are what a library makes."""
    kind = type(library)
    if kind is Pipeline:
        chosen: np.ndarray | None = np.arange(n_columns)
        for step in library[:-1]:
            chosen = None if chosen is None else _passed(step, chosen)
        powers = None if chosen is None else powers_of(library[-1], len(chosen))
        if chosen is None or powers is None:
            return None
        of_all = np.zeros((len(powers), n_columns), dtype=powers.dtype)
        np.add.at(of_all.T, chosen, powers.T)
        return of_all
    known = kind is PolynomialFeatures or (
        kind.__name__ == "PolynomialLibrary" and kind.__module__.startswith("pysindy.")
    )
    return library.powers_ if known else None


def plan(library, n_columns: int) -> Features | None:
    """What known steps do to rows of so many columns; None of others.

    The checks of a union or a pipeline take twenty times as long as their work on a few hundred
    rows, and rollouts ask for such a few at a time.
    """
    if isinstance(library, FunctionLibrary):
        return library.at_rows
    if type(library) is Pipeline:
        return _in_a_row(library, n_columns)
    powers = powers_of(library, n_columns)
    if powers is not None:
        return Monomials(powers)
    if type(library) is FeatureUnion and not library.transformer_weights:
        return _side_by_side([plan(part, n_columns) for _, part in library.transformer_list])
    if type(library) is ColumnTransformer and library.remainder == "drop":
        fitted = library.named_transformers_
        return _side_by_side(
            [
                _of_columns(np.asarray(columns), one if one == "passthrough" else fitted[name])
                for name, one, columns in library.transformers
            ]
        )
    return None


def _in_a_row(steps, n_columns: int) -> Features | None:
    """One step after the other."""
    plans: list[Features] = []
    for step in steps:
        own = plan(step, n_columns)
        if own is None:
            return None
        plans.append(own)
        n_columns = own(np.ones((1, n_columns))).shape[1]
    return lambda X: reduce(lambda made, own: own(made), plans, X)


def _side_by_side(plans: Sequence[Features | None]) -> Features | None:
    """The columns of one after those of another."""
    known = [own for own in plans if own is not None]
    return (lambda X: np.hstack([own(X) for own in known])) if len(known) == len(plans) else None


def _of_columns(columns: np.ndarray, step) -> Features | None:
    """What a step makes of some columns; None of those that have names, or are a mask."""
    if columns.ndim != 1 or columns.dtype.kind != "i":
        return None
    if step == "passthrough":
        return lambda X: X[:, columns]
    own = plan(step, len(columns))
    return None if own is None else lambda X: own(X[:, columns])


def _passed(step, columns: np.ndarray) -> np.ndarray | None:
    """Those of some columns that a step lets pass, None if it does anything else."""
    does = {step}
    if type(step) is ColumnTransformer:
        does = {step.remainder, *(one for _, one, _ in step.transformers)}
    if not does <= {"drop", "passthrough"}:
        return None
    with arrays():
        passed = columns if step == "passthrough" else step.transform(columns[None, :])[0]
        return np.asarray(passed, dtype=columns.dtype)
