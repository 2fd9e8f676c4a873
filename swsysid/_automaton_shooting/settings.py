"""The numbers of a joint refinement, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers that hold for every automaton."""

    # samples of a leg
    leg: int = 30
    # how tightly legs are tied to each other, in units of the noise; by which switches may miss
    # their guards, in intervals between samples; and turns for each. The last make the legs one
    # rollout, as chaos asks for; automata are judged with ties at which rounding counts for nothing
    ties: tuple[tuple[float, float, int], ...] = (
        (0.3, 0.3, 10),
        (0.03, 0.03, 20),
        (0.003, 0.003, 20),
        (0.0003, 0.0003, 20),
    )
    judged: int = 1  # the number of those
    # part of the measured values that says something about the noise, at least
    least_freedom: float = 0.1
    # part by which rollouts of the recordings may be worse by chance
    worse: float = 0.01
    # intervals by which a guard may have risen already at a sample of its mode
    beyond: float = 0.1


SETTINGS = Settings()
