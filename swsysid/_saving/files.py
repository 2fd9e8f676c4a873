"""`save_model` and `load_model`: fitted models in files that hold no code.

A file also tells its model in words, and what it must predict to be the same.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from swsysid._automaton.documents import FORMAT as AUTOMATON
from swsysid._automaton.model import HybridAutomaton
from swsysid._checks.parameters import bytes_of, names_of_columns, shown
from swsysid._pipelines import switching_step
from swsysid._results import Array
from swsysid._saving.classes import name_of
from swsysid._saving.values import read_objects, write_objects
from swsysid._whole_or_nothing import write_text

_NAME = "swsysid model"
_MODELS = (
    "SwitchingSystemRegressor",
    "PolynomialSurfaceClassifier",
    "EffectRegressor",
    "ModePipeline",
    "sklearn.Pipeline",
    "TrajectoryIdentifier",
    "HybridAutomatonRegressor",
    "HybridAutomaton",
    "EffectSearchCV",
)
_FORMAT = 1  # raised where an older version could not read what is written
_MALFORMED = (
    ValueError, TypeError, KeyError, IndexError, AttributeError, RecursionError, OverflowError,
    ImportError,
)  # fmt: skip
_PACKAGES = ("swsysid", "scikit-learn", "numpy")
_DIGITS = 6
_N_PROBES = 4  # states whose velocities a file holds, to be found again when it is read
_PROBE_TOLERANCE = 1e-9  # processors differ in the last digits
# The part that predicts, of models that are fitted to more than states and velocities.
_PREDICTING = {
    "TrajectoryIdentifier": "estimator_",
    "EffectSearchCV": "best_estimator_",
    "HybridAutomatonRegressor": "automaton_",
}
Told = Sequence[float | str] | None


@dataclass(frozen=True)
class Recording:
    """What a model was identified from.

    Attributes
    ----------
    source : str
        The file or the data set.
    names : list of str
        Names of the columns of X.
    units : dict of str
        Units by the names of columns; those of velocities by names such as ``x'``.
    smoothing : dict
        How the velocities were made: the method, its window and the like, by name.
    checksum : str
        SHA-256 of the file, which tells it from another one of its name.

    Examples
    --------
    >>> from swsysid import Recording
    >>> Recording("runs.csv", units={"x": "m", "x'": "m/s"}, smoothing={"window": 11}).units["x"]
    'm'
    """

    source: str = ""
    names: list[str] = field(default_factory=list)
    units: Mapping[str, str] = field(default_factory=dict)
    smoothing: Mapping[str, Any] = field(default_factory=dict)
    checksum: str = ""


def save_model(
    model: BaseEstimator | HybridAutomaton, path: str | Path, *, recording: Recording | None = None
) -> None:
    """Write a fitted model to a file that holds no code.

    The file is JSON, in UTF-8: the versions that wrote it, what was recorded, the laws and the
    surfaces as text, and the model, bit by bit. `load_model` reads it.

    Parameters
    ----------
    model : fitted estimator or HybridAutomaton
        Any of this package, with its standard errors and its report, or a pipeline of
        scikit-learn's that ends in one.
    path : str or path
        A usual ending is ``.json``. A file that is there is overwritten.
    recording : Recording, default=None
        Data source, names, units and smoothing; by default what `load_model` found.

    Raises
    ------
    TypeError
        If a part of the model is code: a function of the user's, a class of the user's. The
        sentence names the part.
    NotFittedError
        If the model is not fitted.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from swsysid import SwitchingSystemRegressor, load_model, save_model
    >>> from swsysid.datasets import make_damped_oscillator
    >>> data = make_damped_oscillator(300, random_state=0)
    >>> model = SwitchingSystemRegressor(2, random_state=0).fit(data.X, data.Xdot)
    >>> path = Path(tempfile.mkdtemp()) / "oscillator.json"
    >>> save_model(model, path)
    >>> same = load_model(path)
    >>> bool((same.predict(data.X) == model.predict(data.X)).all())
    True
    """
    _check_model(model)
    known = vars(model).get("recording_", Recording()) if recording is None else recording
    _check_recording(known)
    if not known.names:
        known = replace(known, names=list(map(str, getattr(model, "feature_names_in_", ()))))
    content = {
        "format": _NAME,
        "format_version": _FORMAT,
        "written_by": {package: version(package) for package in _PACKAGES},
        "recording": asdict(known),
        "equations": _equations_of(model, "equations"),
        "surface_equations": _equations_of(model, "surface_equations"),
        "probe": _probe(model),
        "objects": write_objects(model),
    }
    content["checksum"] = _checksum(content)
    write_text(path, _text(content))


def load_model(path: str | Path) -> BaseEstimator | HybridAutomaton:
    """The model of a file that `save_model` wrote; no code of the file is run.

    It predicts the same numbers to the last bit, simulates, prints its equations and is plotted
    as the one that was saved. What it was identified from is its attribute ``recording_``. The
    document of `HybridAutomaton.to_dict` as JSON, such as the ``automaton.json`` of the command
    line, is read too.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    fitted estimator or HybridAutomaton

    Raises
    ------
    ValueError
        If the file is none of `save_model`, is damaged or edited, was written by a newer
        version, or predicts otherwise with the versions installed here.
    OSError
        If the file cannot be read.

    Examples
    --------
    See `save_model`.
    """
    content = _content(Path(path))
    if content["format"] == AUTOMATON:
        return HybridAutomaton.from_dict(content)
    try:
        model = read_objects(content["objects"])
        recording = Recording(**content["recording"])
        unknown = name_of(type(model)) not in _MODELS
        same = unknown or _finds_again(model, content["probe"])
    except _MALFORMED as error:
        raise ValueError(
            f"{path} does not hold a model of swsysid ({error}); do not trust this file, and save "
            "the model again."
        ) from None
    if unknown:
        raise ValueError(f"{path} holds a {type(model).__name__}, which is no model of swsysid.")
    if not same:
        versions = ", ".join(f"{name} {number}" for name, number in content["written_by"].items())
        raise ValueError(
            f"{path} predicts other velocities here than where it was written (with {versions}); "
            "install these versions, or fit the model again."
        )
    vars(model)["recording_"] = recording  # an automaton has no other way
    return model


def _check_model(model: object) -> None:
    """Refuse what is no fitted model of this package."""
    if name_of(type(model)) not in _MODELS:
        kind = type(model).__name__
        if kind.endswith("SearchCV"):
            raise TypeError(
                f"{kind} is a search; save the model that it found: "
                "save_model(search.best_estimator_, path)."
            )
        raise TypeError(
            f"{kind} is not a model that save_model knows; give an estimator of this package, a "
            "Pipeline that ends in one, or a HybridAutomaton."
        )
    if isinstance(model, BaseEstimator):
        check_is_fitted(model)


def _check_recording(recording: object) -> None:
    """Refuse what a file cannot tell of the data."""
    if not isinstance(recording, Recording):
        raise TypeError(
            f"recording={shown(recording)} must be a swsysid.Recording, such as "
            'Recording("runs.csv", units={"x": "m"}).'
        )
    names_of_columns("names", recording.names)
    try:
        json.dumps(asdict(recording), allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise type(error)(
            f"recording cannot be written ({str(error).rstrip('.')}); give texts, finite numbers, "
            "and lists and dicts of these."
        ) from None


def _content(path: Path) -> dict[str, Any]:
    """The checked outer part of a file."""
    try:
        content = json.loads(bytes_of(path).decode("utf-8"), parse_constant=_no_constant)
    except (ValueError, RecursionError):
        content = None
    if isinstance(content, dict) and content.get("format") == AUTOMATON:
        return content
    if not isinstance(content, dict) or content.get("format") != _NAME:
        raise ValueError(f"{path} is no model file of swsysid; write one with save_model.")
    written = content.get("format_version")
    if type(written) is not int or written > _FORMAT:
        raise ValueError(
            f"{path} is in format {written} and this version of swsysid reads formats up to "
            f"{_FORMAT}; update swsysid."
        )
    if content.get("checksum") != _checksum(content):
        raise ValueError(
            f"{path} is damaged or was edited: its checksum is another one; save the model again."
        )
    return content


def _text(content: dict[str, Any]) -> str:
    """The file, with each object of the model in a line of its own."""
    lines = [
        f" {json.dumps(key)}: {json.dumps(value, allow_nan=False)}"
        for key, value in content.items()
        if key != "objects"
    ]
    listed = ",\n  ".join(json.dumps(entry, allow_nan=False) for entry in content["objects"])
    return "{\n" + ",\n".join([*lines, f' "objects": [\n  {listed}\n ]']) + "\n}\n"


def _checksum(content: dict[str, Any]) -> str:
    rest = {key: value for key, value in content.items() if key != "checksum"}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no JSON")


def _equations_of(model: object, method: str) -> list[str]:
    """Equations for a reader of the file; none from a model or a surface that has no text."""
    try:
        return list(getattr(switching_step(_predicting(model))[1], method)(precision=_DIGITS))
    except (AttributeError, TypeError):
        return []


def _probe(model: object) -> Told:
    """What the model predicts for a few states; None where it needs more than states."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return np.asarray(_predicted(_predicting(model))).ravel().tolist()
        except ValueError:  # a logarithm of a negative number, or an effect that needs the times
            return None


def _finds_again(model: object, versions: Told) -> bool:
    """Whether the model predicts what it predicted where it was written."""
    if versions is None:
        return True
    found = _probe(model)
    if found is None or len(found) != len(versions):
        return False
    if not all(isinstance(value, float) for value in versions):
        return found == versions
    return bool(np.allclose(found, versions, rtol=_PROBE_TOLERANCE, atol=1e-300, equal_nan=True))


def _predicting(model: object) -> Any:
    part = _PREDICTING.get(name_of(type(model)) or "")
    return model if part is None else vars(model)[part]


def _predicted(model: Any) -> Array:
    """Velocities at a few states: those of all modes where the state does not tell the mode."""
    is_automaton = isinstance(model, HybridAutomaton)
    n_columns = len(model.feature_map.names_in) if is_automaton else model.n_features_in_
    X = np.random.default_rng(0).uniform(-1.0, 1.0, (_N_PROBES, n_columns))
    if not is_automaton:
        return model.predict(X)
    modes, n_lagged = range(model.n_modes), model.n_lagged
    return np.array([model.velocity(x[:n_lagged], x[n_lagged:], k) for k in modes for x in X])
