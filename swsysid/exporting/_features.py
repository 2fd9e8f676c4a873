"""What libraries of features make of columns, as formulas."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import FeatureUnion, Pipeline

from swsysid._data.plans import powers_of
from swsysid._results import Array
from swsysid.exporting._expressions import Expression, NoFormulaError, number, operation, traced


@runtime_checkable
class FunctionTerms(Protocol):
    """A library whose features are functions of columns, by name."""

    @property
    def terms(self) -> Sequence[tuple[Callable, str, Sequence[int]]]:
        """Each function, its name, and the columns that it takes."""


def columns_of(n_states: int, n_inputs: int) -> list[Expression]:
    """Leaves for states, then inputs."""
    states = [Expression("x", (place,)) for place in range(n_states)]
    return states + [Expression("u", (place,)) for place in range(n_inputs)]


def features_of(library: object, columns: Sequence[Expression]) -> list[Expression]:
    """The features of a library that has been fitted; refused if they are no formulas."""
    powers = powers_of(library, len(columns))
    if powers is not None:
        return monomials(powers, columns)
    if isinstance(library, FunctionTerms):
        return [
            traced(function, [columns[place] for place in group], f"the feature {name}")
            for function, name, group in library.terms
        ]
    if isinstance(library, FeatureUnion) and not library.transformer_weights:
        parts = [features_of(part, columns) for _, part in library.transformer_list]
        return [one for part in parts for one in part]
    if isinstance(library, Pipeline):
        made = list(columns)
        for _, step in library.steps:
            made = features_of(step, made)
        return made
    if isinstance(library, ColumnTransformer) and library.remainder == "drop":
        return _of_columns(library, columns)
    raise NoFormulaError(
        f"the features of {type(library).__name__} cannot be written as formulas; use a degree, a "
        "FunctionLibrary, or a FeatureUnion, a Pipeline or a ColumnTransformer of these."
    )


def _of_columns(library: ColumnTransformer, columns: Sequence[Expression]) -> list[Expression]:
    """Features of some columns each, the columns themselves where nothing is made of them."""
    made: list[Expression] = []
    for name, own, places in library.transformers:
        chosen = [columns[place] for place in np.arange(len(columns))[places].tolist()]
        passed = own == "passthrough"
        made += chosen if passed else features_of(library.named_transformers_[name], chosen)
    return made


def monomials(powers: NDArray[np.intp], columns: Sequence[Expression]) -> list[Expression]:
    """Products of powers of columns, a row of exponents each."""
    return [
        operation(
            "mul",
            1.0,
            *(columns[place] ** int(row[place]) for place in np.flatnonzero(row).tolist()),
        )
        for row in np.asarray(powers)
    ]


def combination(coef: Array, terms: Sequence[Expression]) -> Expression:
    """A sum of terms with coefficients, those of zero left out."""
    kept = [number(value) * term for value, term in zip(coef.tolist(), terms, strict=True) if value]
    return operation("add", 0.0, *kept)
