"""What was done to a recording before anything was identified, in words."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from swsysid._cli.samples import Samples

__all__ = ["preparation"]


def preparation(samples: Samples) -> list[str]:
    """Lines on what was mended, masked and left out, and on smoothing and noise."""
    return [*samples.remarks, *_smoothing(samples)]


def _smoothing(samples: Samples) -> Iterator[str]:
    smoothing, t = samples.smoothing, samples.t
    if smoothing is None or t is None:
        return
    if smoothing.window:
        step = float(np.median(np.diff(t))) / samples.decimate
        span = f"{smoothing.window * step:.2g} {samples.time_unit}".rstrip()
        how = f"Smoothed over windows of {smoothing.window} samples ({span})"
    elif smoothing.cutoff:
        rate = f" 1/{samples.time_unit}" if samples.time_unit not in ("", "s") else " Hz"
        how = f"Smoothed by a low-pass of {smoothing.cutoff:.3g}{rate}"
    else:
        how = "Not smoothed"
    noise = zip(samples.names, smoothing.noise, samples.units, strict=False)
    sizes = ", ".join(f"{name} {size:.2g} {unit}".rstrip() for name, size, unit in noise)
    yield f"{how}; noise of one sample: {sizes}."
