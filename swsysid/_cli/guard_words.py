"""Where each mode is active, in words that a person uses: "vs > 1.003 vC + 0.6 V"."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import median_abs_deviation

from swsysid._classifier import PolynomialSurfaceClassifier
from swsysid._cli.samples import Samples
from swsysid._cli.settings import WORDING, Wording
from swsysid._data.rows import spread_rows
from swsysid._results import Array

__all__ = ["Inequality", "best_threshold", "inequality", "memory", "regions"]


@dataclass(frozen=True)
class Inequality:
    """Where a surface is positive, such as ``"x > 0.02 m"``, and where negative.

    They are "everywhere" and "nowhere" if all samples are on one side. `share` is that of the
    samples which the words put on the same side as the surface.
    """

    positive: str
    negative: str
    share: float


def regions(surface: PolynomialSurfaceClassifier, samples: Samples) -> list[str]:
    """One line for each mode: where it is. One more where the words leave something out."""
    X = samples.X[spread_rows(len(samples.X), WORDING.most_rows)]
    monomials = surface.surface_features(X)
    names = [str(name) for name in surface.fitted_surfaces.basis.names(samples.names)]
    units = [samples.unit(name) for name in names]
    told = [inequality(coef, monomials, names, units) for coef in surface.coef_]
    lines = []
    for mode, signs in zip(surface.classes_, surface.mode_book_, strict=True):
        sides = [
            each.positive if sign > 0 else each.negative
            for each, sign in zip(told, signs, strict=True)
            if sign
        ]
        lines.append(f"mode {mode} {_together(sides)}")
    share = min(each.share for each in told)
    if share < 1.0:
        lines.append(
            f"(in these words {100 * share:.1f} % of the samples are on the side that the "
            "equations give them)"
        )
    return lines


def _together(sides: Sequence[str]) -> str:
    """All of some inequalities."""
    if "nowhere" in sides:
        return "nowhere"
    told = [side for side in sides if side != "everywhere"]
    return f"where {' and '.join(told)}" if told else "everywhere"


def inequality(
    coef: Array,
    monomials: Array,
    names: Sequence[str],
    units: Sequence[str],
    settings: Wording = WORDING,
) -> Inequality:
    """A surface as an inequality between its largest monomials, the largest of coefficient 1.

    As few terms are kept as put nearly all samples on the same side. The rows of `monomials` are
    samples; names and units are those of its columns, the constant's is "1".

    Examples
    --------
    >>> rows = np.array([[1.0, -2.0, -1.0], [1.0, 2.0, 1.0], [1.0, 1.0, 2.0], [1.0, 2.5, 2.0]])
    >>> inequality(np.array([-1.0, 2.0, -2.0]), rows, ["1", "a", "b"], ["", "V", "V"]).positive
    'a > b + 0.5 V'
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
    kept, threshold, share = _fewest_terms(scaled, monomials, order, above, settings)
    terms = [(float(scaled[place]), names[place]) for place in sorted(kept)]
    left = _sum([term for term in terms if term[0] > 0.0])
    right = _sum([(-value, name) for value, name in terms if value < 0.0])
    right = _with_constant(right, threshold, units[lead])
    sides = (f"{left} > {right}", f"{left} < {right}")
    return Inequality(*(sides if coef[lead] > 0.0 else sides[::-1]), share)


def _fewest_terms(
    scaled: Array, monomials: Array, order: list[int], above: NDArray[np.bool_], settings: Wording
) -> tuple[list[int], float, float]:
    """The terms to keep, their threshold, and the share of the samples on the same side."""
    for n_terms in range(1, len(order)):
        kept = order[:n_terms]
        values = monomials[:, kept] @ scaled[kept]
        threshold = best_threshold(values, above)[0]
        threshold, share = _with_or_without(threshold, values, above, settings.no_constant)
        if share >= settings.same_side:
            return kept, threshold, share
    rest = np.setdiff1d(np.arange(len(scaled)), order)
    values, exact = monomials[:, order] @ scaled[order], -float(monomials[0, rest] @ scaled[rest])
    return (order, *_with_or_without(exact, values, above, settings.no_constant))


def _with_or_without(
    threshold: float, values: Array, above: NDArray[np.bool_], no_constant: float
) -> tuple[float, float]:
    """A threshold, or zero if that is as good, and the share of the samples on the same side."""
    shares = [float(np.mean((values > level) == above)) for level in (0.0, threshold)]
    return (0.0, shares[0]) if shares[0] >= shares[1] - no_constant else (threshold, shares[1])


def _sum(terms: Sequence[tuple[float, str]]) -> str:
    """A sum of positive terms, factors of one left out."""
    return " + ".join(
        name if f"{value:.4g}" == "1" else f"{value:.4g} {name}" for value, name in terms
    )


def _with_constant(terms: str, constant: float, unit: str) -> str:
    number = f"{abs(constant):.4g} {unit}".rstrip()
    if not terms:
        return f"{'-' if constant < 0.0 else ''}{number}" if constant else f"0 {unit}".rstrip()
    if constant == 0.0:
        return terms
    return f"{terms} {'+' if constant > 0.0 else '-'} {number}"


def best_threshold(values: Array, positive: NDArray[np.bool_]) -> tuple[float, float]:
    """The threshold whose sides agree best with a labelling, and the fraction that agrees.

    Examples
    --------
    >>> best_threshold(np.array([1.0, 2.0, 3.0, 5.0]), np.array([True, True, False, False]))
    (2.5, 1.0)
    """
    order = np.argsort(values)
    ordered, labels = values[order], np.asarray(positive)[order]
    # with the first k samples below the threshold, those positive there plus those negative above
    # agree with "below is positive"; all others with the opposite orientation
    below = np.cumsum(labels)[:-1] + (~labels).sum() - np.cumsum(~labels)[:-1]
    share = np.maximum(below, len(labels) - below) / len(labels)
    k = int(np.argmax(share))
    return float(ordered[k : k + 2].mean()), float(share[k])


def memory(modes: NDArray[np.intp], samples: Samples, settings: Wording = WORDING) -> str:
    """Where each of two modes begins, if one column says it: below one level, above another.

    "" if no column does, or the modes change too seldom to say.
    """
    order = np.argsort(samples.groups, kind="stable")
    modes, groups, X = modes[order], samples.groups[order], samples.X[order]
    last = np.flatnonzero((modes[1:] != modes[:-1]) & (groups[1:] == groups[:-1]))
    first = last + 1
    entered = [last[modes[first] == mode] for mode in (0, 1)]
    if min(map(len, entered)) < settings.fewest_switches:
        return ""
    crossings = [0.5 * (X[rows] + X[rows + 1]) for rows in entered]
    levels = [np.median(points, axis=0) for points in crossings]
    scatter = np.max([median_abs_deviation(points) for points in crossings], axis=0)
    gap = np.abs(levels[0] - levels[1])
    sharpness = np.where(gap > 0.0, scatter / np.where(gap > 0.0, gap, 1.0), np.inf)
    column = int(np.argmin(sharpness))
    if sharpness[column] > settings.sharp:
        return ""
    low, high = sorted((0, 1), key=lambda mode: float(levels[mode][column]))
    name = samples.names[column]
    below, above = (
        f"{levels[mode][column]:.4g} {samples.unit(name)}".rstrip() for mode in (low, high)
    )
    return f"mode {low} begins below {name} = {below}, mode {high} above {name} = {above}"
