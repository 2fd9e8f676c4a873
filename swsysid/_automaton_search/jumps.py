r"""Where the state of a recording jumps, before any law is known.

Two parabolas, one through the samples before an interval and one through those after it, meet in
its middle. Where the state goes on, a kink anywhere in the interval leaves at most
:math:`\tfrac12 \Delta t\, |\Delta \dot x|` between them; what they miss each other by beyond that,
beyond noise and beyond what the parabolas themselves leave over, is a jump.

A speed of which only the position is measured turns the position. Through the samples on both sides
of an interval goes

.. math:: q(t) = \sum_{k \le 4} a_k t^k + \theta(t)\, (s + d\, t + \tfrac12 b\, t^2) ,

where b is what a switch does, s says where in the interval it happens, and d is the jump.

Where samples are many for what moves, d drowns in their noise: means of 2, 4, 8, ... neighbours are
asked as well, as long as a recording has enough of them. A kink is seen in them ever more clearly.
A short contact, which is as good as one in some of them, is not in those of half as many.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d
from scipy.stats import chi2

from swsysid._automaton_search.settings import SETTINGS
from swsysid._data.recordings import Record
from swsysid._results import Array
from swsysid._stays.given import FEWEST_SAMPLES, Given
from swsysid._stays.pieces import jumps_at_events, noise_between_events
from swsysid._stays.settings import LIMITS

# Samples to each side that tell where a state was going; by how many intervals a kink may lead
# astray (a half, and rounding); quantiles of slopes that a state may have; how far beyond curvature
# it must land: extrapolated by half an interval, the cubic part of a motion is six times what a
# parabola through five samples leaves, on both sides together.
_SIDES = (5, 9, 15)
_KINK = 0.55
_USUAL = (0.05, 0.95)
_BEYOND_CURVATURE = 12.0
# Of a turn, coefficients that both sides share, and the quantile of noise up to which they follow;
# what one about a sample counts beside one in an interval, which it otherwise is as well.
_SHARED, _FOLLOWS, _ABOUT = 5, 0.9999, 0.5
# Of accelerations, what is usual: a record may rest for half of its time.
_USUAL_MOTION = 0.75
_AT_ONCE = 10_000  # intervals that are worked at once

FEWEST_AROUND = 2 * _SIDES[0]  # samples on both sides of a jump of all states


def jumps_of(given: Given) -> list[NDArray[np.intp]]:
    """Of each recording the samples after which its state jumps."""
    noise, found = noise_between_events(given), []
    for record, known in zip(given.records, jumps_at_events(given, noise), strict=True):
        # whether it jumps at an event its limits tell, and beside one they hide what parabolas see
        own = _jumps_of(record, noise, given.n_positions)
        apart = np.abs(own[:, None] - record.events).min(axis=1, initial=len(record.t))
        found.append(np.union1d(known, own[apart >= _SIDES[0]]).astype(np.intp))
    return found


def restarts_of(given: Given, *, are_positions: bool) -> list[NDArray[np.intp]]:
    """Of each recording the samples after which all that was measured jumps at once.

    A plant resets a speed; where its positions jump as well, someone began anew. A single state
    that is no position may be reset.
    """
    noise, width = noise_between_events(given), _SIDES[0]
    found = []
    for record in given.records:
        certain = np.zeros(len(record.t) - 1)
        if (given.n_channels > 1 or are_positions) and len(record.t) >= FEWEST_AROUND:
            inside = slice(width - 1, len(record.t) - width)
            certain[inside] = _excess(record, noise, width).min(axis=1)
        # beside a jump parabolas miss each other by less
        highest = maximum_filter1d(certain, FEWEST_AROUND - 1)
        found.append(np.flatnonzero((certain > 1.0) & (certain == highest)))
    return found


def without_impacts(given: Given, jumps: Sequence[NDArray[np.intp]]) -> Given:
    """Positions without those that were measured while the speed jumped: an impact lasts.

    A sample beside a jump is left out where the parabola of the next ones inside does not lead to
    it. What the parabolas of all jumps leave of their samples tells the noise.
    """
    count, sides = given.n_positions, []
    for number, (record, cuts) in enumerate(zip(given.records, jumps, strict=True)):
        ends = np.concatenate([[-1], cuts, [len(record.t) - 1]])
        for first, last in pairwise(ends.tolist()):
            inside = np.arange(first + 1, last + 1)
            if len(inside) > _SIDES[0]:
                sides += [(number, inside[:6])] * (first >= 0)
                sides += [(number, inside[-6:][::-1])] * (last < len(record.t) - 1)
    if not sides:
        return given
    t = np.array([given.records[k].t[rows] for k, rows in sides])
    y = np.array([given.records[k].filled[rows, :count].T for k, rows in sides])
    value, _, left, gain = _parabolas(t[:, 1:], y[:, :, 1:], t[:, 0])
    squares = np.square(left).sum(axis=2)
    noise = np.sqrt(np.median(squares, axis=0) / chi2.median(left.shape[2] - 3))
    allowed = SETTINGS.beyond_noise * np.sqrt(1.0 + gain)[:, None] * noise
    records = list(given.records)
    for (number, rows), off in zip(sides, np.abs(y[:, :, 0] - value) > allowed, strict=True):
        kept = records[number].y.copy()
        kept[rows[0], :count][off] = np.nan
        records[number] = replace(records[number], y=kept)
    return replace(given, records=records)


def _jumps_of(record: Record, noise: Array, n_positions: int) -> NDArray[np.intp]:
    """Intervals of one recording in which it jumps, the most certain of each neighbourhood."""
    n = len(record.t)
    certain = np.zeros(n - 1)
    nearest = FEWEST_SAMPLES if n_positions else _SIDES[0]
    for width in _SIDES:
        if n >= 2 * width:
            inside = slice(width - 1, n - width)
            missed = _excess(record, noise, width).max(axis=1)
            certain[inside] = np.maximum(certain[inside], missed)
            if n_positions:
                y = record.filled[:, :n_positions]
                turns = _turns(record.t, y, noise[:n_positions], width)
                certain[inside] = np.maximum(certain[inside], turns)
    if n > 2 * _SIDES[0]:
        last = _excess_at_end(record.t, record.filled, noise)
        first = _excess_at_end(-record.t[::-1], record.filled[::-1], noise)
        certain[n - 1 - len(last) :], certain[: len(first)] = last, first[::-1]
    beyond = np.flatnonzero(certain > 1.0).tolist()
    of_samples = [(float(certain[place]), place, nearest) for place in beyond]
    found: list[int] = []
    for _, place, reach in sorted(of_samples, key=lambda one: -one[0]) + _turns_of_means(
        record.t, record.filled[:, :n_positions], noise[:n_positions]
    ):
        if all(abs(place - other) >= reach for other in found):
            found.append(place)
    return np.sort(np.array(found, dtype=np.intp))


def _turns_of_means(t: Array, y: Array, noise: Array) -> list[tuple[float, int, int]]:
    """Where means of neighbouring samples turn: how certainly, after which sample, and their reach.

    The most certain first. Those of half as many neighbours turn there too, and say more closely
    where; within the reach of one that is more certain they turn because of that one.
    """
    width, count = _SIDES[-1], 1
    found: list[tuple[float, int, int]] = []
    before, finer = np.zeros(0, dtype=np.intp), np.zeros(0)
    while y.shape[1] and len(t) >= 2 * width * count:
        n = len(t) // count
        times, values = (
            one[: n * count].reshape(n, count, -1).mean(axis=1) for one in (t[:, None], y)
        )
        certain = _turns(times[:, 0], values, noise / np.sqrt(count), width, smooth=True)
        places = (np.arange(len(certain)) + width) * count - 1
        for k in np.flatnonzero(certain > 1.0):
            near = np.flatnonzero((np.abs(before - places[k]) <= 2 * count) & (finer > 1.0))
            if near.size:
                places[k] = before[near[finer[near].argmax()]]
                found.append((float(certain[k]), int(places[k]), width * count))
        before, finer, count = places, certain, 2 * count
    return sorted(found, key=lambda one: -one[0])


def _excess_at_end(t: Array, y: Array, noise: Array) -> Array:
    """The same in the last intervals, after which there are too few samples for a parabola.

    The slope after the interval is that of the next sample, or for the very last one any that is
    usual in the recording.
    """
    width = _SIDES[0]
    slopes = np.diff(y, axis=0) / np.diff(t)[:, None]
    usual = np.quantile(slopes, _USUAL, axis=0)
    excess = np.zeros(width - 1)
    for place in range(width - 1):
        k = len(t) - width + place  # the last sample before the interval
        before = slice(k - width + 1, k + 1)
        value, slope, left, gain = _parabolas(
            t[None, before], y[None, before].transpose(0, 2, 1), t[None, k + 1]
        )
        after = slopes[k + 1 : k + 2] if k + 2 < len(t) else usual
        turned = np.abs(after - slope).max(axis=0)
        apart = np.abs(y[k + 1] - value[0]) - 2.0 * _KINK * (t[k + 1] - t[k]) * turned
        allowed = SETTINGS.beyond_noise * np.sqrt(gain + 1.0) * noise
        most = np.abs(left[0]).max(axis=1)
        allowed = allowed + _BEYOND_CURVATURE * most + np.finfo(float).tiny
        excess[place] = (apart / allowed).max()
    return excess


def _excess(record: Record, noise: Array, width: int) -> Array:
    """By how much both sides of an interval miss each other, in units of what they may.

    Shape (n_intervals, n_channels).
    """
    t, y = record.t, record.filled
    windows, values = sliding_window_view(t, width), sliding_window_view(y, width, axis=0)
    middles = 0.5 * (t[width - 1 : len(t) - width] + t[width : len(t) - width + 1])
    n = len(middles)
    left = _parabolas(windows[:n], values[:n], middles)
    right = _parabolas(windows[width : width + n], values[width : width + n], middles)
    durations = (t[width : len(t) - width + 1] - t[width - 1 : len(t) - width])[:, None]
    apart = np.abs(right[0] - left[0]) - _KINK * durations * np.abs(right[1] - left[1])
    of_noise = SETTINGS.beyond_noise * np.sqrt(left[3] + right[3])[:, None] * noise
    most = np.maximum(*(np.abs(side[2]).max(axis=2) for side in (left, right)))
    of_curvature = _BEYOND_CURVATURE * most
    return np.asarray(apart / (of_noise + of_curvature + np.finfo(float).tiny))


def _turns(t: Array, y: Array, noise: Array, width: int, *, smooth: bool = False) -> Array:
    """By how much positions turn in an interval, in units of what they may.

    Or about the sample after it, where they turn far more: that may belong to neither side. With
    `smooth` they do not where a polynomial of as many terms is as good, which few samples cannot
    tell.
    """
    n = len(t) - 2 * width + 1
    turned, sides = np.zeros(n), np.arange(2 * width)
    for share, samples in ((1.0, sides), (_ABOUT, sides + (sides >= width))):
        length = int(samples[-1]) + 1
        if length > len(t):
            break
        times, values = sliding_window_view(t, length), sliding_window_view(y, length, axis=0)
        parts = [slice(k, k + _AT_ONCE) for k in range(0, len(times), _AT_ONCE)]
        found = [
            _turn(times[own][:, samples], values[own][:, :, samples], noise, smooth=smooth)
            for own in parts
        ]
        if not found:
            continue
        jumps, errors, moves = (np.concatenate(one) for one in zip(*found, strict=True))
        # a motion that comes to rest, or whose law switches somewhere in the interval, changes its
        # speed by no more than a usual acceleration does in an interval
        follows = np.isfinite(moves)
        usual = np.nanquantile(moves, _USUAL_MOTION, axis=0) if follows.any(axis=0).all() else 0.0
        duration = times[:, samples[width]] - times[:, samples[width - 1]]
        beyond = np.maximum(jumps - duration[:, None] * usual, 0.0)
        own = np.where(follows, beyond / errors / SETTINGS.beyond_noise, 0.0).max(axis=1)
        turned[: len(own)] = np.maximum(turned[: len(own)], share * own)
    return turned


def _turn(t: Array, values: Array, noise: Array, *, smooth: bool) -> tuple[Array, Array, Array]:
    """Jumps of the speed amid windows, their errors, and accelerations before, NaN if none follows.

    A window that leaves more than noise is another motion, or turns elsewhere.
    """
    width = t.shape[1] // 2
    at, unit = 0.5 * (t[:, width - 1] + t[:, width]), (t[:, -1] - t[:, 0])[:, None]
    since = (t - at[:, None]) / unit
    after = np.where(since > 0.0, 1.0, 0.0)[:, :, None] * since[:, :, None] ** np.arange(3)
    basis = np.concatenate([since[:, :, None] ** np.arange(_SHARED), after], axis=2)
    if np.ptp(since, axis=0).max() <= LIMITS.exactly:  # windows of equal steps share one inverse
        since, basis = since[:1], basis[:1]
    inverse = np.linalg.pinv(basis)
    coef = np.matmul(values, inverse.transpose(0, 2, 1))
    left = values - np.matmul(coef, basis.transpose(0, 2, 1))
    freedom, speed = left.shape[2] - basis.shape[2], _SHARED + 1
    follows = np.square(left / noise[:, None]).sum(axis=2) <= chi2.ppf(_FOLLOWS, freedom)
    errors = noise * np.sqrt(np.square(inverse[:, speed]).sum(axis=1))[:, None] / unit
    jumps = np.abs(coef[:, :, speed]) / unit
    if smooth:
        rival = np.linalg.qr(since[:, :, None] ** np.arange(basis.shape[2]))[0]
        of_rival = values - np.matmul(np.matmul(values, rival), rival.transpose(0, 2, 1))
        gained = (np.square(of_rival) - np.square(left)).sum(axis=2) / np.square(noise)
        jumps = np.where(gained > SETTINGS.beyond_noise**2, jumps, 0.0)
    accelerations = np.where(follows, 2.0 * np.abs(coef[:, :, 2]) / np.square(unit), np.nan)
    return jumps, errors, accelerations


def _parabolas(t: Array, values: Array, at: Array) -> tuple[Array, Array, Array, Array]:
    """Values and slopes of parabolas at some times, what they leave, and how noise enters.

    Shapes: t (n, width), values (n, n_channels, width), at (n,).
    """
    unit = (t[:, -1] - t[:, 0])[:, None]
    offsets = (t - at[:, None]) / unit
    basis = offsets[:, :, None] ** np.arange(3)
    inverse = np.linalg.pinv(basis)
    coef = np.matmul(values, inverse.transpose(0, 2, 1))
    left = values - np.matmul(coef, basis.transpose(0, 2, 1))
    return coef[..., 0], coef[..., 1] / unit, left, np.square(inverse[:, 0]).sum(axis=1)
