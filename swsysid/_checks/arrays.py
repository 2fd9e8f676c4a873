"""Data that are no numbers, incomplete, of another shape or out of reach, refused at the door.

What comes through is a plain array of finite floats of the shape that was asked for, whose
squares and products neither overflow nor vanish.
"""

from __future__ import annotations

from datetime import date, timedelta
from numbers import Real
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import issparse

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]

# Sizes of data whose products of a few factors are neither infinite nor zero in double precision.
LARGEST, SMALLEST = 1e60, 1e-60

_NO_NUMBERS = {
    "U": "{} holds text; give numbers, and leave out rows of names or units.",
    "S": "{} holds text; give numbers, and leave out rows of names or units.",
    "T": "{} holds text; give numbers, and leave out rows of names or units.",
    "M": "{} holds dates; give numbers, such as the seconds since the first date.",
    "m": "{} holds time spans; give numbers, such as the seconds in each of them.",
    "c": "Complex data not supported: {} is complex; give real and imaginary parts as columns of "
    "their own.",
    "V": "{} holds records with named fields; give a plain table of numbers.",
}


@runtime_checkable
class Frame(Protocol):
    """A frame or a column of pandas."""

    @property
    def index(self) -> pd.Index:
        """Labels of the rows."""

    def isna(self) -> ArrayLike:
        """Which entries are missing."""


def numbers(name: str, values: object, *, missing: bool = False) -> Array:
    """Values of any shape as finite floats, else refused; with `missing` they may be NaN."""
    array = refuse_unlike_numbers(name, values).astype(float, copy=False)
    usable = np.isfinite(array) | np.isnan(array) if missing else np.isfinite(array)
    if usable.all():
        return array
    if not array.ndim:
        raise ValueError(f"{name} is {array}; give a finite number.")
    bad = np.atleast_1d(~usable.reshape(len(array), -1).all(axis=1))
    raise ValueError(
        f"{name} contains NaN or infinity in {int(bad.sum())} of {len(bad)} rows, first in row "
        f"{int(bad.argmax())}; leave those rows out, or fill them in."
    )


def names_of(values: object, n_columns: int, stem: str) -> list[str]:
    """Names of the columns of a data frame, or a stem with numbers where there are none.

    Examples
    --------
    >>> names_of([[1.0, 2.0]], 2, "x")
    ['x0', 'x1']
    """
    columns = getattr(values, "columns", [getattr(values, "name", None)])
    named = len(columns) == n_columns and all(isinstance(name, str) for name in columns)
    return list(columns) if named else [f"{stem}{column}" for column in range(n_columns)]


def other_names(values: object, names: list[str]) -> list[str] | None:
    """Names of the columns of a data frame, None where there are none or just these.

    Examples
    --------
    >>> other_names([[1.0, 2.0]], ["x", "v"])
    """
    unnamed = [str(number) for number in range(len(names))]
    given = names_of(values, len(names), "")
    return None if given in (names, unnamed) else given


def table(
    name: str,
    values: object,
    n_rows: int | None = None,
    n_columns: int | None = None,
    *,
    missing: bool = False,
    empty: bool = False,
) -> Array:
    """Values as a table, (n_rows, n_columns); one dimension is a single column.

    Examples
    --------
    >>> table("x", [1.0, 2.0]).shape
    (2, 1)
    >>> table("x", [1.0, 2.0], n_rows=3)
    Traceback (most recent call last):
        ...
    ValueError: x has shape (2,); give one row for each of the 3 samples.
    """
    array = numbers(name, values, missing=missing)
    shape = array.shape
    array = array[:, None] if array.ndim == 1 else array
    if array.ndim != 2 or not (array.size or empty):
        raise ValueError(
            f"{name} has shape {shape}; give a table with one row for each sample and one column "
            "for each channel."
        )
    if n_rows is not None and len(array) != n_rows:
        raise ValueError(
            f"{name} has shape {shape}; give one row for each of the {n_rows} samples."
        )
    if n_columns is not None and array.shape[1] != n_columns:
        raise ValueError(f"{name} has {array.shape[1]} columns; give {n_columns}.")
    refuse_overflow(name, array)
    return array


def column(name: str, values: object, n_rows: int | None = None) -> Array:
    """One value for each row, (n_rows,)."""
    array = numbers(name, values)
    shape = array.shape
    array = array[:, 0] if array.ndim == 2 and shape[1] == 1 else array
    if array.ndim != 1 or not array.size or (n_rows is not None and len(array) != n_rows):
        each = "for each sample" if n_rows is None else f"for each of the {n_rows} samples"
        raise ValueError(f"{name} has shape {shape}; give one value {each}.")
    refuse_overflow(name, array)
    return array


