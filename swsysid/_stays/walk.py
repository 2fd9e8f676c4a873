r"""Noise in the equation: a random walk of the states beside the laws.

Draughts, gusts and turbulence move a state, and it goes on from where they left it. With the laws
and the stays given, :math:`dx = f_j(x)\,dt + q\,dW` is measured with noise :math:`\sigma`, and what
each sample says beyond those before it, the innovations of Kalman's filter, tells both:

.. math:: \max_{\sigma, q} \; -\tfrac12 \sum_k \Big( \frac{e_k^2}{s_k^2} + \log s_k^2 \Big).

A law that lacks something leaves more than the noise, too, and goes on doing so: only where the
innovations are white is it a walk.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from swsysid._free_rollouts.breaks import first_breaks
from swsysid._noise import normal_scores, portmanteau
from swsysid._results import Array
from swsysid._stays.filtering import Belief, FlowFilter, corrected, first_belief
from swsysid._stays.lifted import Estimate
from swsysid._stays.recordings import Piece, Recordings, pieces_of
from swsysid._stays.samples import intervals_of, states_of
from swsysid._stays.settings import StaySettings

# Deviations that are tried, by the noise at hand: of both, at most, and of a walk, the first one.
_LEAST, _MOST, _FIRST = 1e-3, 1e2, 0.3
# Part of the likelihood that a step must gain; samples of a piece, all worked side by side.
_CONVERGED, _PIECE = 1e-6, 30
# Samples that tell sizes, of more every so many pieces: to 2 %, by a fifth of what a turn may move.
_ENOUGH = 4000
_BESIDE = 1e-6  # of a size, how far beside it its slope is told
# Part by which sizes may differ and be the same: the turn after one that moved them by less moves
# them by 2 % at most (a fridge, a mass at an elastic stop).
_SAME = 0.1
# The significance below which innovations are not white, and the lags that are asked.
_COLOURED, _LAGS = 1e-3, 10


@dataclass(frozen=True)
class Walk:
    """Noise of the sensor and of a walk, of highest likelihood."""

    innovations: _Innovations
    sensor: Array  # (n_states,)
    walk: Array  # (n_states,): what it adds in a usual interval

    @cached_property
    def nats(self) -> float:
        """By which the samples are less likely without a walk."""
        return self._less_likely(np.full(len(self.walk), _LEAST), None)

    @cached_property
    def nats_of_sensor(self) -> float:
        """By which they are without noise of the sensor."""
        return self._less_likely(None, np.full(len(self.sensor), _LEAST))

    @property
    def is_all(self) -> bool:
        """Whether nothing else is left: innovations are noise, and of the same size throughout."""
        return self.innovations.are_noise

    @property
    def pays(self) -> bool:
        """Whether it says more than its sizes take, by the Bayesian information criterion."""
        n_values = np.isfinite(self.innovations.pieces.y[1:][self.innovations.inside]).sum()
        return bool(self.nats > 0.5 * len(self.walk) * np.log(max(2, n_values)))

    def sentences(self, names: Sequence[str]) -> Iterator[str]:
        """What is said of it, in the names of states."""
        sizes = ", ".join(
            f"{name} {size:.3g}" for name, size in zip(names, self.walk, strict=False)
        )
        yield (
            f"There is noise in the equation, in an interval: {sizes}; that of the sensor alone is "
            f"{self.nats:.3g} nats less likely."
        )

    def is_as(self, other: Walk) -> bool:
        """Whether both sizes are about the same, where the sensor's leaves them to be seen."""
        sizes = (np.hypot(one.walk, _SAME * one.sensor) for one in (self, other))
        return bool((np.abs(np.log(np.divide(*sizes))) < _SAME).all())

    def _less_likely(self, walk: Array | None, sensor: Array | None) -> float:
        seen = self.innovations
        return seen.nats - seen.most_likely(walk, sensor).nats


def walk_of(estimate: Estimate, noise: Array, settings: StaySettings) -> Walk:
    """Both noises of highest likelihood at the laws and stays of an estimate."""
    seen = _Innovations.of(estimate, noise, settings).most_likely()
    return Walk(seen, seen.filter_.noise, seen.filter_.disturbance * np.sqrt(seen.pieces.interval))


