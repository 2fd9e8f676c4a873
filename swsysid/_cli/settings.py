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
    # Times the noise of neighbouring samples from which on rollouts leave more than noise.
    noise_alone: float = 1.3
    # The same, from which on what the laws lack decides the answer and not the noise.
    hopeless: float = 10.0
    # Times the error of derivatives that the model of derivatives has, where rollouts leave more
    # than noise; right laws may have this much, for smoothing bends derivatives at a switch.
    worse: float = 2.0
    # Trajectories, and switches of each, whose instants are printed; the file holds all.
    most_trajectories: int = 8
    most_instants: int = 8


@dataclass(frozen=True)
class Judging:
    """From errors on held-out rows to a verdict."""

    # From so many trajectories on whole ones are held out; fewer would make a lottery of the rest.
    whole_groups: int = 5
    blocks: int = 10  # contiguous stretches on which two models are compared, taken as independent
    exact: float = 1e-12  # squared errors below this fraction of the largest are round-off
    # Share of the error by which a richer model must be better to be worth having.
    worth: float = 0.05
    certain: float = 2.0  # standard errors from which on a gain is called certain: two-sided 5 %
    # Share of a smooth law's error: modes that leave less are no imitation of a curve; and of the
    # spread: one law whose free rollouts leave more predicts nothing.
    half: float = 0.5
    # Share of the error of one law's free rollouts that laws leave which are told their modes: a
    # heat pump, a cycler, a car and cells leave a sixth at most, a tank behind one that nobody
    # measured, which is no switch, half.
    told: float = 1.0 / 3.0
    # Held-out rows, and changes of the mode, that allow a verdict.
    fewest_rows: int = 50
    fewest_switches: int = 5
    rare_mode: float = 0.005  # share of the training rows below which a mode is absent from them
    # Features of a richer law that is only tried, and rows that each of them needs.
    most_features: int = 200
    rows_a_feature: int = 5
    # Samples of a held-out stretch, as where a recording is identified; turns that look for its
    # start, and their first damping, relative to the diagonal.
    stretch: int = 30
    turns: int = 12
    damping: float = 1e-3
    # Samples that tell where a trajectory starts of which the model has seen nothing: its error is
    # then a fifth of the noise.
    samples_of_start: int = 100
    integrated: float = 1e-5  # of a state's spread: to this rollouts are exact, without noise too


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
    # Scatter of switches in distances of two thresholds, and switches to each side, that still
    # show a memory.
    sharp: float = 0.25
    fewest_switches: int = 3


PREPARING, CLOCKS, RECORDINGS = Preparing(), Clocks(), Recordings()
JUDGING, WORDING = Judging(), Wording()
