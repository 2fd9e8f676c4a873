r"""Noise in the equation: a random walk of the states beside the laws.

Draughts, gusts and turbulence move a state, and it goes on from where they left it. With the laws
and the stays given, :math:`dx = f_j(x)\,dt + q\,dW` is measured with noise :math:`\sigma`, and what
each sample says beyond those before it, the innovations of Kalman's filter, tells both:

.. math:: \max_{\sigma, q} \; -\tfrac12 \sum_k \Big( \frac{e_k^2}{s_k^2} + \log s_k^2 \Big).

A law that lacks something leaves more than the noise, too, and goes on doing so: only where the
innovations are white is it a walk.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from swsysid._residual_report.whiteness import whiteness_test
from swsysid._results import Array
from swsysid._stays.filtering import Belief, FlowFilter, corrected, first_belief
from swsysid._stays.lifted import Estimate
from swsysid._stays.recordings import Recordings, pieces_of
from swsysid._stays.samples import intervals_of, states_of
from swsysid._stays.settings import StaySettings

# Deviations that are tried, by the noise at hand: of both, at most, and of a walk, the first one.
_LEAST, _MOST, _FIRST = 1e-3, 1e2, 0.3
# Part by which sizes may differ and be the same.
_SAME = 0.1
# The significance below which innovations are not white.
_COLOURED = 1e-3


@dataclass(frozen=True)
class Walk:
    """Noise of the sensor and of a walk, and how much likelier recordings are with it."""

    sensor: Array  # (n_states,)
    walk: Array  # (n_states,): what it adds in a usual interval
    nats: float  # by which the samples are less likely without a walk
    nats_of_sensor: float  # and without noise of the sensor
    is_white: bool  # whether nothing else is left


    def pays(self, estimate: Estimate) -> bool:
        """Whether it says more than its sizes take, by the Bayesian information criterion."""
        n_values = np.isfinite(estimate.nodes.y).sum()
        return bool(self.nats > 0.5 * len(self.walk) * np.log(max(2, n_values)))

    def is_as(self, other: Walk) -> bool:
        """Whether both sizes are about the same."""
        sizes = (np.hypot(one.walk, _SAME * one.sensor) for one in (self, other))
        return bool((np.abs(np.log(np.divide(*sizes))) < _SAME).all())


def walk_of(estimate: Estimate, noise: Array, settings: StaySettings) -> Walk:
    """Both noises of highest likelihood at the laws and stays of an estimate."""
    seen = _Innovations.of(estimate, noise, settings)
    n_states, measured = len(noise), np.isfinite(estimate.nodes.y).any(axis=0)
    limits = np.log([_LEAST, _MOST])

    def split(sizes: Array) -> tuple[Array, Array]:
        sensor = noise.copy()
        sensor[measured] *= np.exp(sizes[n_states:])
        return sensor, noise * np.exp(sizes[:n_states])

    def unlikely(sizes: Array) -> float:
        return -seen.with_noise(*split(sizes)).nats

    first = np.zeros(n_states + int(measured.sum()))
    first[:n_states] = np.log(_FIRST)
    def least(bounds: Array) -> tuple[float, Array]:
        found = minimize(unlikely, first.clip(*bounds.T), method="L-BFGS-B", bounds=bounds)
        return float(found.fun), found.x

    free = np.tile(limits, (len(first), 1))
    still, ideal = free.copy(), free.copy()
    still[:n_states, 1] = ideal[n_states:, 1] = limits[0]
    value, sizes = least(free)
    sensor, walk = split(sizes)
    nats = (least(some)[0] - value for some in (still, ideal))
    return Walk(sensor, walk, *nats, seen.with_noise(sensor, walk).are_white)


@dataclass(frozen=True)
class _Innovations:
    """What samples say beyond those before them, along pieces of recordings side by side."""

    filter_: FlowFilter
    pieces: Recordings
    modes: NDArray[np.intp]  # (n_steps, n_pieces)
    inside: NDArray[np.bool_]  # of the samples at the ends of steps: those that are no overlap
    errors: Array | None = None  # (n_steps, n_pieces, n_states), in their own deviations
    nats: float = 0.0

    @classmethod
    def of(cls, estimate: Estimate, noise: Array, settings: StaySettings) -> _Innovations:
        recordings = estimate.nodes.recordings.with_guess(states_of(estimate))
        pieces, places = recordings.cut(settings.piece, settings.overlap)
        spans = pieces_of(recordings.spans, places)
        filter_ = FlowFilter.of(estimate.laws, pieces, noise, np.zeros(len(noise)), spans)
        k = np.arange(len(pieces.steps))[:, None]
        first, last = (
            np.array([own - piece.begin for own, piece in zip(ends, places, strict=True)])
            for ends in zip(*((piece.first, piece.last) for piece in places), strict=True)
        )
        modes = pieces_of(intervals_of(estimate), places)
        return cls(filter_, pieces, modes, (k >= first) & (k < last))

    def with_noise(self, sensor: Array, walk: Array) -> _Innovations:
        """The same where noise is of such sizes, in states and in a usual interval."""
        per_time = walk / np.sqrt(self.pieces.interval)
        filter_ = replace(self.filter_, noise=sensor, disturbance=per_time)
        first = first_belief(filter_, self.pieces.y[0], self.pieces.guess[0])
        belief = Belief(*(part[..., None] for part in first))
        now, errors, nats = self.modes[0], [], 0.0
        for k, (modes, inside) in enumerate(zip(self.modes, self.inside, strict=True)):
            ahead = filter_.ahead(k, belief, now[:, None])[0]
            own = Belief(*(
                np.take_along_axis(part, modes.reshape(*[1] * (part.ndim - 3), -1, 1, 1), -1)
                for part in ahead
            ))  # fmt: skip
            y = self.pieces.y[k + 1]
            variances = np.diagonal(own.covariance[..., 0, 0]).reshape(y.shape) + sensor**2
            errors.append((y - own.mean[..., 0, 0].T) / np.sqrt(variances))
            belief, seen = corrected(own, y, sensor)
            belief, now = Belief(*(part[..., 0] for part in belief)), modes
            nats += float(seen[inside].sum())
        return replace(self, filter_=filter_, errors=np.array(errors), nats=nats)

    @property
    def are_white(self) -> bool:
        """Whether no channel goes on as it did before."""
        assert self.errors is not None
        run = np.broadcast_to(np.arange(self.inside.shape[1]), self.inside.shape)
        for own in np.moveaxis(self.errors, 2, 0):
            seen = self.inside & np.isfinite(own)
            if seen.any():
                test = whiteness_test(own.T[seen.T], groups=run.T[seen.T])
                if test.p_value < _COLOURED:
                    return False
        return True
