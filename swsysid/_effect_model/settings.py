"""The numbers of a model with effects."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ModelSettings:
    """How a declared model and effects are fitted together."""

    # -- the alternation of effects and laws: sharpenings of velocities that a filter has made, each
    # from better modes; share of the rows whose mode may still change when it ends
    sharpenings: int = 2
    same_modes: float = 1e-3
    most_sought: int = 12  # columns of an effect in the library while modes are sought anew
    # -- modes of recordings: standard errors of the instant of a switch within which no mode is
    # sure; samples to either side of a switch; nats that a switch must be worth; share of the rows
    # of a fit whose modes a surface between modes that were told before may mistake
    doubt: float = 3.0
    most_doubtful: int = 10
    price_of_a_switch: float = 8.0
    disagreeing: float = 0.05
    # -- rollouts: rows of a record that is there for the names of parameters alone
    rows_for_names: int = 16


SETTINGS = ModelSettings()
