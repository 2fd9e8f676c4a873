"""The numbers that the command line decides by, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Preparing:
    """From cells to runs: what is no measurement, and where a run ends."""

    # Ranges of the other values beyond which a value is far away: no signal has such a crest.
    far: float = 5.0
    # Percentiles that a state's range lies between, so that spikes do not widen it.
    middle: tuple[float, float] = (10.0, 90.0)
    # Samples of a spike: two that differ, or some more that are all the same (a lost signal).
    longest_spike: int = 2
    longest_stuck: int = 5
    most_spikes: float = 0.05  # share of spikes above which they are the signal
    # Rows after which a clock that went back has caught up, if a row was merely written late.
    late: int = 3
    # Share of the rows that go back in time, from which on they stand in no order at all.
    no_order: float = 0.1
    # Share of a column's spread that noise has where neighbouring samples have little in common.
    unlike: float = 0.5
    # Correlation from which on a column is the rate of another.
    rate: float = 0.99
    # Steps after which a filter that needs even times starts again: one row is missing.
    even_gap: float = 1.5


@dataclass(frozen=True)
class Clocks:
    """Channels that have times of their own, or were filled in between them."""

    # Changes of an input, of the rows of the states, up to which it may keep its value between.
    rare: float = 0.5
    # Mean square of the changes of its steps, of that of the steps: 2 where each is a surprise, 1
    # for six samples a period, and little for what moves gradually and lies on lines.
    rough: float = 1.0
    # Share of the mean step by which the times of two rows differ that are one: far above rounding.
    rounding: float = 1e-6
    # Share of the largest bend below which a line is straight, digits of a file included.
    straight: float = 1e-3
    # Places of samples, and the share of them at regular steps, that show how a tool filled rows.
    fewest: int = 8
    regular: float = 0.9


@dataclass(frozen=True)
class Recordings:
    """From recordings to a model, without derivatives."""

    # Memory bounds it: a hundred thousand samples of two states take about a gigabyte.
    most_samples: int = 200_000
    # The same for a pipeline of transformers, which takes some fifty times as long for a step.
    most_of_pipelines: int = 2_000
    # Times the noise of neighbouring samples that rollouts leave from which on what the laws lack
    # decides the answer and not the noise.
    hopeless: float = 10.0
    # Times the error of derivatives that the model of derivatives has, where rollouts leave more
    # than noise; right laws may have this much, for smoothing bends derivatives at a switch.
    worse: float = 2.0
    # Trajectories, and switches of each, whose instants are printed; the file holds all.
    most_trajectories: int = 8
    most_instants: int = 8


@dataclass(frozen=True)
class Wording:
    """From a model to text."""

    precision: int = 6  # decimals of coefficients
    # Share of the spread of a rate that an input has to move to be called its drive.
    sensible: float = 0.01
    still: float = 0.01  # share of the motion of other modes that is called none
    rounding: float = 1e-6  # share of a coefficient by which two laws without noise may differ
    sure: float = 3.0  # standard errors by which two laws differ in a term: two-sided 0.3 %
    most_rows: int = 20_000  # samples that decide where the modes are, in words
    same_side: float = 0.99  # share of the samples on which fewer terms must say the same as all
    no_constant: float = 0.001  # share of the samples that a constant has to put right to be told
    levels: int = 8  # values of an input up to which those on each side of a surface are listed


PREPARING, CLOCKS = Preparing(), Clocks()
RECORDINGS, WORDING = Recordings(), Wording()