def state(name: str, values: object, n_states: int | None = None) -> Array:
    """One state, (n_states,)."""
    array = numbers(name, values)
    if array.ndim != 1 or not array.size:
        raise ValueError(
            f"{name} has shape {array.shape}; give one finite state of shape (n_states,)."
        )
    if n_states is not None and len(array) != n_states:
        raise ValueError(f"{name} holds {len(array)} states; give {n_states}.")
    return array


def truth_values(name: str, values: object) -> NDArray[np.bool_]:
    """Values of any shape that are true or false; 0 and 1 will do."""
    array = numbers(name, values)
    if not np.isin(array, (0.0, 1.0)).all():
        raise ValueError(f"{name} holds other values than True and False; give only these.")
    return array.astype(bool)


def labels(name: str, values: object, n_rows: int | None = None) -> NDArray:
    """One name for each row, (n_rows,), all of one kind and none missing."""
    array = plain_array(name, values)
    if array.ndim != 1 or not array.size or (n_rows is not None and len(array) != n_rows):
        each = "for each sample" if n_rows is None else f"for each of the {n_rows} samples"
        raise ValueError(f"{name} has shape {array.shape}; give one name {each}.")
    kind = array.dtype.kind
    if kind in "cV" or (kind == "O" and not _are_of_one_kind(array)):
        raise TypeError(f"{name} mixes names of several kinds; give all as text or all as numbers.")
    if (kind == "f" and not np.isfinite(array).all()) or (kind in "mM" and np.isnat(array).any()):
        raise ValueError(f"{name} has missing names; give each row one, or leave those rows out.")
    return array


def refuse_unlike_numbers(name: str, values: object) -> NDArray:
    """The values as an array of real numbers, perhaps NaN; anything else is refused."""
    array = plain_array(name, values)
    kind = array.dtype.kind
    if kind in "biuf":
        return array
    if kind == "O" and isinstance(values, Frame):  # pandas marks what is missing by an object
        array = np.where(values.isna(), np.nan, array)
    if kind in _NO_NUMBERS:
        raise ValueError(_NO_NUMBERS[kind].format(name))
    if values is None:
        raise ValueError(f"{name} is None; give numbers, one row for each sample.")
    for entry in array.ravel():
        if isinstance(entry, (str, bytes)):
            raise ValueError(_NO_NUMBERS["U"].format(name))
        if isinstance(entry, date | timedelta):
            raise ValueError(_NO_NUMBERS["M" if isinstance(entry, date) else "m"].format(name))
        if entry is not None and not isinstance(entry, Real):
            raise TypeError(
                f"{name} holds a {type(entry).__name__}; each entry of this argument must be "
                "neither a string nor an object but a number."
            )
    try:
        return array.astype(float)
    except OverflowError:
        raise ValueError(
            f"{name} holds whole numbers beyond 1e308; give it in other units."
        ) from None


def refuse_overflow(name: str, array: Array) -> None:
    """Refuse entries so large that products of a few of them are infinite."""
    largest = max(array.max(), -array.min()) if array.size else 0.0
    if largest > LARGEST:
        raise _out_of_reach(name, largest)


def refuse_vanishing(name: str, array: Array) -> None:
    """Refuse columns so small altogether that products of their entries are zero."""
    if array.size:
        largest = np.maximum(array.max(axis=0), -array.min(axis=0))
        vanishing = (largest > 0.0) & (largest < SMALLEST)
        if vanishing.any():
            raise _out_of_reach(name, np.extract(vanishing, largest)[0])


def _out_of_reach(name: str, size: float) -> ValueError:
    return ValueError(
        f"{name} has a column of values up to {size:.1e}, whose products are lost in double "
        f"precision; give it in units in which the largest lie between {SMALLEST:g} and "
        f"{LARGEST:g}."
    )


def plain_array(name: str, values: object) -> NDArray:
    """The values as an array of any kind, dense and with nothing masked."""
    if issparse(values):
        raise TypeError(f"{name} is sparse, but dense data is required; give {name}.toarray().")
    if np.ma.is_masked(values):
        raise ValueError(f"{name} has masked entries; leave those rows out, or fill the entries.")
    try:
        return np.asarray(values)
    except (ValueError, TypeError):
        raise ValueError(
            f"{name} has rows of different lengths; give a table with as many columns in each row."
        ) from None


def _are_of_one_kind(array: NDArray) -> bool:
    """Whether entries can be sorted: all text, or all numbers that equal themselves."""
    texts = [isinstance(entry, str) for entry in array]
    if any(texts):
        return all(texts)
    return all(isinstance(entry, Real) and entry == entry for entry in array)
