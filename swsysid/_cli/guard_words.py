"""Where each mode is active, in words that a person uses: "vs > 1.003 vC + 0.6 V"."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._cli.samples import Samples
from swsysid._cli.settings import WORDING
from swsysid._data.rows import spread_rows
from swsysid._results import Array
from swsysid._surfaces.surface import MarginClassifier


@dataclass(frozen=True)
class Inequality:
    """Where a surface is positive, such as ``"x > 0.02 m"``, and where negative.

    They are "everywhere" and "nowhere" if all samples are on one side. `share` is that of the
    samples which the words put on the same side as the surface. One that compares columns with a
    number has their `sum` and that `level`, above which the surface is positive if it `rises`.
    """

    positive: str
    negative: str
    share: float
    sum: str = field(default="", repr=False)
    level: float = field(default=np.nan, repr=False)
    rises: bool = field(default=True, repr=False)

    def side(self, sign: int) -> _Side:
        """One of both."""
        words, is_above = self.positive if sign > 0 else self.negative, (sign > 0) == self.rises
        return _Side(words, (self.sum, is_above), self.level if is_above else -self.level)


class _Side(NamedTuple):
    """A side in words; of several that bound a sum from one side the tightest says all."""

    words: str
    bounds: tuple[str, bool]
    tightness: float


def regions(surface: MarginClassifier, samples: Samples) -> list[str]:
    """One line for each mode: where it is. One more where the words leave something out."""
    X = samples.with_recorded_inputs[spread_rows(len(samples.X), WORDING.most_rows)]
    monomials = surface.surface_features(X)
    names = [str(name) for name in surface.fitted_surfaces.basis.names(samples.names)]
    units = [samples.unit(name) for name in names]
    levels = _levels(samples)
    told = [inequality(coef, monomials, names, units, levels) for coef in surface.coef_]
    lines = []
    for mode, signs in zip(surface.classes_, surface.mode_book_, strict=True):
        of = [(each, sign) for each, sign in zip(told, signs, strict=True) if sign]
        sides = [each.side(sign) for each, sign in of]
        limits = [
            side.words for side in sides if side.words != "everywhere" and _bounds(side, sides)
        ]
        where = f"where {' and '.join(limits)}" if limits else "everywhere"
        lines.append(
            f"mode {mode} {'nowhere' if any(side.words == 'nowhere' for side in sides) else where}"
        )
    share = min(each.share for each in told)
    if share < 1.0:
        lines.append(
            f"(in these words {100 * share:.1f} % of the samples are on the side that the "
            "equations give them)"
        )
    return lines


def inequality(
    coef: Array,
    monomials: Array,
    names: Sequence[str],
    units: Sequence[str],
    levels: Mapping[str, Array] = MappingProxyType({}),
) -> Inequality:
    """A surface as an inequality between its largest monomials, the largest of coefficient 1.

    As few terms are kept as put nearly all samples on the same side. The rows of `monomials` are
    samples; names and units are those of its columns, the constant's is "1". Of a column that
    takes few values, as a switch does, these are `levels`, and those on each side are named.

    Examples
    --------
    >>> rows = np.array([[1.0, -2.0, -1.0], [1.0, 2.0, 1.0], [1.0, 1.0, 2.0], [1.0, 2.5, 2.0]])
    >>> inequality(np.array([-1.0, 2.0, -2.0]), rows, ["1", "a", "b"], ["", "V", "V"]).positive
    'a > b + 0.5 V'
    >>> levels = {"b": np.array([-1.0, 1.0, 2.0])}
    >>> inequality(np.array([0.0, 0.0, -1.0]), rows, ["1", "a", "b"], ["", "V", ""], levels)
    Inequality(positive='b = -1', negative='b = 1 or 2', share=1.0)

    A square alone says how far a column is from zero:

    >>> x = np.array([-3.0, -1.0, 1.0, 3.0])
    >>> rows = np.column_stack([np.ones(4), x, x**2])
    >>> inequality(np.array([-4.0, 0.0, 1.0]), rows, ["1", "x", "x^2"], ["", "m", ""]).positive
    '|x| > 2 m'
    """
    positive = monomials @ coef > 0.0
    if positive.all() or not positive.any():
        words = ("everywhere", "nowhere") if positive.all() else ("nowhere", "everywhere")
        return Inequality(*words, 1.0)
    amounts = np.abs(coef) * monomials.std(axis=0)
    order = [int(place) for place in np.argsort(-amounts, kind="stable") if amounts[place] > 0.0]
    lead = order[0]
    scaled = coef / coef[lead]
    above = positive if coef[lead] > 0.0 else ~positive
    kept, threshold, share = _fewest_terms(scaled, monomials, order, above)
    values = levels.get(names[lead], np.empty(0))
    if kept == [lead] and len(np.unique(values > threshold)) == 2:
        parted = values[values > threshold], values[values <= threshold]
        highest, lowest = (_one_of(names[lead], side, units[lead]) for side in parted)
        return Inequality(*_turned(highest, lowest, coef[lead]), share)
    name, base = names[lead], names[lead].removesuffix("^2")
    if kept == [lead] and base != name and base in names and threshold > 0.0:
        bound = f"{np.sqrt(threshold):.4g} {units[names.index(base)]}".rstrip()
        return Inequality(*_turned(f"|{base}| > {bound}", f"|{base}| < {bound}", coef[lead]), share)
    terms = [(float(scaled[place]), names[place]) for place in sorted(kept)]
    left = _sum((value, name) for value, name in terms if value > 0.0)
    right = _sum((-value, name) for value, name in terms if value < 0.0)
    constant = f"{abs(threshold):.4g} {units[lead]}".rstrip()
    if threshold and right:
        right += f" {'+' if threshold > 0.0 else '-'} {constant}"
    elif not right:
        right = f"-{constant}" if threshold < 0.0 else constant
    words = _turned(f"{left} > {right}", f"{left} < {right}", coef[lead])
    if len(terms) != 1:
        return Inequality(*words, share)
    return Inequality(*words, share, left, threshold, bool(coef[lead] > 0.0))


def _bounds(side: _Side, sides: Sequence[_Side]) -> bool:
    """Whether no other one says the same of the same sum, and more."""
    return not any(
        other.bounds == side.bounds and other.tightness > side.tightness for other in sides
    )


def _turned(above: str, below: str, coef: float) -> tuple[str, str]:
    """What is said where a surface is positive, and where negative."""
    return (above, below) if coef > 0.0 else (below, above)


def _levels(samples: Samples) -> dict[str, Array]:
    """The values of the inputs that take few of them, as they were measured: a filter adds some."""
    recorded, n_states = samples.recorded, len(samples.rate_names)
    inputs = samples.X[:, n_states:] if recorded is None else recorded.inputs
    known = [np.unique(column[np.isfinite(column)]) for column in inputs.T]
    return {
        name: values
        for name, values in zip(samples.names[n_states:], known, strict=True)
        if len(values) <= WORDING.levels
    }


def _one_of(name: str, levels: Array, unit: str) -> str:
    """A column that has one of some values."""
    return f"{name} = {' or '.join(f'{level:.4g}' for level in levels)} {unit}".rstrip()


def _fewest_terms(
    scaled: Array, monomials: Array, order: list[int], above: NDArray[np.bool_]
) -> tuple[list[int], float, float]:
    """The terms to keep, their threshold, and the share of the samples on the same side."""
    for n_terms in range(1, len(order)):
        kept = order[:n_terms]
        values = monomials[:, kept] @ scaled[kept]
        threshold, share = _with_or_without(best_threshold(values, above), values, above)
        if share >= WORDING.same_side:
            return kept, threshold, share
    rest = np.setdiff1d(np.arange(len(scaled)), order)
    values, exact = monomials[:, order] @ scaled[order], -float(monomials[0, rest] @ scaled[rest])
    return (order, *_with_or_without(exact, values, above))


def _with_or_without(
    threshold: float, values: Array, above: NDArray[np.bool_]
) -> tuple[float, float]:
    """A threshold, or zero if that is as good, and the share of the samples on the same side."""
    zero, share = (float(np.mean((values > level) == above)) for level in (0.0, threshold))
    return (0.0, zero) if zero >= share - WORDING.no_constant else (threshold, share)


def _sum(terms: Iterable[tuple[float, str]]) -> str:
    """A sum of positive terms, factors of one left out."""
    return " + ".join(f"{value:.4g} {name}".removeprefix("1 ") for value, name in terms)


def best_threshold(values: Array, positive: NDArray[np.bool_]) -> float:
    """The threshold whose sides agree best with a labelling.

    Examples
    --------
    >>> best_threshold(np.array([1.0, 2.0, 3.0, 5.0]), np.array([True, True, False, False]))
    2.5
    """
    order = np.argsort(values)
    ordered, labels = values[order], np.asarray(positive)[order]
    # with the first k samples below the threshold, those positive there plus those negative above
    # agree with "below is positive"; all others with the opposite orientation
    below = np.cumsum(labels)[:-1] + (~labels).sum() - np.cumsum(~labels)[:-1]
    k = int(np.argmax(np.maximum(below, len(labels) - below)))
    return float(ordered[k : k + 2].mean())


def higher_surface(modes: NDArray[np.intp], samples: Samples, degree: int) -> str:
    """That a surface of one degree more than `degree` tells the modes; "" where it does not.

    It tells them if it puts less than half as many samples on a wrong side as one of `degree`.
    """
    rows = spread_rows(len(modes), WORDING.most_rows)
    X, modes = samples.X[rows], modes[rows]
    lower, higher = (
        PolynomialSurfaceClassifier(each, random_state=0).fit(X, modes).score(X, modes)
        for each in (degree, degree + 1)
    )
    if 2.0 * (1.0 - higher) >= 1.0 - lower:
        return ""
    return (
        f"A surface of degree {degree + 1} tells {100 * higher:.0f} % of them: run again with "
        f"--surface-degree {degree + 1}."
    )
