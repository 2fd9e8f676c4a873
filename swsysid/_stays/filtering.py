r"""Kalman's filter for laws that are known nearly, one interval of many hypotheses at a time.

The state follows the law of its mode but for a small disturbance of its velocity, white with the
spectral density :math:`q^2`, and is measured with white noise:

.. math:: x_{k+1} = F_j(x_k) + w_k, \quad \operatorname{cov} w_k = q^2 \Delta t, \qquad
          y_k = x_k + v_k, \quad \operatorname{cov} v_k = R .

Every hypothesis is near the rough states, around which the flows of all modes through both halves
of all intervals are linear: they are found beforehand, in one pass over the data. In the interval
of a switch the old law may have acted for any part of it, on average for a half. Its velocity
differs from the new one's by :math:`\Delta f`, which adds :math:`(\Delta f \Delta t)^2 / 12` to the
covariance. Where a recording slides along a surface the state is known to lie on it.

Arrays of hypotheses have rows last: means (n_states, ...), covariances (n_states, n_states, ...).
Of these the recordings come last in memory, since there are most of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np

from swsysid._results import Array
from swsysid._stays.laws import Laws, Modes, slope_of
from swsysid._stays.recordings import Recordings
from swsysid._stays.sliding import SlidingLaws

# How well a rough state is known, in spreads; what one sample may cost in squares: outliers are
# bounded.
_ROUGHLY_KNOWN, _MOST_SQUARES = 0.5, 60.0


class Belief(NamedTuple):
    """What is known of the states of hypotheses."""

    mean: Array  # (n_states, ...)
    covariance: Array  # (n_states, n_states, ...)


class Filter(Protocol):
    """What a decoder asks: hypotheses of a recording and their modes, one sample later."""

    @property
    def noise(self) -> Array:
        """Standard deviations of the measurement, (n_states,)."""

    @property
    def n_modes(self) -> int:
        """Number of modes."""

    @property
    def spread(self) -> Array:
        """Typical size of each state."""

    def ahead(self, k: int, belief: Belief, modes: Modes) -> tuple[Belief, Array | float]:
        """Beliefs at sample k + 1 before it is measured, and log probabilities of the modes there.

        Of hypotheses (..., n_recordings, n_kept) in each mode, (..., n_recordings, n_kept,
        n_modes).
        """


class Linear(NamedTuple):
    """A function of the state for every mode in all intervals: offset + slope @ state."""

    offset: Array  # (n_states, n_modes, n_steps, n_recordings)
    slope: Array  # (n_states, n_states, n_modes, n_steps, n_recordings)

    def of_all(self, k: int) -> tuple[Array, Array]:
        """Of all modes in one interval, (..., n_modes, 1, n_recordings)."""
        return self.offset[:, :, k][:, :, None], self.slope[:, :, :, k][:, :, :, None]

    def of_some(self, k: int, modes: Modes) -> tuple[Array, Array]:
        """Of modes (n_kept, n_recordings) in one interval, of the same shape."""
        n_states, places = (
            len(self.offset),
            modes * self.offset.shape[3] + np.arange(modes.shape[1]),
        )
        offset, slope = self.offset[:, :, k], self.slope[:, :, :, k]
        return (
            offset.reshape(n_states, -1).take(places, 1),
            slope.reshape(n_states, n_states, -1).take(places, 2),
        )

    def at(self, k: int, states: Array) -> Array:
        """Values at states (n_states, 1, n_kept, n_recordings), for all modes."""
        value, slope = self.of_all(k)
        for b, own in enumerate(states):
            value = value + slope[:, b] * own
        return value


class Surfaces(NamedTuple):
    """Surfaces of all slides along the rough states: offset + gradient @ state."""

    offset: Array  # (n_slides, n_steps, n_recordings)
    gradient: Array  # (n_states, n_slides, n_steps, n_recordings)


@dataclass(frozen=True)
class FlowFilter:
    """The filter of flows; `disturbance` are standard deviations of the velocity, times sqrt(s)."""

    noise: Array  # (n_states,): of the measurement
    disturbance: Array  # (n_states,), or of each hypothesis kept (n_states, n_kept)
    spread: Array  # (n_states,)
    halves: tuple[Linear, Linear]
    rates: Linear  # velocities in the middle of intervals
    steps: Array  # (n_steps, n_recordings)
    spans: Array  # of the same shape: durations in which switches may be
    surfaces: Surfaces | None = None
    entering: Array | None = None  # (n_states, n_modes): variances more where a mode is entered

    @classmethod
    def of(
        cls,
        laws: Laws,
        recordings: Recordings,
        noise: Array,
        disturbance: Array,
        spans: Array | None = None,
    ) -> FlowFilter:
        """That of some laws along the rough states of recordings.

        `spans` are durations in which switches may be, those of the intervals by default.
        """
        shape, laws = recordings.steps.shape, laws.known()
        x, u, after = recordings.guess[:-1], recordings.u[:-1], recordings.u[1:]
        steps = recordings.steps.ravel()
        flat = [one.reshape(len(steps), -1) for one in (x, recordings.guess[1:], u, after)]
        middle, of_inputs = 0.5 * (flat[0] + flat[1]), 0.5 * (flat[2] + flat[3])
        halves = (
            _half(laws, flat[0], flat[2], of_inputs, 0.5 * steps, shape),
            _half(laws, middle, of_inputs, flat[3], 0.5 * steps, shape),
        )
        moves = slope_of(flat[2], flat[3], steps)
        every = [np.full(len(steps), mode, dtype=np.intp) for mode in laws.modes]
        values = np.stack(
            [laws.velocities(one, middle, of_inputs, moves).T for one in every], axis=1
        ).reshape(-1, len(every), *shape)
        # the logarithm of a flow's slope is that of its velocity times the duration
        change = halves[1].slope - np.eye(len(laws.spread))[:, :, None, None, None]
        half = 0.5 * np.where(recordings.steps > 0.0, recordings.steps, np.inf)
        slope = (change - 0.5 * np.einsum("abmkr,bcmkr->acmkr", change, change)) / half
        offset = values - (slope * middle.T.reshape(-1, 1, *shape)).sum(axis=1)
        rates = Linear(offset, slope)
        surfaces, steps = _surfaces(laws, flat[1], flat[3], shape), recordings.steps
        spans = steps if spans is None else spans
        return cls(noise, disturbance, laws.spread, halves, rates, steps, spans, surfaces)

    @property
    def n_modes(self) -> int:
        """Number of modes and slides."""
        return self.rates.offset.shape[1]

    def disturbed(self, disturbance: Array) -> FlowFilter:
        """The same with another disturbance."""
        return replace(self, disturbance=disturbance)

    def ahead(self, k: int, belief: Belief, modes: Modes) -> tuple[Belief, Array | float]:
        """As `Filter.ahead`."""
        own, duration, (first, second) = modes.T, self.steps[k], self.halves
        kept = Belief(*(part.swapaxes(-1, -2) for part in belief))
        half = _through(*first.of_some(k, own), kept)
        # now each hypothesis in every mode
        wide = Belief(half.mean[:, None], half.covariance[:, :, None])
        mean, covariance = _through(*second.of_all(k), wide)
        rates = self.rates.at(k, half.mean[:, None])
        jump = (rates - np.take_along_axis(rates, own[None, None], axis=1)) * self.spans[k]
        covariance += jump[:, None] * jump[None] / 12.0
        diagonal = np.arange(len(mean))
        more = np.square(self.disturbance).reshape(len(mean), 1, -1, 1) * duration
        if self.entering is not None:
            enters = own != np.arange(self.n_modes)[:, None, None]
            more = more + self.entering[:, :, None, None] * enters
        covariance[diagonal, diagonal] += more
        ahead, jump = Belief(mean.swapaxes(1, 3), covariance.swapaxes(2, 4)), jump.swapaxes(1, 3)
        return ahead, 0.0 if self.surfaces is None else self._on_surfaces(k, ahead, jump, modes)

    def _on_surfaces(self, k: int, ahead: Belief, jump: Array, modes: Modes) -> Array:
        """Put those that slide on their surface; how likely they got there.

        A crossing in the interval of a switch is as likely as the normal density of f, times what f
        changes by in the interval.
        """
        assert self.surfaces is not None
        mean, covariance = ahead
        nats = np.zeros(mean.shape[1:])
        first = self.n_modes - len(self.surfaces.offset)
        for number in range(len(self.surfaces.offset)):
            slide = first + number
            gradient = self.surfaces.gradient[:, number, k][:, :, None]
            own, wide = mean[..., slide], covariance[..., slide]
            value = self.surfaces.offset[number, k][:, None] + (gradient * own).sum(axis=0)
            reach = (gradient[:, None] * wide).sum(axis=0)
            variance = np.maximum((gradient * reach).sum(axis=0), np.finfo(float).tiny)
            mean[..., slide] = own - reach / variance * value
            covariance[..., slide] = wide - reach[:, None] * reach[None] / variance
            change = np.square((gradient * jump[..., slide]).sum(axis=0))
            squares = np.minimum(np.square(value) / variance, _MOST_SQUARES)
            change = np.maximum(change, np.finfo(float).tiny)
            entered = -0.5 * (squares + np.log(2.0 * np.pi * variance) - np.log(change))
            nats[..., slide] = np.where(modes != slide, entered, 0.0)
        return nats


def _through(offset: Array, slope: Array, belief: Belief) -> Belief:
    """Beliefs after a linear flow, (..., n_rows) broadcast against each other."""
    mean, covariance = offset, 0.0
    for b, own in enumerate(belief.mean):
        mean = mean + slope[:, b] * own
        half = slope[:, 0] * belief.covariance[0, b]
        for c in range(1, len(belief.mean)):
            half = half + slope[:, c] * belief.covariance[c, b]
        covariance = covariance + half[:, None] * slope[None, :, b]
    return Belief(mean, np.asarray(covariance))


def _half(
    laws: Laws, x: Array, u: Array, after: Array, steps: Array, shape: tuple[int, int]
) -> Linear:
    """The flows of all modes around rough states (n_rows, n_states)."""
    offsets, slopes = [], []
    for mode in laws.modes:
        ends, by_state, _ = laws.flow(mode, x, u, after, steps)
        slope = by_state.swapaxes(0, 1)
        offsets.append(ends.T - (slope * x.T).sum(axis=1))
        slopes.append(np.broadcast_to(slope, (*slope.shape[:2], len(x))))
    offset, slope = np.stack(offsets, axis=1), np.stack(slopes, axis=2)
    return Linear(
        offset.reshape(*offset.shape[:2], *shape), slope.reshape(*slope.shape[:3], *shape)
    )


def _surfaces(laws: Laws, x: Array, u: Array, shape: tuple[int, int]) -> Surfaces | None:
    """The surfaces of all slides at rough states."""
    if not isinstance(laws, SlidingLaws):
        return None
    offsets, gradients = [], []
    for slide in laws.modes[len(laws.coef) :]:
        value, gradient = laws.off(np.full(len(x), slide, dtype=np.intp), x, u)
        offsets.append(value - (gradient * x).sum(axis=1))
        gradients.append(gradient.T)
    gradient = np.stack(gradients, axis=1)
    return Surfaces(
        np.stack(offsets).reshape(-1, *shape), gradient.reshape(*gradient.shape[:2], *shape)
    )


def first_belief(filter_: Filter, y: Array, guess: Array) -> Belief:
    """Of the first samples (n_recordings, n_states); what is not measured is roughly known."""
    seen = np.isfinite(y)
    variance = np.square(np.where(seen, filter_.noise, _ROUGHLY_KNOWN * filter_.spread))
    return Belief(np.where(seen, y, guess).T, variance.T * np.eye(y.shape[1])[:, :, None])


def corrected(ahead: Belief, y: Array, noise: Array) -> tuple[Belief, Array]:
    """Beliefs (..., n_recordings, n_kept, n_modes) after a measurement, and its log likelihood.

    One channel after the other, as their noise is independent; outliers are bounded.
    """
    mean, covariance = ahead
    squares, logarithms = np.zeros_like(mean[0]), np.zeros_like(mean[0])
    for k, size in enumerate(noise):
        seen = np.isfinite(y[:, k])[:, None, None]
        if not seen.any():
            continue
        total = covariance[k, k] + size**2
        error, row, logarithm = y[:, k][:, None, None] - mean[k], covariance[k], np.log(total)
        if not seen.all():
            error, row, logarithm = (np.where(seen, one, 0.0) for one in (error, row, logarithm))
        gain = row / total
        squares += np.square(error) / total
        logarithms += logarithm
        mean = mean + gain * error
        covariance = covariance - gain[:, None] * row[None]
        # what a switch leaves open may exceed the noise by ten powers of ten
        exact = gain * size**2
        if not seen.all():
            exact = np.where(seen, exact, covariance[k])
        covariance[k], covariance[:, k] = exact, exact
    likelihood = -0.5 * (np.minimum(squares, _MOST_SQUARES) + logarithms)
    return Belief(mean, covariance), likelihood
