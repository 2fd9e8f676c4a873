r"""Two models compared by what their rollouts leave of stretches that neither was fitted to.

*Size* is the share of the squares that the second takes away. *Evidence* is the logarithm of the
ratio of their likelihoods on n such samples of d measured states, with as many independent ones as
the memory m of what is left allows,

.. math:: \frac nm \sum_k \log\frac{s_{0,k}}{s_{1,k}} - \frac d2 \log\frac nm .

The deviations s are those of these very stretches, which may be harder to predict than those of the
fit, and for a good model by a larger factor than for a bad one; for those of its own the second
pays. If the first model is right the ratio is no larger than 1 in the mean, up to what such a price
neglects, so that one of L has no more probability than 1 / L (universal inference: Wasserman,
Ramdas and Balakrishnan, 2020).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from swsysid._noise import memory
from swsysid._output_error.settings import SETTINGS
from swsysid._results import Array
from swsysid._stays.nodes import Rows

_BLOCKS = 20  # in which two models are compared
_CAP = 25.0  # squares in units of the mean that one sample counts at most


_MOST = 1e100  # that a rollout leaves: one that leaves more has diverged


@dataclass(frozen=True)
class Left:
    """What rollouts of a model leave of stretches."""

    samples: Array  # (n_samples, n_measured)
    series: tuple[Rows, ...]  # numbers of the samples of each stretch

    @property
    def is_bounded(self) -> bool:
        """False of a rollout that has diverged."""
        return not bool((np.abs(self.samples) >= _MOST).any())

    @cached_property
    def memory(self) -> float:
        """Samples that are worth one, at most of any state."""
        finite = np.where(np.abs(self.samples) < _MOST, self.samples, 0.0)
        return max(memory(column, list(self.series)) for column in finite.T)


@dataclass(frozen=True)
class Fall:
    """By how much what is left falls from one model to another."""

    blocks: Array  # (n_blocks,): of the squared error, each in units of the mean before
    nats: float  # of evidence
    count: float  # of independent samples

    @property
    def share(self) -> float:
        """Of the squared error of all samples."""
        return float(self.blocks.mean())

    @property
    def error(self) -> float:
        """Standard error of the share, from block to block."""
        return float(self.blocks.std(ddof=1) / np.sqrt(len(self.blocks)))

    @property
    def is_worse(self) -> bool:
        """Whether the squares rise by more than blocks of samples differ."""
        return self.share <= -self.error

    @property
    def p_value(self) -> float:
        """Most probability of so much evidence, where the first model is right."""
        return float(np.exp(min(0.0, -self.nats)))


def fall(before: Left, after: Left) -> Fall:
    """From one model to another, each state by what the first leaves of it in the mean."""
    sizes, tiny = _mean_squares(before.samples), np.finfo(float).tiny
    squares = [_capped(one.samples, sizes) for one in (before, after)]
    change, blocks = _changes(*squares)
    count = max(1.0, len(change) / max(before.memory, after.memory))
    own = [np.maximum(np.nanmean(one, axis=0), tiny) for one in squares]
    nats = 0.5 * count * np.log(own[0] / own[1]).sum() - 0.5 * len(sizes) * np.log(count)
    return Fall(blocks, float(nats), count)


def most_share(before: Left, samples: Array) -> float:
    """Share of the squares that a model takes away at most, if it leaves these of the first ones.

    It leaves nothing of the others then.
    """
    sizes = _mean_squares(before.samples)
    squares = _capped(before.samples, sizes)
    left = np.zeros_like(squares)
    left[: len(samples)] = _capped(samples, sizes)
    return float(_changes(squares, left)[1].mean())


def _changes(before: Array, after: Array) -> tuple[Array, Array]:
    """Of the squares of each sample, and in blocks in units of the mean before."""
    change = np.nan_to_num(np.nanmean(before - after, axis=1))
    blocks = np.array([part.mean() for part in np.array_split(change, _BLOCKS)])
    return change, blocks / max(float(np.nanmean(before)), np.finfo(float).tiny)


def price(n_parameters: int, count: float) -> float:
    """Nats that parameters cost where so many independent samples have chosen them."""
    return float(0.5 * n_parameters * np.log(count))


def as_good(lost: Fall, significance: float) -> bool:
    """Whether what a model loses beside another one is no more than chance, or than a trifle.

    Chance as blocks of samples say, of which a few may have all that matters, and the evidence.
    """
    is_sure = lost.share > lost.error or lost.p_value <= significance
    return lost.share <= SETTINGS.worthwhile or not is_sure


def go_astray(before: Left, after: Left, significance: float) -> bool:
    """Whether rollouts become surely worse, or leave all bounds."""
    diverge = before.is_bounded and not after.is_bounded
    return diverge or not as_good(fall(after, before), significance)


def _mean_squares(samples: Array) -> Array:
    known = np.where(np.abs(samples) < _MOST, samples, np.nan)
    return np.maximum(np.nanmean(np.square(known), axis=0), np.finfo(float).tiny)


def _capped(samples: Array, sizes: Array) -> Array:
    """Squares in units of some, no larger than one sample counts at most."""
    return np.asarray(np.minimum(np.square(np.clip(samples, -_MOST, _MOST)) / sizes, _CAP))
