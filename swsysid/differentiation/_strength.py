r"""How strongly to smooth: the window or the cut-off with the least error of the derivative.

A smoother with derivative kernel :math:`d_w` has variance :math:`\sigma^2\|d_w\|^2`, known once
the noise :math:`\sigma` is; its bias is estimated by how far it departs from every weaker smoother
beyond what noise explains (Goldenshluger and Lepski, Annals of Statistics 39, 2011). Both are
means over the rows of all trajectories, so that their order does not matter.

Differentiators of others may count samples where they should read the times. Many of PySINDy's
smooth over a number of samples as if these were evenly spaced, and divide by the actual steps
afterwards. One that reads the times gives a straight line its slope. How wrong another one is
depends on the times and on the signal, so it is measured: on a smooth curve through the
measurements, whose derivative is known.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from swsysid._checks.parameters import shown
from swsysid._results import IdentificationWarning
from swsysid.differentiation._noise import is_rounding, noise_in, unrounded
from swsysid.differentiation._smoothing import (
    EVEN,
    Array,
    Smoother,
    TooShortError,
    external,
    local_polynomial,
    low_pass,
)

# Strengths to choose from, each about 1.4 times the one before it.
WINDOWS = (
    *(7, 9, 11, 15, 21, 29, 41, 57, 81, 115, 163, 231, 327, 463, 655, 927, 1311, 1855, 2623),
    *(3711, 5247, 7419, 10493),
)

_LOST = 0.25  # share of the rows that the ends of a window may cost

# Of the sampling rate.
_CUTOFFS = (*(0.4, 0.28, 0.2, 0.14, 0.1, 0.07, 0.05, 0.035, 0.025, 0.0175, 0.0125),)
# Rows that decide, and rows of one trajectory that decide side by side; more say the same.
_ROWS = 50_000
_STRETCH = 1_000
# Noise explains a departure up to this over the root of the number of rows, relative to it: the
# estimated variance of the noise and the departure itself are uncertain by about five.
_DOUBT = 10.0
# Of rounding, which is white noise only nearly: so many times as much, in comparisons with
# smoothers of up to so many times the variance. Beyond, as much as errors of half a quantum make at
# most: the squared sum of what they are weighted by, over the sum of squares, times (1/2)^2 * 12.
_ROUNDING_MARGIN = 1.7
_ROUNDING_REACH = 30.0
_ROUNDING_AT_MOST = 3.0
# An error that grows by less than a tenth is not worth a warning.
_NOTICED = 1.1

Part = tuple[Array, Array]  # measured columns and times of one trajectory


@dataclass(frozen=True)
class Strength:
    """A smoother and the number that says how strong it is."""

    smoother: Smoother
    window: int | None = None  # samples of a local polynomial
    cutoff: float | None = None  # of a low-pass, in the inverse unit of the times


def strengths(
    method: str | object,
    times: Sequence[Array],
    window: int | None,
    degree: int,
    cutoff: float | None,
    decimate: int,
    may_drop: bool,
) -> list[Strength]:
    """The smoothers to choose from, weak to strong; one where the user chose.

    The options are those of `differentiate`, `times` those of each trajectory, which may be left
    out if they are shorter than a window and `may_drop`.
    """
    if callable(method) and not isinstance(method, type):
        return [Strength(external(method))]
    name = method if isinstance(method, str) else None
    if name == "finite_difference":
        # The parabola through three neighbours: central differences, correct on uneven times.
        return [Strength(local_polynomial(3, 2))]
    lengths = np.array([len(t) for t in times])
    if name == "savitzky_golay":
        least = max(degree + 2, 2 * decimate + 1)
        wide = [w for w in WINDOWS if w >= least]
        windows = [w for w in wide if _is_affordable(w, lengths, may_drop)]
        smallest = min(wide, default=least + 1 - least % 2)
        chosen = [window] if window else windows or [smallest]
        return [Strength(local_polynomial(w, degree), window=w) for w in chosen]
    if name == "butterworth":
        steps = np.concatenate([np.diff(t) for t in times])
        rate = 1.0 / float(np.median(steps)) if len(steps) else 1.0
        fine = [c for c in _CUTOFFS if c <= 0.5 / decimate]
        affordable = [c for c in fine if _is_affordable(8.0 / c, lengths, may_drop)]
        cutoffs = [c * rate for c in affordable] or [0.4 * rate / decimate]
        return [Strength(low_pass(c), cutoff=c) for c in ([cutoff] if cutoff else cutoffs)]
    raise ValueError(
        f"method={shown(method)} is unknown; choose savitzky_golay, butterworth, "
        "finite_difference, or pass a PySINDy differentiator."
    )


def _is_affordable(window: float, lengths: NDArray[np.intp], may_drop: bool) -> bool:
    """Whether the ends of a window cost few enough rows, of short trajectories all of them."""
    if not may_drop:
        return bool(window <= _LOST * lengths.min())
    return bool(np.minimum(lengths, window).sum() <= _LOST * lengths.sum())


# --- the least risk ---------------------------------------------------------------------------


def strongest(
    candidates: Sequence[Strength], parts: Sequence[Part], quantum: Array, order: int
) -> Strength:
    """The smoother, from weak to strong, with the least estimated error of the derivative.

    Each trajectory has a noise of its own; columns are rounded to the quantum where it is not 0.
    """
    if len(candidates) < 2:
        return candidates[0]
    smoothers = [candidate.smoother for candidate in candidates]
    noises = [noise_in([x], quantum, [t]) for x, t in parts]
    totals = _Totals(len(smoothers), is_rounding(np.min(noises, axis=0), quantum))
    alike: dict[bytes, list[tuple]] = {}  # trajectories with the same times are worked as one
    for (x, t, rows), noise in zip(deciding_rows(parts), noises, strict=True):
        own = unrounded(x, noise, quantum), noise**2, t, rows
        alike.setdefault(t.tobytes(), []).append(own)
    for some in alike.values():
        x, variance = np.hstack([one[0] for one in some]), np.sum([one[1] for one in some], axis=0)
        totals.add(smoothers, x, some[0][2], some[0][3], variance, order)
    risks = totals.risks()
    return candidates[int(np.nanargmin(risks))] if np.isfinite(risks).any() else candidates[0]


def deciding_rows(parts: Sequence[Part]) -> Iterator[tuple[Array, Array, NDArray[np.intp]]]:
    """Each trajectory with the rows of it that decide: all, or the middles of its stretches."""
    share = min(1.0, _ROWS / sum(len(t) for _, t in parts))
    for x, t in parts:
        middles = []
        n_stretches = int(np.ceil(share * len(t) / _STRETCH))
        for rows in np.array_split(np.arange(len(t)), n_stretches):
            count = int(np.ceil(share * len(rows)))
            start = (len(rows) - count) // 2
            middles.append(rows[start : start + count])
        yield x, t, np.concatenate(middles)


class _Totals:
    """Sums over trajectories for each pair of a smoother k and a weaker one j.

    Where j is k they are those of the estimates of k themselves.
    """

    def __init__(self, n: int, rounded: NDArray[np.bool_]):
        n_columns = len(rounded)
        # Rounding is white noise only nearly, which tells most in comparisons with the weakest.
        self.rounded = rounded
        self.margin = np.where(rounded, _ROUNDING_MARGIN, 1.0)
        self.rows = np.zeros((n, n))  # at which both estimates exist
        self.departures = np.zeros((n, n, n_columns))  # squared differences of the estimates
        self.explained = np.zeros((n, n, n_columns))  # what noise alone would make of them
        self.at_most = np.zeros((n, n))  # times as much is what rounding can make of them

    def add(self, smoothers, x: Array, t: Array, rows, variance: Array, order) -> None:
        """Add trajectories of the same times, the columns of one after those of the other.

        `variance` is the sum of their noise's; smoothers that do not fit into them have no part.
        """
        count = x.shape[1] // len(variance)
        estimates, trims = [], []
        for smoother in smoothers:
            try:
                estimate, trim = _derivative(smoother, x, t, rows, order)
            except TooShortError:
                break  # stronger ones do not fit either
            estimates.append(estimate)
            trims.append(trim)
        if not estimates:
            return
        kernels = kernels_of(smoothers[: len(estimates)], t, max(trims), order)
        for k, estimate in enumerate(estimates):
            present = np.isfinite(estimate[:, 0])
            for j in range(k + 1):
                weaker, kernel = (estimates[j], kernels[j]) if j < k else (0.0, 0.0)
                squares = np.sum((estimate - weaker)[present] ** 2, axis=0)
                self.rows[k, j] += present.sum() * count
                self.departures[k, j] += squares.reshape(count, -1).sum(axis=0)
                weights = kernels[k] - kernel
                noise = np.sum(weights**2)
                self.explained[k, j] += present.sum() * variance * noise
                most = _ROUNDING_AT_MOST * np.abs(weights).sum() ** 2 / noise
                self.at_most[k, j] = max(self.at_most[k, j], most)

    def risks(self) -> Array:
        """Squared bias plus variance of each smoother, columns in units of their own size."""
        counts = np.diag(self.rows)
        last = np.flatnonzero(counts)[-1] if counts.any() else 0
        size = self.departures[last, last] / max(counts[last], 1.0)
        weight = 1.0 / np.where(size > 0, size, 1.0)
        risks = np.full(len(counts), np.nan)
        for k in np.flatnonzero(counts):
            bias, variance = np.zeros_like(size), self.explained[k, k] / counts[k]
            for j in range(k):
                allowed = self.margin * (1.0 + _DOUBT / np.sqrt(self.rows[k, j]))
                far = self.explained[j, j] > _ROUNDING_REACH * variance * counts[j]
                allowed = np.where(self.rounded & far, self.at_most[k, j], allowed)
                excess = self.departures[k, j] - allowed * self.explained[k, j]
                bias = np.maximum(bias, excess / self.rows[k, j])
            risks[k] = weight @ (bias + variance)
        return risks


def _derivative(smoother, x, t, rows, order) -> tuple[Array, int]:
    """Derivative of order `order` at `rows`, NaN where trimmed."""
    jets, trim = smoother(x, t, rows)
    padded = np.full((len(rows), x.shape[1]), np.nan)
    padded[(rows >= trim) & (rows < len(t) - trim)] = jets[order]
    return padded, trim


def kernels_of(smoothers, t, trim: int, order: int) -> list[Array]:
    """Weights of the samples around the middle of an even grid with the steps of `t`."""
    length = min(len(t), 4 * trim + 3)
    impulse = np.zeros((length, 1))
    impulse[length // 2] = 1.0
    rows = np.arange(length)
    even = (t[-1] - t[0]) / (len(t) - 1) * rows
    return [
        np.nan_to_num(_derivative(smoother, impulse, even, rows, order)[0])
        for smoother in smoothers
    ]


def warn_of_counting(other: Smoother, parts: Sequence[Part], quantum: Array, degree: int) -> None:
    """Say how far a differentiator is off where it counts samples and the times are uneven.

    The most uneven trajectory decides; `degree` is that of the polynomials that know the times.
    """
    uneven = [_unevenness(t) for _, t in parts]
    if max(uneven, default=0.0) <= EVEN:
        return
    x, t = parts[int(np.argmax(uneven))]
    try:
        if _size(other(t[:, None], t, None)[0][1] - 1.0)[0] <= EVEN:
            return
        added, usual = _errors(other, x, t, quantum, degree)
    except TooShortError:
        return
    worst = int(np.argmax(added - usual))
    if np.hypot(added, usual)[worst] > _NOTICED * usual[worst]:
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
