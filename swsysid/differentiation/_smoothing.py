"""Linear smoothers of one trajectory: local polynomials, a zero-phase low-pass, PySINDy's.

A smoother maps ``(x, t, rows)``, of shapes (n_samples, n_columns), (n_samples,) and (n_rows,), to
its jets, an array (3, n_kept, n_columns) of values, first and second derivatives, and to the
number of rows it trims at either end, where its estimates would be one-sided. The rows kept are
those of `rows` that are not trimmed; `rows` increase, and None asks for all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, oaconvolve, sosfiltfilt
from scipy.special import comb

from swsysid._checks.parameters import shown

# Relative deviation of the steps up to which sampling counts as even, and of a line's slope up to
# which the times are known.
EVEN = 1e-3

# A longer gap, in median steps, is not one trajectory any more
LARGEST_GAP = 20.0

_ROWS_AT_A_TIME = 20_000  # smoothed, which bounds the memory

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Smoother = Callable[[Array, Array, Rows | None], tuple[Array, int]]

_FACTORIALS = np.array([1.0, 1.0, 2.0])


class TooShortError(ValueError):
    """A trajectory has fewer samples than the smoother needs."""

    def __init__(self, needed: int, got: int):
        super().__init__(
            f"has {got} samples and this differentiation needs {needed}; use a smaller window or "
            "a higher cutoff, or leave it out."
        )


def _inner(rows: Rows | None, n_samples: int, trim: int) -> Rows:
    """The rows that are not trimmed."""
    if rows is None:
        return np.arange(trim, n_samples - trim)
    return rows[(rows >= trim) & (rows < n_samples - trim)]


# --- local polynomials ------------------------------------------------------------------------


def local_polynomial(window: int, degree: int) -> Smoother:
    """Least-squares polynomials over `window` samples; on even times, Savitzky and Golay's."""
    half = window // 2
    # Weights of the samples on even times, half a window being the unit of time: the k-th
    # derivative at the centre is k! times the k-th coefficient of the polynomial.
    offsets = np.linspace(-1.0, 1.0, window)[:, None] ** np.arange(degree + 1)
    weights = _FACTORIALS[:, None] * np.linalg.pinv(offsets)[:3]

    def smooth(x, t, rows=None):
        if len(x) < window:
            raise TooShortError(window, len(x))
        kept = _inner(rows, len(x), half)
        even, step = _even_windows(np.diff(t), window)
        powers = (step * half) ** np.arange(3)[:, None]
        jets = np.empty((3, len(kept), x.shape[1]))
        for start, stop in _stretches(kept, even[kept - half]):
            first, last = kept[start], kept[stop - 1] + 1
            if even[first - half]:
                part = _filtered(x[first - half : last + half], weights / powers)
            else:
                part = _fitted(x, t, first, last, window, degree)
            jets[:, start:stop] = part
        return jets, half

    return smooth


