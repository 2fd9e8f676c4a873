"""Which classes a model file may name: those of this package, and transformers known to be data.

A file names models by the short names of this table. The records of reports, which are frozen
dataclasses and the like, it names by their room in this package and the file of it that they were
in when it was written; nothing else that it says is imported. An object is its class and its
attributes; none of its methods runs while it is made, but for constructors, which only store and
check.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from inspect import signature

from sklearn.base import BaseEstimator

from swsysid._automaton.model import HybridAutomaton
from swsysid._automaton.parts import FirstModes
from swsysid._automaton.transitions import AffineReset, PolynomialGuard, Transition
from swsysid._automaton_regressor import HybridAutomatonRegressor
from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._data.features import FeatureMap, FunctionLibrary, Monomials
from swsysid._effect_model.joint_fit import JointFit
from swsysid._effect_regressor import EffectRegressor
from swsysid._effect_search.search import EffectSearchCV
from swsysid._identification.number_of_modes import ModeCandidate
from swsysid._identification.terms import SurfaceCandidate
from swsysid._pipelines import ModePipeline
from swsysid._regressor import SwitchingSystemRegressor
from swsysid._results import IterationRecord
from swsysid._surfaces.polynomials import LibraryBasis, PolynomialBasis, RelevantBasis, SpannedBasis
from swsysid._surfaces.probability import ModePosterior, SurfaceEvidence
from swsysid._trajectory_identifier import TrajectoryIdentifier
from swsysid.effects import PlacedEffect, all_effects, special_effects
from swsysid.effects._guards import Guard
from swsysid.relaxations import ExactRelaxation, MomentRelaxation, SimplexRelaxation

_OWN = {
    each.__name__: each
    for each in (
        SwitchingSystemRegressor, PolynomialSurfaceClassifier, EffectRegressor, ModePipeline,
        TrajectoryIdentifier, HybridAutomatonRegressor, EffectSearchCV,
        FeatureMap, FunctionLibrary, Monomials,
        PolynomialBasis, LibraryBasis, RelevantBasis, SpannedBasis,
        ModePosterior, SurfaceEvidence, SurfaceCandidate, ModeCandidate, IterationRecord,
        HybridAutomaton, Transition, PolynomialGuard, AffineReset, FirstModes,
        JointFit, PlacedEffect, Guard,
        ExactRelaxation, SimplexRelaxation, MomentRelaxation,
        *map(type, [*all_effects(), *special_effects()]),
    )
}  # fmt: skip
# What these hold after a fit is numbers and names.
_FOREIGN = {
    "sklearn.preprocessing": (
        "PolynomialFeatures", "StandardScaler", "MinMaxScaler", "MaxAbsScaler", "RobustScaler",
        "FunctionTransformer",
    ),
    "sklearn.pipeline": ("Pipeline", "FeatureUnion"),
    "sklearn.compose": ("ColumnTransformer",),
    "sklearn.decomposition": ("PCA",),
    "sklearn.kernel_approximation": ("RBFSampler", "Nystroem"),
    "sklearn.linear_model": ("LogisticRegression",),
    "sklearn.model_selection": (
        "KFold", "GroupKFold", "TimeSeriesSplit", "ShuffleSplit", "LeaveOneGroupOut",
    ),
    "pysindy": (
        "PolynomialLibrary", "FourierLibrary", "IdentityLibrary", "ConcatLibrary",
        "TensoredLibrary",
    ),
}  # fmt: skip
_MODULE_OF = {
    f"{module.partition('.')[0]}.{name}": module for module, names in _FOREIGN.items()
    for name in names
}  # fmt: skip
# Which metadata a user asks for, what `load_model` says, and what only a fit needs, are no part of
# what a model knows.
_LEFT_OUT = ("_metadata_request", "recording_", "_declared", "_recordings", "checkpoint")
# Attributes of records by the names that they had in files of earlier versions, and what their
# values are called today.
_ONCE_CALLED: dict[tuple[str, str], tuple[str, Callable[[object], object]]] = {
    ("Records", "told"): ("decoded_modes", lambda modes: modes),
    ("FreeRollouts", "unit"): ("in_noise", "the noise".__eq__),
}
_PACKAGE = __name__.partition(".")[0] + "."


def name_of(kind: type) -> str | None:
    """The name of a class in a file; None if it has none."""
    if _OWN.get(kind.__name__) is kind:
        return kind.__name__
    if _is_record(kind):
        return f"{kind.__module__}.{kind.__name__}"
    name = f"{kind.__module__.partition('.')[0]}.{kind.__name__}"
    return name if name in _MODULE_OF and class_named(name) is kind else None


def class_named(name: str) -> type:
    """The class of a name in a file; KeyError if there is none."""
    if name in _OWN:
        return _OWN[name]
    place, _, last = name.rpartition(".")
    if name.startswith(_PACKAGE):
        kind = next(_records_named(last, *place.rpartition(".")[::2]), None)
        if kind is None:
            raise KeyError(name)
        return kind
    return vars(importlib.import_module(_MODULE_OF[name]))[last]


def _records_named(name: str, room: str, file: str) -> Iterator[type]:
    """Records of a name in a room, first in the file where a version of this package has put it."""
    files = [one.name for one in pkgutil.iter_modules(importlib.import_module(room).__path__)]
    for one in sorted(files, key=lambda one: one != file):
        module = importlib.import_module(f"{room}.{one}")
        kind = vars(module).get(name)
        if isinstance(kind, type) and _is_record(kind) and kind.__module__ == module.__name__:
            yield kind


def _is_record(kind: type) -> bool:
    """Whether objects of a class of this package are no more than their fields."""
    is_ours = kind.__module__.startswith(_PACKAGE)
    return is_ours and (is_dataclass(kind) or issubclass(kind, Enum | tuple))


def state_of(value: object) -> dict[str, object]:
    """The attributes from which `made` makes an equal object."""
    if isinstance(value, tuple):
        return dict(zip(vars(type(value))["_fields"], value, strict=True))
    # what a record has computed and kept beside its fields is no part of it
    names = [one.name for one in fields(value)] if is_dataclass(value) else list(vars(value))
    return {name: vars(value)[name] for name in names if name not in _LEFT_OUT}


def made(kind: type, state: dict[str, object]) -> object:
    """An object with given attributes.

    Parameters of an estimator that the file does not know have their defaults. Attributes that the
    class does not have are a TypeError or a ValueError.
    """
    if is_dataclass(kind) or issubclass(kind, tuple):
        today = {}
        for name, value in state.items():
            known_as, read = _ONCE_CALLED.get((kind.__name__, name), (name, None))
            today[known_as] = value if read is None else read(value)
        return kind(**today)
    if not issubclass(kind, BaseEstimator):
        return _with_attributes(object.__new__(kind), state)
    known = signature(kind).parameters
    estimator = kind(**{name: value for name, value in state.items() if name in known})
    rest = {name: value for name, value in state.items() if name not in known}
    return _with_attributes(estimator, rest)


def _with_attributes(value: object, state: dict[str, object]) -> object:
    hidden = [name for name in state if hasattr(type(value), name)]
    if hidden:  # an attribute of that name would hide a method
        raise ValueError(f"{type(value).__name__} has no attribute {hidden[0]}")
    vars(value).update(state)
    return value
