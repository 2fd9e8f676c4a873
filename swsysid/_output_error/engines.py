"""What a search asks of whoever estimates laws: of rates, or of a quantity."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from swsysid._output_error import estimate, regression, scan
from swsysid._output_error.criterion import Left, price
from swsysid._output_error.estimate import Fit, cost
from swsysid._output_error.law import Law
from swsysid._output_error.scan import Score
from swsysid._output_error.settings import SETTINGS
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid.effects import UnknownFunction


@dataclass(frozen=True, eq=False)
class Model:
    """A law fitted to all stretches, and what laws fitted to some of them leave of the others."""

    fit: Fit
    unseen: Left

    @property
    def law(self) -> Law:
        """The law with its coefficients."""
        return self.fit.law

    @property
    def is_nameless(self) -> bool:
        """True of a function of any shape as the last effect."""
        return isinstance(self.law.terms[-1].effect, UnknownFunction)

    def loss(self, count: float) -> float:
        """Minus the log likelihood of all stretches as so many samples, with its price."""
        return count * self.law.n_states * cost(self.fit) + price(self.law.n_parameters, count)


def as_likely(models: Sequence[Model], count: float, significance: float) -> list[Model]:
    """Those that so many independent samples do not surely speak against beside the likeliest."""
    losses = [one.loss(count) for one in models]
    most = min(losses) - np.log(significance)
    return [one for one, loss in zip(models, losses, strict=True) if loss <= most]


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
