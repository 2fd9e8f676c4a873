"""What data say of each thing known: knowledge is a hypothesis."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
        tell nothing, NaN and zero where the other sentences say the same.
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
        if np.isnan(self.value):
            return (
                f"{self.sentence}: follows from the other sentences, and is not asked beside them"
            )
        told = f"{self.name} = {with_error(self.value, self.error)}"
        if self.questioned:
            return f"{self.sentence}: the data would rather have {told}, p = {self.p_value:.2g}"
        return f"{self.sentence}: not contradicted, p = {self.p_value:.2g} (without it {told})"


def blamed(known: Sequence[KnownCheck]) -> str:
    """What to do about sentences that the data contradict; nothing where there are none."""
    said = " and ".join(f'"{one.sentence}"' for one in known if one.questioned)
    return f"What is known contradicts the recordings: leave out or correct {said}." if said else ""


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

    def log_p_unasked(self, region: Region, number: int, /) -> float:
        """That of a sentence that says nothing of the modes that were found."""

    def without_one(self, region: Region, doubted: Sequence[int], /) -> tuple[int, Fit]:
        """The sentence to be given up, of some of which the first is doubted most, and the fit."""


def checks(fit: Fit, region: Region) -> tuple[KnownCheck, ...]:
    """One for each sentence, by an F-test of what the fit gains without it.

    What is wrong makes its neighbours look wrong: one sentence that the data contradict is given
    up, and the fit made without it, before the others are asked.
    """
    found: dict[int, KnownCheck] = {}
    every = range(len(region.sentences))
    most = float(np.log(SIGNIFICANCE / len(every)))
    while len(found) < len(every):
        gain = fit.released(region).gain
        asked = {k: _Asked(fit, region, k, gain) for k in every if k not in found}
        doubted = [k for k in asked if asked[k].log_p < most]
        if not doubted:
            return tuple(found[k] if k in found else asked[k].told() for k in every)
        worst, fit = fit.without_one(region, sorted(doubted, key=lambda k: asked[k].log_p))
        found[worst] = asked[worst].told(fit)
        region = region.without(worst).of_modes(len(fit.coef))
    return tuple(found[k] for k in every)


class _Asked:
    """What is gained without one sentence."""

    def __init__(self, fit: Fit, region: Region, number: int, gain: float):
        self.fit, self.region, self.number = fit, region, number
        own, less = region.owner == number, region.without(number)
        if not own.any():
            self.log_p = fit.log_p_unasked(region, number)
            return
        released = fit.released(less)
        ranks = [one.steps(fit.coef, fit.free).rank for one in (region, less)]
        n_free = max(1, ranks[0] - ranks[1])
        statistic = 2.0 * max(0.0, released.gain - gain) / (n_free * released.unit)
        self.log_p = float(fisher.logsf(statistic, n_free, released.n_values))
        if not region.equal[own].all():
            # missed to one side only; where it is not reached there is nothing to gain
            self.log_p = self.log_p - np.log(2.0) if statistic > 0.0 else 0.0

    def told(self, without: Fit | None = None) -> KnownCheck:
        """The answer, with the row that agrees least, by the fit `without` it if it was made."""
        fit, sentence = without or self.fit, str(self.region.sentences[self.number])
        region = self.region.of_modes(len(fit.coef))
        own = np.flatnonzero(region.owner == self.number)
        released, rows = fit.released(region.without(self.number)), region.matrix[own]
        forms, covariance = rows[:, fit.free], released.covariance()
        untold = np.isinf(np.diag(covariance))
        known = np.where(untold[:, None] | untold, 0.0, covariance)
        variances = np.einsum("rk,kl,rl->r", forms, known, forms) * released.unit
        told = ~(forms[:, untold] != 0.0).any(axis=1) & (variances > 0.0)
        if not told.any():
            follows = not (forms[:, untold] != 0.0).any()
            return KnownCheck(sentence, 1.0, "", np.nan, 0.0 if follows else np.inf, False)
        errors = np.sqrt(np.where(told, variances, np.inf))
        values = np.einsum("rmsf,msf->r", rows, fit.coef + released.change)
        off = np.abs(values - values.clip(region.lower[own], region.upper[own]))
        worst = int((off / errors).argmax())
        row = region.rows[own[worst]]
        scale = row[row != 0.0][0] if (row != 0.0).sum() == 1 else 1.0
        return KnownCheck(
            sentence,
            float(np.exp(self.log_p)),
            _described(row / scale, region.names),
            float(values[worst] / scale),
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
