"""Numbers of an identification from recordings."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class StaySettings:
    """What an identification from recordings takes for granted."""

    # Candidates for the disturbance of the velocity in the filter, as fractions of the velocity's
    # spread times the square root of the time in `memory` samples; likelihood chooses.
    disturbances: tuple[float, ...] = (0.3, 0.1, 0.03, 0.01, 0.003)
    memory: int = 3
    n_kept: int = 6  # hypotheses of a recording
    price: float = 4.0  # of a switch, in nats
    # least probability that a surface gives to a mode, in the first round and in later ones: the
    # first surface comes from velocities that were differentiated
    trust: tuple[float, float] = (0.1, 0.03)
    segment: int = 30  # samples of a segment
    # how tightly segments are tied to each other, in units of the noise, and turns for each
    ties: tuple[tuple[float, int], ...] = ((2.0, 6), (0.3, 6), (0.03, 10))
    damping: float = 1e-3  # of the first step, relative to the diagonal
    rise: float = 8.0  # of the damping after a step that failed; it falls by as much after another
    most_failures: int = 8
    converged: float = 1e-4  # relative decrease at which a stage ends
    most_rounds: int = 5  # ends sooner where the stays repeat


SETTINGS = StaySettings()
