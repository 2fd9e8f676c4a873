r"""Where what is left is no longer noise: Page's test of a variance.

With e the residuals in units of their noise, the log likelihood ratio of a variance v against 1 is
:math:`\ell_i = \tfrac12 \big( e_i^2 (1 - 1/v) - \log v \big)`. The sum over a stretch of noise
alone exceeds h somewhere among n samples with a probability of at most :math:`n e^{-h}` (each
begin is a martingale of mean one), which sets h.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swsysid._results import Array

# Chance of a break in all samples together that are noise alone.
SIGNIFICANCE = 1e-3
# Variance that Page's test looks for: what a wrong rollout adds is as large as the noise.
VARIANCE = 2.0

# Squares of a sample count up to here: one outlier, or a sample on the wrong side of a jump,
# is no break, which takes at least half a dozen.
_MOST_SQUARES = 9.0


@dataclass(frozen=True)
class Break:
    """Where a free rollout leaves the noise.

    Attributes
    ----------
    recording : str
    channel : str
        The one that leaves it first.
    time : float
    follows : float
        Time from the start of the rollout to there.
    cause : str
        What the model's guards do with the last switch before, in words; "" where that is right.
    ended : str
        Why the simulation ended there; "" where it went on.
    mode : int
        Of the rollout there; -1 where it slides, or ended before its first sample.
    transition : str
        The one that the cause is about, in words.
    leaves : float
        Root mean square of what is left of the channel until the rollout switches again.
    """

    recording: str
    channel: str
    time: float
    follows: float
    cause: str
    ended: str
    mode: int = -1
    transition: str = ""
    leaves: float = np.nan

    @property
    def part(self) -> str:
        """The transition, or else the mode, that is not right."""
        return self.transition or f"mode {self.mode}"


def first_breaks(
    left: Sequence[Array], together: float = 1.0, variance: float = VARIANCE
) -> list[NDArray[np.intp]]:
    """Sample from which on each channel is no longer noise, -1 where it always is.

    `left` are residuals of every course in units of the noise, (n_samples, n_channels), NaN where
    nothing was measured and infinite where a rollout has ended; `together` samples count as one.
    `variance` is what the test looks for.
    """
    n_values = sum(int(np.isfinite(one).sum()) for one in left)
    limit = np.log(max(1, n_values) / SIGNIFICANCE)
    return [np.array([_first(one, limit * together, variance) for one in part.T]) for part in left]


def leave_more(left: Sequence[Array], together: float, variance: float) -> bool:
    """Whether all samples of a channel together are no noise, if no stretch alone tells so."""
    gains = _gain(np.vstack(left), variance).sum(axis=0)
    return bool((gains > -np.log(SIGNIFICANCE) * together).any())


def _gain(left: Array, variance: float) -> Array:
    """Log likelihood ratios of the samples, 0 where nothing was measured."""
    squares = np.minimum(np.square(left), _MOST_SQUARES)
    gain = 0.5 * (squares * (1.0 - 1.0 / variance) - np.log(variance))
    return np.where(np.isnan(left), 0.0, gain)


def _first(left: Array, limit: float, variance: float) -> int:
    """Begin of the first stretch that exceeds the limit."""
    sums = np.append(0.0, np.cumsum(_gain(left, variance)))
    lowest = np.minimum.accumulate(sums)
    over = np.flatnonzero(sums - lowest > limit)
    ended = np.flatnonzero(np.isinf(left))
    begin = len(left) if not over.size else int(np.argmin(sums[: over[0] + 1]))
    first = min(begin, int(ended[0]) if ended.size else len(left))
    return first if first < len(left) else -1
