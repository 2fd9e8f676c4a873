"""How much a report of effects says and shows, with the reason of each number."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["REPORT", "ReportSettings"]


@dataclass(frozen=True)
class ReportSettings:
    """Numbers of the text, the page and the pictures."""

    # -- what is worth telling ----------------------------------------------------------------
    worth_telling: float = 0.01  # share by which an error is lowered
    smallest_p_value: float = 1e-16  # smaller ones are rounding
    exact: float = 1e-9  # of the spread of a velocity: a smaller error is rounding
    confidence: float = 0.95  # of the band of a shape, as of the intervals of parameters

    # -- lists --------------------------------------------------------------------------------
    names_in_text: int = 12  # lines of a terminal
    names_on_page: int = 30  # words of a paragraph
    most_rows: int = 40  # of a table of trajectories

    # -- rollouts -----------------------------------------------------------------------------
    most_rollouts: int = 4  # each has a picture of its own
    most_samples: int = 1000  # of one rollout: seconds of work, and all that a picture resolves

    # -- pictures -----------------------------------------------------------------------------
    most_dots: int = 3000
    most_bars: int = 24  # whose names can be read
    longest_label: int = 34  # letters on one line
    decades: float = 30.0  # errors that differ by a larger factor stand on a logarithmic axis
    jump: float = 0.02  # neighbours of a function differ by less than this share of its range
    stretch: int = 300  # samples of one trajectory that are shown where time is the axis


REPORT = ReportSettings()
