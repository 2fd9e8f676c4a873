"""The numbers of a refinement, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers that hold for every model; users have the options of `refine`."""

    # -- segments: a thirty-second of the data, but no fewer samples than decide about a state
    n_segments: int = 32
    shortest: int = 10
    # rounds in which steps or the scale of a surface may turn out to need another look
    most_rounds: int = 3

    # -- which coefficients are free: what a fitted law differs from another column by rounding
    rounding: float = 1e-9

    # -- integration: a step times the fastest rate of the model; the error of a Runge-Kutta step is
    # its fifth power over 120, 3e-6
    step_rate: float = 0.2
    most_substeps: int = 50
    # rows at which rates and sizes are looked at
    most_rows: int = 500
    # a state so many times larger than anything measured has diverged
    diverged: float = 1e3

    # -- least squares
    tolerance: float = 1e-8
    # of a difference quotient, times the size of a parameter
    step: float = 1e-6


SETTINGS = Settings()
