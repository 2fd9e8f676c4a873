"""Numbers of an identification of automata."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class AutomatonSettings:
    """What an identification of automata takes for granted."""

    # -- jumps: samples to each side that tell where a state was going; by how many intervals a kink
    # may lead astray (a half, and rounding); quantiles of slopes that a state may have; how far
    # beyond noise and curvature it must land (extrapolated by half an interval, the cubic part of a
    # motion is six times what a parabola through five samples leaves, on both sides together); of a
    # spread, what is counted as exact
    sides: tuple[int, ...] = (5, 9, 15)
    kink: float = 0.55
    usual: tuple[float, float] = (0.05, 0.95)
    beyond_noise: float = 6.0
    beyond_curvature: float = 12.0
    least_noise: float = 1e-6
    # -- jumps that laws show: what most recordings may leave, in units of the noise, where laws are
    # believed
    most_usual_excess: float = 2.0
    # -- between which samples it jumps: how many a cut moves at most; squares of one that is lost
    farthest_place: int = 10
    lost: float = 1e4
    # -- pieces: rounds in which they are cut and joined; samples by which a stay tells its own
    # states
    most_rounds: int = 4
    fewest_of_a_stay: int = 4
    # -- guards, in intervals: the least error of an instant, and by how much a sample may lie
    # beyond; in deviations, what is so far off that it counts less; of the median rate at which a
    # guard is crossed, the slowest; columns that it depends on; turns of weights, the first of them
    # without sides, and those in which switches that it does not explain are left out
    instant: float = 1e-4
    beyond: float = 0.1
    far_miss: float = 3.0
    slowest: float = 0.1
    most_columns: int = 3
    turns: int = 12
    turns_without_sides: int = 4
    turns_of_explained: int = 4
    # rivals of a guard that are named, and digits of their numbers
    most_rivals: int = 3
    digits_of_rivals: int = 4
    # -- choice of a guard, in nats: by which one of more columns must be better, beside its price;
    # by which one with a clock must, in deviations of what noise makes of it (three of seventy-two
    # published automata have one); at least, of a switch that it does not explain
    better: float = 1.0
    clock: float = 3.0
    unexplained: float = 6.0
    # -- guards in discrete time: nats that a step beyond a guard costs; rows that enter the margin
    # program at once, and how often more do; turns of modes and guards
    slack_price: float = 5.0
    first_rows: int = 60
    turns_of_rows: int = 8
    turns_of_modes: int = 6
    # -- resets: turns of least absolute deviations; of the jumps, what counts as exact; of the
    # noise, what a state at the end of a stay is off by at most; errors by which terms must differ
    turns_of_deviations: int = 20
    exact: float = 1e-9
    end_of_stay: float = 2.0
    told_apart: float = 10.0
    # -- instants of jumps: turns; times between two samples; parts of these once an instant is
    # known nearly, and where nothing but the guard tells it; intervals by which a guard is missed
    # anyway
    turns_of_instants: int = 30
    grid: int = 33
    closer: tuple[float, ...] = (0.1, 0.01)
    nearby: float = 0.5
    missed: float = 0.01
    # -- transitions that are forestalled: how often the other one is taken for each of theirs, and
    # intervals before which its guard is about to be passed
    more_often: float = 3.0
    about_to: float = 0.5
    # -- all refined together: how tightly nodes are tied to each other, in units of the noise; by
    # which switches may miss their guards, in intervals between samples; and turns for each. The
    # last make the nodes one rollout, as chaos asks for; automata are judged with ties at which
    # rounding counts for nothing, whose number is the next
    ties: tuple[tuple[float, float, int], ...] = (
        (0.05, 0.3, 10),
        (0.0055, 0.03, 20),
        (0.00055, 0.003, 20),
        (0.000055, 0.0003, 20),
    )
    judged: int = 1
    # part of the measured values that says something about the noise, at least; standard errors by
    # which guards differ at most that are one; part by which rollouts of the recordings may be
    # worse by chance
    least_freedom: float = 0.1
    equal_guards: float = 3.0
    worse: float = 0.05
    # -- verdict: samples within which a guard explains a switch, and the part that it must explain;
    # samples that tell the first mode of a rollout
    near: float = 2.0
    told_by_guard: float = 0.9
    most_first_modes: int = 2000
    # -- report: what the laws may leave, in units of the noise, and samples that follow none
    most_excess: float = 1.3
    most_unexplained: float = 0.05


SETTINGS = AutomatonSettings()
