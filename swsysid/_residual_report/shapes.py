"""The shape of a dependence in a few words: a line, a step, a curve."""

from __future__ import annotations

import numpy as np

from swsysid._residual_report.channels import best_step
from swsysid._residual_report.settings import SETTINGS, Settings
from swsysid._results import Array

__all__ = ["describe", "rounded"]


def describe(
    name: str, coordinate: Array, values: Array, share: float, settings: Settings = SETTINGS
) -> str:
    """A few words on how `values` depend on a coordinate, empty if no simple shape fits.

    `share` is the share of the variance of `values` that any function of the coordinate explains;
    a line, a step and a parabola are measured against it.
    """
    known = np.isfinite(coordinate)
    order = np.argsort(coordinate[known], kind="stable")
    x, y = coordinate[known][order], values[known][order] - values[known].mean()
    total = float(y @ y)
    if total == 0.0 or x[0] == x[-1] or share <= 0.0:
        return ""
    z = (x - x.mean()) / x.std()
    line = float(z @ y) / len(z)
    step, place = best_step(x, y)
    kink, other = best_step(x, y - line * z, z)
    simple = {"line": len(z) * line**2 / total, "step": step / total}
    both = {
        "step and line": simple["line"] + kink / total,
        "parabola": _parabola(z, y) / total,
    }
    direction = "rising" if line > 0 else "falling"
    words = {
        "line": f"{direction} in a line",
        "step": f"a step at {name}={rounded(place, x, settings)}",
        "step and line": f"a step at {name}={rounded(other, x, settings)} and a line",
        "parabola": "a parabola",
    }
    for shapes in (simple, both):
        best = max(shapes, key=lambda shape: shapes[shape])
        if shapes[best] >= settings.named_shape * share:
            return words[best]
    return "a curve"


def _parabola(z: Array, y: Array) -> float:
    design = np.polynomial.polynomial.polyvander(z, 2)
    fit = design @ np.linalg.lstsq(design, y, rcond=None)[0]
    return float(fit @ fit)


def rounded(place: float, x: Array, settings: Settings = SETTINGS) -> str:
    """A threshold with the digits that its neighbours deserve."""
    low, high = np.quantile(x, [0.05, 0.95])
    if low == high:  # nearly all rows have one value, as of a switch that is hardly ever on
        low, high = x[0], x[-1]
    digits = int(np.ceil(-np.log10((high - low) / 20.0)))
    rounded = round(place, digits) + 0.0
    if digits > settings.most_digits or abs(rounded) >= 10.0**settings.most_digits:
        return f"{rounded:.3g}"
    return f"{rounded:.{max(digits, 0)}f}"
