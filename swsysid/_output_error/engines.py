"""What a search asks of whoever estimates laws: of rates, or of a quantity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from swsysid._output_error import estimate, regression, scan
from swsysid._output_error.criterion import Left
from swsysid._output_error.estimate import Fit
from swsysid._output_error.law import Law
from swsysid._output_error.scan import Score
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array


@dataclass(frozen=True)
class Engine:
    """Estimation of laws, and what they leave of stretches."""

    fitted: Callable[..., Fit]  # a law, stretches; where it may begin
    left_over: Callable[..., Left]  # a fit, other stretches; where their states may begin
    left_of: Callable[..., Array]  # the same by the law alone, which nothing helps
    scores: Callable[..., Sequence[Score]]  # of a fit, by how nodes are tied
    stepped: Callable[[Law, Stretches], Stretches]  # in steps that the law allows
    disturbances: tuple[float, ...]  # of a law, with each of which a first effect is looked for


RATES = Engine(
    estimate.fitted,
    estimate.left_over,
    estimate.rolled_out,
    scan.scores,
    estimate.stepped,
    SETTINGS.disturbances,
)
QUANTITIES = Engine(
    regression.fitted,
    regression.left_over,
    regression.left_of,
    regression.scores,
    lambda _, own: own,
    SETTINGS.disturbances[:1],  # nothing is rolled out
)
