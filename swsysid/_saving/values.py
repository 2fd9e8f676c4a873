"""Values as JSON: numbers, texts, containers, arrays, and objects of the classes a file may name.

A list is a list; every JSON object has a key that says what it stands for. Objects of classes lie
in one table, parts before the whole, and refer to each other by their places, so that what is
shared is written once and nothing can refer to itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from swsysid._results import Status
from swsysid._saving.arrays import array_of, json_of_array, json_of_float
from swsysid._saving.classes import class_named, made, name_of, state_of

__all__ = ["read_objects", "write_objects"]


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
    reader = _Reader()
    for entry in table:
        state = {str(name): reader.read(value) for name, value in entry["state"].items()}
        reader.known.append(made(class_named(entry["class"]), state))
    return reader.known[-1]


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
                return json_of_float(float(value))
            case list():
                return [self.write(part, f"{where}[{place}]") for place, part in enumerate(value)]
            case tuple():
                return {"tuple": self.write(list(value), where)}
            case dict():
                return {
                    "dict": [
                        [self.write(key, where), self.write(part, f"{where}[{key!r}]")]
                        for key, part in value.items()
                    ]
                }
            case slice():
                return {"slice": self.write([value.start, value.stop, value.step], where)}
            case np.ndarray():
                try:
                    return json_of_array(value)
                except TypeError as error:
                    raise TypeError(_refusal(where, str(error))) from None
            case np.ufunc() if _is_named_by_numpy(value):
                return {"ufunc": value.__name__}
            case np.random.RandomState():
                return {"random_state": self.write(value.get_state(legacy=False), where)}
            case Status():
                return {"status": value.name}
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


def _is_named_by_numpy(function: np.ufunc) -> bool:
    return vars(np).get(function.__name__) is function


def _described(value: object) -> str:
    name = getattr(value, "__name__", None)
    return f"the function {name}" if name else f"an object of the class {type(value).__name__}"


def _refusal(where: str, what: str) -> str:
    return (
        f"{where} is {what}, which a file without code cannot hold; put something of this package, "
        "scikit-learn or NumPy (such as numpy.sin) in its place, or keep the model with joblib, "
        "whose files run code when they are loaded."
    )


class _Reader:
    """Reads values; `known` are the objects that the table has had so far."""

    def __init__(self) -> None:
        self.known: list[object] = []

    def read(self, told: Any) -> Any:
        """The value of some JSON."""
        if isinstance(told, list):
            return [self.read(part) for part in told]
        if not isinstance(told, dict):
            return told
        if "shape" in told:
            values = array_of(told)
            return values if values.shape else values[()]
        ((kind, inner),) = told.items()
        match kind:
            case "object" if type(inner) is int and inner >= 0:
                return self.known[inner]
            case "tuple":
                return tuple(self.read(inner))
            case "dict":
                return {self.read(key): self.read(part) for key, part in inner}
            case "slice":
                return slice(*self.read(inner))
            case "float":
                return float(inner)
            case "ufunc" if isinstance(getattr(np, inner, None), np.ufunc):
                return getattr(np, inner)
            case "random_state":
                random_state = np.random.RandomState()
                random_state.set_state(self.read(inner))
                return random_state
            case "status":
                return Status[inner]
        raise ValueError(f"{told!r} stands for nothing")
