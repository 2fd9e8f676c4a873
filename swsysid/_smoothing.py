"""Linear smoothers of one trajectory: local polynomials, a zero-phase low-pass, PySINDy's.

A smoother maps ``(x, t)``, of shapes (n_samples, n_columns) and (n_samples,), to its jets, an
array (3, n_kept, n_columns) of values, first and second derivatives, and to the number of rows
it trimmed at either end, where its estimates would be one-sided.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

__all__ = ["Smoother", "TooShortError", "external", "local_polynomial", "low_pass"]

Array = NDArray[np.float64]
Smoother = Callable[[Array, Array], tuple[Array, int]]

EVEN_TOLERANCE = 1e-3  # relative deviation of the steps up to which sampling counts as even


class TooShortError(ValueError):
    """A trajectory has fewer samples than the smoother needs."""

    def __init__(self, needed: int, got: int):
        super().__init__(
            f"has {got} samples and this differentiation needs {needed}; use a smaller window or "
            "a higher cutoff, or leave it out."
        )


def local_polynomial(window: int, degree: int) -> Smoother:
    """Least-squares polynomials over `window` samples; on even times, Savitzky and Golay's."""

    def smooth(x, t):
        if len(x) < window:
            raise TooShortError(window, len(x))
        weights = _polynomial_weights(t, window, degree)
        windows = sliding_window_view(x, window, axis=0)
        # One set of weights serves all windows on an even grid, hence the broadcast.
        jets = np.stack([np.einsum("ncw,nw->nc", windows, w) for w in weights])
        return jets, window // 2

    return smooth


def _polynomial_weights(t: Array, window: int, degree: int) -> Array:
    """Weights of value, first and second derivative, shape (3, n_windows, window)."""
    times = sliding_window_view(t, window)
    count = len(times)
    if _is_even(t):
        step = (t[-1] - t[0]) / (len(t) - 1)
        times = step * np.arange(window)[None]
    offsets = times - times[:, [window // 2]]
    # Offsets scaled to one keep the Vandermonde matrix well conditioned; the k-th derivative at
    # the centre is k! times the k-th coefficient, over the scale to the k.
    scale = np.abs(offsets).max(axis=1, keepdims=True)
    powers = (offsets / scale)[..., None] ** np.arange(degree + 1)
    coefficients = np.linalg.pinv(powers)[:, :3]
    factors = np.array([1.0, 1.0, 2.0]) / scale ** np.arange(3)
    weights = (coefficients * factors[..., None]).swapaxes(0, 1)
    return np.broadcast_to(weights, (3, count, window))


def low_pass(cutoff: float) -> Smoother:
    """Fourth-order Butterworth forward and backward, then central differences."""

    def smooth(x, t):
        if len(x) < 9:
            raise TooShortError(9, len(x))
        if not _is_even(t):
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
        return np.stack([values, first, second])[:, trim:-trim], trim

    return smooth


def external(differentiator) -> Smoother:
    """A PySINDy differentiator; its values within two samples of an end are one-sided."""

    def smooth(x, t):
        if len(x) < 5:
            raise TooShortError(5, len(x))
        first = np.asarray(differentiator(x, t), dtype=float)
        values = np.asarray(getattr(differentiator, "smoothed_x_", x), dtype=float)
        second = np.asarray(differentiator(first, t), dtype=float)
        return np.stack([values, first, second])[:, 2:-2], 2

    return smooth


def _is_even(t) -> bool:
    steps = np.diff(t)
    return bool(np.ptp(steps) <= EVEN_TOLERANCE * steps.mean())
