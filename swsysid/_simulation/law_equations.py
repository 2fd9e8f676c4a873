"""The laws of modes, C_j Phi(x), as text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import product

from swsysid._data.features import FeatureMap
from swsysid._rendering.printing import check_format, linear_combination, merged, rate, symbol
from swsysid._results import Array

AddedTerms = Callable[[int, int], Iterable[tuple[float, str, float]]]


def law_equations(
    coef: Array,
    feature_map: FeatureMap,
    precision: int,
    style: str,
    *,
    discrete_time: bool,
    states: Sequence[str],
    columns: Sequence[str] | None = None,
    added: AddedTerms | None = None,
) -> list[str]:
    """One equation for every mode and state.

    `states` and `columns` name the states and what the features are made of, the latter by default
    as in the fit; ``added(mode, state)`` lists further terms: coefficient, name, size on the data.
    """
    check_format(style, precision)
    features = feature_map.names(feature_map.names_in if columns is None else columns)
    lines = []
    for mode, state in product(range(coef.shape[0]), range(coef.shape[1])):
        row = coef[mode, state].tolist()
        own = zip(row, features, feature_map.sizes, strict=True)
        values, names, sizes = merged([*own, *(added(mode, state) if added else ())])
        law = linear_combination(values, names, precision=precision, style=style, sizes=sizes)
        name = states[state] if state < len(states) else f"y{state}"
        left = f"{symbol(name, style)}[k+1]" if discrete_time else rate(name, style)
        lines.append(f"{mode_name(mode, style)}{left} = {law}")
    return lines


def mode_name(mode: int, style: str) -> str:
    """What stands before the law of a mode."""
    return rf"\text{{mode }} {mode}: \; " if style == "latex" else f"mode {mode}: "
