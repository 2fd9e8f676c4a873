"""Values as JSON: numbers, texts, containers, arrays, and objects of the classes a file may name.

A list is a list; every JSON object has a key that says what it stands for. Objects of classes lie
in one table, parts before the whole, and refer to each other by their places, so that what is
shared is written once and nothing can refer to itself.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import singledispatch
from typing import Any

import numpy as np

from swsysid._results import Status
from swsysid._saving.arrays import array_of, json_of_array, json_of_float
from swsysid._saving.classes import class_named, made, name_of, state_of

__all__ = ["read_objects", "write_objects"]


def write_objects(model: object) -> list[dict[str, Any]]:
    """The table of objects of which a model consists, the model itself at its end.

    Raises
    ------
    TypeError
        If a part cannot be written without code; the message names the part.
    """
    writer = _Writer()
    writer.write(model, "the model")
    return writer.table


def read_objects(table: list[dict[str, Any]]) -> Any:
    """The last object of a table.

    Raises
    ------
    ValueError, TypeError, KeyError, IndexError, AttributeError
        If the table is not one that `write_objects` writes.
    """
    reader = _Reader([])
    for entry in table:
        state = {str(name): reader.read(value) for name, value in entry["state"].items()}
        reader.known.append(made(class_named(entry["class"]), state))
    return reader.known[-1]


class _Writer:
    """Writes values; remembers which objects it has written."""

    def __init__(self) -> None:
        self.table: list[dict[str, Any]] = []
        self.places: dict[int, int] = {}

    def write(self, value: Any, where: str) -> Any:
        """A value as JSON; `where` names it in a refusal."""
        return _written(value, self, where)

    def write_object(self, value: Any, where: str) -> dict[str, int]:
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


def _described(value: Any) -> str:
    name = getattr(value, "__name__", None)
    return f"the function {name}" if name else f"an object of the class {type(value).__name__}"


def _refusal(where: str, what: str) -> str:
    return (
        f"{where} is {what}, which a file without code cannot hold; put something of this package, "
        "scikit-learn or NumPy (such as numpy.sin) in its place, or keep the model with joblib, "
        "whose files run code when they are loaded."
    )


@singledispatch
def _written(value: Any, writer: _Writer, where: str) -> Any:
    return writer.write_object(value, where)


@_written.register(type(None))
@_written.register(bool)
@_written.register(int)
@_written.register(str)
def _(value: Any, writer: _Writer, where: str) -> Any:
    return value


@_written.register
def _(value: float, writer: _Writer, where: str) -> Any:
    return json_of_float(float(value))


@_written.register
def _(value: np.generic, writer: _Writer, where: str) -> Any:
    return writer.write(np.asarray(value), where)


@_written.register
def _(value: list, writer: _Writer, where: str) -> Any:
    return [writer.write(part, f"{where}[{place}]") for place, part in enumerate(value)]


@_written.register
def _(value: tuple, writer: _Writer, where: str) -> Any:
    return {"tuple": writer.write(list(value), where)}


@_written.register
def _(value: dict, writer: _Writer, where: str) -> Any:
    return {
        "dict": [
            [writer.write(key, where), writer.write(part, f"{where}[{key!r}]")]
            for key, part in value.items()
        ]
    }


@_written.register
def _(value: slice, writer: _Writer, where: str) -> Any:
    return {"slice": writer.write([value.start, value.stop, value.step], where)}


@_written.register
def _(value: np.ndarray, writer: _Writer, where: str) -> Any:
    try:
        return json_of_array(value)
    except TypeError as error:
        raise TypeError(_refusal(where, str(error))) from None


@_written.register
def _(value: np.ufunc, writer: _Writer, where: str) -> Any:
    if getattr(np, value.__name__, None) is not value:
        raise TypeError(_refusal(where, _described(value)))
    return {"ufunc": value.__name__}


@_written.register
def _(value: np.random.RandomState, writer: _Writer, where: str) -> Any:
    return {"random_state": writer.write(value.get_state(legacy=False), where)}


@_written.register
def _(value: Status, writer: _Writer, where: str) -> Any:
    return {"status": value.name}


class _Reader:
    """Reads values; `known` are the objects that the table has had so far."""

    def __init__(self, known: list[object]) -> None:
        self.known = known
        self.kinds: dict[str, Callable[[Any], Any]] = {
            "object": self._object,
            "tuple": lambda told: tuple(self.read(told)),
            "dict": lambda told: {self.read(key): self.read(part) for key, part in told},
            "slice": lambda told: slice(*self.read(told)),
            "float": float,
            "ufunc": _ufunc_named,
            "random_state": lambda told: _random_state(self.read(told)),
            "status": lambda told: Status[told],
        }

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
        return self.kinds[kind](inner)

    def _object(self, place: int) -> object:
        if type(place) is not int or place < 0:
            raise ValueError(f"{place!r} is no place of an object")
        return self.known[place]


def _ufunc_named(name: str) -> np.ufunc:
    function = getattr(np, name, None)
    if not isinstance(function, np.ufunc):
        raise ValueError(f"numpy has no function of arrays called {name}")
    return function


def _random_state(state: dict[str, Any]) -> np.random.RandomState:
    random_state = np.random.RandomState()
    random_state.set_state(state)
    return random_state
