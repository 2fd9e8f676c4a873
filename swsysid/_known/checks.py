"""What data say of each thing known: knowledge is a hypothesis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from swsysid._known.region import Region
from swsysid._known.sentences import Names
from swsysid._rendering.printing import linear_combination, with_error
from swsysid._results import Array

# Chance that anything that is right is questioned, all sentences of a fit together.
SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class KnownCheck:
    """What the data would rather have of one thing known.

    Attributes
    ----------
    sentence : str
        As `Known` prints it.
    p_value : float
        Chance of data that speak against it as these do, if it is right.
    name : str
        The coefficient, or combination of them, with which the data agree least.
    value, error : float
        What the data would rather have there, and its standard error; NaN and infinite where they
        tell nothing.
    questioned : bool
        True where the data contradict it: right knowledge is questioned in one fit of a hundred.
    """

    sentence: str
    p_value: float
    name: str
    value: float
    error: float
    questioned: bool

    def __str__(self) -> str:
        if not np.isfinite(self.error):
            return f"{self.sentence}: the data do not tell (nothing else would fit better)"
        told = f"{self.name} = {with_error(self.value, self.error)}"
        if self.questioned:
            return f"{self.sentence}: the data would rather have {told}, p = {self.p_value:.2g}"
        return f"{self.sentence}: not contradicted, p = {self.p_value:.2g} (without it {told})"


class Released(NamedTuple):
    """What a fit becomes where less is known."""

    change: Array  # (n_modes, n_equations, n_terms): of the coefficients
    gain: float  # half the squares, in units of the noise, by which the misfit is less
    unit: float  # what twice the gain of a direction is that says nothing, in the mean
    n_values: float  # with which the unit is known
    covariance: Callable[[], Array]  # of the free coefficients, at a unit of one


class Fit(Protocol):
    """Coefficients fitted within a region."""

    @property
    def coef(self) -> Array:
        """The coefficients, (n_modes, n_equations, n_terms)."""

    @property
    def free(self) -> NDArray[np.bool_]:
        """Those that are free but for the region."""

    def released(self, region: Region, /) -> Released:
        """What it becomes in another region, to first order."""

    def refitted(self, region: Region, /) -> Fit:
        """The same fitted in another region."""


def checks(fit: Fit, region: Region) -> tuple[KnownCheck, ...]:
    """One for each sentence, by an F-test of what the fit gains without it.

    What is wrong makes its neighbours look wrong: without the sentence that the data contradict
    most the fit is made again, before the others are asked.
    """
    found: dict[int, KnownCheck] = {}
    every = range(len(region.sentences))
    while len(found) < len(every):
        gain = fit.released(region).gain
        asked = {k: _Asked(fit, region, k, gain) for k in every if k not in found}
        worst = min(asked, key=lambda k: asked[k].log_p)
        if asked[worst].log_p >= np.log(SIGNIFICANCE / len(every)):
            return tuple(found[k] if k in found else asked[k].told() for k in every)
        region = region.without(worst)
        fit = fit.refitted(region)
        found[worst] = asked[worst].told(fit)
    return tuple(found[k] for k in every)


class _Asked:
    """What is gained without one sentence."""

    def __init__(self, fit: Fit, region: Region, number: int, gain: float):
        self.fit, self.region, self.number = fit, region, number
        self.own, less = np.flatnonzero(region.owner == number), region.without(number)
        self.released = fit.released(less)
        ranks = [one.steps(fit.coef, fit.free).rank for one in (region, less)]
        n_free = max(1, ranks[0] - ranks[1])
        statistic = 2.0 * max(0.0, self.released.gain - gain) / (n_free * self.released.unit)
        self.log_p = float(fisher.logsf(statistic, n_free, self.released.n_values))
        if not region.equal[self.own].all():
            # missed to one side only; where it is not reached there is nothing to gain
            self.log_p = self.log_p - np.log(2.0) if statistic > 0.0 else 0.0

    def told(self, without: Fit | None = None) -> KnownCheck:
        """The answer, with the row that agrees least, by the fit `without` it if it was made."""
        sentence, rows = str(self.region.sentences[self.number]), self.region.matrix[self.own]
        forms, covariance = rows[:, self.fit.free], self.released.covariance()
        untold = np.isinf(np.diag(covariance))
        known = np.where(untold[:, None] | untold, 0.0, covariance)
        variances = np.einsum("rk,kl,rl->r", forms, known, forms) * self.released.unit
        told = ~(forms[:, untold] != 0.0).any(axis=1) & (variances > 0.0)
        if not told.any():
            return KnownCheck(sentence, 1.0, "", np.nan, np.inf, False)
        errors = np.sqrt(np.where(told, variances, np.inf))
        coef = self.fit.coef + self.released.change if without is None else without.coef
        moved = np.abs(np.einsum("rmsf,msf->r", rows, coef - self.fit.coef))
        worst = int((moved / errors).argmax())
        row = self.region.rows[self.own[worst]]
        scale = row[row != 0.0][0] if (row != 0.0).sum() == 1 else 1.0
        return KnownCheck(
            sentence,
            float(np.exp(self.log_p)),
            _described(row / scale, self.region.names),
            float((rows[worst] * coef).sum() / scale),
            float(errors[worst] / abs(scale)),
            without is not None,
        )


def _described(row: Array, names: Names) -> str:
    """A sum of coefficients, with their modes where there are several."""
    parts = []
    for mode, equation, term in sorted(
        zip(*np.nonzero(row), strict=True), key=lambda place: -row[place]
    ):
        where = f" in mode {mode}" if names.n_modes > 1 else ""
        name = f"{names.equations[equation]}'[{names.terms[term]}]{where}"
        parts.append((float(row[mode, equation, term]), name))
    return linear_combination(*zip(*parts, strict=True), brief=True)
