"""Numbers of an identification of automata."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AutomatonSettings:
    """What an identification of automata takes for granted."""

    # -- jumps: samples to each side that tell where a state was going, and how far beyond noise
    # and curvature it must land
    sides: tuple[int, ...] = (5, 9, 15)
    kink: float = 0.55  # intervals for which a kink may lead astray: a half, and rounding
    usual: tuple[float, float] = (0.05, 0.95)  # quantiles of slopes that a state may have
    beyond_noise: float = 6.0
    # extrapolated by half an interval, the cubic part of a motion is six times what a parabola
    # through five samples leaves of it on both sides together
    beyond_curvature: float = 12.0
    least_noise: float = 1e-6  # of a spread: what is counted as exact

    steps: int = 4  # of the integration between two samples
    # -- guards: least and largest size of what is known, in intervals: a switch instant, and by
    # how much a sample may lie beyond a guard; what is further off counts less
    instant: float = 1e-4
    beyond: float = 0.1
    far_miss: float = 3.0
    slowest: float = 0.1  # of the median rate at which a guard is crossed
    most_columns: int = 3  # that a guard depends on
    better: float = 1.0  # nats by which a guard of more columns must be better, beside its price
    # nats that a guard with a clock must be better: three of seventy-two published automata have
    # one, and in a limit cycle a clock tells the switches as well as the state does
    clock: float = 3.0
    unexplained: float = 6.0  # nats of a switch that a guard does not know
    turns: int = 6  # of weights and sides
    fewest_of_a_stay: int = 4  # samples by which a stay tells its own states
    # -- discrete time: nats that a step beyond a guard costs; rows that enter the margin program at
    # once, and how often more do
    slack_price: float = 5.0
    first_rows: int = 60
    turns_of_rows: int = 8
    # -- resets: turns of least absolute deviations, of jumps what counts as exact; turns of
    # instants, guards and resets; times between two samples
    turns_of_deviations: int = 20
    exact: float = 1e-9
    most_rounds: int = 4  # of pieces
    turns_of_instants: int = 30
    grid: int = 33
    # of this time, once an instant is known nearly; and where nothing but the guard tells it
    closer: tuple[float, ...] = (0.1, 0.01)
    nearby: float = 0.5
    missed: float = 0.01  # intervals by which a guard is missed for reasons of its own
    end_of_stay: float = 2.0  # of the noise: what a state there is off by at most
    told_apart: float = 10.0  # errors by which terms of a reset must differ in some direction
    # -- verdict: samples within which a guard explains a switch, and the part that it must explain;
    # samples that tell the first mode of a rollout
    near: float = 2.0
    told_by_guard: float = 0.9
    most_first_modes: int = 2000


SETTINGS = AutomatonSettings()
