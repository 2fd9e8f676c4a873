"""The numbers of a simulation, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers that hold for every system; users have the `Options` of `simulate`."""

    # -- of the size of a state: tolerance of the integration beside the relative one, the magnitude
    # at which it has diverged, and what a state that starts at zero is of the largest one
    atol: float = 1e-10
    state_bound: float = 1e9
    least_size: float = 1e-3

    # -- events: parts of a step at whose ends the mode is compared; so many switches in so small a
    # fraction of the requested time are Zeno behaviour
    n_parts: int = 4
    zeno_switches: int = 64
    zeno_fraction: float = 1e-9

    # -- sliding: share of the size of the states over which differences are taken and sides are
    # asked: the square root of rounding, and a hundred times that for rounding in the guard
    shift: float = 1e-6

    # -- systems with memory: Runge-Kutta steps of a sample interval, and share of the requested
    # time that a state is moved along a field to see where that leads
    n_substeps: int = 4
    ahead: float = 1e-6

    # -- given channels: inputs jump at the ends of an interval, so columns are asked a millionth of
    # it further in; times closer than this share of a step are the same to roundoff
    inside: float = 1e-6
    same_time: float = 1e-9


SETTINGS = Settings()
