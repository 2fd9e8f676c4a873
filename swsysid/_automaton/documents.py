"""An automaton as a dict of numbers and names, for JSON, and back without running any code."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.compose import ColumnTransformer
from sklearn.pipeline import FeatureUnion, Pipeline
from sklearn.preprocessing import PolynomialFeatures

from swsysid._automaton.parts import AutomatonParts, FirstModes
from swsysid._automaton.polynomial_text import MOST_TERMS
from swsysid._automaton.transitions import (
    AffineReset,
    Guard,
    PolynomialGuard,
    Transition,
    guard_of,
)
from swsysid._checks.arrays import numbers
from swsysid._checks.parameters import flag, names_of_columns, real, whole
from swsysid._data.features import FeatureMap, FunctionLibrary, check_degree
from swsysid._results import Array

FORMAT, VERSION = "swsysid automaton", 1  # raised where an older version could not read it
Told = Mapping[str, object]


# coef, feature_map, transitions, discrete_time, lags, first_modes
Parts = tuple[Array, FeatureMap, tuple[Transition, ...], bool, int, FirstModes | None]


def document_of(automaton: AutomatonParts) -> dict[str, object]:
    """The parts in types that JSON knows."""
    features, first = automaton.feature_map, automaton.first_modes
    return {
        "format": FORMAT,
        "format_version": VERSION,
        "columns": list(features.names_in),
        "features": _written_library(features.library),
        "feature_sizes": features.sizes.tolist(),
        "discrete_time": bool(automaton.discrete_time),
        "lags": int(automaton.lags),
        "laws": automaton.coef.tolist(),
        "transitions": [_written_transition(one) for one in automaton.transitions],
        "first_modes": first and {"states": first.states.tolist(), "modes": first.modes.tolist()},
    }


def parts_of(told: object) -> Parts:
    """The parts that a document tells; anything else is refused in one sentence."""
    if not isinstance(told, Mapping) or told.get("format") != FORMAT:
        raise ValueError("this is no automaton of swsysid; give what to_dict returned.")
    written = told.get("format_version")
    if type(written) is not int or written > VERSION:
        raise ValueError(
            f"this automaton is in format {written} and this version of swsysid reads formats up "
            f"to {VERSION}; update swsysid."
        )
    try:
        return _read(told)
    except (ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError) as error:
        what = f"it lacks {error}" if isinstance(error, KeyError) else str(error).rstrip(".")
        raise ValueError(
            f"this automaton is damaged ({what}); give what to_dict returned."
        ) from None


def _read(told: Told) -> Parts:
    columns = names_of_columns("columns", told["columns"])
    library = _read_library(_mapping(told["features"]), len(columns))
    features = FeatureMap(library, np.ones((1, len(columns))), columns)
    features.sizes = _array("feature_sizes", told["feature_sizes"], (features.n_features_out,))
    first = told["first_modes"]
    return (
        _array("laws", told["laws"], (None, None, features.n_features_out)),
        features,
        tuple(_read_transition(one) for one in _listed(told["transitions"])),
        flag("discrete_time", told["discrete_time"]),
        whole("lags", told["lags"], least=0),
        None if first is None else _read_first_modes(_mapping(first)),
    )


# -- libraries of features -------------------------------------------------------------------------


def _written_library(library: object) -> dict[str, object]:
    """What makes a library again: a degree, names of functions of NumPy, or several of these."""
    if isinstance(library, PolynomialFeatures) and not library.interaction_only:
        if library.degree == int(library.degree):
            return {"degree": int(library.degree), "constant": bool(library.include_bias)}
    if isinstance(library, FunctionLibrary):
        known = [_name_in_numpy(function) for function in library.functions]
        if None not in known:
            return {"functions": known, "names": library.names and list(library.names)}
    if isinstance(library, FeatureUnion) and library.transformer_weights is None:
        parts = {name: _written_library(part) for name, part in library.transformer_list}
        return {"together": parts, "prefixes": bool(library.verbose_feature_names_out)}
    if isinstance(library, Pipeline):
        return {"in_turn": {name: _written_library(part) for name, part in library.steps}}
    if isinstance(library, ColumnTransformer) and _is_by_number(library):
        columns = {name: _written_columns(*part) for name, *part in library.transformers}
        return {"by_columns": columns, "prefixes": bool(library.verbose_feature_names_out)}
    raise TypeError(
        f"the features of {type(library).__name__} cannot be written without code; use a degree, a "
        "FunctionLibrary of functions of NumPy or a FeatureUnion, a Pipeline or a "
        "ColumnTransformer of these, or save the model with joblib."
    )


def _is_by_number(library: ColumnTransformer) -> bool:
    """Whether it takes columns by their numbers, and no others."""
    numbered = all(
        isinstance(columns, (list, tuple)) and all(isinstance(one, int) for one in columns)
        for _, _, columns in library.transformers
    )
    return bool(numbered and library.remainder == "drop" and not library.transformer_weights)


def _written_columns(library: object, columns: Sequence[int]) -> dict[str, object]:
    """Features of some columns, these themselves where nothing is made of them."""
    own = None if library == "passthrough" else _written_library(library)
    return {"features": own, "columns": [int(column) for column in columns]}


def _read_columns(told: Told, n_columns: int) -> tuple[BaseEstimator | str, list[int]]:
    own = told["features"]
    library = "passthrough" if own is None else _read_library(_mapping(own), n_columns)
    return library, [whole("columns", one, least=0) for one in _listed(told["columns"])]


def _name_in_numpy(function: object) -> str | None:
    """The name of a universal function of NumPy."""
    name = str(function.__name__) if isinstance(function, np.ufunc) else ""
    return name if name and vars(np).get(name) is function else None


def _read_library(told: Told, n_columns: int) -> BaseEstimator:
    if "together" in told:
        parts = _mapping(told["together"])
        steps = [(name, _read_library(_mapping(part), n_columns)) for name, part in parts.items()]
        prefixes = flag("prefixes", told["prefixes"])
        return FeatureUnion(steps, verbose_feature_names_out=prefixes)
    if "in_turn" in told:
        turns = _mapping(told["in_turn"])
        return Pipeline([(n, _read_library(_mapping(one), n_columns)) for n, one in turns.items()])
    if "by_columns" in told:
        prefixes = flag("prefixes", told["prefixes"])
        each = [
            (name, *_read_columns(_mapping(one), n_columns))
            for name, one in _mapping(told["by_columns"]).items()
        ]
        return ColumnTransformer(each, verbose_feature_names_out=prefixes)
    if "degree" in told:
        degree = whole("degree", told["degree"], least=0)
        check_degree("degree", degree, n_columns)
        return PolynomialFeatures(degree, include_bias=flag("constant", told["constant"]))
    named = [vars(np).get(str(name)) for name in _listed(told["functions"])]
    functions = [function for function in named if isinstance(function, np.ufunc)]
    if len(functions) < len(named):
        raise ValueError(f"the functions {told['functions']} are not all of NumPy")
    names = told["names"]
    return FunctionLibrary(functions, None if names is None else names_of_columns("names", names))


# -- transitions -----------------------------------------------------------------------------------


def _written_transition(one: Transition) -> dict[str, object]:
    reset = one.reset
    return {
        "source": int(one.source),
        "target": int(one.target),
        "guard": _written_guard(one.guard),
        "reset": reset and {"matrix": reset.matrix.tolist(), "offset": reset.offset.tolist()},
        "support": int(one.support),
        **({} if one.asked_every is None else {"asked_every": float(one.asked_every)}),
    }


def _written_guard(guard: Guard) -> dict[str, object]:
    """A polynomial, or the polynomials that must all hold."""
    written = [
        {"coef": one.coef.tolist(), "powers": one.powers.tolist()} for one in guard.conditions
    ]
    return written[0] if len(written) == 1 else {"all": written}


def _read_guard(told: Told) -> Guard:
    parts = _listed(told["all"]) if "all" in told else [told]
    read = [
        PolynomialGuard(
            _array("coef", part["coef"], (None,)), _whole_numbers("powers", part["powers"])
        )
        for part in map(_mapping, parts)
    ]
    return guard_of(read)


def _read_transition(entry: object) -> Transition:
    told = _mapping(entry)
    return Transition(
        whole("source", told["source"], least=0),
        whole("target", told["target"], least=0),
        _read_guard(_mapping(told["guard"])),
        None if told["reset"] is None else _read_reset(_mapping(told["reset"])),
        whole("support", told["support"], least=0),
        real("asked_every", told["asked_every"], above=0.0) if "asked_every" in told else None,
    )


def _read_reset(told: Told) -> AffineReset:
    matrix = _array("matrix", told["matrix"], (None, None))
    return AffineReset(matrix, _array("offset", told["offset"], (None,)))


def _read_first_modes(told: Told) -> FirstModes:
    states = _array("states", told["states"], (None, None))
    modes = _whole_numbers("modes", told["modes"])
    if modes.shape != (len(states),):
        raise ValueError("first_modes has not one mode for each state")
    return FirstModes(states, modes)


# -- values ----------------------------------------------------------------------------------------


def _array(name: str, told: object, shape: tuple[int | None, ...]) -> Array:
    """Finite numbers of a shape, of any length where it says None."""
    values = numbers(name, told)
    as_wanted = len(values.shape) == len(shape) and all(
        wanted in (None, length) for wanted, length in zip(shape, values.shape, strict=True)
    )
    if not as_wanted:
        raise ValueError(f"{name} has shape {values.shape}")
    return values


def _whole_numbers(name: str, told: object) -> NDArray[np.intp]:
    values = numbers(name, told)
    most = MOST_TERMS
    if (values != np.round(values)).any() or (values < 0).any() or (values > most).any():
        raise ValueError(f"{name} holds other entries than whole numbers from 0 to {most}")
    return values.astype(np.intp)


def _mapping(told: object) -> Told:
    if not isinstance(told, Mapping):
        raise ValueError("a part is no dict")
    return told


def _listed(told: object) -> Sequence[object]:
    if not isinstance(told, (list, tuple)):
        raise ValueError("a part is no list")
    return told
