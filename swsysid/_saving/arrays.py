"""Arrays as JSON, every bit kept, and read back without trusting what is said about them."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["array_of", "json_of_array", "json_of_float"]

_SHORT = 100  # entries; longer arrays are not for reading
_KINDS = "biufU"  # truth values, whole and floating-point numbers, fixed-length texts


def json_of_float(value: float) -> float | dict[str, str]:
    """A number that JSON knows, or its name; reading the digits gives the same bits back.

    Examples
    --------
    >>> json_of_float(0.1), json_of_float(float("-inf"))
    (0.1, {'float': '-inf'})
    """
    return value if math.isfinite(value) else {"float": repr(value)}


def json_of_array(values: NDArray) -> dict[str, Any]:
    """An array with its type and shape: its entries if it is short, else its bytes in base 64.

    Raises
    ------
    TypeError
        If it holds anything but numbers and text.

    Examples
    --------
    >>> json_of_array(np.array([[1.0, 2.5]]))
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
    told = {"type": ordered.dtype.str, "shape": shape}
    is_number = values.dtype.kind in "biuf"
    if ordered.size <= _SHORT and (not is_number or bool(np.isfinite(ordered).all())):
        return {"array": ordered.ravel().tolist(), **told}
    return {"bytes": base64.b64encode(ordered.tobytes()).decode("ascii"), **told}


def array_of(told: dict[str, Any]) -> NDArray:
    """The array of a JSON object.

    Raises
    ------
    ValueError, TypeError, KeyError
        If its entries, its type and its shape do not belong together.
    """
    shape = tuple(told["shape"])
    if not all(type(length) is int and length >= 0 for length in shape):
        raise ValueError(f"the shape {shape} of an array")
    if told["type"] == "object":
        if not all(type(entry) is str for entry in told["array"]):
            raise ValueError("an array of text with other entries")
        values = np.empty(len(told["array"]), dtype=object)
        values[:] = told["array"]
        return values.reshape(shape)
    dtype = np.dtype(str(told["type"]))
    if dtype.kind not in _KINDS:
        raise ValueError(f"the type {told['type']} of an array")
    if "bytes" in told:
        values = np.frombuffer(base64.b64decode(told["bytes"], validate=True), dtype=dtype)
    else:
        values = np.array(told["array"], dtype=dtype)
    # a copy, since what lies over bytes cannot be written to
    return values.reshape(shape).astype(dtype.newbyteorder("="))
