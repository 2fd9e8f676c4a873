"""What data say of each thing known: knowledge is a hypothesis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from swsysid._known.region import Region
from swsysid._known.sentences import Energy, Guard, Names
from swsysid._rendering.printing import linear_combination, with_error
from swsysid._results import Array

# Chance that anything that is right is questioned, all sentences of a fit together.
SIGNIFICANCE = 0.01
_NO_CHANCE = 1e-99


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
        tell nothing, NaN and zero where it says nothing of the laws that were found.
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
            return f"{self.sentence}: says nothing of the laws found, and is not asked"
        told = f"{self.name} = {with_error(self.value, self.error)}"
        chance = f"p = {self.p_value:.2g}" if self.p_value > _NO_CHANCE else "p < 1e-99"
        if self.questioned:
            return f"{self.sentence}: the data would rather have {told}, {chance}"
        return f"{self.sentence}: not contradicted, {chance} (without it {told})"


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


def least_unit(matrix: Array, coef: Array, freedom: float, exactly: float) -> float:
    """Mean square that is left at least: what laws say is known to a share of it, `exactly`.

    Of data without noise rounding and the steps of an integration are left, which are no evidence.
    """
    return max(exactly**2 * float(coef @ matrix @ coef) / freedom, float(np.finfo(float).tiny))


class GuardDoubt(NamedTuple):
    """What data would rather have of a surface, and how surely."""

    log_p: float
    name: str  # of the sum that passes a threshold
    threshold: float
    error: float


class Fit(Protocol):
    """Coefficients fitted within a region."""

    @property
    def coef(self) -> Array:
        """The coefficients, (n_modes, n_equations, n_terms)."""

    @property
    def free(self) -> NDArray[np.bool_]:
        """Those that are free but for the region."""

    @property
    def falls_short(self) -> bool:
        """True if it leaves more than noise, or has fewer modes than were asked for."""

    def released(self, region: Region, /) -> Released:
        """What it becomes in another region, to first order."""

    def of_guard(self, guard: Guard, /) -> GuardDoubt | None:
        """What it says of a shape of surfaces; None where there is no surface."""

    def without(self, left_out: frozenset[int], /) -> Self:
        """A whole identification without some sentences."""

    def log_p_beside(self, other: Self, /) -> float:
        """That nothing but chance makes another one likelier, which more is left free of."""

    def likeliest(self, others: Mapping[int, Self], /) -> int:
        """The number of the one that is likeliest for what it leaves free."""


F = TypeVar("F", bound=Fit)


def checks(fit: F, region: Region) -> tuple[KnownCheck, ...]:
    """One for each sentence, by an F-test of what the fit gains without it.

    What is wrong makes its neighbours look wrong, and may distort the modes so that no small step
    from there is a gain. Where anything is in doubt, or more than noise is left, the sentences are
    asked beside an identification without all of them, too. One is given up, and the fit made
    without it, until no other is in doubt; of that fit it is asked what those that were given up
    would cost.
    """
    every = frozenset(range(len(region.sentences)))
    most = float(np.log(SIGNIFICANCE / len(every)))
    given_up: set[int] = set()
    while doubted := _doubted(fit, region, every - given_up, most):
        tried = {k: fit.without(region.without(k, *beside).left_out) for k, beside in doubted}
        given_up.add(fit.likeliest(tried))
        region = region.without(*given_up)
        fit = fit.without(region.left_out)
        region = region.of_modes(len(fit.coef))
    asked = (_Asked(fit, region.whole.without(*given_up - {k}), k) for k in sorted(every))
    return tuple(one.told(most if one.number in given_up else -np.inf) for one in asked)


def _doubted(
    fit: F, region: Region, left: frozenset[int], most: float
) -> list[tuple[int, tuple[int, ...]]]:
    """Sentences that data contradict, each with others that say the same in part."""
    asked = {k: _Asked(fit, region, k) for k in left}
    doubted = {k for k in left if asked[k].log_p < most}
    if left and (doubted or fit.falls_short):
        free = fit.without(frozenset(range(len(region.sentences))))
        if fit.log_p_beside(free) < most:
            whole = region.of_modes(len(free.coef))
            alone = {k: _Asked(free, whole.without(*left - {k}), k) for k in left}
            doubted |= {k for k in left if alone[k].log_p < most}
    return [(k, asked[k].beside) for k in sorted(doubted)]


class _Asked:
    """What is gained without one sentence, those that say the same in part released with it."""

    def __init__(self, fit: Fit, region: Region, number: int):
        self.fit, self.region, self.number, self.log_p = fit, region, number, 0.0
        sentence = region.sentences[number]
        self.of_guard = fit.of_guard(sentence) if isinstance(sentence, Guard) else None
        if self.of_guard is not None:
            self.log_p = self.of_guard.log_p
        region = region.tangent(fit.coef)
        self.beside = region.beside(number, fit.coef, fit.free)
        held = region.without(*self.beside)
        own, self.less = region.owner == number, held.without(number)
        if not own.any():
            return
        both = [fit.released(one) for one in (held, self.less)]
        ranks = [one.steps(fit.coef, fit.free).rank for one in (held, self.less)]
        n_free = max(1, ranks[0] - ranks[1] + region.n_bent(number, fit.coef))
        statistic = 2.0 * max(0.0, both[1].gain - both[0].gain) / (n_free * both[1].unit)
        self.log_p = float(fisher.logsf(statistic, n_free, both[1].n_values))
        if not region.equal[own].all():
            # missed to one side only; where it is not reached there is nothing to gain
            self.log_p = self.log_p - np.log(2.0) if statistic > 0.0 else 0.0

    def told(self, most: float) -> KnownCheck:
        """The answer, with the row that agrees least; questioned where log p is below `most`."""
        fit, region, sentence = self.fit, self.region, str(self.region.sentences[self.number])
        if self.of_guard is not None:
            doubt, chance = self.of_guard, float(np.exp(self.log_p))
            return KnownCheck(sentence, chance, *doubt[1:], self.log_p < most)
        released = fit.released(self.less)
        region = region.tangent(fit.coef + released.change)
        own = np.flatnonzero(region.owner == self.number)
        rows = region.matrix[own]
        forms, covariance = rows[:, fit.free], released.covariance()
        untold = np.isinf(np.diag(covariance))
        known = np.where(untold[:, None] | untold, 0.0, covariance)
        variances = np.einsum("rk,kl,rl->r", forms, known, forms) * released.unit
        told = ~(forms[:, untold] != 0.0).any(axis=1) & (variances > 0.0)
        if not told.any():
            settled = not (forms[:, untold] != 0.0).any()
            return KnownCheck(sentence, 1.0, "", np.nan, 0.0 if settled else np.inf, False)
        errors = np.sqrt(np.where(told, variances, np.inf))
        values = np.einsum("rmsf,msf->r", rows, fit.coef + released.change)
        off = np.abs(values - values.clip(region.lower[own], region.upper[own]))
        worst = int((off / errors).argmax())
        row = region.rows[own[worst]]
        scale = row[row != 0.0][0] if (row != 0.0).sum() == 1 else 1.0
        asked, name = region.sentences[self.number], ""
        if isinstance(asked, Energy):
            name = asked.direction(row, region.names)
        return KnownCheck(
            sentence,
            float(np.exp(self.log_p)),
            name or _described(row / scale, region.names),
            float(values[worst] / scale),
            float(errors[worst] / abs(scale)),
            self.log_p < most,
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
