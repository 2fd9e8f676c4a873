"""Names for a function that has none: what it looks like, once a fit has shown its shape.

A score test asks what a candidate explains along the law without it, which has bent to what it
lacks: a spring that begins somewhere is then told from far off. A function of any shape goes where
the recordings lead it, and named effects of its channel are compared with it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from swsysid._output_error.engines import loss
from swsysid._output_error.estimate import Fit
from swsysid._output_error.law import remembers
from swsysid._output_error.scan import Candidate
from swsysid._output_error.stretches import Stretches
from swsysid._results import Array
from swsysid.effects import PlacedEffect, UnknownFunction

_N_NAMES = 2  # of other kinds, that a function looks most like


def names_for(
    fits: Sequence[Fit], listed: Sequence[Candidate], stretches: Stretches, count: float
) -> list[PlacedEffect]:
    """Named effects that look most like those functions which are likelier than any name.

    So many independent samples pay for their parameters.
    """
    least = min((loss(fit, count) for fit in fits if not fit.law.is_nameless), default=np.inf)
    found = [
        one
        for fit in fits
        if fit.law.is_nameless and loss(fit, count) < least
        for one in _most_alike(fit, listed, stretches)
    ]
    return list({(*one.signature, one.theta): one for one in found}.values())


def _most_alike(
    fit: Fit, listed: Iterable[Candidate], stretches: Stretches
) -> Iterator[PlacedEffect]:
    """The likest of the kinds, beside all that the law can say itself of that equation."""
    term, seen, rows = fit.law.terms[-1], stretches.seen, stretches.rows
    columns = term.effect.columns(seen, term.place, *term.theta)[rows]
    own = fit.law.library(seen.X)[rows][:, fit.law.declared[term.target]]
    spanned, _ = np.linalg.qr(own / np.maximum(np.linalg.norm(own, axis=0), np.finfo(float).tiny))

    def beside(values: Array) -> Array:
        return values - spanned @ (spanned.T @ values)

    shape = beside(columns @ fit.law.coefficients(len(fit.law.terms) - 1))
    best: dict[str, tuple[float, PlacedEffect]] = {}
    for candidate in listed:
        placed = candidate.placed
        is_of_it = (placed.place, placed.target) == (term.place, term.target)
        if not is_of_it or not placed.effect.terms or remembers(placed):
            continue
        if isinstance(placed.effect, UnknownFunction):
            continue
        for theta in candidate.grid.tolist():
            one = replace(placed, theta=tuple(theta))
            values = beside(np.nan_to_num(one.effect.columns(seen, one.place, *theta))[rows])
            coef, *_ = np.linalg.lstsq(values, shape, rcond=None)
            missed = float(np.square(shape - values @ coef).sum())
            if one.effect.kind not in best or missed < best[one.effect.kind][0]:
                best[one.effect.kind] = missed, one
    ranked = sorted(best.values(), key=lambda pair: pair[0])
    yield from (one for _, one in ranked[:_N_NAMES])
