"""The laws of modes, C_j Phi(x), as text."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

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
    lines = []
    for mode in range(len(coef)):
        where = rf"\text{{mode }} {mode}: \; " if style == "latex" else f"mode {mode}: "
        laws = laws_of_mode(
            coef, mode, feature_map, precision, style,
            discrete_time=discrete_time, states=states, columns=columns, added=added,
        )  # fmt: skip
        lines += [where + law for law in laws]
    return lines


def laws_of_mode(
    coef: Array,
    mode: int,
    feature_map: FeatureMap,
    precision: int,
    style: str,
    *,
    discrete_time: bool,
    states: Sequence[str],
    columns: Sequence[str] | None = None,
    added: AddedTerms | None = None,
    brief: bool = False,
) -> list[str]:
    """One equation for every state in a mode; arguments as `law_equations` takes them."""
    columns = feature_map.names_in if columns is None else columns
    rows, features, feature_sizes = feature_map.printed(coef[mode], columns)
    lines = []
    for state, row in enumerate(rows.tolist()):
        own = zip(row, features, feature_sizes, strict=True)
        values, names, sizes = merged([*own, *(added(mode, state) if added else ())])
        law = linear_combination(
            values, names, precision=precision, style=style, sizes=sizes, brief=brief
        )
        name = states[state] if state < len(states) else f"y{state}"
        left = f"{symbol(name, style)}[k+1]" if discrete_time else rate(name, style)
        lines.append(f"{left} = {law}")
    return lines
