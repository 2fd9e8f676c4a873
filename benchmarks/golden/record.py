"""What is kept of an answer: few digits, in plain lists."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from benchmarks.results import measured_here

__all__ = ["ALIKE", "answered", "estimate", "fingerprint", "short", "took", "yardstick"]

Found = TypeVar("Found")
DIGITS = 6  # significant ones
ALIKE = 0.98  # balanced accuracy of modes that are right


def answered(
    cell: list,
    data: object,
    identify: Callable[[], Found],
    kept: Callable[[Found], dict],
    refusals: tuple[type[Exception], ...] = (ValueError,),
) -> dict:
    """The record of a cell: CPU seconds of ``identify``, and what is kept of what it finds.

    ``data`` is what was identified from: its fingerprint tells data that changed from answers that
    did. A refusal in words is an answer, too.
    """
    one = {"cell": cell, "commit": measured_here()["commit"], "data": fingerprint(data)}
    unit, began = yardstick(), time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            found = identify()
        except refusals as refusal:
            told = {"refused": f"{type(refusal).__name__}: {refusal}", "right": False}
            return one | took(time.process_time() - began, unit) | told
        one |= took(time.process_time() - began, unit)
        one |= kept(found)
    one["figures"] = {name: short([value])[0] for name, value in one["figures"].items()}
    return one


def yardstick() -> float:
    """CPU seconds of a small task, by which those of other machines and loads are told.

    It calls NumPy on a dozen rows, as an identification does; cores that are shared slow both down.
    """
    rows, matrix = np.ones((12, 6)), np.full((6, 6), 0.1)
    times = []
    for _ in range(5):
        began = time.process_time()
        for _ in range(4000):
            rows = np.tanh(rows @ matrix) + 0.1
        times.append(time.process_time() - began)
    return min(times)


def took(seconds: float, unit: float) -> dict[str, float]:
    """CPU seconds of an answer, and those of the yardstick beside it, of which some are before."""
    return {"seconds": round(seconds, 2), "unit": round(0.5 * (unit + yardstick()), 5)}


def estimate(values, errors=None) -> dict[str, list]:
    """Numbers with their standard errors, row after row; none are known where they are missing."""
    kept = {"value": short(np.ravel(values))}
    return kept if errors is None else kept | {"error": short(np.ravel(errors), 2)}


def short(values, digits: int = DIGITS) -> list[float | None]:
    """Numbers with so many significant digits; infinite ones and NaN as None."""
    return [float(f"{x:.{digits}g}") if np.isfinite(x) else None for x in np.ravel(values)]


def fingerprint(data) -> list[float]:
    """How many numbers there are, and their root mean square; nothing of none."""
    values = np.ravel(np.asarray(data, dtype=float))
    if not len(values):
        return []
    return [len(values), *short([np.sqrt(np.mean(values**2))])]