@dataclass(frozen=True)
class _Innovations:
    """What samples say beyond those before them, along pieces of recordings side by side."""

    filter_: FlowFilter
    recordings: Recordings
    places: list[Piece]
    pieces: Recordings
    modes: NDArray[np.intp]  # (n_steps, n_pieces)
    inside: NDArray[np.bool_]  # of the samples at the ends of steps: those that are no overlap
    unit: Array  # (n_states,): what sizes are tried in
    errors: Array = field(default_factory=lambda: np.zeros(0))  # (n_steps, n_pieces, n_states)
    nats_of_trials: Array = field(default_factory=lambda: np.zeros(1))
    few: _Innovations | None = None  # those of some of the pieces, where these are enough

    @classmethod
    def of(
        cls, estimate: Estimate, noise: Array, settings: StaySettings, every: int = 1
    ) -> _Innovations:
        """Those of an estimate, of every so many pieces."""
        recordings = estimate.nodes.recordings.with_guess(states_of(estimate))
        pieces, places = recordings.cut(_PIECE, settings.overlap)
        fewer, few = len(places) * _PIECE // _ENOUGH, None
        if every > 1:
            places = places[::every]
            pieces = recordings.parted(places)
        elif fewer > 1:
            few = cls.of(estimate, noise, settings, fewer)
        spans = pieces_of(recordings.spans, places)
        filter_ = FlowFilter.of(estimate.motion, pieces, noise, np.zeros(len(noise)), spans)
        k = np.arange(len(pieces.steps))[:, None]
        first, last = (
            np.array([own - piece.begin for own, piece in zip(ends, places, strict=True)])
            for ends in zip(*((piece.first, piece.last) for piece in places), strict=True)
        )
        modes = pieces_of(intervals_of(estimate), places)
        inside = (k >= first) & (k < last)
        return cls(filter_, recordings, places, pieces, modes, inside, noise, few=few)

    def most_likely(self, walk: Array | None = None, sensor: Array | None = None) -> _Innovations:
        """At sizes of highest likelihood, in these units, but for those that are given."""
        n, measured = len(self.unit), np.isfinite(self.pieces.y).any(axis=(0, 1))
        first = np.concatenate([
            np.full(n, _FIRST) if walk is None else walk, np.ones(n) if sensor is None else sensor
        ])  # fmt: skip
        free = np.append(np.full(n, walk is None), measured & (sensor is None))

        def sized(seen: _Innovations, logarithms: Array) -> _Innovations:
            sizes = np.repeat(first[:, None], logarithms.shape[1], axis=1)
            sizes[free] = np.exp(logarithms)
            return seen.with_noise(self.unit[:, None] * sizes[n:], self.unit[:, None] * sizes[:n])

        def sloping(logarithms: Array) -> tuple[float, Array]:
            beside = _BESIDE * np.eye(len(logarithms), len(logarithms) + 1, 1)
            nats = sized(self.few or self, logarithms[:, None] + beside).nats_of_trials
            return -float(nats[0]), (nats[0] - nats[1:]) / _BESIDE

        found = minimize(
            sloping, np.log(first[free]), jac=True, method="L-BFGS-B",
            bounds=[np.log([_LEAST, _MOST])] * int(free.sum()), options={"ftol": _CONVERGED},
        )  # fmt: skip
        return sized(self, found.x[:, None])

    def with_noise(self, sensor: Array, walk: Array) -> _Innovations:
        """The same where noise is of such sizes, in states and in a usual interval.

        Of trials side by side, (n_states, n_trials), the errors are those of the first.
        """
        sensor, walk = (one.reshape(len(self.unit), -1) for one in (sensor, walk))
        filter_ = replace(self.filter_, disturbance=walk / np.sqrt(self.pieces.interval))
        firsts = [
            first_belief(replace(filter_, noise=own), self.pieces.y[0], self.pieces.guess[0])
            for own in sensor.T
        ]
        belief = Belief(*(np.stack(parts, axis=-1) for parts in zip(*firsts, strict=True)))
        before, errors, nats = self.modes[0], [], np.zeros(sensor.shape[1])
        for k, (modes, inside) in enumerate(zip(self.modes, self.inside, strict=True)):
            now = np.repeat(before[:, None], len(nats), axis=1)
            ahead = filter_.ahead(k, belief, now)[0]
            own = Belief(*(
                np.take_along_axis(part, modes.reshape(*[1] * (part.ndim - 3), -1, 1, 1), -1)
                for part in ahead
            ))  # fmt: skip
            y = self.pieces.y[k + 1]
            variances = np.diagonal(own.covariance[..., 0, 0]).reshape(y.shape) + sensor[:, 0] ** 2
            errors.append((y - own.mean[..., 0, 0].T) / np.sqrt(variances))
            belief, seen = corrected(own, y, sensor[..., None])
            belief, before = Belief(*(part[..., 0] for part in belief)), modes
            nats += seen[inside, :, 0].sum(axis=0)
        filter_ = replace(filter_, noise=sensor[:, 0], disturbance=filter_.disturbance[:, 0])
        return replace(self, filter_=filter_, errors=np.array(errors), nats_of_trials=nats)

    @property
    def nats(self) -> float:
        """Log likelihood, that of the first trial."""
        return float(self.nats_of_trials[0])

    @property
    def are_noise(self) -> bool:
        """Whether no channel goes on as it did before, and none is larger in any stretch."""
        channels = np.moveaxis(self.errors, 2, 0)
        whole = [self.recordings.of_pieces(own, self.places) for own in channels]
        ends = self.recordings.lengths - 1
        left = [np.stack([own[:n, k] for own in whole], axis=1) for k, n in enumerate(ends)]
        return all((one < 0).all() for one in first_breaks(left)) and all(
            _is_white([one[:, channel] for one in left]) for channel in range(len(whole))
        )


def _is_white(left: list[Array]) -> bool:
    """Whether what is left of a channel, of each recording, says nothing of what follows."""
    seen = [one[np.isfinite(one)] for one in left]
    if not any(map(len, seen)):  # it is not measured
        return True
    recording = np.repeat(np.arange(len(seen)), [len(one) for one in seen])
    scores = normal_scores(np.concatenate(seen))
    return portmanteau(scores, recording, _LAGS).p_value >= _COLOURED
