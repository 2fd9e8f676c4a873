"""Values as JSON: numbers, texts, containers, arrays, and objects of the classes a file may name.

A list is a list; every JSON object has a key that says what it stands for. Objects of classes lie
in one table, parts before the whole, and refer to each other by their places, so that what is
shared is written once and nothing can refer to itself.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from swsysid._results import Status
from swsysid._saving.classes import class_named, made, name_of, state_of

_SHORT = 100  # entries; longer arrays are not for reading
_KINDS = "biufU"  # truth values, whole and floating-point numbers, fixed-length texts


def write_objects(model: object) -> list[dict[str, object]]:
    """The table of objects of which a model consists, the model itself at its end.

    A part that cannot be written without code is a TypeError, whose message names the part.
    """
    writer = _Writer()
    writer.write(model, "the model")
    return writer.table


def read_objects(table: Sequence[Mapping[str, Any]]) -> Any:
    """The last object of a table.

    A table that `write_objects` did not write is a ValueError, TypeError, KeyError, IndexError or
    AttributeError.
    """
    known: list[object] = []
    for entry in table:
        state = {str(name): _read(value, known) for name, value in entry["state"].items()}
        known.append(made(class_named(entry["class"]), state))
    return known[-1]


class _Writer:
    """Writes values; remembers which objects it has written."""

    def __init__(self) -> None:
        self.table: list[dict[str, object]] = []
        self.places: dict[int, int] = {}

    def write(self, value: object, where: str) -> object:
        """A value as JSON; `where` names it in a refusal."""
        match value:
            case None | bool() | int() | str():
                return value
            case np.generic():
                return self.write(np.asarray(value), where)
            case float():
                return _json_of_float(float(value))
            case list():
                return [self.write(part, f"{where}[{place}]") for place, part in enumerate(value)]
            case tuple() if type(value) is tuple:
                return {"tuple": self.write(list(value), where)}
            case dict():
                return {
                    "dict": [
                        [self.write(key, where), self.write(part, f"{where}[{key!r}]")]
                        for key, part in value.items()
                    ]
                }
            case frozenset() | set():
                return {type(value).__name__: self.write(sorted(value), where)}
            case csr_matrix():
                parts = [list(value.shape), value.data, value.indices, value.indptr]
                return {"csr": self.write(parts, where)}
            case slice():
                return {"slice": self.write([value.start, value.stop, value.step], where)}
            case np.ndarray():
                try:
                    return _json_of_array(value)
                except TypeError as error:
                    raise TypeError(_refusal(where, str(error))) from None
            case np.ufunc(__name__=str(name)) if vars(np).get(name) is value:
                return {"ufunc": name}
            case np.random.RandomState():
                return {"random_state": self.write(value.get_state(legacy=False), where)}
            case Status():
                return {"status": value.name}
            case Enum() if (kind := name_of(type(value))) is not None:
                return {"enum": [kind, value.name]}
        return self._write_object(value, where)

    def _write_object(self, value: object, where: str) -> dict[str, int]:
        """An object of a class that a file may name, as its place in the table."""
        if id(value) not in self.places:
            name = name_of(type(value))
            if name is None:
                raise TypeError(_refusal(where, _described(value)))
            of = "" if where == "the model" else f"{where}."
            state = {key: self.write(part, of + key) for key, part in state_of(value).items()}
            self.table.append({"class": name, "state": state})
            self.places[id(value)] = len(self.table) - 1
        return {"object": self.places[id(value)]}


def _described(value: object) -> str:
    name = getattr(value, "__name__", None)
    return f"the function {name}" if name else f"an object of the class {type(value).__name__}"


def _refusal(where: str, what: str) -> str:
    return (
        f"{where} is {what}, which a file without code cannot hold; put something of this package, "
        "scikit-learn or NumPy (such as numpy.sin) in its place, or keep the model with joblib, "
        "whose files run code when they are loaded."
    )


def _read(written: Any, known: list[object]) -> Any:
    """The value of some JSON; `known` are the objects that the table has had so far."""
    if isinstance(written, list):
        return [_read(part, known) for part in written]
    if not isinstance(written, dict):
        return written
    if "shape" in written:
        values = _array_of(written)
        return values if values.shape else values[()]
    ((kind, inner),) = written.items()
    match kind:
        case "object" if type(inner) is int and inner >= 0:
            return known[inner]
        case "tuple":
            return tuple(_read(inner, known))
        case "dict":
            return {_read(key, known): _read(part, known) for key, part in inner}
        case "slice":
            return slice(*_read(inner, known))
        case "float":
            return float(inner)
        case "ufunc" if isinstance(getattr(np, inner, None), np.ufunc):
            return getattr(np, inner)
        case "random_state":
            random_state = np.random.RandomState()
            random_state.set_state(_read(inner, known))
            return random_state
        case "status":
            return Status[inner]
        case "csr":
            shape, *parts = _read(inner, known)
            matrix = csr_matrix(tuple(parts), shape=tuple(shape))
            matrix.check_format(full_check=True)  # places beyond the end are read without a check
            return matrix
        case "set" | "frozenset":
            values = _read(inner, known)
            return set(values) if kind == "set" else frozenset(values)
        case "enum" if issubclass(kind_of := class_named(inner[0]), Enum):
            return kind_of[inner[1]]
    raise ValueError(f"{written!r} stands for nothing")


def _json_of_float(value: float) -> float | dict[str, str]:
    """A number that JSON knows, or its name; reading the digits gives the same bits back.

    Examples
    --------
    >>> _json_of_float(0.1), _json_of_float(float("-inf"))
    (0.1, {'float': '-inf'})
    """
    return value if math.isfinite(value) else {"float": repr(value)}


def _json_of_array(values: NDArray) -> dict[str, Any]:
    """An array with its type and shape: its entries if it is short, else its bytes in base 64.

    Examples
    --------
    >>> _json_of_array(np.array([[1.0, 2.5]]))
    {'array': [1.0, 2.5], 'type': '<f8', 'shape': [1, 2]}
    """
    shape = list(values.shape)
    if values.dtype == object:
        entries = values.ravel().tolist()
        if not all(isinstance(entry, str) for entry in entries):
            raise TypeError("an array of Python objects")
        return {"array": entries, "type": "object", "shape": shape}
    if values.dtype.kind not in _KINDS:
        raise TypeError(f"an array of type {values.dtype}")
    ordered = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"), copy=False)
    written = {"type": ordered.dtype.str, "shape": shape}
    is_number = values.dtype.kind in "biuf"
    if ordered.size <= _SHORT and (not is_number or bool(np.isfinite(ordered).all())):
        return {"array": ordered.ravel().tolist(), **written}
    return {"bytes": base64.b64encode(ordered.tobytes()).decode("ascii"), **written}


def _array_of(written: dict[str, Any]) -> NDArray:
    """The array of a JSON object."""
    shape = tuple(written["shape"])
    if not all(type(length) is int and length >= 0 for length in shape):
        raise ValueError(f"the shape {shape} of an array")
    if written["type"] == "object":
        if not all(type(entry) is str for entry in written["array"]):
            raise ValueError("an array of text with other entries")
        values = np.empty(len(written["array"]), dtype=object)
        values[:] = written["array"]
        return values.reshape(shape)
    dtype = np.dtype(str(written["type"]))
    if dtype.kind not in _KINDS:
        raise ValueError(f"the type {written['type']} of an array")
    if "bytes" in written:
        values = np.frombuffer(base64.b64decode(written["bytes"], validate=True), dtype=dtype)
    else:
        values = np.array(written["array"], dtype=dtype)
    # a copy, since what lies over bytes cannot be written to
    return values.reshape(shape).astype(dtype.newbyteorder("="))
