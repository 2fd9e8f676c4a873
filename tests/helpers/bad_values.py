"""Wrong values for an argument, by what the argument is: a table, a column, a count, ...

Every wrong value has a name, a function that makes it from the right value, and whether a call
with it has to be refused: extreme but meaningful values may also be answered, if rightly.
"""

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pandas as pd
from scipy.sparse import csr_array
from sklearn.linear_model import LinearRegression

from swsysid import SwitchingSystemRegressor

__all__ = ["BAD", "TEMPLATES", "BadValue"]


@dataclass(frozen=True)
class BadValue:
    """A way to make an argument wrong."""

    name: str
    make: Callable
    refused: bool = True


class Opaque:
    """An object that is nothing of what a call may ask for."""

    def __repr__(self):
        return "Opaque()"


def _constant(value):
    return lambda good: value


def _named(*values, refused=True):
    return [BadValue(repr(value)[:40], _constant(value), refused) for value in values]


def _with_entry(value, dtype=float):
    """The right array with one entry replaced."""

    def make(good):
        array = np.array(good, dtype=dtype)
        array.reshape(-1)[array.size // 2] = value
        return array

    return make


def _scaled(factor):
    return lambda good: np.asarray(good, dtype=float) * factor


_ENTRIES = [
    BadValue("one NaN", _with_entry(np.nan)),
    BadValue("one infinity", _with_entry(np.inf)),
    BadValue("one negative infinity", _with_entry(-np.inf)),
    BadValue("one None", _with_entry(None, object)),
    BadValue("one text", _with_entry("text", object)),
    BadValue("one list", lambda good: _with_list(good)),
    BadValue("one huge whole number", _with_entry(10**400, object)),
    BadValue("all NaN", lambda good: np.full(np.shape(good), np.nan)),
    BadValue("texts", lambda good: np.full(np.shape(good), "text")),
    BadValue("digits as texts", lambda good: np.asarray(good, dtype=float).astype(str)),
    BadValue("complex", lambda good: np.asarray(good) * (1.0 + 1.0j)),
    BadValue("datetime", lambda good: _numbered(good).astype("M8[s]")),
    BadValue("timedelta", lambda good: _numbered(good).astype("m8[s]")),
    BadValue("records", lambda good: np.zeros(len(good), dtype=[("a", float)])),
    BadValue("a masked entry", lambda good: _masked(good)),
    BadValue("1e160", _scaled(1e160), False),
    BadValue("1e300", _scaled(1e300), False),
    BadValue("1e-200", _scaled(1e-200), False),
    BadValue("1e-310", _scaled(1e-310), False),
    BadValue("zeros", lambda good: np.zeros(np.shape(good)), False),
    BadValue("bytes", lambda good: np.full(np.shape(good), b"ab")),
]

_SHAPES = [
    *_named(None, "text", b"text", 3.0, {}, [], Opaque(), {1, 2}, np.nan),
    BadValue("a function", lambda good: len),
    BadValue("a type", lambda good: float),
    BadValue("one row fewer", lambda good: np.asarray(good)[:-1]),
    BadValue("one row more", lambda good: np.concatenate([good, good[-1:]])),
    BadValue("no rows", lambda good: np.asarray(good)[:0]),
    BadValue("one more dimension", lambda good: np.asarray(good)[..., None, None]),
    BadValue("a generator", lambda good: (row for row in good)),
    BadValue("ragged", lambda good: [[0.0] * (1 + row % 2) for row in range(len(good) + 1)]),
    BadValue("a number without dimensions", lambda good: np.array(1.0)),
    BadValue("sparse", lambda good: csr_array(np.reshape(good, (len(good), -1)).astype(float))),
]

_TABLE_SHAPES = [
    BadValue("no columns", lambda good: np.asarray(good)[:, :0]),
    BadValue("a column fewer", lambda good: np.asarray(good)[:, :-1], False),
    BadValue("a column more", lambda good: np.column_stack([good, np.asarray(good)[:, -1]]), False),
    BadValue("transposed", lambda good: np.asarray(good).T, False),
    BadValue("flat", lambda good: np.asarray(good).ravel(), False),
    BadValue("a frame with text", lambda good: pd.DataFrame(good).assign(name="text")),
    BadValue("a frame with dates", lambda good: pd.DataFrame(good).assign(when=pd.Timestamp(0))),
]


def _numbered(good):
    return np.arange(np.size(good)).reshape(np.shape(good))


def _with_list(good):
    array = np.array(good, dtype=object)
    array.reshape(-1)[0] = [1.0, 2.0]
    return array


def _masked(good):
    array = np.ma.array(np.asarray(good, dtype=float))
    array[(0,) * array.ndim] = np.ma.masked
    return array


_NO_NUMBER = _named("3", "nonsense", b"3", [2.0], (), {}, 1j, np.array([1, 2]), Opaque(), float)
_ROWS = ("one row fewer", "one row more")


def _without(bad_values, *names):
    return [bad for bad in bad_values if bad.name not in names]


_COUNT = [
    *_named(-1, 1.5, np.nan, np.inf, True, Fraction(3, 2), None),
    *_NO_NUMBER,
    *_named(10**9, 120, 10**400, refused=False),
]
_NUMBER = [
    *_named(-1.0, np.nan, -np.inf, True, None, 10**400),
    *_NO_NUMBER,
    *_named(1e160, 1e-200, refused=False),
]

BAD = {
    "table": _ENTRIES + _SHAPES + _TABLE_SHAPES,
    "rows": _without(_ENTRIES + _SHAPES + _TABLE_SHAPES, *_ROWS),
    "inputs": _without(_ENTRIES + _SHAPES + _TABLE_SHAPES, "one row fewer"),
    "recorded": _without(_ENTRIES + _SHAPES + _TABLE_SHAPES, "one NaN", "one None"),
    "coefficients": _without(_ENTRIES + _SHAPES, *_ROWS),
    "column": _ENTRIES + _SHAPES,
    "state": _ENTRIES + _SHAPES,
    "guess": _without(_ENTRIES + _SHAPES, "{}"),
    "spread": _without(_ENTRIES + _SHAPES, "3.0", "a number without dimensions"),
    "clock": _without(_ENTRIES + _SHAPES, "zeros", *_ROWS),
    "times": [
        *(bad for bad in _ENTRIES if bad.name != "zeros"),
        *_SHAPES,
        BadValue("backwards", lambda good: -np.asarray(good)),
        BadValue("all the same", lambda good: np.zeros(np.shape(good))),
    ],
    "labels": [
        *_SHAPES,
        BadValue("one NaN", _with_entry(np.nan)),
        BadValue("one None", _with_entry(None, object)),
        BadValue("mixed", _with_entry("text", object)),
        BadValue("one list", lambda good: _with_list(good)),
        BadValue("not a time", lambda good: np.full(np.shape(good), np.datetime64("NaT"))),
        BadValue("complex", lambda good: np.asarray(good) * 1j),
    ],
    "count": [*_named(0), *_COUNT],
    "count from 0": _COUNT,
    "number": [*_named(np.inf), *_NUMBER],
    "limit": _NUMBER,
    "degree": [
        *_named(-1, 1.5, np.nan, True, 10**400),
        *_NO_NUMBER,
        *_named(10**9, 200, refused=False),
    ],
    "choice": _named("nonsense", "", 2, 2.5, None, True, [], {}, ["l1"], Opaque(), len, np.ones(3)),
    "text": _named(2, 2.5, None, True, [], {}, Opaque(), len),
    "method": _named("nonsense", "", 2, 2.5, None, True, [], {}, Opaque(), len, np.ones(3)),
    "kinds": _named("nonsense", "", 2, 2.5, True, {}, ["l1"], [None], Opaque(), len, np.ones(3)),
    "flag": _named("yes", 2, -1, 0.5, None, [], np.array([True, False]), Opaque()),
    "seed": _named(-1, 1.5, "text", [], {}, Opaque(), 2**40, np.nan, 1j),
    "jobs": _named(0, 1.5, "text", [2], {}, Opaque(), np.nan, True),
    "object": _named(None, 5, "text", [], Opaque(), float),
    "list": _named(None, 5, "text", [None], Opaque(), float),
    "model": [
        *_named(None, 5, "text", [], Opaque(), float, SwitchingSystemRegressor),
        *_named(SwitchingSystemRegressor(), LinearRegression()),
    ],
    "function": _named(None, 5, "text", [], Opaque()),
    "names": _named(5, "text", ["only one"], [1, 2, 3, 4], Opaque(), [None, None]),
}

# What is made wrong where a right call leaves the argument out.
TEMPLATES = {
    "table": np.ones((40, 1)),
    "column": np.linspace(0.0, 1.0, 40),
    "labels": np.repeat([0, 1], 20),
    "times": np.arange(40.0),
    "state": np.array([0.5, -0.5]),
    "guess": np.array([0.5, -0.5]),
    "spread": np.array([0.5, 0.5]),
}
