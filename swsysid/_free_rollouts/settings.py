"""The numbers that free rollouts are judged by, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Judgement:
    """From what rollouts leave to whether a model holds."""

    # Chance of a break in all samples together that are noise alone.
    significance: float = 1e-3
    # Variance that Page's test looks for: what a wrong rollout adds is as large as the noise.
    variance: float = 2.0
    # Of the spread of a channel: what a rollout may be off by whatever the noise. The errors of a
    # solver add up along a recording, unlike noise: 2e-4 in six impacts at a tolerance of 1e-5.
    size: float = 1e-3
    # Samples of a set whose noise is compared with that of others, and sets of a channel's values.
    fewest: int = 40
    most_parts: int = 8
    # Part of the noise that differences of what is left must show: less is rounding.
    shown: float = 0.3
    # Part of the noise to which a rollout is integrated, and switches beside one a sample after
    # which a model chatters.
    accuracy: float = 1e-3
    most_switches: int = 100


SETTINGS = Judgement()
