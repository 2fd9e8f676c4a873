"""The numbers of automata, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """Numbers that hold for every automaton; users have the `Options` of `simulate`."""

    # -- rounding: a value is zero within so many roundings of the terms it is made of, and of the
    # states and times at which it was taken
    roundings: float = 8.0
    # -- crossings: roots of a guard so close to the real line, in halves of a step, are looked at:
    # a double root comes out as a pair apart by the square root of rounding
    close_pair: float = 1e-6
    # -- past rows that a law may see: more is a slip of the hand
    most_lags: int = 1000
    # -- texts: terms of a polynomial beyond which it is a slip of the hand
    most_terms: int = 3000


SETTINGS = Settings()
