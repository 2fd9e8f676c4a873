"""Polynomials in named columns, and what of them follows from others.

A polynomial is a dict from exponents, one for each column, to coefficients.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import nnls

Powers = tuple[int, ...]
Polynomial = dict[Powers, float]

# relative rounding of coefficients that are equal by construction
_ROUNDING = 1e-9


def total(left: Polynomial, right: Polynomial, sign: float = 1.0) -> Polynomial:
    """``left + sign * right``."""
    found = dict(left)
    for powers, coef in right.items():
        found[powers] = found.get(powers, 0.0) + sign * coef
    return found


def product(left: Polynomial, right: Polynomial) -> Polynomial:
    """``left * right``."""
    found: Polynomial = {}
    for one, a in left.items():
        for other, b in right.items():
            powers = tuple(p + q for p, q in zip(one, other, strict=True))
            found[powers] = found.get(powers, 0.0) + a * b
    return found


def nonzero(value: Polynomial) -> Polynomial:
    """Without the terms that are zero."""
    return {powers: coef for powers, coef in value.items() if coef != 0.0}


def negative(value: Polynomial) -> Polynomial:
    """``-value``."""
    return {powers: -coef for powers, coef in value.items()}


def rate(value: Polynomial, laws: Mapping[int, Polynomial]) -> Polynomial | None:
    """The time derivative along laws of some columns, the Lie derivative.

    None where the polynomial has a column without a law, such as an input.

    Examples
    --------
    The height h of a ball changes with its speed v:

    >>> rate({(1, 0): -1.0}, {0: {(0, 1): 1.0}, 1: {(0, 0): -9.81}})
    {(0, 1): -1.0}
    """
    found: Polynomial = {}
    for powers, coef in value.items():
        for column, power in enumerate(powers):
            if not power:
                continue
            if column not in laws:
                return None
            lower = tuple(p - (place == column) for place, p in enumerate(powers))
            found = total(found, product({lower: coef * power}, laws[column]))
    return nonzero(found)


def substituted(value: Polynomial, columns: Mapping[int, Polynomial]) -> Polynomial:
    """The polynomial with other polynomials in the place of some columns.

    Examples
    --------
    >>> substituted({(2,): 1.0}, {0: {(1,): 1.0, (0,): 1.0}})
    {(2,): 1.0, (1,): 2.0, (0,): 1.0}
    """
    found: Polynomial = {}
    for powers, coef in value.items():
        left = tuple(0 if column in columns else power for column, power in enumerate(powers))
        term: Polynomial = {left: coef}
        for column, replacement in columns.items():
            for _ in range(powers[column]):
                term = product(term, replacement)
        found = total(found, term)
    return nonzero(found)


def follows(
    claim: Polynomial, zero: Sequence[Polynomial] = (), positive: Sequence[Polynomial] = ()
) -> bool:
    """Whether a claim is shown not to be negative where others are zero or not negative.

    It is where it is a sum of these with weights, not negative but for those that are zero, and of
    a number that is not negative: for affine polynomials that is all there is to know (Farkas).

    Examples
    --------
    Where T is 22, T - 20 is not negative; nothing tells its sign where T is unknown:

    >>> claim = {(1,): 1.0, (0,): -20.0}
    >>> follows(claim, zero=[{(1,): 1.0, (0,): -22.0}]), follows(claim)
    (True, False)
    """
    if not claim:
        return True
    one: Polynomial = {(0,) * len(next(iter(claim))): 1.0}
    given = [one, *zero, *map(negative, zero), *positive]
    keys = sorted({powers for each in (claim, *given) for powers in each})
    table = np.array([[each.get(powers, 0.0) for each in (*given, claim)] for powers in keys])
    table /= np.maximum(np.abs(table).max(axis=0), 1e-300)
    # each monomial of the claim counts alike: which is large on the data is not known
    sizes = np.where(table[:, -1] != 0.0, table[:, -1], np.abs(table).max(axis=1))
    rows = table / np.maximum(np.abs(sizes), 1e-300)[:, None]
    _, residual = nnls(rows[:, :-1], rows[:, -1])
    return bool(residual <= _ROUNDING)