def _stretches(rows: Rows, even: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    """Parts of `rows` that follow each other and are all even or all uneven, of bounded length."""
    full = np.arange(1, len(rows)) % _ROWS_AT_A_TIME == 0
    new = (np.diff(rows) != 1) | (np.diff(even) != 0) | full
    cuts = [0, *(np.flatnonzero(new) + 1).tolist(), len(rows)]
    yield from ((start, stop) for start, stop in pairwise(cuts) if stop > start)


def _even_windows(steps: Array, window: int) -> tuple[NDArray[np.bool_], float]:
    """Which windows have even times, and their step.

    A sample that is missing makes the windows around it uneven, not the whole trajectory.
    """
    usual = np.median(steps)
    odd = np.abs(steps - usual) > EVEN * usual
    count = np.concatenate([[0], np.cumsum(odd)])
    even = count[window - 1 :] == count[: len(count) - window + 1]
    return even, float(steps[~odd].mean()) if even.any() else float(usual)


def _filtered(x: Array, weights: Array) -> Array:
    """Jets of all windows from one set of weights."""
    # Without the mean the rounding of the Fourier transforms is relative to what varies.
    mean = x.mean(axis=0)
    jets = oaconvolve((x - mean)[None], weights[:, ::-1, None], mode="valid", axes=1)
    jets[0] += mean
    return jets


def _fitted(x: Array, t: Array, first: int, last: int, window: int, degree: int) -> Array:
    """Jets at the rows from `first` up to `last`, each window fitted on its own times.

    The normal equations of a window are sums of powers of its times. They are differences of
    running sums over blocks half a window long, so that the work does not grow with the window,
    and are then moved from the middle of the block to the row.
    """
    half, block = window // 2, window // 2 + 1
    starts = np.arange(first, last, block)
    # The last block reaches back rather than beyond the rows.
    starts[-1] = max(min(starts[-1], last - block), first)
    block = min(block, last - first)
    rows = starts[:, None] + np.arange(-half, block + half)
    times = t[rows] - t[starts, None]
    middle = (times[:, :1] + times[:, -1:]) / 2
    scale = (times[:, -1:] - times[:, :1]) / 2
    offsets = (times - middle) / scale
    level = x[rows].mean(axis=1, keepdims=True)
    powers = offsets[..., None] ** np.arange(2 * degree + 1)
    products = powers[..., : degree + 1, None] * (x[rows] - level)[..., None, :]
    centres = offsets[:, half : half + block]
    moments = _moved(_window_sums(powers, window), centres)
    right = _moved(_window_sums(products, window), centres)
    hankel = moments[..., np.add.outer(np.arange(degree + 1), np.arange(degree + 1))]
    coefficients = np.linalg.solve(hankel, right)[..., :3, :]
    factors = _FACTORIALS / scale ** np.arange(3)
    jets = coefficients * factors[:, None, :, None]
    jets[..., 0, :] += level
    found = np.empty((last - first, *jets.shape[2:]))
    found[(starts[:, None] + np.arange(block) - first).ravel()] = jets.reshape(-1, *jets.shape[2:])
    return found.swapaxes(0, 1)


def _window_sums(values: Array, window: int) -> Array:
    """Sums over the windows of each block, along the second axis."""
    running = np.cumsum(values, axis=1)
    sums = running[:, window - 1 :].copy()
    sums[:, 1:] -= running[:, :-window]
    return sums


def _moved(sums: Array, centres: Array) -> Array:
    """Sums of powers of ``offset - centre`` from those of ``offset``, by the binomial theorem."""
    n_powers = sums.shape[2]
    moved = np.zeros_like(sums)
    shape = centres.shape + (1,) * (sums.ndim - 3)
    for power in range(n_powers):
        for lower in range(power + 1):
            factor = comb(power, lower, exact=True) * (-centres) ** (power - lower)
            moved[:, :, power] += factor.reshape(shape) * sums[:, :, lower]
    return moved


# --- filters ----------------------------------------------------------------------------------


def low_pass(cutoff: float) -> Smoother:
    """Fourth-order Butterworth forward and backward, then central differences."""

    def smooth(x, t, rows=None):
        if len(x) < 9:
            raise TooShortError(9, len(x))
        steps = np.diff(t)
        if np.ptp(steps) > EVEN * steps.mean():
            raise ValueError(
                'method="butterworth" needs evenly spaced times; use "savitzky_golay", which '
                "fits on the actual ones."
            )
        step = (t[-1] - t[0]) / (len(t) - 1)
        if not 0 < cutoff * step < 0.5:
            raise ValueError(
                f"cutoff={cutoff:g} must lie between 0 and half the sampling rate, {0.5 / step:g}."
            )
        sections = butter(4, 2.0 * cutoff * step, output="sos")
        # The slowest pole has decayed to one per cent after 1.9 / cutoff: what lies nearer to an
        # end depends on how the signal was continued beyond it.
        trim = int(np.ceil(2.0 / (cutoff * step))) + 2
        if len(x) <= 2 * trim:
            raise TooShortError(2 * trim + 1, len(x))
        values = sosfiltfilt(sections, x, axis=0)
        first = np.gradient(values, step, axis=0)
        second = np.gradient(first, step, axis=0)
        return np.stack([values, first, second])[:, _inner(rows, len(x), trim)], trim

    return smooth


def external(differentiator) -> Smoother:
    """A PySINDy differentiator; its values within two samples of an end are one-sided."""

    def smooth(x, t, rows=None):
        if len(x) < 5:
            raise TooShortError(5, len(x))
        try:
            first = np.asarray(differentiator(x, t), dtype=float)
        except TypeError as error:
            raise TypeError(
                f"method={shown(differentiator)} must be a differentiator, called as method(x, t)."
            ) from error
        values = np.asarray(getattr(differentiator, "smoothed_x_", x), dtype=float)
        second = np.asarray(differentiator(first, t), dtype=float)
        return np.stack([values, first, second])[:, _inner(rows, len(x), 2)], 2

    return smooth
