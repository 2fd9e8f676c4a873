"""What a figure must reach, and the mark of one that does not: the same in every table."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from math import inf

__all__ = ["MISSED", "Goal"]

REACHED, MISSED = "reached", "**missed**"


@dataclass(frozen=True)
class Goal:
    """A limit from below, from above, or both.

    Attributes
    ----------
    at_least, at_most : float or None
        None where there is no limit on that side.
    percent : bool
        The figures are shares; the limits are told in per cent.
    """

    at_least: float | None = None
    at_most: float | None = None
    percent: bool = False

    @classmethod
    def of(cls, stored: dict | None) -> Goal:
        """The goal in a file of results; nothing stored is no limit."""
        return cls(**(stored or {}))

    def stored(self) -> dict:
        """What a file of results keeps: the limits that there are."""
        unset = asdict(Goal())
        return {name: value for name, value in asdict(self).items() if value != unset[name]}

    def is_reached(self, value: float) -> bool:
        """Whether a figure is within the limits; one that is not a number never is."""
        low = -inf if self.at_least is None else self.at_least
        high = inf if self.at_most is None else self.at_most
        return low <= value <= high

    def verdict(self, value: float) -> str:
        """The mark beside a figure; empty where nothing is asked of it."""
        if self.at_least is None and self.at_most is None:
            return ""
        return REACHED if self.is_reached(value) else MISSED

    @property
    def told(self) -> str:
        """The limits in words; they say whether larger or smaller is better."""
        low, high = (_number(limit, self.percent) for limit in (self.at_least, self.at_most))
        unit = " %" if self.percent else ""
        if low and high:
            return f"{low} to {high}{unit}"
        return f"at least {low}{unit}" if low else f"at most {high}{unit}" if high else ""


def _number(limit: float | None, percent: bool) -> str:
    return "" if limit is None else f"{100 * limit if percent else limit:g}"
