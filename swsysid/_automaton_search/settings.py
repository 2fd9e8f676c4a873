"""Numbers of an identification of automata."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class AutomatonSettings:
    """What an identification of automata takes for granted."""

    # -- deviations of the noise beyond which a state jumps; of the noise, what a state at the end
    # of a stay is off by at most; samples by which a stay tells its own states; rounds of cuts
    beyond_noise: float = 6.0
    end_of_stay: float = 2.0
    fewest_of_a_stay: int = 4
    most_rounds: int = 4
    # -- guards, in intervals: the least error of an instant, and by how much a sample may lie
    # beyond; in deviations, what is so far off that it counts less; columns that guards and resets
    # depend on
    instant: float = 1e-4
    beyond: float = 0.1
    far_miss: float = 3.0
    most_columns: int = 3
    # -- choices, in nats: by which one of more columns must be better, beside its price; at least,
    # of a switch that a guard does not explain
    better: float = 1.0
    unexplained: float = 6.0
    exact: float = 1e-9  # of values, what is rounding
    # -- verdict: samples within which a guard explains a switch, and the part that it must explain;
    # what the laws may leave, in units of the noise
    near: float = 2.0
    told_by_guard: float = 0.9
    most_excess: float = 1.3

    def excess(self, n_samples: int) -> float:
        """What laws may leave of so many samples: differences of white noise tell its size.

        The logarithm of that size has a standard error of 1.7 / sqrt(n) (30 to 1,600 samples).
        """
        return self.most_excess * float(np.exp(2.0 * 1.7 / np.sqrt(n_samples)))


SETTINGS = AutomatonSettings()
