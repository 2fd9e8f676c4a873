"""Differentiators of others that count samples where they should read the times.

Many of PySINDy's smooth over a number of samples as if these were evenly spaced, and divide by the
actual steps afterwards. One that reads the times gives a straight line its slope. How wrong another
one is depends on the times and on the signal, so it is measured: on a smooth curve through the
measurements, whose derivative is known.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from swsysid._results import IdentificationWarning
from swsysid.differentiation._settings import SETTINGS
from swsysid.differentiation._smoothing import Array, Smoother, TooShortError
from swsysid.differentiation._strength import Part, strengths, strongest


def warn_of_counting(other: Smoother, parts: Sequence[Part], quantum: Array, degree: int) -> None:
    """Say how far a differentiator is off where it counts samples and the times are uneven.

    The most uneven trajectory decides; `degree` is that of the polynomials that know the times.
    """
    uneven = [_unevenness(t) for _, t in parts]
    if max(uneven, default=0.0) <= SETTINGS.even:
        return
    x, t = parts[int(np.argmax(uneven))]
    try:
        if _size(other(t[:, None], t, None)[0][1] - 1.0)[0] <= SETTINGS.even:
            return
        added, usual = _errors(other, x, t, quantum, degree)
    except TooShortError:
        return
    worst = int(np.argmax(added - usual))
    if np.hypot(added, usual)[worst] > SETTINGS.noticed * usual[worst]:
        warnings.warn(
            "method counts samples as if the times were even, which they are not: on a smooth "
            f"curve through the measurements its derivative is off by {added[worst]:.2g} of the "
            f"spread of that derivative, beside {usual[worst]:.2g} by smoothing and noise; use "
            'method="savitzky_golay", which fits on the actual times.',
            IdentificationWarning,
            stacklevel=3,
        )


def _unevenness(t: Array) -> float:
    steps = np.diff(t)
    return float(np.ptp(steps) / steps.mean()) if len(steps) else 0.0


def _errors(
    other: Smoother, x: Array, t: Array, quantum: Array, degree: int
) -> tuple[Array, Array]:
    """What counting adds to the error of each column's derivative, and what is there without it.

    Both in units of the spread of the derivative. Without counting there are the error on even
    times, by smoothing, and the noise that is left in the derivative.
    """
    known = strengths("savitzky_golay", [t], None, degree, None, 1, False)
    (values, slopes, _), trim = strongest(known, [(x, t)], quantum, 1).smoother(x, t, None)
    inner = slice(trim, len(t) - trim)
    curve = CubicHermiteSpline(t[inner], values, slopes)
    even = np.linspace(t[inner][0], t[inner][-1], len(values))

    def error(times: Array) -> Array:
        jets, cut = other(curve(times), times, None)
        return _size(jets[1] - curve(times, 1)[cut : len(times) - cut])

    impulse = np.zeros_like(values)
    impulse[len(even) // 2] = 1.0
    kernel = other(impulse, even, None)[0][1]
    noise = np.std(x[inner] - values, axis=0) * np.sqrt(np.nansum(kernel**2, axis=0))
    spread, smoothing = slopes.std(axis=0), error(even)
    unit = np.where(spread > 0.0, spread, 1.0)
    added = np.sqrt(np.maximum(error(t[inner]) ** 2 - smoothing**2, 0.0))
    return added / unit, np.hypot(smoothing, noise) / unit


def _size(values: Array) -> Array:
    """Root mean square of each column, where there is a value."""
    size: Array = np.sqrt(np.nanmean(values**2, axis=0))
    return size
