"""The numbers that a verdict rests on, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Judging:
    """From errors on held-out rows to a verdict."""

    fraction: float = 0.3  # of recordings, or of their samples, that is held out
    # From so many trajectories on whole ones are held out; fewer would make a lottery of the rest.
    whole_groups: int = 5
    blocks: int = 10  # contiguous stretches on which two models are compared, taken as independent
    exact: float = 1e-12  # squared errors below this fraction of the largest are round-off
    # Share of the error by which a richer model must be better to be worth having.
    worth: float = 0.05
    # Probability of as large a gain either way, by Student's t over blocks, below which it is sure.
    chance: float = 0.05
    # Share of a smooth law's error: modes that leave less are no imitation of a curve; and of the
    # spread: one law whose free rollouts leave more predicts nothing.
    half: float = 0.5
    # The same of laws that are told their modes by the samples of a recording: a heat pump, a
    # cycler, a car and cells leave a sixth at most, a tank behind one that nobody measured, which
    # is no switch, half.
    told: float = 1.0 / 3.0
    # Times the noise of neighbouring samples from which on rollouts leave more than noise.
    noise_alone: float = 1.3
    # Held-out rows, and changes of the mode, that allow a verdict; fewer rows of recordings do if
    # their stretches are sure.
    fewest_rows: int = 50
    fewest_switches: int = 5
    rare_mode: float = 0.005  # share of the training rows below which a mode is absent from them
    # Features of a richer law that is only tried, and rows that each of them needs.
    most_features: int = 200
    rows_a_feature: int = 5
    # Samples of a held-out stretch at first, as where a recording is identified: it is doubled
    # where a smooth law leaves nothing but noise. Turns that look for its start, and the share of
    # the squares by which another one must lower them.
    stretch: int = 30
    # Of a short recording: of three, Student's t asks for more than 4 standard errors. With five a
    # thermostat, a ball in a video and a motor with a dead zone are sure, with three one of them;
    # with six none of 16 recordings of smooth plants is.
    fewest_stretches: int = 5
    turns: int = 12
    settled: float = 1e-6
    # Samples that tell where a trajectory starts of which the model has seen nothing: its error is
    # then a fifth of the noise.
    samples_of_start: int = 100
    most_rolled_out: int = 8  # held-out trajectories whose free rollouts are judged in time
    integrated: float = 1e-5  # of a state's spread: to this rollouts are exact, without noise too
    # Scatter of switches in distances of two thresholds, and switches to each side, that still
    # show a memory.
    sharp: float = 0.25
    fewest_entries: int = 3


JUDGING = Judging()
