r"""The noise of every sample: of one size, or growing with the value, or another by recording.

Second differences of what a fit leaves, :math:`d_i = (r_{i-1} - 2 r_i + r_{i+1}) / \sqrt 6`, hold
its noise and hardly anything of a law that it lacks. Their sizes are compared between samples of
small and of large values, and between recordings: the logarithm of a median size of m of them has a
standard error of :math:`1.6 / \sqrt m` (1.17 for independent ones, neighbours share noise).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.stats import chi2

from swsysid._free_rollouts.breaks import SIGNIFICANCE, VARIANCE
from swsysid._noise import robust_scale
from swsysid._results import Array

_FEWEST = 40  # samples of a set whose noise is compared with that of others
_MOST_PARTS = 8  # sets of a channel's values
# Part of the noise that differences of what is left must show: less is rounding.
_SHOWN = 0.3

_ERROR = 1.6  # standard error of the logarithm of a median size, times the root of their number


@dataclass(frozen=True)
class ChannelNoise:
    """Standard deviations of one channel: the root of constant² + (share · value)².

    They are at least the `least`: a value that crosses zero has no less noise than was seen of the
    smallest ones. `by_recording` are constants, empty where recordings do not differ.
    """

    constant: float
    share: float = 0.0
    least: float = 0.0
    by_recording: tuple[float, ...] = ()

    @property
    def differs(self) -> bool:
        """True if it differs from sample to sample."""
        return bool(self.share or self.by_recording)

    def at(self, values: Array, recording: int) -> Array:
        """Of samples of a recording."""
        constant = self.by_recording[recording] if self.by_recording else self.constant
        return np.maximum(np.hypot(constant, self.share * values), self.least)

    def sentence(self, name: str, labels: Sequence[str]) -> str:
        """How it differs from sample to sample; "" where it does not."""
        if self.share:
            return f"The noise of {name} grows with its size: {100 * self.share:.2g} % of it."
        if not self.by_recording:
            return ""
        least, most = int(np.argmin(self.by_recording)), int(np.argmax(self.by_recording))
        return (
            f"The noise of {name} differs by recording: {self.by_recording[least]:.2g} in "
            f"recording {labels[least]}, {self.by_recording[most]:.2g} in recording {labels[most]}."
        )


@dataclass(frozen=True)
class SampleNoise:
    """Of all channels; recordings are those of which courses are parts."""

    channels: tuple[ChannelNoise, ...]
    labels: tuple[str, ...]  # of the recordings
    least: Array | None = None  # (n_channels,): it counts as no less than that

    @classmethod
    def constant(cls, noise: Array, labels: Sequence[str]) -> SampleNoise:
        """The same at all samples, (n_channels,)."""
        return cls(tuple(ChannelNoise(float(one)) for one in noise), _once(labels))

    @classmethod
    def seen(
        cls, noise: Array, left: Sequence[Array], values: Sequence[Array], labels: Sequence[str]
    ) -> SampleNoise:
        """Of this size, or as what is `left` of the courses shows that it differs.

        `left` and the `values` of the samples are (n_samples, n_channels); `labels` are those of
        the courses.
        """
        once = _once(labels)
        of = [np.full(max(len(part) - 2, 0), once.index(label))
              for part, label in zip(left, labels, strict=True)]  # fmt: skip
        recording = np.concatenate(of)
        sizes = np.vstack([_differences(part) for part in left])
        middle = np.vstack([np.abs(part[1:-1]) for part in values])
        return cls(
            tuple(
                _seen(float(one), np.abs(sizes[:, k]), middle[:, k], recording)
                for k, one in enumerate(noise)
            ),
            once,
        )

    @property
    def differs(self) -> bool:
        """True if it differs from sample to sample."""
        return any(one.differs for one in self.channels)

    def at(self, values: Array, label: str) -> Array:
        """Standard deviations of the samples of a course, (n_samples, n_channels)."""
        recording = self.labels.index(label)
        pairs = zip(self.channels, values.T, strict=True)
        sizes = np.column_stack([channel.at(one, recording) for channel, one in pairs])
        return sizes if self.least is None else np.maximum(sizes, self.least)

    def sentences(self, names: Sequence[str]) -> list[str]:
        """How the noise of channels differs from sample to sample."""
        told = [one.sentence(name, self.labels)
                for one, name in zip(self.channels, names, strict=True)]  # fmt: skip
        return [one for one in told if one]


def _once(labels: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(labels))


def _differences(left: Array) -> Array:
    if len(left) < 3:
        return np.empty((0, left.shape[1]))
    return (left[:-2] - 2.0 * left[1:-1] + left[2:]) / np.sqrt(6.0)


def _seen(noise: float, sizes: Array, values: Array, recording: NDArray[np.intp]) -> ChannelNoise:
    """The noise of a channel by the sizes of second differences."""
    known = np.isfinite(sizes) & np.isfinite(values)
    sizes, values, recording = sizes[known], values[known], recording[known]
    plain = ChannelNoise(noise)
    if len(sizes) < 2 * _FEWEST or robust_scale(sizes) < _SHOWN * noise:
        return plain
    by_value = _Cells.of(sizes, _parts_by_size(values))
    by_recording = _Cells.of(sizes, recording)
    constant, share, gain = by_value.grows([values[part] for part in by_value.rows])
    other = by_recording.differs() if by_recording.is_complete(recording) else 0.0
    if max(gain, other) <= 0.0:
        return plain
    if gain >= other:
        return ChannelNoise(constant, share, float(by_value.scale.min()))
    return ChannelNoise(noise, by_recording=tuple(by_recording.scale.tolist()))


def _parts_by_size(values: Array) -> NDArray[np.intp]:
    """Number of the part of each sample, the values ordered by size."""
    count = int(np.clip(len(values) // _FEWEST, 1, _MOST_PARTS))
    edges = np.quantile(values, np.linspace(0.0, 1.0, count + 1)[1:-1])
    return np.searchsorted(edges, values)


@dataclass(frozen=True)
class _Cells:
    """Sets of samples with the usual size of the noise in each."""

    rows: list[NDArray[np.intp]]
    scale: Array
    error: Array  # of the logarithm of the scale

    @classmethod
    def of(cls, sizes: Array, parts: NDArray[np.intp]) -> _Cells:
        rows = [np.flatnonzero(parts == part) for part in np.unique(parts)]
        rows = [one for one in rows if len(one) >= _FEWEST]
        scale = np.array([float(robust_scale(sizes[one])) for one in rows])
        error = _ERROR / np.sqrt([len(one) for one in rows])
        return cls(rows, np.maximum(scale, 1e-3 * scale.max(initial=0.0)), error)

    def is_complete(self, parts: NDArray[np.intp]) -> bool:
        """Whether each part has enough samples."""
        return len(self.rows) == len(np.unique(parts))

    def _squares(self, scale: Array) -> float:
        """Of the distances of the scales from others, in standard errors."""
        return float(np.square(np.log(self.scale / scale) / self.error).sum())

    def _usual(self) -> Array:
        weight = self.error**-2.0
        mean = np.average(np.log(self.scale), weights=weight) if len(weight) else 0.0
        return np.full(len(self.scale), np.exp(mean))

    def _gain(self, scale: Array, freedom: int) -> float:
        """Squares that other scales explain beyond chance; 0 where they hardly differ."""
        if len(scale) < 2 or (scale.max() / scale.min()) ** 2 < VARIANCE:
            return 0.0
        gain = self._squares(self._usual()) - self._squares(scale)
        return gain - float(chi2.isf(SIGNIFICANCE, freedom))

    def differs(self) -> float:
        """By how much more than chance the sets differ."""
        return self._gain(self.scale, max(1, len(self.scale) - 1))

    def grows(self, values: list[Array]) -> tuple[float, float, float]:
        """The constant, the share of the value, and how much more than chance they explain."""
        if len(self.rows) < 2:
            return 0.0, 0.0, 0.0
        squares = np.array([np.median(np.square(one)) for one in values])
        weight = 1.0 / (self.error * self.scale**2)
        design = np.column_stack([np.ones(len(squares)), squares])
        found = nnls(design * weight[:, None], self.scale**2 * weight)[0]
        scale = np.sqrt(np.maximum(design @ found, np.finfo(float).tiny))
        gain = self._gain(scale, 1) if found[1] > 0.0 else 0.0
        return float(np.sqrt(found[0])), float(np.sqrt(found[1])), gain
